"""Which of the project's Fast DDS profiles a program takes: sockets on the loopback interface, or on all."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from siren_ros.params.params_files import params_dir

PROFILE_VARIABLES: Final = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
"""Environment variables that name Fast DDS's profile: of the release in Jazzy, and of later ones."""
LOOPBACK: Final = "fastdds_localhost.xml"
NETWORK: Final = "fastdds.xml"
_OPEN_RANGES: Final = frozenset({"", "NOT_SET", "SUBNET", "SYSTEM_DEFAULT"})
"""Values of ROS_AUTOMATIC_DISCOVERY_RANGE that let discovery leave the machine; rcl takes others as LOCALHOST."""


def profile_name(environment: Mapping[str, str]) -> str:
    """The profile that the variables of discovery ask for: one for this machine alone, or one for a network."""
    leaves = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "") in _OPEN_RANGES
    return NETWORK if leaves or environment.get("ROS_STATIC_PEERS") else LOOPBACK


def choose_profile() -> None:
    """Set the profile of this process, and of those it starts, unless the user has one of their own."""
    ours = {(params_dir() / name).resolve() for name in (LOOPBACK, NETWORK)}
    given = [Path(value).resolve() for variable in PROFILE_VARIABLES if (value := os.environ.get(variable))]
    if ours.issuperset(given):
        os.environ[PROFILE_VARIABLES[0]] = str(params_dir() / profile_name(os.environ))
