"""Controls the civilians at each step (paper, Algorithm 2): who notices an EMV, and how each responds."""

import math
from bisect import bisect_left
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Ids, Rows, changed
from siren_ros.base.numerics.compiled import X, Y, compiled
from siren_ros.base.numerics.units import steps_from_s
from siren_ros.simulation.behaviour.civilians.pull_over import (
    emv_waits_behind,
    hold,
    pull_over,
    pull_over_again,
    start_pull_over,
)
from siren_ros.simulation.behaviour.civilians.yield_lane_change import (
    OFF_PATH_GRACE_S,
    change_lane,
    keep_lane,
    needs_no_siren,
    rejoin,
    start_lane_change,
    who_lets_in,
)
from siren_ros.simulation.behaviour.driving.driver_states import (
    STANDING_MPS,
    Compliance,
    Driver,
    EmvView,
    YieldStep,
    YieldUnit,
    draw_driver,
    emv_fully_passed,
    release_reason,
    yield_event,
)
from siren_ros.simulation.behaviour.driving.lane_path import lanes_along
from siren_ros.simulation.behaviour.driving.navigator import DriveCommand
from siren_ros.simulation.behaviour.driving.step_view import (
    SEEN_HALF_LENGTH,
    ActorTable,
    BehaviourWorld,
    Ego,
    StepView,
    Surroundings,
)
from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.scenario.paper import CivilianResponse, ControlConstants
from siren_ros.simulation.scenario.scenario import in_region
from siren_ros.simulation.world.actors import (
    NO_ACTOR,
    ActorClass,
    Event,
    EventKind,
    Indices,
    Mode,
    Owner,
    TrafficState,
)
from siren_ros.simulation.world.commands import CommandRow, VehicleCommands

SOURCE: Final = "yield_manager"
_COAST: Final = DriveCommand(throttle=0.0, brake=0.0, steer_rad=0.0, hand_brake=False)
"""Command in rows that SUMO owns; it has no effect."""


_EMV_PATH_AHEAD_M: Final = 120.0
"""Length of the EMV's path that is considered."""
_EDGES_KEPT: Final = 3
"""Number of edges behind the EMV that still count as its road."""


@dataclass(frozen=True, eq=False)
class EmvRoad:
    """Road ahead of one EMV; it is valid while its lane and route stay the same."""

    key: tuple[int, bytes]
    lane_start_m: Floats
    """Distance from the start of the EMV's lane to the start of each lane on its path; infinite off the path."""
    road_start_m: Floats
    """The same distance for all lanes of the edges on its path, including lanes that are not on the path."""
    on_road: Flags
    """Whether each edge belongs to the road: edges ahead and those just left."""
    left_edges: tuple[int, ...]
    edges_ahead: frozenset[int]
    """The present edge and those ahead."""

    @classmethod
    def ahead_of(cls, ego: Ego, before: "EmvRoad | None") -> "EmvRoad | None":
        """Road of an EMV; the previous step's road while nothing changes or the EMV is off the road."""
        network, lane = ego.network, ego.lane
        if lane == NO_LANE:
            return before
        key = (lane, ego.route.tobytes())
        if before is not None and before.key == key:
            return before
        edge = network.lanes[lane].edge
        left_before = () if before is None else before.left_edges
        left = tuple(dict.fromkeys((edge, *left_before)))[:_EDGES_KEPT]
        ahead_m = network.lanes[lane].length_m + _EMV_PATH_AHEAD_M
        lane_start, road_start = np.full((2, len(network.lanes)), np.inf)
        on_road = np.zeros(len(network.edges), dtype=np.bool_)
        on_road[list(left)] = True
        way = 0.0
        lanes = lanes_along(network, lane, 0.0, ego.route, ahead_m)[0]
        for item in lanes:
            edge = network.lanes[item].edge
            lane_start[item] = way
            road_start[list(network.edges[edge].lanes)] = way
            on_road[edge] = True
            way += network.lanes[item].length_m
        return cls(key, lane_start, road_start, on_road, left, frozenset(network.lanes[item].edge for item in lanes))


