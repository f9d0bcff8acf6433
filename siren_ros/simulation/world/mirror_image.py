"""The mirror image of what exists at a step, about the x axis of the ``map`` frame.

On a map with left-hand traffic, drivers and SUMO are given the mirror image of the world
(``siren_ros.simulation.roads.mirror_image``), and what they say is mirrored again.
"""

from dataclasses import fields, replace
from typing import Any, Final, TypeVar

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.simulation.world.actors import ActorStates, Lights
from siren_ros.simulation.world.commands import AvControl, VehicleCommands
from siren_ros.simulation.world.traffic_state import EmvAdvice, Event, TrafficState

Content = TypeVar("Content", TrafficState, ActorStates, VehicleCommands, AvControl, Event, EmvAdvice)

_TO_THE_LEFT: Final = frozenset({
    *("y_m", "sumo_y_m", "vy_mps", "lateral_offset_m", "lateral_accel_mps2", "yaw_rate_radps", "steer_rad"),
    "lane_change_intent",
})  # fmt: skip
"""Fields that are positive to the left or counter-clockwise."""
_YAWS: Final = frozenset({"yaw_rad", "sumo_yaw_rad"})
_CODES: Final = frozenset({"lights", "flags"})
_PARTS: Final = frozenset({"events", "emvs"})
_SIGNED_DETAILS: Final = frozenset({"side", "offset_m"})
_LEFT, _RIGHT = int(Lights.INDICATOR_LEFT), int(Lights.INDICATOR_RIGHT)
"""Bits of the indicators in codes of lights. The flags for wished lane changes use the same bits."""


def _exchanged(code: int) -> int:
    to_right, to_left = (_RIGHT if code & _LEFT else 0), (_LEFT if code & _RIGHT else 0)
    return code & ~(_LEFT | _RIGHT) | to_right | to_left


SIDES_EXCHANGED: Final = np.array([_exchanged(code) for code in range(256)], dtype=np.uint8)
"""For each code of lights or flags, the code with left and right exchanged."""


def mirror_image(content: Content) -> Content:
    """The mirror image of a structure. The mirror image of the result is the structure again."""
    parts: Any = {field.name: getattr(content, field.name) for field in fields(content)}
    changed: dict[str, Any] = {}
    for name, value in parts.items():
        if name in _TO_THE_LEFT:
            changed[name] = -value
        elif name in _YAWS:
            changed[name] = _mirrored_yaw(value)
        elif name in _CODES:
            changed[name] = _exchanged(value) if isinstance(value, int) else SIDES_EXCHANGED[value]
        elif name in _PARTS:
            changed[name] = tuple(map(mirror_image, value))
        elif name == "detail":
            changed[name] = {key: -number if key in _SIGNED_DETAILS else number for key, number in value.items()}
    return replace(content, **changed)


def _mirrored_yaw(yaw_rad: Floats) -> Floats:
    """Mirrored yaws, in (−π, π]."""
    return np.where(yaw_rad == np.pi, np.pi, -yaw_rad)
