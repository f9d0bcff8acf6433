"""What a driver sees at a step: its path with the road along it, and others relative to its path.

The road along a path is its edges, junctions, lines with signals, and the lanes beside it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats
from siren_ros.base.numerics.geometry import Polyline, wrap_angle
from siren_ros.data.tracks import locate
from siren_ros.simulation.behaviour.driving.lane_path import road_limits
from siren_ros.simulation.roads.road_network import NO_LANE, Connection, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import driving_lanes, is_leftmost_of_several, rescue_sides
from siren_ros.simulation.world.actors import ActorDescription, ActorStates, Indices, Lights, SignalState


@dataclass(frozen=True)
class LanesBeside:
    """Lanes beside a path: columns of shape ``(K,)``, one value per row of the path.

    Offsets are positive to the left.
    """

    width_m: Floats
    """Width of the path's lane."""
    left: Floats
    """Number of driving lanes of the same direction to the left; in junctions it is interpolated between both sides."""
    right: Floats
    """Number of lanes to the right of the path's lane."""

    @classmethod
    def of(cls, network: RoadNetwork, way: Indices) -> Self:
        """Lanes beside the lanes of a path, one per row, on a map with right-hand traffic."""
        s_m = np.arange(float(len(way)))
        columns = np.full((3, len(s_m)), np.nan)
        for row, index in enumerate(way.tolist()):
            lanes = (
                [] if index == NO_LANE else [lane.index for lane in driving_lanes(network, network.lanes[index].edge)]
            )
            if index not in lanes:
                continue
            position = lanes.index(index)
            beside = len(lanes) - 1 - position, position
            columns[:, row] = network.lanes[index].width_m, *beside
        known = np.isfinite(columns[0])
        if not known.any():
            columns[:] = np.array([3.5, 0.0, 0.0])[:, None]
        else:
            columns = np.array([np.interp(s_m, s_m[known], column[known]) for column in columns])
        return cls(*columns)

    def rightmost(self, row: int) -> int:
        """Number of the rightmost lane, counted from the path's lane, positive to the left."""
        return -round(float(self.right[row]))

    def leftmost(self, row: int) -> int:
        """Number of the leftmost lane, counted from the path's lane."""
        return round(float(self.left[row]))

    def is_leftmost(self, row: int, lane: int) -> bool:
        """Whether a lane is the leftmost of several, or would be left of it."""
        return lane >= self.leftmost(row) > self.rightmost(row)

    def lane_at(self, row: int, offset_m: float) -> int:
        """Number of the lane at an offset, counted from the path's lane, also outside the road."""
        return round(offset_m / float(self.width_m[row]))

    def lane_there(self, row: int, lane: int) -> int:
        """Nearest existing lane at a row, by its number from the path's lane."""
        return min(max(lane, self.rightmost(row)), self.leftmost(row))

    def offset_m(self, row: int, lane: int) -> float:
        """Lateral distance of a lane from the path at a row. The lane is given by its number from the path's lane.

        In a junction, a lane that exists only before or only after it moves towards the path or away from it.
        """
        there = min(max(float(lane), -float(self.right[row])), float(self.left[row]))
        return there * float(self.width_m[row])


SPACING_M: Final = 1.0
_JUMP_M: Final = 1.0
_DRIFT: Final = 0.02
"""Lateral drift per metre above which the path is changing lanes."""


@dataclass(frozen=True)
class Line:
    """A stop line on the path."""

    at_m: float
    """Arc length on the path."""
    connection: Connection


