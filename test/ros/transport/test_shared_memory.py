"""Only what nobody owns any more is removed."""

import fcntl
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from faulty_episodes import in_own_mounts
from live_episodes import Domain

from siren_ros.errors import InputError
from siren_ros.ros.transport import shared_memory
from siren_ros.ros.transport.shared_memory import (
    FOLDER,
    LEAST_BYTES,
    SEGMENT_BYTES,
    abandoned_segments,
    check_room,
    free_bytes,
    lack_of_room,
    remove_abandoned_segments,
)

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


def has_free(monkeypatch: pytest.MonkeyPatch, free: int, blocks: int = 10**9) -> None:
    state = SimpleNamespace(f_bavail=free, f_frsize=1, f_blocks=blocks)
    monkeypatch.setattr(shared_memory, "statvfs", lambda _: state)


def test_below_the_least_room_the_folder_is_named_with_what_is_free(monkeypatch: pytest.MonkeyPatch) -> None:
    has_free(monkeypatch, LEAST_BYTES - 1)
    with pytest.raises(InputError, match=r"^/dev/shm: '16 kB free' cannot be used; allowed: at least 16 kB"):
        check_room()
    has_free(monkeypatch, LEAST_BYTES)
    check_room()


def test_without_room_for_a_segment_the_user_is_told_of_udp(monkeypatch: pytest.MonkeyPatch) -> None:
    has_free(monkeypatch, SEGMENT_BYTES)
    assert lack_of_room() == ""
    has_free(monkeypatch, 1_000_000)
    assert lack_of_room().startswith(f"{FOLDER} has 1,000 kB free and a process needs 17,700 kB: ")
    assert "UDP" in lack_of_room()


def test_a_folder_without_a_limit_or_without_shared_memory_has_room(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert free_bytes(tmp_path / "none") == float("inf")
    has_free(monkeypatch, 0, blocks=0)
    check_room()


PARTICIPANT = """
import siren_nodes
from siren_ros.ros.programs.program import start_ros
from rclpy.node import Node
start_ros()
node = Node("small")
print("started", flush=True)
"""


@pytest.mark.timeout(120)
@pytest.mark.parametrize("size_kb", [4, 16, 1000])
def test_on_a_small_shared_memory_a_program_starts_or_says_why_not(size_kb: int) -> None:
    """Never SIGBUS, which comes without a line."""
    pytest.importorskip("rclpy", reason="needs ROS")
    prepare = f"mount -t tmpfs -o size={size_kb}k tmpfs /dev/shm"
    run = in_own_mounts(prepare, [sys.executable, "-c", PARTICIPANT], Domain().environment)
    if run is None:
        pytest.skip("mount namespaces with a small disk cannot be made here")
    (line,) = run.stderr.splitlines()
    if size_kb * 1024 < LEAST_BYTES:
        assert run.returncode == 2
        assert line.startswith(f"{FOLDER}: '4 kB free' cannot be used; allowed: at least 16 kB")
    else:
        assert run.returncode == 0
        assert "started" in run.stdout
        assert re.match(rf"{FOLDER} has [\d,]+ kB free and a process needs 17,700 kB: .* UDP", line)


@pytest.mark.timeout(60)
def test_a_segment_needs_what_the_user_is_told() -> None:
    pytest.importorskip("rclpy", reason="needs ROS")
    count = "import os\nprint(sum(os.stat(entry).st_blocks for entry in os.scandir('/dev/shm')) * 512)\n"
    prepare = "mount -t tmpfs -o size=100m tmpfs /dev/shm"
    run = in_own_mounts(prepare, [sys.executable, "-c", PARTICIPANT + count], Domain().environment)
    if run is None:
        pytest.skip("mount namespaces with a small disk cannot be made here")
    assert run.stderr == ""
    assert 0.98 * SEGMENT_BYTES < int(run.stdout.splitlines()[-1]) <= SEGMENT_BYTES
