"""The mirror image of what exists at a step, about the x axis of the ``map`` frame.

On a map with left-hand traffic, drivers and SUMO are given the mirror image of the world
(``siren_ros.simulation.roads.mirror_image``), and what they say is mirrored again.
"""

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from operator import neg
from typing import Any, Final, TypeVar

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.simulation.world.actors import MIRROR, ActorStates, Lights
from siren_ros.simulation.world.commands import AvControl, VehicleCommands
from siren_ros.simulation.world.traffic_state import EmvAdvice, Event, TrafficState

Content = TypeVar("Content", TrafficState, ActorStates, VehicleCommands, AvControl, Event, EmvAdvice)

_SIGNED_DETAILS: Final = frozenset({"side", "offset_m"})
_LEFT, _RIGHT = int(Lights.INDICATOR_LEFT), int(Lights.INDICATOR_RIGHT)
"""Bits of the indicators in codes of lights. The flags for wished lane changes use the same bits."""


def _exchanged(code: int) -> int:
    to_right, to_left = (_RIGHT if code & _LEFT else 0), (_LEFT if code & _RIGHT else 0)
    return code & ~(_LEFT | _RIGHT) | to_right | to_left


SIDES_EXCHANGED: Final = np.array([_exchanged(code) for code in range(256)], dtype=np.uint8)
"""For each code of lights or flags, the code with left and right exchanged."""


def mirror_image(content: Content) -> Content:
    """The mirror image of a structure. The mirror image of the result is the structure again.

    The metadata of its fields say which of them have a side (``siren_ros.simulation.world.actors``).
    """
    sided = {field.name: field.metadata[MIRROR] for field in fields(content) if MIRROR in field.metadata}
    return replace(content, **{name: _CHANGES[how](getattr(content, name)) for name, how in sided.items()})


def _mirrored_yaw(yaw_rad: Floats) -> Floats:
    """Mirrored yaws, in (−π, π]."""
    return np.where(yaw_rad == np.pi, np.pi, -yaw_rad)


def _other_sides(code: Any) -> Any:
    """Lights or flags with left and right exchanged: one code, or an array of codes."""
    return _exchanged(code) if isinstance(code, int) else SIDES_EXCHANGED[code]


def _mirrored_detail(detail: Mapping[str, Any]) -> dict[str, Any]:
    return {key: -fact if key in _SIGNED_DETAILS else fact for key, fact in detail.items()}


_CHANGES: Final[dict[str, Callable[[Any], Any]]] = {
    "sign": neg,
    "yaw": _mirrored_yaw,
    "sides": _other_sides,
    "parts": lambda parts: tuple(map(mirror_image, parts)),
    "details": _mirrored_detail,
}
"""What happens to a field, by what its metadata says."""
