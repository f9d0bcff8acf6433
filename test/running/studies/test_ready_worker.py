import os
import signal
import subprocess
import sys
import time
from pathlib import Path


def test_a_server_that_gets_ready_ends_with_its_program_and_leaves_no_folder(tmp_path: Path) -> None:
    """It makes an episode for seconds, in which it does not look for its program."""
    load = f"{sys.executable} -c 'import siren_ros.running.studies.ready_worker; print(\"ready\")' & echo $!; wait"
    variables = {**os.environ, "TMPDIR": str(tmp_path)}
    with subprocess.Popen(["/bin/sh", "-c", load], env=variables, stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        server = int(program.stdout.readline())
        while not list(tmp_path.glob("tmp*/.bag.partial/*.mcap")):
            assert program.poll() is None
            time.sleep(0.01)
        program.send_signal(signal.SIGKILL)
        assert program.stdout.read() == "", "until the server, which has the same pipe, is gone"
    assert not Path(f"/proc/{server}/cmdline").exists() or not Path(f"/proc/{server}/cmdline").read_bytes()
    assert not list(tmp_path.iterdir())
