"""The civilians' per-step yield control (paper, Algorithm 2): who notices an EMV, and what each one does about it."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.behaviour.civilians.interaction_region import EmvRoad, InteractionRegion, region_members, way_from_emv_m
from siren_ros.behaviour.civilians.pull_over import emv_waits_behind, hold, pull_over, start_pull_over
from siren_ros.behaviour.civilians.rejoin import rejoin
from siren_ros.behaviour.civilians.yield_lane_change import change_lane, keep_lane, start_lane_change
from siren_ros.behaviour.driving.civilian_unit import (
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
from siren_ros.behaviour.driving.navigator import DriveCommand
from siren_ros.behaviour.driving.step_view import ActorTable, BehaviourWorld, Ego, StepView, Surroundings
from siren_ros.numerics.arrays import Floats, Ids
from siren_ros.numerics.units import steps_from_s
from siren_ros.scenario.paper import CivilianResponse
from siren_ros.world.actors import Lights, Mode, Owner, rows_of_ids
from siren_ros.world.commands import VehicleCommands
from siren_ros.world.traffic_state import Event, EventKind, TrafficState

SOURCE: Final = "yield_manager"
_COAST: Final = DriveCommand(throttle=0.0, brake=0.0, steer_rad=0.0, hand_brake=False)
"""Filler of rows that SUMO owns."""


@dataclass(frozen=True, eq=False)
class YieldState:
    """All civilians that respond, by id, their drivers, and the regions of all EMVs, by the EMV's id."""

    units: Mapping[int, YieldUnit] = field(default_factory=dict)
    drivers: Mapping[int, Driver] = field(default_factory=dict)
    regions: Mapping[int, InteractionRegion] = field(default_factory=dict)
    actors: ActorTable = field(default_factory=ActorTable.empty)

    @classmethod
    def initial(cls) -> "YieldState":
        """Before the first step."""
        return cls()


@dataclass(frozen=True, eq=False)
class _EmvScene:
    """One EMV at one step, with the distance from it to every vehicle."""

    row: int
    members: Ids
    way_m: Floats
    """Along the lanes that the EMV will drive on (L2) or any lane of its road (L3); infinite elsewhere."""
    on_road: npt.NDArray[np.bool_]


def step_yield(state: YieldState, traffic: TrafficState, world: BehaviourWorld) -> tuple[YieldState, VehicleCommands]:
    """One step of all civilians.

    Args:
        state: Latched state.
        traffic: SUMO's state and the simulated poses.
        world: Level, preset, constants and road network.

    Returns:
        The next state, and one row per civilian in any phase of a yield: owned by ROS while the navigator drives,
        by SUMO while the driver reacts, waits for a gap or keeps its new lane.
    """
    actors = state.actors.updated(traffic)
    if world.policy.response is CivilianResponse.NOMINAL:
        return YieldState(actors=actors), VehicleCommands.empty(traffic.step, SOURCE)
    view = StepView(world, traffic, Surroundings.seen(traffic, actors, world.courses), actors)
    regions, scenes = _regions(state, view)
    units = dict(state.units)
    drivers = dict(state.drivers)
    events: list[Event] = list(_notice(units, drivers, scenes, view))
    commands: dict[int, tuple[YieldUnit, DriveCommand | None]] = {}
    left: dict[int, YieldUnit] = {}
    ids = np.array(sorted(units), dtype=np.uint32)
    for actor_id, row in zip(ids.tolist(), rows_of_ids(traffic.actor_id, ids).tolist(), strict=True):
        if row < 0:
            continue
        outcome = _step_unit(units[actor_id], view.ego(row), scenes)
        events.extend(outcome.events)
        if outcome.unit is not None:
            left[actor_id] = outcome.unit
            if outcome.unit.phase is not Mode.NOMINAL:
                commands[actor_id] = (outcome.unit, outcome.command)
    return YieldState(left, drivers, regions, actors), _rows(commands, traffic.step, tuple(events))


def _regions(state: YieldState, view: StepView) -> tuple[dict[int, InteractionRegion], dict[int, _EmvScene]]:
    constants, seen = view.world.constants, view.seen
    regions: dict[int, InteractionRegion] = {}
    scenes: dict[int, _EmvScene] = {}
    whole_road = view.world.policy.response is CivilianResponse.PULL_OVER
    for row in np.flatnonzero(seen.is_emv).tolist():
        emv_id = int(seen.actor_id[row])
        before = state.regions.get(emv_id)
        road = EmvRoad.ahead_of(view.ego(row), before.road if before is not None else None)
        known = before.members if before is not None else np.empty(0, dtype=np.uint32)
        members = region_members(seen, row, known, constants)
        regions[emv_id] = InteractionRegion(road, members)
        if road is None:
            continue
        lane = view.traffic.lane
        edge_of_lane = view.world.edge_of_lane
        way = way_from_emv_m(view, row, road.road_start_m if whole_road else road.lane_start_m)
        on_road = np.where(lane >= 0, road.on_road[edge_of_lane[lane]], False)
        scenes[emv_id] = _EmvScene(row, members, way, on_road)
    return regions, scenes


