"""Settings of Fast DDS: the profile, free space in shared memory, and removal of segments of killed processes.

The profile uses sockets on the loopback interface, or on all. A participant owns one segment, ``fastrtps_`` and 16
hexadecimal digits in ``/dev/shm``, and locks the file of the same name with ``_el`` while it exists (Fast DDS 2,
``RobustExclusiveLock``; the kernel releases the lock with the process). Nobody opens the segment of a dead participant
again, and removing it does not affect a process that still has it open. Ports stay: the next participant with the same
number uses them again. ``fastdds shm clean`` does the same.
"""

import fcntl
import os
import re
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from os import geteuid, statvfs
from pathlib import Path
from typing import Final

from siren_ros.base.params.resources import params_dir
from siren_ros.errors import InputError

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
