"""Only what nobody owns any more is removed."""

import fcntl
import os
import subprocess
import sys
from pathlib import Path

from siren_ros.ros.transport.shared_memory import abandoned_segments, remove_abandoned_segments

DEAD, ALIVE, YOUNG = (f"fastrtps_{digit * 16}" for digit in "abc")
HOLD = """
import fcntl, sys
file = open(sys.argv[1])
fcntl.flock(file, fcntl.LOCK_EX)
print("held", flush=True)
input()
"""


def make(folder: Path, name: str, age_s: float) -> Path:
    (folder / name).write_bytes(b"data")
    lock = folder / f"{name}_el"
    lock.touch()
    then = lock.stat().st_mtime - age_s
    os.utime(lock, (then, then))
    return lock


def test_dead_owners_segments_go_and_all_else_stays(tmp_path: Path) -> None:
    dead, alive = make(tmp_path, DEAD, 100.0), make(tmp_path, ALIVE, 100.0)
    make(tmp_path, YOUNG, 1.0)
    others = [tmp_path / "fastrtps_port7400", tmp_path / "fastrtps_port7400_el", tmp_path / "sem.mine"]
    for other in others:
        other.write_bytes(b"")
        os.utime(other, (0.0, 0.0))
    with alive.open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert abandoned_segments(folder=tmp_path) == [dead]
        assert remove_abandoned_segments(folder=tmp_path) == 1
    names = {ALIVE, f"{ALIVE}_el", YOUNG, f"{YOUNG}_el", *(other.name for other in others)}
    assert {path.name for path in tmp_path.iterdir()} == names


def test_the_lock_ends_with_the_process(tmp_path: Path) -> None:
    lock = make(tmp_path, DEAD, 100.0)
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(lock)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as owner:
        assert owner.stdout is not None
        assert owner.stdout.readline() == b"held\n"
        assert abandoned_segments(folder=tmp_path) == []
        owner.kill()
        owner.wait()
    assert abandoned_segments(folder=tmp_path) == [lock]


def test_where_there_is_no_shared_memory_there_is_nothing_to_do(tmp_path: Path) -> None:
    assert remove_abandoned_segments(folder=tmp_path / "none") == 0
