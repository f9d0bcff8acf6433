"""One worker of a run of all tests loads first."""

import os
import subprocess
import sys
from pathlib import Path

LOADS = "import os, sys, first_worker; print(os.environ['PYTEST_XDIST_WORKER'], file=open(sys.argv[1], 'a'))"
CONTROLS = """
import os, subprocess, sys, time
from pathlib import Path
from first_worker import begin_turn, end_turn
folder = Path(sys.argv[1])
begin_turn(folder / "turn")
def worker(name):
    command = [sys.executable, "-c", sys.argv[2], str(folder / "order")]
    return subprocess.Popen(command, env={**os.environ, "PYTEST_XDIST_WORKER": name})
others = [worker("gw1"), worker("gw2")]
worker("gw0").wait()
def waiting(process):
    return any("->" in line and str(process.pid) in line.split() for line in open("/proc/locks"))
while not all(waiting(process) or process.poll() is not None for process in others):
    time.sleep(0.02)
print("end", file=open(folder / "order", "a"))
end_turn()
end_turn()
for process in others:
    process.wait()
"""


def test_the_others_wait_until_the_first_worker_has_loaded(tmp_path: Path) -> None:
    path = {"PYTHONPATH": str(Path(__file__).parent)}
    command = [sys.executable, "-c", CONTROLS, str(tmp_path), LOADS]
    subprocess.run(command, env={**os.environ, **path}, check=True, timeout=120.0)
    first, end, *others = (tmp_path / "order").read_text().split()
    assert (first, end, sorted(others)) == ("gw0", "end", ["gw1", "gw2"])
