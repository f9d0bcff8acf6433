"""What a driver who makes room for an EMV may do on the junction ahead."""

from collections.abc import Mapping
from typing import Final

from siren_ros.simulation.behaviour.driving.step_view import Ego
from siren_ros.simulation.behaviour.paths.lane_path import connection_of_internal, lanes_along
from siren_ros.simulation.conflicts.yielding import Rank, rank_of
from siren_ros.simulation.roads.movements import road_lane_of
from siren_ros.simulation.roads.road_network import NO_LANE, Connection


def on_junction(ego: Ego, lane: int) -> bool:
    """Whether a lane leads across a junction."""
    return lane != NO_LANE and road_lane_of(ego.network, lane) == NO_LANE


def approach_lane_of(ego: Ego, lane: int) -> int:
    """The road's lane that a lane belongs to; on a junction the one before it, ``NO_LANE`` where that is not known."""
    road = road_lane_of(ego.network, lane)
    if road != NO_LANE or lane == NO_LANE:
        return road
    movement = connection_of_internal(ego.network, lane, ego.route)
    return NO_LANE if movement is None else movement.from_lane


def movement_from(ego: Ego, lane: int) -> Connection | None:
    """The movement that a driver takes at the end of a lane."""
    onward = lanes_along(ego.network, lane, 0.0, ego.route, ego.network.lanes[lane].length_m + 0.1, civilian=True)[0]
    ways = ego.network.connections_from.get(lane, ())
    return next((way for way in ways if (*way.via, way.to_lane) == onward[1:]), None)


def room_beyond_line_m(ego: Ego, movement: Connection) -> float:
    """How far a driver's front may go beyond the stop line without being in the way of others."""
    return ego.world.junction_room.beyond_line_m(movement, _signals(ego), frozenset(ego.traffic.lane.tolist()))


_IN_THE_WAY_M: Final = 2.0
"""A vehicle that is farther in the way of others than this crosses the junction at a red light too."""


def may_cross(ego: Ego, movement: Connection, front_m: float) -> bool:
    """Whether a driver goes across the junction: no light holds the movement, or the front is in others' way already.

    ``front_m`` is the front's way beyond the stop line.
    """
    in_the_way_m = _IN_THE_WAY_M
    return not is_held(ego, movement) or front_m > room_beyond_line_m(ego, movement) + in_the_way_m


def is_held(ego: Ego, movement: Connection | None) -> bool:
    """Whether a light that is red, or about to be, holds a movement."""
    return movement is not None and rank_of(movement, _signals(ego)) in {Rank.RED, Rank.CLEARING}


def _signals(ego: Ego) -> Mapping[str, str]:
    return {} if ego.seen.outlook is None else ego.seen.outlook.signals


def junction_m(ego: Ego, movement: Connection) -> float:
    """Length of a movement's way across its junction."""
    return ego.network.length_m(movement.via)


def way_inside_m(ego: Ego, movement: Connection, lane: int) -> float:
    """From the stop line to the start of a lane of a movement; 0 where the lane is none of its own."""
    before = movement.via[: movement.via.index(lane)] if lane in movement.via else ()
    return ego.network.length_m(before)