def way_from_emv_m(view: StepView, emv_row: int, starts_m: Floats) -> Floats:
    """Distance along lanes from an EMV's front to every vehicle's rear, shape ``(N,)``; infinite off these lanes.

    ``starts_m`` says where each lane starts, measured from the start of the EMV's lane (``EmvRoad.lane_start_m``).
    """
    traffic = view.traffic
    return _ways_from(traffic.lane, traffic.lane_position_m, view.seen.bodies, starts_m, emv_row)


@compiled
def _ways_from(lane: Indices, front_m: Floats, bodies: Floats, starts_m: Floats, emv_row: int) -> Floats:
    way_m = np.full(len(lane), np.inf)
    for n in range(len(lane)):
        if lane[n] >= 0:
            way_m[n] = starts_m[lane[n]] + front_m[n] - 2.0 * bodies[SEEN_HALF_LENGTH, n] - front_m[emv_row]
    return way_m


def region_members(seen: Surroundings, emv_row: int, before: Ids, constants: ControlConstants) -> Ids:
    """Sorted ids of the civilians in an EMV's interaction region, given those of the previous step."""
    limits = constants.region_enter_m, constants.region_leave_m
    return seen.actor_id[_in_region(seen.bodies, seen.actor_id, seen.is_emv, emv_row, before, limits)]


@compiled
def _in_region(
    bodies: Floats, actor_id: Ids, is_emv: Flags, emv_row: int, before: Ids, limits: tuple[float, float]
) -> Flags:
    """Which actors are civilians in an EMV's interaction region."""
    at, inside = 0, np.zeros(len(actor_id), np.bool_)
    for n in range(len(actor_id)):
        while at < len(before) and before[at] < actor_id[n]:
            at += 1
        was_inside = at < len(before) and before[at] == actor_id[n]
        distance = np.hypot(bodies[X, n] - bodies[X, emv_row], bodies[Y, n] - bodies[Y, emv_row])
        inside[n] = not is_emv[n] and in_region(distance, was_inside, limits[0], limits[1])
    return inside


@compiled
def _may_notice(way_m: Floats, bodies: Floats, is_emv: Flags) -> Rows:
    """Rows of the civilians on an EMV's path that it has not passed."""
    return np.flatnonzero(np.isfinite(way_m) & ~is_emv & (way_m > -2.0 * bodies[SEEN_HALF_LENGTH]))


@dataclass(frozen=True, eq=False)
class YieldState:
    """All civilians that respond, by id, and their drivers."""

    units: Mapping[int, YieldUnit] = field(default_factory=dict)
    drivers: Mapping[int, Driver] = field(default_factory=dict)
    regions: Mapping[int, tuple[EmvRoad | None, Ids]] = field(default_factory=dict)
    """Each EMV's road and the sorted ids of the civilians in its interaction region, by the EMV's id."""
    actors: ActorTable = field(default_factory=ActorTable.empty)


@dataclass(frozen=True, eq=False)
class _EmvScene:
    """One EMV at one step, with its distance to every vehicle."""

    row: int
    members: frozenset[int]
    candidates: list[int]
    """Rows of the civilians that may notice it."""
    way_m: list[float]
    """Distance along lanes that the EMV will use (L2) or any lane of its road (L3); infinite elsewhere."""
    on_road: list[bool]
    edges_ahead: frozenset[int]
    road_m: list[float]
    """Distance along any lane of its road, at all levels."""


