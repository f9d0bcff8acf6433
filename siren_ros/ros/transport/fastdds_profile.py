"""Which of the project's Fast DDS profiles a program takes: sockets on the loopback interface, or on all."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from siren_ros.params.resources import params_dir

PROFILE_VARIABLES: Final = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
"""Environment variables that name Fast DDS's profile: of the release in Jazzy, and of later ones."""
LOOPBACK: Final = "fastdds_localhost.xml"
NETWORK: Final = "fastdds.xml"
_RANGE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_OPEN_RANGES: Final = frozenset({"", "NOT_SET", "SUBNET", "SYSTEM_DEFAULT"})
"""Values of ROS_AUTOMATIC_DISCOVERY_RANGE that let discovery leave the machine; rcl takes others as LOCALHOST."""


def profile_name(environment: Mapping[str, str]) -> str:
    """The profile that the variables of discovery ask for: one for this machine alone, or one for a network."""
    leaves = environment.get(_RANGE, "") in _OPEN_RANGES
    return NETWORK if leaves or environment.get("ROS_STATIC_PEERS") else LOOPBACK


def choose_profile() -> None:
    """Set the profile of this process, and of those it starts, unless the user has one of their own."""
    ours = {(params_dir() / name).resolve() for name in (LOOPBACK, NETWORK)}
    given = [Path(value).resolve() for variable in PROFILE_VARIABLES if (value := os.environ.get(variable))]
    if ours.issuperset(given):
        os.environ[PROFILE_VARIABLES[0]] = str(params_dir() / profile_name(os.environ))


@contextmanager
def discovery_as_in_profile() -> Iterator[None]:
    """Around ``rclpy.init``: leave the range LOCALHOST to our profile for this machine, where it is the chosen one.

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
