"""``visualization_msgs/MarkerArray``: vehicles for RViz and Foxglove while an episode runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

import numpy as np

from siren_ros.interfaces.messages import header, make_message, sequence, stamp
from siren_ros.interfaces.transforms import (
    Vector,
    from_quaternion,
    from_vector,
    quaternion_of_yaw,
    to_pose,
    to_vector,
    yaw_of_quaternion,
)
from siren_ros.world.actors import ActorDescription, ActorStates, Mode
from siren_ros.world.carrier import MAP_FRAME

Colour = tuple[float, float, float, float]
"""Red, green, blue, opacity, 0–1 each."""

EMV_COLOUR: Final[Colour] = (0.85, 0.10, 0.12, 1.0)
MODE_COLOURS: Final[dict[Mode, Colour]] = {
    Mode.YIELD_REACTING: (0.99, 0.85, 0.30, 1.0),
    Mode.YIELD_DEFERRED: (0.95, 0.60, 0.10, 1.0),
    Mode.YIELD_LANE_CHANGE: (0.10, 0.60, 0.85, 1.0),
    Mode.YIELD_KEEP_LANE: (0.15, 0.70, 0.55, 1.0),
    Mode.YIELD_PULL_OVER: (0.45, 0.35, 0.80, 1.0),
    Mode.YIELD_HOLD: (0.30, 0.20, 0.55, 1.0),
    Mode.REJOIN: (0.55, 0.75, 0.45, 1.0),
    Mode.STOPPED: (0.83, 0.0, 0.0, 1.0),
}
"""Colours of civilians that respond to the siren or have been in contact; all others show their paint."""
LIFETIME_NS: Final = 400_000_000
"""Two periods of the topic, so that markers of actors that left go out by themselves."""
_TEXT_HEIGHT_M: Final = 1.4
_TEXT_ABOVE_ROOF_M: Final = 1.2


class MarkerShape(IntEnum):
    """The ``type`` constants of ``visualization_msgs/Marker`` in use."""

    CUBE = 1
    TEXT = 9


@dataclass(frozen=True)
class Marker:
    """One shape in the ``map`` frame."""

    namespace: str
    marker_id: int
    shape: MarkerShape
    centre_m: Vector
    yaw_rad: float
    size_m: Vector
    colour: Colour
    text: str = ""


def vehicle_markers(states: ActorStates, actors: Mapping[int, ActorDescription]) -> tuple[Marker, ...]:
    """A coloured box per actor, and above each EMV its mode and speed."""
    markers = []
    rows = zip(
        states.actor_id.tolist(),
        states.x_m.tolist(),
        states.y_m.tolist(),
        states.z_m.tolist(),
        states.yaw_rad.tolist(),
        states.mode.tolist(),
        states.speed_mps.tolist(),
        strict=True,
    )
    for actor_id, x_m, y_m, z_m, yaw_rad, mode_code, speed_mps in rows:
        actor, mode = actors[actor_id], Mode(mode_code)
        size = (actor.length_m, actor.width_m, actor.height_m)
        centre = (x_m, y_m, z_m + actor.height_m / 2.0)
        colour = _colour_of(actor, mode)
        markers.append(Marker("vehicles", actor_id, MarkerShape.CUBE, centre, yaw_rad, size, colour))
        if actor.is_emv:
            above = (x_m, y_m, z_m + actor.height_m + _TEXT_ABOVE_ROOF_M)
            text = f"{mode.name.lower().replace('_', ' ')}  {speed_mps * 3.6:.0f} km/h"
            text_size = (0.0, 0.0, _TEXT_HEIGHT_M)
            markers.append(Marker("emv", actor_id, MarkerShape.TEXT, above, 0.0, text_size, (1.0, 1.0, 1.0, 1.0), text))
    return tuple(markers)


def _colour_of(actor: ActorDescription, mode: Mode) -> Colour:
    if actor.is_emv:
        return EMV_COLOUR
    red, green, blue = actor.colour_rgb
    return MODE_COLOURS.get(mode, (red / 255.0, green / 255.0, blue / 255.0, 0.85))


def to_markers(step: int, markers: Sequence[Marker]) -> Any:
    """``visualization_msgs/MarkerArray`` of one step."""
    shared = {
        "header": header(step, MAP_FRAME),
        "lifetime": make_message(
            "builtin_interfaces/msg/Duration", sec=LIFETIME_NS // 10**9, nanosec=LIFETIME_NS % 10**9
        ),
        "texture": make_message(
            "sensor_msgs/msg/CompressedImage",
            header=make_message("std_msgs/msg/Header", stamp=stamp(0), frame_id=""),
            format="",
            data=sequence(np.empty(0, dtype=np.uint8)),
        ),
        "mesh_file": make_message(
            "visualization_msgs/msg/MeshFile", filename="", data=sequence(np.empty(0, dtype=np.uint8))
        ),
    }
    return make_message(
        "visualization_msgs/msg/MarkerArray", markers=[_to_marker(marker, shared) for marker in markers]
    )


def _to_marker(marker: Marker, shared: dict[str, Any]) -> Any:
    red, green, blue, opacity = marker.colour
    return make_message(
        "visualization_msgs/msg/Marker",
        ns=marker.namespace,
        id=marker.marker_id,
        type=int(marker.shape),
        action=0,
        pose=to_pose(marker.centre_m, quaternion_of_yaw(marker.yaw_rad)),
        scale=to_vector(marker.size_m),
        color=make_message("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=opacity),
        frame_locked=False,
        points=[],
        colors=[],
        texture_resource="",
        uv_coordinates=[],
        text=marker.text,
        mesh_resource="",
        mesh_use_embedded_materials=False,
        **shared,
    )


def from_markers(message: Any) -> tuple[Marker, ...]:
    """Inverse of ``to_markers``."""
    return tuple(
        Marker(
            namespace=str(marker.ns),
            marker_id=int(marker.id),
            shape=MarkerShape(int(marker.type)),
            centre_m=from_vector(marker.pose.position),
            yaw_rad=yaw_of_quaternion(from_quaternion(marker.pose.orientation)),
            size_m=from_vector(marker.scale),
            colour=(float(marker.color.r), float(marker.color.g), float(marker.color.b), float(marker.color.a)),
            text=str(marker.text),
        )
        for marker in message.markers
    )