@dataclass(frozen=True)
class Way:
    """A path along lane centres; columns have shape ``(K,)``, one value per metre."""

    curve: Polyline
    lane: Indices
    """Index of the lane or of the path across a junction; ``NO_LANE`` off the lanes."""
    right_m: Floats
    """Offset of the road's right edge, positive to the left."""
    driving_right_m: Floats
    """Offset of the right edge of the driving lanes, without shoulder."""
    lane_right_m: Floats
    """Offset of the lane's right edge."""
    lane_left_m: Floats
    """Offset of the lane's left edge."""
    leftmost: Flags
    """Whether the lane is the leftmost of several."""
    in_junction: Flags
    limit_mps: Floats
    """Speed limit of the lane."""
    changes: Floats
    """+1 where the path changes to the left lane, −1 to the right lane, 0 elsewhere."""
    duty: Flags
    """Whether slow traffic must keep a corridor open between the lanes before any siren (Germany's rescue lane)."""
    lines: tuple[Line, ...]
    """Stop lines in the order along the path."""
    lanes: LanesBeside

    @classmethod
    def of(cls, network: RoadNetwork, curve: Polyline) -> Self:
        """The path along a curve on a map with right-hand traffic."""
        s_m = np.arange(0.0, curve.length_m + SPACING_M, SPACING_M)
        points, heading = curve.at(s_m), curve.heading_rad(s_m)
        places = locate(network, points, np.asarray(heading), np.full(len(s_m), NO_LANE, np.int32))
        right, limit = np.full(len(s_m), -1.75), np.full(len(s_m), np.nan)
        driving_right, lane_right, lane_left = (
            np.full(len(s_m), -1.75),
            np.full(len(s_m), -1.75),
            np.full(len(s_m), 1.75),
        )
        leftmost, inside, duty = (np.zeros(len(s_m), np.bool_) for _ in range(3))
        rescue = rescue_sides(network)
        for row, lane_index in enumerate(places.lane.tolist()):
            if lane_index == NO_LANE:
                continue
            lane = network.lanes[lane_index]
            duty[row] = rescue[lane_index] != 0
            inside[row], limit[row] = lane.kind is LaneKind.INTERNAL, lane.speed_limit_mps
            limits = road_limits(network, lane_index)
            right[row], driving_right[row] = (
                edge - float(places.offset_m[row]) for edge in (limits.right_m, limits.driving_right_m)
            )
            lane_right[row] = -0.5 * lane.width_m - float(places.offset_m[row])
            lane_left[row] = 0.5 * lane.width_m - float(places.offset_m[row])
            leftmost[row] = is_leftmost_of_several(network, lane_index)
        drift = np.diff(places.offset_m, append=places.offset_m[-1:])
        drift[~np.isfinite(drift) | (np.abs(drift) > _JUMP_M) | inside] = 0.0  # a jump means another lane, not a drift
        changes = np.where(np.abs(drift) > _DRIFT, np.sign(drift), 0.0)
        known = np.isfinite(limit)
        limit = np.interp(s_m, s_m[known], limit[known]) if known.any() else np.full(len(s_m), 8.0)
        edges = right, driving_right, lane_right, lane_left
        lines = tuple(_lines(network, s_m, places.lane.tolist()))
        lanes = LanesBeside.of(network, places.lane)
        return cls(curve, places.lane, *edges, leftmost, inside, limit, changes, duty, lines, lanes)

    def row(self, s_m: float) -> int:
        """Row of an arc length."""
        return int(min(max(round(s_m / SPACING_M), 0), len(self.right_m) - 1))


def _lines(network: RoadNetwork, s_m: Floats, lanes: list[int]) -> list[Line]:
    """Stop lines where the path leaves a lane for a path across a junction."""
    found, before = [], NO_LANE
    for at_m, lane in zip(s_m.tolist(), lanes, strict=True):
        if lane in {before, NO_LANE}:
            continue
        if before != NO_LANE and network.lanes[before].kind is not LaneKind.INTERNAL:
            onward = [one for one in network.connections_from.get(before, ()) if lane in {*one.via, one.to_lane}]
            found += [Line(at_m, one) for one in onward[:1]]
        before = lane
    return found


_AHEAD_M: Final = 60.0
_BEHIND_M: Final = 30.0
_ASIDE_M: Final = 8.0
_RED: Final = frozenset("rRyY")


@dataclass(frozen=True)
class Siren:
    """An EMV with its siren on."""

    actor_id: int
    gap_m: float
    """Gap from the EMV's front to the own rear along the own heading; negative beside and ahead."""
    left_m: float
    """Lateral distance of its centre from the own centre, positive to the left."""
    speed_mps: float
    behind: bool
    """Whether it comes from behind on this road: it has not passed, and drives in the same direction."""
    ahead_m: float
    """Distance from the own front to its rear; negative beside and behind."""
    along: bool
    """Whether it drives on this road in the same direction."""


@dataclass(frozen=True)
class Other:
    """A vehicle or person on the path ahead or near the own position."""

    gap_m: float
    """Gap from the own front along the path; negative beside and behind."""
    left_m: float
    """Offset of its centre from the path, positive to the left."""
    half_width_m: float
    """Half width across the path."""
    speed_mps: float
    """Speed along the path."""
    length_m: float
    """Length along the path."""


@dataclass(frozen=True)
class Sight:
    """What a driver sees at a step. Offsets are lateral, positive to the left."""

    step: int
    way: Way
    s_m: float
    """Arc length of the own centre on the path."""
    left_m: float
    turn_rad: float
    """Own heading relative to the path."""
    speed_mps: float
    length_m: float
    width_m: float
    sirens: tuple[Siren, ...]
    others: tuple[Other, ...]
    red_m: float
    """Distance from the own front to the next red line on the path; infinite without one."""
    in_junction: bool
    states: ActorStates
    """States of all actors."""
    bodies: Mapping[int, ActorDescription]
    """Descriptions of the actors by id."""
    row: int
    """Row of the own vehicle in ``states``."""

    @property
    def body(self) -> ActorDescription:
        """Description of the own vehicle."""
        return self.bodies[int(self.states.actor_id[self.row])]