def _notice(
    units: dict[int, YieldUnit], drivers: dict[int, Driver], scenes: dict[int, _EmvScene], view: StepView
) -> list[Event]:
    """Latches the civilians that notice an EMV at this step (adds to ``units`` and ``drivers``)."""
    world, seen = view.world, view.seen
    events: list[Event] = []
    for emv_id, scene in scenes.items():
        candidates = np.isfinite(scene.way_m) & ~seen.is_emv
        candidates &= (scene.way_m > -2.0 * seen.half_length_m) & (seen.actor_id != world.av_id)
        for row in np.flatnonzero(candidates).tolist():
            actor_id = int(seen.actor_id[row])
            if actor_id in units:
                continue
            driver = drivers.get(actor_id)
            if driver is None:
                driver = drivers[actor_id] = draw_driver(world.preset, world.seed, actor_id)
            if scene.way_m[row] > driver.response_distance_m:
                continue
            refuses = driver.compliance is Compliance.NEVER
            unit = YieldUnit(
                actor_id=actor_id,
                emv_id=emv_id,
                driver=driver,
                react_step=view.step + steps_from_s(driver.delay_s),
                phase=Mode.NOMINAL if refuses else Mode.YIELD_REACTING,
            )
            units[actor_id] = unit
            detail = {"way_m": float(scene.way_m[row]), "compliance": driver.compliance.value}
            events.append(yield_event(unit, view.ego(row), EventKind.YIELD_REQUESTED, **detail))
    return events


def _step_unit(unit: YieldUnit, ego: Ego, scenes: dict[int, _EmvScene]) -> YieldStep:
    emv = _emv_of(unit, ego, scenes)
    if unit.phase is Mode.NOMINAL:
        return YieldStep(None if release_reason(emv) else unit)
    waits = not emv.passed and emv_waits_behind(ego, emv.row)
    if waits or unit.emv_waits_steps:
        unit = replace(unit, emv_waits_steps=unit.emv_waits_steps + 1 if waits else 0)
    return _PHASES.get(unit.phase, _before_start)(unit, ego, emv)


def _before_start(unit: YieldUnit, ego: Ego, emv: EmvView) -> YieldStep:
    """Reacting or deferred: cancelled if there is nobody left to yield to, otherwise started once the driver reacts."""
    off_path = 0 if emv.on_path else unit.off_path_steps + 1
    if off_path != unit.off_path_steps:
        unit = replace(unit, off_path_steps=off_path)
    grace = steps_from_s(ego.config.yielding.off_path_grace_s)
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


def _emv_of(unit: YieldUnit, ego: Ego, scenes: dict[int, _EmvScene]) -> EmvView:
    scene = scenes.get(unit.emv_id)
    if scene is None:
        return EmvView(-1, False, False, False, False)
    way = scene.way_m[ego.row]
    return EmvView(
        row=scene.row,
        passed=emv_fully_passed(ego, scene.row),
        in_region=unit.actor_id in scene.members or _responds(unit, ego, scene.row),
        on_path=bool(np.isfinite(way) and way > -2.0 * ego.half_length_m),
        on_road=bool(scene.on_road[ego.row]),
    )


def _responds(unit: YieldUnit, ego: Ego, emv_row: int) -> bool:
    """Whether a driver who noticed the EMV beyond the interaction region is still near enough to it."""
    seen, constants = ego.seen, ego.world.constants
    bumpers = ego.half_length_m + float(seen.half_length_m[emv_row])
    hysteresis = constants.region_leave_m - constants.region_enter_m
    distance = math.hypot(*(float(axis[ego.row] - axis[emv_row]) for axis in (seen.x_m, seen.y_m)))
    return distance <= unit.driver.response_distance_m + bumpers + hysteresis


def _rows(
    commands: dict[int, tuple[YieldUnit, DriveCommand | None]], step: int, events: tuple[Event, ...]
) -> VehicleCommands:
    rows = []
    for actor_id, (unit, command) in commands.items():
        owner = Owner.SUMO if command is None else Owner.ROS
        rows.append((actor_id, owner, *(command or _COAST), unit.phase, _lights(unit)))
    return VehicleCommands.of(step, SOURCE, rows, events)


def _lights(unit: YieldUnit) -> int:
    if unit.phase in {Mode.YIELD_REACTING, Mode.YIELD_KEEP_LANE} or unit.side == 0:
        return int(Lights.NONE)
    return int(Lights.INDICATOR_LEFT if unit.side > 0 else Lights.INDICATOR_RIGHT)
