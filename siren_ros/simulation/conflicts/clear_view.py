"""Limits speed by the view: how far a driver sees into side streets before a line.

The view follows from the junction's geometry: façades stand at one distance behind all roads, as in the generated
scene. At a stop line itself a driver sees past them.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.simulation.roads.movements import comes_from_the_side, crossing_connections, movement_path
from siren_ros.simulation.roads.road_network import Connection, RoadNetwork

SETBACK_M: Final = 3.0
"""Distance of the façades from the roads, as in the 3-D scene (``SceneConfig.building_setback_m``)."""
_EYE_M: Final = 2.0
"""Distance of a driver's eyes behind the front of the vehicle."""
# These are no parameters: the resolution of the search, and a value that keeps quotients finite.
_STEP_M: Final = 0.25
_LEAST_MPS: Final = 0.1


@dataclass(frozen=True)
class SideStreet:
    """The lanes that reach a junction from one side, as a driver before the line sees them."""

    near_m: float
    """Distance from the line to the nearest edge of their lanes."""
    far_m: float
    """Distance from the line to the far edge of their lanes."""
    aside_m: float
    """Distance from the middle of the driver's lane to the façades on this side."""
    limit_mps: float
    """Highest speed limit of these lanes."""

    def seen_m(self, before_m: float) -> float:
        """Length of the street that is visible at a distance before the line; infinite beyond the façades."""
        beyond_m = before_m + _EYE_M - SETBACK_M
        return self.aside_m * (1.0 + (self.near_m + SETBACK_M) / beyond_m) if beyond_m > 0.0 else math.inf


@dataclass(frozen=True)
class Lookout:
    """Assumptions of a driver about vehicles that are not visible yet."""

    horizon_s: float
    """Vehicles that need longer to the crossing do not count."""
    pet_s: float
    """Time that must remain between the two vehicles."""
    brake_mps2: float
    reaction_s: float
    standoff_m: float
    """Distance kept from the nearest lane's edge at a stop."""
    length_m: float
    """Length of the own vehicle."""


def safe_mps(street: SideStreet, before_m: float, lookout: Lookout) -> float:
    """Speed at which the driver can still stop for a vehicle that comes into view.

    It does not matter, and is infinite, where who is not in view yet comes so late that the driver is past before it
    at that speed.
    """
    unseen_s = street.seen_m(before_m) / max(street.limit_mps, _LEAST_MPS)
    if unseen_s >= lookout.horizon_s:
        return math.inf
    free_m = max(before_m + street.near_m - lookout.standoff_m, 0.0)
    brake, reaction_s = lookout.brake_mps2, lookout.reaction_s
    stops_mps = brake * (math.sqrt(reaction_s**2 + 2.0 * free_m / brake) - reaction_s)
    past_m = before_m + street.far_m + lookout.length_m
    return math.inf if stops_mps * (unseen_s - lookout.pet_s) >= past_m else stops_mps


def side_streets(network: RoadNetwork, connection: Connection) -> tuple[SideStreet, ...]:
    """Streets from the left and right whose movements cross a movement; empty if there are none."""
    sides: dict[bool, list[tuple[float, float, float]]] = {}
    for index in crossing_connections(network, connection):
        other = network.connections[index]
        if not comes_from_the_side(network, connection, other):
            continue
        lane, place_m = network.lanes[other.from_lane], _meeting_m(network, connection, other)
        half_m = 0.5 * lane.width_m
        from_left = _turn_rad(network, connection, other) < 0.0
        sides.setdefault(from_left, []).append((place_m - half_m, place_m + half_m, lane.speed_limit_mps))
    return tuple(
        SideStreet(
            near_m=max(min(near for near, _, _ in spans), 0.0),
            far_m=max(far for _, far, _ in spans),
            aside_m=_road_beside_m(network, connection.from_lane, from_left) + SETBACK_M,
            limit_mps=max(limit for *_, limit in spans),
        )
        for from_left, spans in sorted(sides.items())
    )


def _turn_rad(network: RoadNetwork, connection: Connection, other: Connection) -> float:
    lanes = (network.lanes[movement.from_lane].centre for movement in (connection, other))
    own, its = (float(lane.heading_rad(lane.length_m)) for lane in lanes)
    return math.remainder(its - own, 2.0 * math.pi)


def _meeting_m(network: RoadNetwork, connection: Connection, other: Connection) -> float:
    """Arc length on a movement's path where another path crosses it."""
    own, its = movement_path(network, connection), movement_path(network, other)
    arc_m = np.linspace(0.0, own.length_m, max(int(own.length_m / _STEP_M), 2))
    its_m, left_m = its.project(own.at(arc_m))
    away_m = np.where((its_m < 0.0) | (its_m > its.length_m), np.inf, np.abs(left_m))
    return float(arc_m[int(np.argmin(away_m))])


def _road_beside_m(network: RoadNetwork, lane: int, on_left: bool) -> float:
    """Distance from the middle of a lane to the outer edge of its road, with sidewalks and opposite lanes."""
    here = network.lanes[lane]
    edge = network.edges[here.edge]
    at = edge.lanes.index(lane)
    beside = edge.lanes[at + 1 :] if on_left else edge.lanes[:at]
    if on_left:
        ends = (edge.to_junction, edge.from_junction)
        back = (other for other in network.edges if (other.from_junction, other.to_junction) == ends)
        beside += next((other.lanes for other in back), ())
    return 0.5 * here.width_m + sum(network.lanes[index].width_m for index in beside)
