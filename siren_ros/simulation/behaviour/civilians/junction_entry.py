"""How far a driver who makes way for an EMV may go onto the junction ahead."""

from collections.abc import Mapping
from typing import Final

from siren_ros.simulation.behaviour.driving.step_view import Ego
from siren_ros.simulation.behaviour.paths.lane_path import connection_of_internal, lanes_along
from siren_ros.simulation.conflicts.yielding import Rank, rank_of
from siren_ros.simulation.roads.movements import road_lane_of
from siren_ros.simulation.roads.road_network import NO_LANE, Connection


def on_junction(ego: Ego, lane: int) -> bool:
    """Whether a lane crosses a junction."""
    return lane != NO_LANE and road_lane_of(ego.network, lane) == NO_LANE


def approach_lane_of(ego: Ego, lane: int) -> int:
    """The road lane that a lane belongs to; on a junction the lane before it, ``NO_LANE`` if unknown."""
    road = road_lane_of(ego.network, lane)
    if road != NO_LANE or lane == NO_LANE:
        return road
    movement = connection_of_internal(ego.network, lane, ego.route)
    return NO_LANE if movement is None else movement.from_lane


def movement_from(ego: Ego, lane: int) -> Connection | None:
    """Movement of a driver at the end of a lane."""
    onward = lanes_along(ego.network, lane, 0.0, ego.route, ego.network.lanes[lane].length_m + 0.1, civilian=True)[0]
    ways = ego.network.connections_from.get(lane, ())
    return next((way for way in ways if (*way.via, way.to_lane) == onward[1:]), None)


def room_beyond_line_m(ego: Ego, movement: Connection) -> float:
    """Distance beyond the stop line that a driver's front may reach without blocking others."""
    return ego.world.junction_room.beyond_line_m(movement, _signals(ego), frozenset(ego.traffic.lane.tolist()))


_IN_THE_WAY_M: Final = 2.0
"""A vehicle that blocks others by more than this crosses the junction even at red."""


def may_cross(ego: Ego, movement: Connection, front_m: float) -> bool:
    """Whether a driver may cross the junction: the light allows it, or the front already blocks others.

    ``front_m`` is the front's way beyond the stop line.
    """
    return not is_held(ego, movement) or front_m > room_beyond_line_m(ego, movement) + _IN_THE_WAY_M


def is_held(ego: Ego, movement: Connection | None) -> bool:
    """Whether a light that is red, or about to be, stops a movement."""
    return movement is not None and rank_of(movement, _signals(ego)) in {Rank.RED, Rank.CLEARING}


def _signals(ego: Ego) -> Mapping[str, str]:
    return {} if ego.seen.outlook is None else ego.seen.outlook.signals


def junction_m(ego: Ego, movement: Connection) -> float:
    """Length of a movement's path across its junction."""
    return ego.network.length_m(movement.via)


def way_inside_m(ego: Ego, movement: Connection, lane: int) -> float:
    """Distance from the stop line to the start of a movement's lane; 0 if the lane does not belong to the movement."""
    before = movement.via[: movement.via.index(lane)] if lane in movement.via else ()
    return ego.network.length_m(before)
