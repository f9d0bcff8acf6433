"""A map with left-hand traffic as the mirror image of a map with right-hand traffic, and the other way round.

Drivers decide and SUMO drives as where traffic keeps right. On a map with left-hand traffic they do so in its mirror
image about the x axis of the ``map`` frame, as SUMO's netconvert builds such nets.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Points
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.simulation.roads.road_network import MAPS_KEPT, Connection, RoadNetwork

MIRROR: Final = np.array((1.0, -1.0))
"""Factors of x and y."""
_SIDES: Final = (("l", "r"), ("L", "R"), ("left", "right"), ("Left", "Right"))
OTHER_SIDE: Final[Mapping[str, str]] = {**dict(_SIDES), **{right: left for left, right in _SIDES}}
"""The other side of each side, by its word or by SUMO's letter of a direction."""


def negated(number: str) -> str:
    """A number with the other sign and the same digits; zero has no sign."""
    digits = number.lstrip("+-")
    return digits if number.startswith("-") or not float(digits) else f"-{digits}"


def right_hand_image(network: RoadNetwork) -> RoadNetwork:
    """The map itself where traffic keeps right, else its mirror image. Indices and ids are the same in both."""
    return mirrored_network(network) if network.left_hand else network


@lru_cache(maxsize=MAPS_KEPT)
def mirrored_network(network: RoadNetwork) -> RoadNetwork:
    """The mirror image of a map, with traffic on the other side. Only its origin has a place on Earth."""
    x_m, y_m = network.sumo_offset_m
    lanes = (replace(lane, centre=Polyline.through(_mirrored(lane.centre.points))) for lane in network.lanes)
    junctions = {
        name: replace(junction, outline=_mirrored(junction.outline), y_m=-junction.y_m)
        for name, junction in network.junctions.items()
    }
    return replace(
        network,
        lanes=tuple(lanes),
        connections=_mirrored_movements(network.connections),
        cycle_connections=_mirrored_movements(network.cycle_connections),
        junctions=junctions,
        sumo_offset_m=(x_m, -y_m),
        projection="!",
        projected_origin_m=(0.0, 0.0),
        crossings=tuple(map(_mirrored, network.crossings)),
        left_hand=not network.left_hand,
    )


def _mirrored_movements(movements: tuple[Connection, ...]) -> tuple[Connection, ...]:
    letters = (OTHER_SIDE.get(movement.direction, movement.direction) for movement in movements)
    return tuple(replace(movement, direction=letter) for movement, letter in zip(movements, letters, strict=True))


def _mirrored(points: Points) -> Points:
    return points * MIRROR
