"""What an episode needs of DDS: a domain of its own, the profile of Fast DDS, and its shared memory.

Two episodes in one domain would receive each other's messages.

The profile uses sockets on the loopback interface, or on all. A participant owns one segment, ``fastrtps_`` and 16
hexadecimal digits in ``/dev/shm``, and locks the file of the same name with ``_el`` while it exists (Fast DDS 2,
``RobustExclusiveLock``; the kernel releases the lock with the process). Nobody opens the segment of a dead participant
again, and removing it does not affect a process that still has it open. Ports stay: the next participant with the same
number uses them again. ``fastdds shm clean`` does the same.
"""

import errno
import os
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rclpy.node import Node
import fcntl
import re
from collections.abc import Mapping
from os import geteuid, statvfs
from pathlib import Path

from siren_ros.base.params.folders import params_dir
from siren_ros.data.interfaces import topics
from siren_ros.errors import InputError

DOMAIN_VARIABLE: Final = "ROS_DOMAIN_ID"
LARGEST_DOMAIN: Final = 101
"""Largest domain for which every platform has the ports (ROS 2 documentation, "The ROS_DOMAIN_ID")."""
DISCOVERY_S: Final = 0.3
"""Time in which two processes of one machine discover each other (params/fastdds_localhost.xml)."""
_POLL_S: Final = 0.01
CLAIM: Final = "siren_ros/domain"
"""Prefix of the abstract sockets that claim a domain."""


class DomainTakenError(InputError):
    """Raised if another episode or player uses the domain."""


def in_free_domain(run: Callable[[], int], say: Callable[[str], None]) -> int:
    """Run an episode in the user's domain, or in the first free one if ROS_DOMAIN_ID is not set.

    Args:
        run: Runs the episode in the domain that ROS_DOMAIN_ID names; must raise DomainTakenError before it has done
            anything. Its result is returned.
        say: Gets a line for the user where the domain is not the default one.

    Raises:
        DomainTakenError: The user's domain is taken, or all are.
    """
    if os.environ.get(DOMAIN_VARIABLE):
        with claimed_domain():
            return run()
    for number in range(LARGEST_DOMAIN + 1):
        os.environ[DOMAIN_VARIABLE] = str(number)
        with suppress(DomainTakenError), claimed_domain():
            if number:
                say(f"lower DDS domains are in use on this machine, so this episode has {DOMAIN_VARIABLE}={number}")
            return run()
    raise _taken("in every domain")


@contextmanager
def claimed_domain() -> Iterator[None]:
    """Claim the domain on this machine while an episode runs.

    The claim is an abstract socket (Linux only). It is decided at once, without discovery, and the kernel releases it
    however the process ends. On other systems discovery alone decides.

    Raises:
        DomainTakenError: An episode of this machine holds the domain; says how to choose another one.
    """
    if sys.platform != "linux":
        yield
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as claim:
        try:
            claim.bind(f"\0{CLAIM}/{_domain()}")
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise _taken("on this machine") from error
            raise
        yield


def check_alone(node: "Node", since_s: float) -> None:
    """Check that no other program publishes the clock in this domain, before any node of the episode exists.

    Waits until ``DISCOVERY_S`` have passed since the node was made. The program can load modules in this time.

    Args:
        node: The master's node, whose own publisher of the clock is there already.
        since_s: Monotonic time at which the node was made.

    Raises:
        DomainTakenError: Somebody else is there; says how to choose another domain.
    """
    while True:
        publishers = node.get_publishers_info_by_topic(topics.CLOCK.name)
        if len(publishers) > 1:
            names = ", ".join(sorted({publisher.node_name for publisher in publishers}))
            raise _taken(f"{topics.CLOCK.name} has {len(publishers)} publishers: {names}")
        if time.monotonic() - since_s >= DISCOVERY_S:
            return
        time.sleep(_POLL_S)


def _domain() -> int:
    return int(os.environ.get(DOMAIN_VARIABLE) or 0)


def _taken(where: str) -> DomainTakenError:
    domain = _domain()
    another = (domain + 1) % (LARGEST_DOMAIN + 1)
    allowed = (
        f"a domain of its own for each episode; another one runs here already ({where}), so choose a free number "
        f"from 0 to {LARGEST_DOMAIN}, for example {DOMAIN_VARIABLE}={another}"
    )
    return DomainTakenError(DOMAIN_VARIABLE, domain, allowed)


FOLDER: Final = Path("/dev/shm")  # noqa: S108 - Linux's folder for shared memory
OLD_S: Final = 60.0
"""A lock file is unlocked for a moment after its creation; older ones than this are not in that state."""
LEAST_BYTES: Final = 16_384
"""Least shared memory: ROS's tracing maps two pages when it loads, and without them SIGBUS ends the process."""
SEGMENT_BYTES: Final = 17_700_000
"""Shared memory of one participant with the project's profile: its segment, two ports, their semaphores."""
_LOCK_FILE: Final = re.compile(r"fastrtps_[0-9a-f]{16}_el")


