"""What a format may need of a bag, how that is told, and the command that records it."""

import shlex
from collections.abc import Sequence
from enum import StrEnum
from typing import Final

from siren_ros.datasets.sources.episode_source import EpisodeSource
from siren_ros.errors import BagError
from siren_ros.scenario.episode import EpisodeDescription


class Need(StrEnum):
    """One thing that a bag must hold."""

    TRACKS = "tracks"
    MAP = "map"
    EMV = "EMV"
    LIDAR = "lidar"
    FRONT_CAMERA = "front camera"
    CAMERA = "camera"


_LACKS: Final = {
    Need.TRACKS: lambda source: not source.has_states,
    Need.MAP: lambda source: not source.has_map,
    Need.EMV: lambda source: not source.description.emv_ids,
    Need.LIDAR: lambda source: source.lidar is None or not source.has_ground_truth,
    Need.FRONT_CAMERA: lambda source: source.front_camera is None,
    Need.CAMERA: lambda source: not source.cameras,
}
_WHAT: Final = {
    Need.TRACKS: "the actors' states",
    Need.MAP: "the map",
    Need.EMV: "an emergency vehicle",
    Need.LIDAR: "a LiDAR with its ground truth",
    Need.FRONT_CAMERA: "a front camera",
    Need.CAMERA: "a camera",
}
_SUITE: Final = {Need.LIDAR: "lidar", Need.FRONT_CAMERA: "front", Need.CAMERA: "full"}
"""The smallest shipped suite that records it; a later one in this order has what the earlier ones have."""


def check_needs(source: EpisodeSource, format_name: str, needs: Sequence[Need]) -> None:
    """Refuses a bag that lacks what a format needs.

    Raises:
        BagError: What is missing, and the command that records this episode with it.
    """
    missing = [need for need in needs if _LACKS[need](source)]
    if missing:
        what = " and ".join(_WHAT[need] for need in missing)
        suites = [_SUITE[need] for need in _SUITE if need in missing]
        command = recording_command(source.description, suites[-1] if suites else source.description.sensor_suite)
        raise BagError(str(source.path), f"an episode with {what}, for {format_name}; `{command}` records one")


def recording_command(description: EpisodeDescription, sensors: str) -> str:
    """The command that records an episode again, with a suite of sensors."""
    values = {
        "template": description.template,
        "level": description.level.name,
        "seed": str(description.seed),
        "duration_s": f"{description.duration_s:.1f}",
        "preset": description.preset,
        "sensors": sensors,
    }
    if (path := str(description.parameters.get("map", ""))) or description.map_name != "town":
        values["map"] = path or description.map_name
    arguments = " ".join(f"-p {name}:={shlex.quote(value)}" for name, value in values.items())
    return f"ros2 run siren_ros cosim --ros-args {arguments}"
