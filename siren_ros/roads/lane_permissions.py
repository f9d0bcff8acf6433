"""What SUMO's ``allow`` and ``disallow`` mean for civilians, emergency vehicles and pedestrians."""

from dataclasses import dataclass
from typing import Final

from siren_ros.roads.road_network import LaneKind

_CIVILIAN_CLASSES: Final = frozenset({"passenger", "bus", "taxi", "delivery", "truck", "private", "coach", "trailer"})
"""Vehicle classes whose lane is a driving lane, even where passenger cars may not use it (a bus lane)."""
_FOOT_TYPES: Final = frozenset({"sidewalk", "walking"})


@dataclass(frozen=True)
class Permissions:
    """Who may use a lane."""

    civilian: bool
    """Passenger cars."""
    emergency: bool
    pedestrian: bool
    other_motor: bool = False
    """Some class of motor traffic, whether or not passenger cars are among it."""


def permissions_of(allow: str | None, disallow: str | None) -> Permissions:
    """Permissions of a lane by its attributes; a lane with neither is open to every class.

    ``allow`` wins where both are given, as in SUMO.
    """
    if allow is not None:
        allowed = frozenset(allow.split())
        open_to = (lambda _: True) if "all" in allowed else allowed.__contains__
    else:
        refused = frozenset((disallow or "").split())
        open_to = (lambda _: False) if "all" in refused else (lambda name: name not in refused)
    return Permissions(
        civilian=bool(open_to("passenger")),
        emergency=bool(open_to("emergency")),
        pedestrian=bool(open_to("pedestrian")),
        other_motor=any(open_to(name) for name in sorted(_CIVILIAN_CLASSES)),
    )


def kind_of_lane(permissions: Permissions, lane_type: str) -> LaneKind:
    """Kind of a lane outside junctions, from who may use it and from the type that the map gave it."""
    if lane_type in _FOOT_TYPES:
        return LaneKind.SIDEWALK
    if permissions.civilian or permissions.other_motor:
        return LaneKind.DRIVING
    if permissions.emergency:
        return LaneKind.SHOULDER
    return LaneKind.SIDEWALK if permissions.pedestrian else LaneKind.KERB
