"""Derives events and checks from SUMO's states: stop lines crossed, reactions to the EMV, teleports, residuals.

An episode that breaks a check fails.
"""

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Codes, Flags, Floats, Ids, Rows
from siren_ros.base.numerics.compiled import compiled
from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import EpisodeError
from siren_ros.simulation.roads.road_network import NO_LANE, Connection, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.scenario.paper import LEVEL_POLICIES, EmergencyLevel
from siren_ros.simulation.traffic.demand.plan import TrafficPlan
from siren_ros.simulation.traffic.sumo.readings import Readings, ahead_on_route, intent_flags
from siren_ros.simulation.world.actors import (
    RESIDUAL_LIMIT_M,
    ActorStates,
    Event,
    EventKind,
    Indices,
    Owner,
    TrafficFlags,
    TrafficState,
)

_BY_SUMO: Final = int(Owner.SUMO)
_ON_JUNCTION: Final = int(TrafficFlags.ON_JUNCTION)


def check_residual(states: ActorStates, limit_m: float = RESIDUAL_LIMIT_M) -> None:
    """Raises EpisodeError where a simulated vehicle and its pose in SUMO are too far apart.

    It names actor, residual and limit.
    """
    if len(states) and states.residual_m.max() > limit_m:
        row = int(np.argmax(states.residual_m))
        away = f"actor {states.actor_id[row]} is {states.residual_m[row]:.2f} m from its pose in SUMO"
        raise EpisodeError(f"{away} at step {states.step}; the limit is {limit_m:g} m")


def check_no_teleport(traffic: TrafficState) -> None:
    """Raises EpisodeError where SUMO has teleported a vehicle; it names actor, step and reason."""
    for event in traffic.events:
        if event.kind is EventKind.TELEPORT:
            reason = event.detail.get("reason", "")
            raise EpisodeError(f"SUMO teleported actor {event.actor_id} at step {event.step} ({reason})")


@dataclass(frozen=True)
class Mover:
    """A vehicle's front bumper at one step."""

    actor_id: int
    lane: int
    x_m: float
    y_m: float
    speed_mps: float


class CrossingWatch:
    """Notices when a vehicle enters or leaves a controlled junction, by its last lane."""

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        self._last_lane = np.full(1, NO_LANE, np.int32)
        """Index of the lane by actor id."""
        self._inside: dict[int, str] = {}

    def forget(self, actor_id: int) -> None:
        """Removes a vehicle that has left the simulation."""
        self._make_room(actor_id)
        self._last_lane[actor_id] = NO_LANE
        self._inside.pop(actor_id, None)

    def elsewhere(self, actor_id: Ids, lane: npt.NDArray[np.int32]) -> list[int]:
        """Rows of vehicles, sorted by id, that are on another lane than at the last call of ``watch``."""
        self._make_room(int(actor_id[-1]) if len(actor_id) else 0)
        rows: list[int] = _elsewhere(self._last_lane, actor_id, lane).tolist()
        return rows

    def _make_room(self, actor_id: int) -> None:
        more = actor_id + 1 - len(self._last_lane)
        if more > 0:
            self._last_lane = np.append(self._last_lane, np.full(2 * more, NO_LANE, np.int32))

    def watch(self, step: int, mover: Mover, signals: Mapping[str, str]) -> tuple[Event, ...]:
        """Events of a vehicle whose lane, which is on the road, has changed since the last call.

        ``signals`` holds the state strings of all signals by id.
        """
        lane = self._network.lanes[mover.lane]
        self._make_room(mover.actor_id)
        before = int(self._last_lane[mover.actor_id])
        last = None if before == NO_LANE else self._network.lanes[before]
        self._last_lane[mover.actor_id] = lane.index
        if last is None or last.edge == lane.edge:
            return ()
        incidents: list[tuple[EventKind, dict[str, float | int | str]]] = []
        if mover.actor_id in self._inside and lane.kind is not LaneKind.INTERNAL:
            incidents.append((EventKind.JUNCTION_LEFT, {"junction": self._inside.pop(mover.actor_id)}))
        connection = self._connection(last, lane) if last.kind is not LaneKind.INTERNAL else None
        if connection is not None and (connection.signal_id is not None or connection.must_stop):
            incidents.append((EventKind.STOP_LINE_CROSSED, _detail(connection, mover.speed_mps, signals)))
            if lane.kind is LaneKind.INTERNAL:
                self._inside[mover.actor_id] = connection.junction
        return tuple(
            Event(step, kind, mover.actor_id, x_m=mover.x_m, y_m=mover.y_m, detail=detail) for kind, detail in incidents
        )

    def _connection(self, last: Lane, lane: Lane) -> Connection | None:
        """The movement between two lanes; a vehicle that changes lanes there may come from a neighbour lane."""
        siblings = [last.index, *(index for index in self._network.edges[last.edge].lanes if index != last.index)]
        for source in siblings:
            for connection in self._network.connections_from.get(source, ()):
                if lane.index in connection.via or connection.to_lane == lane.index:
                    return connection
        return None