def step_yield(state: YieldState, traffic: TrafficState, world: BehaviourWorld) -> tuple[YieldState, VehicleCommands]:
    """One step of all civilians.

    Returns:
        The next state, and one row per civilian in any phase of a yield: owned by ROS while the navigator drives,
        by SUMO while the driver reacts, waits for a gap or keeps its new lane.
    """
    traffic = world.seen(traffic)
    if world.policy.response is CivilianResponse.NOMINAL:
        return YieldState(actors=state.actors.updated(traffic)), VehicleCommands.empty(traffic.step, SOURCE)
    view = world.view(traffic, state.actors)
    regions, scenes = _regions(state, view)
    units, drivers = dict(state.units), dict(state.drivers)
    events = _notice(units, drivers, scenes, view)
    if world.policy.response is CivilianResponse.FEASIBLE_YIELD:
        events += _let_in(units, drivers, scenes, view)
    rows: list[CommandRow] = []
    left: dict[int, YieldUnit] = {}
    present = traffic.actor_id.tolist()
    for actor_id in sorted(units):
        row = bisect_left(present, actor_id)
        if row == len(present) or present[row] != actor_id:
            continue
        ego = view.ego(row)
        outcome = _step_unit(units[actor_id], ego, scenes)
        events.extend(outcome.events)
        if outcome.unit is not None:
            left[actor_id] = outcome.unit
            if outcome.unit.phase is not Mode.NOMINAL:
                rows.append(_command_row(outcome.unit, ego, outcome.command))
    commands = VehicleCommands.of(traffic.step, SOURCE, rows, tuple(events))
    return YieldState(left, drivers, regions, view.actors), world.said(commands)


def _regions(state: YieldState, view: StepView) -> tuple[dict[int, tuple[EmvRoad | None, Ids]], dict[int, _EmvScene]]:
    seen, lane = view.seen, view.traffic.lane
    regions: dict[int, tuple[EmvRoad | None, Ids]] = {}
    scenes: dict[int, _EmvScene] = {}
    whole_road = view.world.policy.response is CivilianResponse.PULL_OVER
    rows = seen.is_emv.nonzero()[0].tolist()
    for row in rows:
        emv_id = int(seen.actor_id[row])
        road_before, known = state.regions.get(emv_id, (None, np.empty(0, dtype=np.uint32)))
        road = EmvRoad.ahead_of(view.ego(row), road_before)
        members = region_members(seen, row, known, view.world.constants)
        regions[emv_id] = road, members
        if road is None:
            continue
        way = way_from_emv_m(view, row, road.road_start_m if whole_road else road.lane_start_m)
        on_road = road.on_road[view.world.edge_of_lane[lane]] & (lane >= 0)
        near = _may_notice(way, seen.bodies, seen.is_emv).tolist()
        beside = way if whole_road else way_from_emv_m(view, row, road.road_start_m)
        scenes[emv_id] = _EmvScene(
            row, frozenset(members.tolist()), near, way.tolist(), on_road.tolist(), road.edges_ahead, beside.tolist()
        )
    return regions, scenes


def _notice(
    units: dict[int, YieldUnit], drivers: dict[int, Driver], scenes: dict[int, _EmvScene], view: StepView
) -> list[Event]:
    """Find civilians that notice an EMV at this step (adds to ``units`` and ``drivers``); cyclists do not respond.

    Where the EMV stands in a queue, or comes up to drivers who have noticed it and stand, all who stand in the queue
    notice it: without those at the head nobody could move.
    """
    world, seen, config = view.world, view.seen, view.world.config.civilian_driver.yielding
    events: list[Event] = []
    for emv_id, scene in scenes.items():
        present = [(row, int(seen.actor_id[row])) for row in scene.candidates]
        stands = seen.speed_mps <= STANDING_MPS
        in_queue = seen.speed_mps[scene.row] <= world.constants.gap_escape.blocked_speed_mps or any(
            stands[row] for row, actor_id in present if actor_id in units
        )
        for row, actor_id in present:
            cycles = view.actors.by_id[actor_id].actor_class is ActorClass.BICYCLE
            if actor_id in units or actor_id == world.av_id or cycles:
                continue
            if actor_id not in drivers:
                drivers[actor_id] = draw_driver(world.preset, world.seed, actor_id)
            driver = drivers[actor_id]
            if (way_m := scene.way_m[row]) > driver.response_distance_m:
                if not (in_queue and way_m <= config.queue_m and stands[row]):
                    continue
                driver = changed(driver, response_distance_m=way_m)
            if world.duty and needs_no_siren(view.ego(row)):
                continue
            phase = Mode.NOMINAL if driver.compliance is Compliance.NEVER else Mode.YIELD_REACTING
            unit = YieldUnit(actor_id, emv_id, driver, view.step + steps_from_s(driver.delay_s), phase)
            units[actor_id] = unit
            detail = {"way_m": way_m, "compliance": driver.compliance.value}
            events.append(yield_event(unit, view.ego(row), EventKind.YIELD_REQUESTED, **detail))
    return events