def sight_of(
    states: ActorStates,
    signals: tuple[SignalState, ...],
    actors: Mapping[int, ActorDescription],
    actor_id: int,
    way: Way,
    near_m: float,
) -> Sight:
    """Make the sight of an actor's driver.

    Args:
        states: The world, on a map where traffic keeps right.
        signals: States of the signals.
        actors: Bodies of those in the world.
        actor_id: The own vehicle, which is in the world.
        way: Its way.
        near_m: Arc length on the way where it was a step before: a long way comes back to roads where it was before.
    """
    row = int(np.searchsorted(states.actor_id, actor_id))
    body = actors[actor_id]
    x, y, yaw = (float(column[row]) for column in (states.x_m, states.y_m, states.yaw_rad))
    speeds = np.hypot(states.vx_mps, states.vy_mps)
    dx, dy = states.x_m - x, states.y_m - y
    ahead = dx * np.cos(yaw) + dy * np.sin(yaw)
    aside = dy * np.cos(yaw) - dx * np.sin(yaw)
    near = (np.hypot(dx, dy) < 2.0 * _AHEAD_M) & (np.arange(len(states)) != row)
    sounds = (states.lights & Lights.SIREN) != 0
    sees = near & (ahead > -_BEHIND_M) & (ahead < _AHEAD_M)
    rows = [row, *np.flatnonzero(sees | (near & sounds)).tolist()]
    own, *places = _on_way(way, states, rows, near_m)
    sirens, others = [], []
    for k, place in zip(rows[1:], places, strict=True):
        other, speed = actors[int(states.actor_id[k])], float(speeds[k])
        if other.is_emv and sounds[k]:
            along = place.s_m - own.s_m, place.left_m - own.left_m, place.turn_rad
            straight = float(ahead[k]), float(aside[k]), float(states.yaw_rad[k]) - yaw
            sirens.append(_siren(other, speed, 0.5 * (body.length_m + other.length_m), along, straight))
        if sees[k]:
            others.append(_other(other, speed, place, place.s_m - own.s_m - 0.5 * body.length_m))
    return Sight(
        states.step,
        way,
        own.s_m,
        own.left_m,
        float(wrap_angle(own.turn_rad)),
        float(speeds[row]),
        body.length_m,
        body.width_m,
        tuple(sirens),
        tuple(others),
        _red_line_m(way, own.s_m, signals) - own.s_m - 0.5 * body.length_m,
        bool(way.in_junction[way.row(own.s_m)]),
        states,
        actors,
        row,
    )


@dataclass(frozen=True)
class _OnWay:
    """Position on the path: arc length, offset, and heading relative to the path."""

    s_m: float
    left_m: float
    turn_rad: float


def _on_way(way: Way, states: ActorStates, rows: list[int], near_m: float) -> list[_OnWay]:
    points = np.stack((states.x_m[rows], states.y_m[rows]), axis=-1)
    s_m, left_m = way.curve.project_near(points, near_m, 2.0 * _AHEAD_M)
    turns = states.yaw_rad[rows] - way.curve.heading_rad(s_m)
    return [_OnWay(*place) for place in zip(s_m.tolist(), left_m.tolist(), turns.tolist(), strict=True)]


def _other(body: ActorDescription, speed_mps: float, place: _OnWay, ahead_m: float) -> Other:
    """Make an ``Other`` for an actor near the path, at this distance along it from the own front."""
    turned = np.cos(place.turn_rad)
    cos, sin = abs(turned), abs(np.sin(place.turn_rad))
    length = body.length_m * cos + body.width_m * sin
    half = 0.5 * (body.length_m * sin + body.width_m * cos)
    return Other(float(ahead_m - 0.5 * length), place.left_m, float(half), float(speed_mps * turned), float(length))


def _siren(emv: ActorDescription, speed_mps: float, reach_m: float, *seen: tuple[float, float, float]) -> Siren:
    """Make a ``Siren`` for an EMV: relative to the own path if it drives along it, otherwise in a straight line.

    Args:
        emv: The EMV.
        speed_mps: Its speed.
        reach_m: Half of both lengths.
        seen: How far ahead and to the left of the own centre it is, and its heading from the own one: along the way,
            and straight.
    """
    here = (one for one in seen if abs(float(wrap_angle(one[2]))) < np.pi / 3.0 and abs(one[1]) < _ASIDE_M)
    found = next(here, None)
    ahead, aside, _ = found or seen[-1]
    behind = found is not None and ahead <= reach_m
    return Siren(emv.actor_id, -ahead - reach_m, aside, speed_mps, behind, ahead - reach_m, found is not None)


def _red_line_m(way: Way, from_m: float, signals: tuple[SignalState, ...]) -> float:
    """Arc length of the next red or yellow line beyond a place; infinite without one."""
    states = {signal.signal_id: signal.state for signal in signals}
    lines = (line for line in way.lines if line.at_m > from_m)
    red = (line for line in lines if line.connection.letter_in(states.get(line.connection.signal_id or "", "")) in _RED)
    return min((line.at_m for line in red), default=np.inf)