@compiled
def _elsewhere(last_lane: Indices, actor_id: Ids, lane: Indices) -> Rows:
    """Rows of vehicles that are on the road, and not on their last lanes, which are given by actor id."""
    rows, count = np.empty(len(lane), np.intp), 0
    for row in range(len(lane)):
        if lane[row] != NO_LANE and lane[row] != last_lane[actor_id[row]]:
            rows[count] = row
            count += 1
    return rows[:count]


def _detail(connection: Connection, speed_mps: float, signals: Mapping[str, str]) -> dict[str, float | int | str]:
    return {
        "junction": connection.junction,
        "direction": connection.direction,
        "signal_state": connection.letter_in(signals.get(connection.signal_id or "", "")),
        "must_stop": int(connection.must_stop),
        "speed_mps": speed_mps,
    }


ADVICE_RANGE_M: Final = 80.0
"""Lane-change intent of civilians is read within this distance of an EMV."""


class Reactions:
    """Derives which vehicles react to EMVs, and the flags of all vehicles, at one step.

    It keeps no state between steps.
    """

    def __init__(self, network: RoadNetwork, plan: TrafficPlan, level: EmergencyLevel) -> None:
        self._internal = np.array([lane.kind is LaneKind.INTERNAL for lane in network.lanes])
        self._emvs = tuple(vehicle.name for vehicle in plan.emvs)
        self._reach_m = plan.response_distance_m
        self._siren = LEVEL_POLICIES[level].siren

    def rescued(
        self, names: Sequence[str], readings: Readings, route_offset: Indices, route_edges: Indices
    ) -> dict[str, list[str]]:
        """Vehicles that react to each EMV's siren: those ahead on its route and within reach.

        ``route_offset`` and ``route_edges`` hold the edges ahead of each vehicle, as in ``TrafficState``.
        """
        if not self._siren:
            return {emv: [] for emv in self._emvs}
        reacting: dict[str, list[str]] = {emv: [] for emv in self._emvs}
        poses = readings.x_m, readings.y_m, readings.yaw_rad
        for emv in self._emvs:
            if emv in names:
                rows = ahead_on_route(names.index(emv), poses, route_offset, route_edges, self._reach_m)
                heard = (names[other] for other in rows.tolist())
                reacting[emv] = [name for name in heard if name not in self._emvs]
        return reacting

    def flags(self, names: Sequence[str], readings: Readings, rescued: Mapping[str, Sequence[str]]) -> Codes:
        """Flags of every vehicle; lane-change wishes only near an EMV."""
        emvs = np.array([names.index(emv) for emv in self._emvs if emv in names], np.intp)
        points = readings.x_m, readings.y_m
        flags, near = _junctions_and_near(readings.lane, self._internal, points, emvs, ADVICE_RANGE_M)
        reacting = {name for listed in rescued.values() for name in listed}
        if reacting:
            flags[[name in reacting for name in names]] |= np.uint8(TrafficFlags.RESCUE_LANE)
        for row in near.tolist():
            intent = intent_flags(names[row])
            if intent is not TrafficFlags.NONE:
                flags[row] |= np.uint8(intent)
        return flags