def _let_in(
    units: dict[int, YieldUnit], drivers: dict[int, Driver], scenes: dict[int, _EmvScene], view: StepView
) -> list[Event]:
    """Find the drivers in other lanes who let in those who have to leave the EMV's lane (adds to ``units``).

    They hear the siren as well. After their reaction time since the other driver has begun to wait, they keep their
    lane at the pace of those who have left the EMV's, so that the other one can draw ahead.
    """
    world, events = view.world, list[Event]()
    rows = {actor_id: row for row, actor_id in enumerate(view.traffic.actor_id.tolist())}
    for unit in [unit for unit in units.values() if unit.actor_id in rows and unit.emv_id in scenes]:
        other_id, way_m = who_lets_in(unit, view.ego(rows[unit.actor_id])), scenes[unit.emv_id].road_m
        if other_id in {NO_ACTOR, world.av_id} or other_id in units or view.actors.by_id[other_id].is_emv:
            continue
        driver = drivers.setdefault(other_id, draw_driver(world.preset, world.seed, other_id))
        late = view.step - unit.deferred_step < steps_from_s(driver.delay_s)
        cycles = view.actors.by_id[other_id].actor_class is ActorClass.BICYCLE
        if late or cycles or driver.compliance is Compliance.NEVER:
            continue
        if way_m[rows[other_id]] <= driver.response_distance_m:
            units[other_id] = YieldUnit(other_id, unit.emv_id, driver, view.step, Mode.YIELD_KEEP_LANE)
            detail: dict[str, float | str] = {"way_m": way_m[rows[other_id]], "reason": "lets_in"}
            events.append(yield_event(units[other_id], view.ego(rows[other_id]), EventKind.YIELD_REQUESTED, **detail))
    return events


def _step_unit(unit: YieldUnit, ego: Ego, scenes: dict[int, _EmvScene]) -> YieldStep:
    other = None
    if len(scenes) > 1 and unit.phase is not Mode.NOMINAL:
        other = _nearer(unit, ego, scenes)
    if other is None:
        return _answer(unit, ego, scenes)
    asked = yield_event(other, ego, EventKind.YIELD_REQUESTED, reason="another_emv")
    if unit.phase is not Mode.REJOIN:
        return _answer(other, ego, scenes).preceded_by(asked)
    again = None
    if ego.world.policy.response is CivilianResponse.PULL_OVER:
        again = pull_over_again(other, ego)
    return _answer(unit, ego, scenes) if again is None else again.preceded_by(asked)


def _nearer(unit: YieldUnit, ego: Ego, scenes: dict[int, _EmvScene]) -> YieldUnit | None:
    """A driver's unit for another, nearer EMV that still comes; None if nothing changes.

    A driver who makes way already hears an EMV on any lane of its road, as far as those do who stand in its queue. A
    driver on the way back to the lane hears it as well, and so does one whose own EMV has passed.
    """
    waits = unit.phase in {Mode.YIELD_REACTING, Mode.YIELD_DEFERRED}
    near_m = unit.driver.response_distance_m
    if not waits:
        near_m = max(near_m, ego.civilian_driver.yielding.queue_m)
    coming = [
        (way_m, emv_id)
        for emv_id, scene in scenes.items()
        if -2.0 * ego.half_length_m < (way_m := (scene.way_m if waits else scene.road_m)[ego.row]) <= near_m
        and not emv_fully_passed(ego, scene.row)
    ]
    way_m, emv_id = min(coming, default=(math.inf, unit.emv_id))
    if emv_id == unit.emv_id:
        return None
    driver = changed(unit.driver, response_distance_m=max(unit.driver.response_distance_m, way_m))
    return changed(unit, emv_id=emv_id, driver=driver, off_path_steps=0)


