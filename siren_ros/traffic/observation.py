"""Conclusions from SUMO's states: stop lines crossed, reactions to the EMV, teleports, and checks of every step.

An episode that breaks a check fails.
"""

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from siren_ros.errors import EpisodeError
from siren_ros.numerics.arrays import Codes, Flags, Floats, Ids
from siren_ros.numerics.units import STEP_S
from siren_ros.roads.road_network import NO_LANE, Connection, Lane, LaneKind, RoadNetwork
from siren_ros.scenario.paper import LEVEL_POLICIES, EmergencyLevel
from siren_ros.traffic.config import RESIDUAL_LIMIT_M, TrafficConfig
from siren_ros.traffic.demand.plan import TrafficPlan
from siren_ros.traffic.sumo.readings import Readings, ahead_on_route, intent_flags, rescued_names
from siren_ros.world.actors import ActorStates, Owner, rows_of_ids
from siren_ros.world.traffic_state import Event, EventKind, TrafficFlags, TrafficState


def check_residual(states: ActorStates, limit_m: float = RESIDUAL_LIMIT_M) -> None:
    """Raises EpisodeError where the two worlds have drifted apart: names the actor, the residual and the limit."""
    if len(states) and states.residual_m.max() > limit_m:
        row = int(np.argmax(states.residual_m))
        away = f"actor {states.actor_id[row]} is {states.residual_m[row]:.2f} m from its pose in SUMO"
        raise EpisodeError(f"{away} at step {states.step}; the limit is {limit_m:g} m")


def check_no_teleport(traffic: TrafficState) -> None:
    """Raises EpisodeError where SUMO has teleported a vehicle: names the actor, the step and the reason."""
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
    """Remembers each vehicle's last lane and tells when it enters or leaves a controlled junction."""

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        self._last_lane = np.full(1, NO_LANE, np.int32)
        """Index of the lane by actor id."""
        self._inside: dict[int, str] = {}

    def forget(self, actor_id: int) -> None:
        """Drop a vehicle that has left."""
        self._make_room(actor_id)
        self._last_lane[actor_id] = NO_LANE
        self._inside.pop(actor_id, None)

    def elsewhere(self, actor_id: Ids, lane: npt.NDArray[np.int32]) -> Flags:
        """Which vehicles, sorted by id, are not on the lane that they were on at the last call of ``watch``."""
        self._make_room(int(actor_id[-1]) if len(actor_id) else 0)
        return np.asarray(self._last_lane[actor_id] != lane)

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


def _detail(connection: Connection, speed_mps: float, signals: Mapping[str, str]) -> dict[str, float | int | str]:
    state = signals.get(connection.signal_id or "", "")
    return {
        "junction": connection.junction,
        "direction": connection.direction,
        "signal_state": state[connection.signal_link] if 0 <= connection.signal_link < len(state) else "",
        "must_stop": int(connection.must_stop),
        "speed_mps": speed_mps,
    }


class Reactions:
    """Derives reactions and flags of one step; holds nothing from step to step."""

    def __init__(self, network: RoadNetwork, plan: TrafficPlan, level: EmergencyLevel, config: TrafficConfig) -> None:
        self._internal = np.array([lane.kind is LaneKind.INTERNAL for lane in network.lanes])
        self._emvs = tuple(vehicle.name for vehicle in plan.emvs)
        self._reach_m = plan.response_distance_m
        self._advice_range_m = config.advice_range_m
        self._siren = LEVEL_POLICIES[level].siren
        self._device = level in config.bluelight_levels

    def rescued(
        self, names: Sequence[str], readings: Readings, routes: Sequence[Sequence[int]]
    ) -> dict[str, list[str]]:
        """Vehicles that react to each EMV's siren: from SUMO's device, or by its criterion where it does not run."""
        if not self._siren:
            return {emv: [] for emv in self._emvs}
        if self._device:
            return rescued_names(names, self._emvs)
        points = np.stack((readings.x_m, readings.y_m), axis=-1)
        present = np.array([route[0] if route else -1 for route in routes], dtype=np.int32)
        reacting: dict[str, list[str]] = {emv: [] for emv in self._emvs}
        for emv in self._emvs:
            if emv in names:
                row = names.index(emv)
                yaw = float(readings.yaw_rad[row])
                hears = ahead_on_route(points[row], yaw, routes[row], points, present, self._reach_m)
                heard = (names[other] for other in np.flatnonzero(hears))
                reacting[emv] = [name for name in heard if name not in self._emvs]
        return reacting

    def flags(self, names: Sequence[str], readings: Readings, rescued: Mapping[str, Sequence[str]]) -> Codes:
        """Flags of every vehicle; lane-change wishes only near an EMV."""
        flags = np.zeros(len(names), dtype=np.uint8)
        on_junction = (readings.lane != NO_LANE) & self._internal[readings.lane]
        flags[on_junction] |= np.uint8(TrafficFlags.ON_JUNCTION)
        reacting = {name for listed in rescued.values() for name in listed}
        if reacting:
            flags[[name in reacting for name in names]] |= np.uint8(TrafficFlags.RESCUE_LANE)
        near = np.zeros(len(names), dtype=np.bool_)
        for emv in self._emvs:
            if emv in names:
                row = names.index(emv)
                distance = np.hypot(readings.x_m - readings.x_m[row], readings.y_m - readings.y_m[row])
                near |= distance <= self._advice_range_m
        for row in np.flatnonzero(near):
            flags[row] |= np.uint8(intent_flags(names[row]))
        return flags


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
        rows = rows_of_ids(last.actor_id, ids)
        now_x, now_y = _fronts(readings.x_m, readings.y_m, readings.yaw_rad, lengths_m)
        then_x, then_y = _fronts(last.sumo_x_m[rows], last.sumo_y_m[rows], last.sumo_yaw_rad[rows], lengths_m)
        moved = np.hypot(now_x - then_x, now_y - then_y)
        explained = np.maximum(readings.speed_mps, last.sumo_speed_mps[rows]) * STEP_S
        stayed = (rows >= 0) & (owner == Owner.SUMO) & (last.owner[rows] == Owner.SUMO)
        for row in np.flatnonzero(stayed & (moved > explained + jump_m)):
            if int(ids[row]) not in moved_on_purpose:
                reasons.setdefault(int(ids[row]), "jump")
    if not reasons:
        return []
    row_of = {int(actor_id): row for row, actor_id in enumerate(ids)}
    events = []
    for actor_id, reason in sorted(reasons.items()):
        row = row_of.get(actor_id)
        x, y = (0.0, 0.0) if row is None else (float(readings.x_m[row]), float(readings.y_m[row]))
        events.append(Event(step, EventKind.TELEPORT, actor_id, x_m=x, y_m=y, detail={"reason": reason}))
    return events


def _fronts(x_m: Floats, y_m: Floats, yaw_rad: Floats, lengths_m: Floats) -> tuple[Floats, Floats]:
    return x_m + 0.5 * lengths_m * np.cos(yaw_rad), y_m + 0.5 * lengths_m * np.sin(yaw_rad)