@compiled
def _junctions_and_near(
    lane: Indices, internal: Flags, points: tuple[Floats, Floats], emvs: Rows, range_m: float
) -> tuple[Codes, Rows]:
    """Flags of vehicles on junctions, and the rows of all vehicles within a distance of an EMV; ``emvs`` are rows."""
    x_m, y_m = points
    flags = np.zeros(len(lane), np.uint8)
    near, count = np.empty(len(lane), np.intp), 0
    for row in range(len(lane)):
        if lane[row] != NO_LANE and internal[lane[row]]:
            flags[row] = _ON_JUNCTION
        for emv in emvs:
            if np.hypot(x_m[row] - x_m[emv], y_m[row] - y_m[emv]) <= range_m:
                near[count] = row
                count += 1
                break
    return flags, near[:count]


def find_teleports(
    step: int,
    ids: Ids,
    readings: Readings,
    lengths_m: Floats,
    owner: Codes,
    started: Iterable[int],
    moved_on_purpose: Container[int],
    last: TrafficState | None,
    jump_m: float,
) -> list[Event]:
    """Teleport events of one step, by actor id: those that SUMO started, and jumps beyond what the speed explains.

    What counts is the front bumper, which SUMO moves; the rod behind it may swing. Only vehicles that SUMO owned at
    both steps and that nobody has moved on purpose can jump.
    """
    reasons = dict.fromkeys(started, "sumo")
    if last is not None:
        now = ids, owner, readings.x_m, readings.y_m, readings.yaw_rad, readings.speed_mps
        then = last.actor_id, last.owner, last.sumo_x_m, last.sumo_y_m, last.sumo_yaw_rad, last.sumo_speed_mps
        for actor_id in ids[_jumped(now, then, lengths_m, jump_m)].tolist():
            if actor_id not in moved_on_purpose:
                reasons.setdefault(actor_id, "jump")
    if not reasons:
        return []
    row_of = {int(actor_id): row for row, actor_id in enumerate(ids)}
    events = []
    for actor_id, reason in sorted(reasons.items()):
        row = row_of.get(actor_id)
        x, y = (0.0, 0.0) if row is None else (float(readings.x_m[row]), float(readings.y_m[row]))
        events.append(Event(step, EventKind.TELEPORT, actor_id, x_m=x, y_m=y, detail={"reason": reason}))
    return events


Moving = tuple[Ids, Codes, Floats, Floats, Floats, Floats]
"""Ids, owners, x, y, yaw and speed of vehicles."""


@compiled
def _jumped(now: Moving, then: Moving, lengths_m: Floats, jump_m: float) -> Rows:
    """Rows of vehicles that SUMO owned at two steps and that have moved further than they drove.

    Both steps hold ids, which are sorted, owners, poses and speeds. Lengths have the rows of the present one.
    """
    ids, owner, x_m, y_m, yaw_rad, speed_mps = now
    then_ids, then_owner, then_x_m, then_y_m, then_yaw_rad, then_mps = then
    rows, count, k = np.empty(len(ids), np.intp), 0, 0
    for row in range(len(ids)):
        while k < len(then_ids) and then_ids[k] < ids[row]:
            k += 1
        if k == len(then_ids) or then_ids[k] != ids[row] or owner[row] != _BY_SUMO or then_owner[k] != _BY_SUMO:
            continue
        half = 0.5 * lengths_m[row]
        dx = x_m[row] + half * np.cos(yaw_rad[row]) - (then_x_m[k] + half * np.cos(then_yaw_rad[k]))
        dy = y_m[row] + half * np.sin(yaw_rad[row]) - (then_y_m[k] + half * np.sin(then_yaw_rad[k]))
        if np.hypot(dx, dy) > max(speed_mps[row], then_mps[k]) * STEP_S + jump_m:
            rows[count] = row
            count += 1
    return rows[:count]