def _answer(unit: YieldUnit, ego: Ego, scenes: dict[int, _EmvScene]) -> YieldStep:
    """One step of a driver that responds to its EMV."""
    emv = _emv_of(unit, ego, scenes)
    if unit.phase is Mode.NOMINAL:
        return YieldStep(None if release_reason(emv) else unit)
    waits = not emv.passed and emv_waits_behind(ego, emv.row)
    if waits or unit.emv_waits_steps:
        unit = changed(unit, emv_waits_steps=unit.emv_waits_steps + 1 if waits else 0)
    return _PHASES.get(unit.phase, _before_start)(unit, ego, emv)


def _before_start(unit: YieldUnit, ego: Ego, emv: EmvView) -> YieldStep:
    """Before the manoeuvre: cancelled if no EMV is left to yield to, otherwise started after the reaction time."""
    off_path = 0 if emv.on_path else unit.off_path_steps + 1
    if off_path != unit.off_path_steps:
        unit = changed(unit, off_path_steps=off_path)
    grace = steps_from_s(OFF_PATH_GRACE_S)
    reason = release_reason(emv) or ("off_path" if off_path > grace else "")
    if reason:
        return YieldStep(None, None, (yield_event(unit, ego, EventKind.YIELD_CANCELLED, reason=reason),))
    if ego.step < unit.react_step:
        return YieldStep(unit)
    if ego.world.policy.response is CivilianResponse.PULL_OVER:
        return start_pull_over(unit, ego)
    return start_lane_change(unit, ego)


_PHASES: Final[Mapping[Mode, Callable[[YieldUnit, Ego, EmvView], YieldStep]]] = {
    Mode.YIELD_LANE_CHANGE: change_lane,
    Mode.YIELD_KEEP_LANE: keep_lane,
    Mode.YIELD_PULL_OVER: pull_over,
    Mode.YIELD_HOLD: hold,
    Mode.REJOIN: lambda unit, ego, _: rejoin(unit, ego),
}


_TURNED_OFF_M: Final = 15.0
"""An EMV farther than this whose path no longer passes a vehicle has turned off."""


def _emv_of(unit: YieldUnit, ego: Ego, scenes: dict[int, _EmvScene]) -> EmvView:
    scene = scenes.get(unit.emv_id)
    if scene is None:
        return EmvView(-1, False, False, False, False)
    way, route = scene.way_m[ego.row], ego.route
    # On a junction, the route begins with the edge before it, which an EMV on that junction has left.
    ahead = math.isfinite(scene.road_m[ego.row]) or (len(route) > 0 and int(route[0]) in scene.edges_ahead)
    config, apart_m = ego.civilian_driver.pull_over, ego.distance_m(scene.row)
    slow = float(ego.seen.speed_mps[scene.row]) < config.stays_behind_mps
    return EmvView(
        row=scene.row,
        passed=emv_fully_passed(ego, scene.row),
        in_region=unit.actor_id in scene.members or _responds(unit, ego, scene.row),
        on_path=math.isfinite(way) and way > -2.0 * ego.half_length_m,
        on_road=scene.on_road[ego.row],
        dawdles=slow and apart_m < config.stays_behind_m,
        turned_off=apart_m > _TURNED_OFF_M and len(route) > 0 and not ahead,
    )


def _responds(unit: YieldUnit, ego: Ego, emv_row: int) -> bool:
    """Whether a driver that noticed the EMV beyond the interaction region is still near enough."""
    seen, constants = ego.seen, ego.world.constants
    bumpers = ego.half_length_m + float(seen.half_length_m[emv_row])
    hysteresis = constants.region_leave_m - constants.region_enter_m
    return ego.distance_m(emv_row) <= unit.driver.response_distance_m + bumpers + hysteresis


def _command_row(unit: YieldUnit, ego: Ego, command: DriveCommand | None) -> CommandRow:
    owner = Owner.SUMO if command is None else Owner.ROS
    turns = unit.side if unit.phase not in {Mode.YIELD_REACTING, Mode.YIELD_KEEP_LANE} else 0
    return unit.actor_id, owner, *(command or _COAST), unit.phase, ego.indicators(turns)