def free_bytes(folder: Path = FOLDER) -> float:
    """Free shared memory; infinite if its size is not limited, or if there is no such folder."""
    try:
        state = statvfs(folder)
    except OSError:
        return float("inf")
    return state.f_bavail * state.f_frsize if state.f_blocks else float("inf")


def check_room(folder: Path = FOLDER) -> None:
    """Check that ROS's libraries can be loaded.

    Raises:
        InputError: Too little shared memory is free.
    """
    free = free_bytes(folder)
    if free < LEAST_BYTES:
        raise InputError(
            str(folder), f"{free / 1000.0:.0f} kB free", f"at least {LEAST_BYTES / 1000.0:.0f} kB, which ROS maps there"
        )


def lack_of_room(folder: Path = FOLDER) -> str:
    """Warning if a participant's messages cannot use shared memory; otherwise empty."""
    free = free_bytes(folder)
    if free >= SEGMENT_BYTES:
        return ""
    return (
        f"{folder} has {free / 1e3:,.0f} kB free and a process needs {SEGMENT_BYTES / 1e3:,.0f} kB: "
        "its messages go over UDP instead"
    )


def abandoned_segments(older_than_s: float = OLD_S, folder: Path = FOLDER) -> list[Path]:
    """Lock files of this user's segments whose owners are dead, sorted; empty if there is no such folder."""
    abandoned = []
    with suppress(OSError):
        for lock_file in sorted(folder.iterdir()):
            with suppress(OSError):
                if _LOCK_FILE.fullmatch(lock_file.name) and _is_abandoned(lock_file, older_than_s):
                    abandoned.append(lock_file)
    return abandoned


def remove_abandoned_segments(older_than_s: float = OLD_S, folder: Path = FOLDER) -> int:
    """Remove the segments whose owners are dead; returns their number."""
    abandoned = abandoned_segments(older_than_s, folder)
    for lock_file in abandoned:
        with suppress(OSError):
            lock_file.with_name(lock_file.name.removesuffix("_el")).unlink(missing_ok=True)
            lock_file.unlink(missing_ok=True)
    return len(abandoned)


def _is_abandoned(lock_file: Path, older_than_s: float) -> bool:
    state = lock_file.lstat()
    if state.st_uid != geteuid() or time.time() - state.st_mtime < older_than_s:
        return False
    with lock_file.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True


PROFILE_VARIABLES: Final = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
"""Environment variables that name Fast DDS's profile: in Jazzy's release, and in later ones."""
LOOPBACK: Final = "fastdds_localhost.xml"
NETWORK: Final = "fastdds.xml"
_RANGE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_OPEN_RANGES: Final = frozenset({"", "NOT_SET", "SUBNET", "SYSTEM_DEFAULT"})
"""Values of ROS_AUTOMATIC_DISCOVERY_RANGE for which discovery leaves the machine; rcl treats others as LOCALHOST."""


def profile_name(environment: Mapping[str, str]) -> str:
    """Name of the profile for the discovery variables: one for this machine only, or one for a network."""
    leaves = environment.get(_RANGE, "") in _OPEN_RANGES
    return NETWORK if leaves or environment.get("ROS_STATIC_PEERS") else LOOPBACK


def choose_profile() -> None:
    """Set the profile of this process and its children, unless the user has set one."""
    ours = {(params_dir() / name).resolve() for name in (LOOPBACK, NETWORK)}
    given = [Path(value).resolve() for variable in PROFILE_VARIABLES if (value := os.environ.get(variable))]
    if ours.issuperset(given):
        os.environ[PROFILE_VARIABLES[0]] = str(params_dir() / profile_name(os.environ))


@contextmanager
def discovery_as_in_profile() -> Iterator[None]:
    """Context around ``rclpy.init``: our profile implements the range LOCALHOST, if it was chosen.

    rmw_fastrtps implements this range with a UDP transport of its own. That transport has sockets on all interfaces,
    although it only sends to this machine. The profile contains the same range without it.
    """
    from rclpy.utilities import get_rmw_implementation_identifier  # noqa: PLC0415 - profiles are chosen without ROS too

    chosen = {os.environ.get(variable) for variable in PROFILE_VARIABLES} - {None, ""}
    ours = chosen == {str(params_dir() / LOOPBACK)} and get_rmw_implementation_identifier() == "rmw_fastrtps_cpp"
    if not ours or os.environ.get(_RANGE) != "LOCALHOST":
        yield
        return
    os.environ[_RANGE] = "SYSTEM_DEFAULT"
    try:
        yield
    finally:
        os.environ[_RANGE] = "LOCALHOST"
