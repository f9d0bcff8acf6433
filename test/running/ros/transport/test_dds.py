"""The claim to a DDS domain, and shared memory: only what nobody owns any more is removed."""

import fcntl
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from dds_domains import own_domain
from faulty_episodes import in_own_mounts
from live_episodes import Domain
from program_output import own_lines
from repository import REPOSITORY

from siren_ros.errors import InputError
from siren_ros.running.ros.transport import dds
from siren_ros.running.ros.transport.dds import (
    DOMAIN_VARIABLE,
    FOLDER,
    LEAST_BYTES,
    LOOPBACK,
    NETWORK,
    SEGMENT_BYTES,
    DomainTakenError,
    abandoned_segments,
    check_alone,
    check_room,
    choose_profile,
    claimed_domain,
    discovery_as_in_profile,
    free_bytes,
    in_free_domain,
    lack_of_room,
    profile_name,
    remove_abandoned_segments,
)

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="abstract sockets are Linux's")


@pytest.fixture(autouse=True)
def _claims(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claims of this process alone: what episodes and other tests of this machine hold makes no difference."""
    monkeypatch.setattr(dds, "CLAIM", f"siren_ros/test {os.getpid()}")


def test_a_chosen_domain_is_claimed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(DOMAIN_VARIABLE, "101")
    refusal = pytest.raises(DomainTakenError, match=r"^ROS_DOMAIN_ID: 101 .*another one runs here .*ROS_DOMAIN_ID=0")
    with claimed_domain(), refusal:
        in_free_domain(lambda: pytest.fail("it ran"), lambda _line: None)
    with claimed_domain():
        pass


def test_without_a_chosen_domain_the_next_free_one_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[str] = []
    monkeypatch.delenv(DOMAIN_VARIABLE, raising=False)

    def nested(depth: int) -> int:
        """An episode within an episode within an episode."""
        if depth == 3:
            return int(os.environ[DOMAIN_VARIABLE])
        monkeypatch.delenv(DOMAIN_VARIABLE)
        return in_free_domain(lambda: nested(depth + 1), lines.append)

    assert in_free_domain(lambda: nested(0), lines.append) == 3
    assert [line.rpartition(" ")[2] for line in lines] == [f"ROS_DOMAIN_ID={number}" for number in (1, 2, 3)]
    assert lines[-1].endswith("this episode has ROS_DOMAIN_ID=3")


def test_a_domain_that_turns_out_to_be_taken_is_left_for_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(DOMAIN_VARIABLE, raising=False)
    tried: list[int] = []

    def run() -> int:
        tried.append(int(os.environ[DOMAIN_VARIABLE]))
        if len(tried) == 1:
            raise DomainTakenError(DOMAIN_VARIABLE, tried[0], "another one")
        return 7

    assert in_free_domain(run, lambda _line: None) == 7
    assert tried == [0, 1]


class GraphOf:
    """A node that sees programs publish the clock: those of each call, and then for ever those of the last."""

    def __init__(self, *calls: tuple[str, ...]) -> None:
        self._calls = list(calls)

    def get_publishers_info_by_topic(self, topic: str) -> list[SimpleNamespace]:
        assert topic == "/clock"
        names = self._calls.pop(0) if len(self._calls) > 1 else self._calls[0]
        return [SimpleNamespace(node_name=name) for name in names]


def test_who_is_alone_with_the_clock_goes_on() -> None:
    check_alone(GraphOf((), ("cosim",)), time.monotonic())


@pytest.mark.parametrize(
    ("calls", "since_s"),
    [((("cosim",), ("player", "cosim")), 0.0), ((("cosim", "player", "player"),), 10.0)],
    ids=["later", "also where loading has taken longer than discovery"],
)
def test_one_more_publisher_of_the_clock_is_refused_by_name(calls: tuple[tuple[str, ...], ...], since_s: float) -> None:
    message = rf"/clock has {len(calls[-1])} publishers: cosim, player\)"
    with pytest.raises(DomainTakenError, match=message):
        check_alone(GraphOf(*calls), time.monotonic() - since_s)


DEAD, ALIVE, YOUNG = (f"fastrtps_{digit * 16}" for digit in "abc")


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
    assert remove_abandoned_segments(folder=tmp_path / "none") == 0


def has_free(monkeypatch: pytest.MonkeyPatch, free: int, blocks: int = 10**9) -> None:
    state = SimpleNamespace(f_bavail=free, f_frsize=1, f_blocks=blocks)
    monkeypatch.setattr(dds, "statvfs", lambda _: state)


def test_a_lack_of_room_is_refused_or_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    has_free(monkeypatch, LEAST_BYTES - 1)
    with pytest.raises(InputError, match=r"^/dev/shm: '16 kB free' cannot be used; allowed: at least 16 kB"):
        check_room()
    has_free(monkeypatch, LEAST_BYTES)
    check_room()
    has_free(monkeypatch, 0, blocks=0)  # no limit
    check_room()
    has_free(monkeypatch, SEGMENT_BYTES)
    assert lack_of_room() == ""
    has_free(monkeypatch, 1_000_000)
    assert lack_of_room().startswith(f"{FOLDER} has 1,000 kB free and a process needs 17,700 kB: ")
    assert "UDP" in lack_of_room()
    monkeypatch.undo()
    assert free_bytes(tmp_path / "none") == float("inf")


PARTICIPANT = """
import siren_nodes
from siren_ros.running.ros.programs.program import start_ros
from rclpy.node import Node
start_ros()
node = Node("small")
print("started", flush=True)
"""


@pytest.mark.timeout(120)
@pytest.mark.parametrize("size_kb", [4, 16])
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


PARAMS = REPOSITORY / "params"


@pytest.mark.parametrize(
    ("variables", "name"),
    [
        ({}, NETWORK),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, NETWORK),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, LOOPBACK),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_STATIC_PEERS": "10.0.0.1"}, NETWORK),
    ],
)
def test_the_range_decides(variables: dict[str, str], name: str) -> None:
    assert profile_name(variables) == name


def test_our_profile_follows_the_range_and_a_users_own_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FASTDDS_DEFAULT_PROFILES_FILE", raising=False)
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(PARAMS / LOOPBACK))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    choose_profile()
    assert Path(os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"]).name == NETWORK
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", "/my/own.xml")
    choose_profile()
    assert os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] == "/my/own.xml"


SOCKETS = """
import os
from pathlib import Path
from rclpy.node import Node
from siren_ros.running.ros.programs.program import start_ros
start_ros()
node = Node("quiet")
own = {os.readlink(entry) for entry in Path("/proc/self/fd").iterdir() if entry.is_symlink()}
for table in ("udp", "udp6"):
    for line in Path("/proc/self/net", table).read_text().splitlines()[1:]:
        words = line.split()
        if f"socket:[{words[9]}]" in own:
            print(table, words[1].split(":")[0], flush=True)
print(os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"], flush=True)
"""


@pytest.mark.timeout(60)
@pytest.mark.parametrize("discovery", ["LOCALHOST", "SUBNET"])
def test_while_discovery_stays_here_every_udp_socket_is_on_the_loopback_interface(discovery: str) -> None:
    """Those that only send, too. What the program starts finds the range that the user chose."""
    pytest.importorskip("rclpy", reason="needs ROS")
    clean = {name: value for name, value in os.environ.items() if "PROFILES_FILE" not in name}
    variables = {**clean, "ROS_DOMAIN_ID": str(own_domain()), "ROS_AUTOMATIC_DISCOVERY_RANGE": discovery}
    run = subprocess.run([sys.executable, "-c", SOCKETS], env=variables, capture_output=True, text=True, check=True)
    *sockets, inherited = own_lines(run.stdout).splitlines()
    assert inherited == discovery
    assert len(sockets) >= 3
    if discovery == "LOCALHOST":
        assert set(sockets) == {"udp 0100007F"}
    else:
        assert "udp 00000000" in sockets


def test_only_the_range_of_this_machine_is_left_to_the_profile(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rclpy", reason="needs ROS")
    monkeypatch.delenv("FASTDDS_DEFAULT_PROFILES_FILE", raising=False)
    variable = "ROS_AUTOMATIC_DISCOVERY_RANGE"
    for profile, given, during in (
        (str(PARAMS / LOOPBACK), "LOCALHOST", "SYSTEM_DEFAULT"),
        (str(PARAMS / LOOPBACK), "OFF", "OFF"),
        (str(PARAMS / NETWORK), "LOCALHOST", "LOCALHOST"),
        ("/my/own.xml", "LOCALHOST", "LOCALHOST"),
        ("", "LOCALHOST", "LOCALHOST"),
    ):
        monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", profile)
        monkeypatch.setenv(variable, given)
        with discovery_as_in_profile():
            assert os.environ[variable] == during
        assert os.environ[variable] == given
