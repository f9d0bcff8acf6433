"""Units and classes of NGSIM's tracks."""

from typing import Final

from siren_ros.world.actors import ActorClass

FOOT_M: Final = 0.3048
LANE_WIDTH_M: Final = 3.5
"""Of vehicles off the road."""
_CAR, _TRUCK = 2, 3
_TRUCKS: Final = frozenset({ActorClass.TRUCK, ActorClass.BUS, ActorClass.FIRE_TRUCK})


def vehicle_class(actor_class: ActorClass) -> int:
    """NGSIM's class of a vehicle: 2 a car, 3 a truck; 1 would be a motorcycle."""
    return _TRUCK if actor_class in _TRUCKS else _CAR
