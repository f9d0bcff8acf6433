"""The EMV's per-step control (paper, Algorithm 1): guarded overrides, evaluated top to bottom over latched flags."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from siren_ros.behaviour.driving.navigator import DriveCommand, DriveInputs, navigate
from siren_ros.behaviour.driving.step_view import ActorTable, BehaviourWorld, StepView, Surroundings
from siren_ros.behaviour.emv.forced_lane_change import (
    cancel_lane_change,
    complete_lane_change,
    forced_lane_change,
)
from siren_ros.behaviour.emv.gap_escape import escape_path, escape_speed_mps, gap_escape_mode
from siren_ros.behaviour.emv.rescue_corridor import corridor_mode, corridor_path
from siren_ros.behaviour.emv.speed_limits import anticipated_limit, entry_limit_mps, passage_blocker, passage_limit
from siren_ros.behaviour.emv.unit import EmvUnit, Guard, GuardResult, plan_route, present_lane
from siren_ros.behaviour.paths.lane_path import LaneEnd
from siren_ros.numerics.units import steps_from_s
from siren_ros.roads.road_network import NO_LANE
from siren_ros.world.actors import Lights, Mode, Owner
from siren_ros.world.commands import VehicleCommands
from siren_ros.world.traffic_state import Event, TrafficState

SOURCE: Final = "emv_controller"
_REPLAN_STEPS: Final = steps_from_s(1.0)
"""Least time between two plans where SUMO's route and the path disagree."""


@dataclass(frozen=True, eq=False)
class EmvState:
    """All emergency vehicles, by id, and the descriptions of all actors."""

    units: Mapping[int, EmvUnit] = field(default_factory=dict)
    actors: ActorTable = field(default_factory=ActorTable.empty)

    @classmethod
    def initial(cls) -> "EmvState":
        """Before the first step."""
        return cls()


def step_emv(state: EmvState, traffic: TrafficState, world: BehaviourWorld) -> tuple[EmvState, VehicleCommands]:
    """One step of every EMV that is in traffic.

    Args:
        state: Latched state.
        traffic: SUMO's state and the simulated poses.
        world: Level, constants and road network.

    Returns:
        The next state, and one command row per EMV, owned by ROS. At a level without privilege (L0) SUMO drives the
        EMV and there are no rows.
    """
    actors = state.actors.updated(traffic)
    if not world.policy.privileged:
        return EmvState({}, actors), VehicleCommands.empty(traffic.step, SOURCE)
    view = StepView(world, traffic, Surroundings.seen(traffic, actors, world.courses), actors)
    units: dict[int, EmvUnit] = {}
    drives: list[tuple[EmvUnit, DriveCommand]] = []
    events: list[Event] = []
    for row in np.flatnonzero(view.seen.is_emv).tolist():
        actor_id = int(traffic.actor_id[row])
        unit, command, happened = _step_unit(state.units.get(actor_id, EmvUnit(actor_id)), view, row)
        units[actor_id] = unit
        drives.append((unit, command))
        events.extend(happened)
    return EmvState(units, actors), _commands(drives, view, tuple(events))


def mode_of(unit: EmvUnit) -> Mode:
    """The active behaviour, by priority."""
    if unit.gap_escape_active:
        return Mode.GAP_ESCAPE
    if unit.corridor:
        return Mode.COPY_SUMO
    return Mode.FORCED_LANE_CHANGE if unit.lane_change_forced else Mode.ROUTE_FOLLOW


def target_speed_mps(unit: EmvUnit, view: StepView) -> float:
    """Guard 5: target speed by priority (paper, table of target speeds)."""
    if unit.gap_escape_active:
        return escape_speed_mps(unit, view)
    speeds = view.world.speeds
    return {
        Mode.COPY_SUMO: speeds.emv_copy_sumo_mps,
        Mode.FORCED_LANE_CHANGE: speeds.emv_lane_change_mps,
    }.get(mode_of(unit), speeds.emv_route_follow_mps)


def _step_unit(unit: EmvUnit, view: StepView, row: int) -> tuple[EmvUnit, DriveCommand, tuple[Event, ...]]:
    guards: tuple[Guard, ...] = (forced_lane_change, waypoints, complete_lane_change)
    if view.world.policy.corridor:
        guards = (gap_escape_mode, corridor_mode, *guards)
    events: tuple[Event, ...] = ()
    for guard in guards:
        unit, happened = guard(unit, view, row)
        events += happened
    between = unit.corridor or unit.gap_escape_active
    limit = passage_limit(unit, view, row) if between else anticipated_limit(unit, view, row)
    limit = replace(limit, speed_mps=min(limit.speed_mps, entry_limit_mps(view, row)))
    situation = DriveInputs(
        seen=view.seen,
        row=row,
        vehicle=view.vehicle(row),
        target_mps=target_speed_mps(unit, view),
        watch=not unit.gap_escape_active,
        watch_leaders=not between,
        limit=limit,
    )
    navigator, command, snapshot = navigate(unit.navigator, situation, view.world.emv_navigator)
    return replace(unit, navigator=navigator, snapshot=passage_blocker(snapshot, limit)), command, events


def waypoints(unit: EmvUnit, view: StepView, row: int) -> GuardResult:
    """Guard 4: the path comes from the gap escape, the corridor, or the route, in this order."""
    if unit.gap_escape_active:
        return escape_path(unit, view, row)
    if unit.corridor:
        return corridor_path(unit, view, row), ()
    return follow_route(unit, view, row)


def follow_route(unit: EmvUnit, view: StepView, row: int) -> GuardResult:
    """The EMV with a path along its route: the present one while it serves, else a new one from the present pose."""
    config, navigator = view.world.config.emv, unit.navigator
    plan, path = unit.plan, navigator.path
    events: tuple[Event, ...] = ()
    if plan is None or path is None:
        lane = present_lane(view, row, navigator)
    elif abs(navigator.left_m) > config.off_path_m or not plan.agrees_with(view.traffic.route_of_row(row)):
        if view.step - plan.planned_step < _REPLAN_STEPS:
            return unit, ()
        lane = int(view.traffic.lane[row])
        unit, events = cancel_lane_change(unit, view, row, "off_path")
    elif (
        plan.end is LaneEnd.HORIZON
        and navigator.remaining_m < config.rebuild_below_m
        and navigator.progress_m > path.settled_m
    ):
        lane = present_lane(view, row, navigator)
    else:
        return unit, ()
    if lane == NO_LANE:
        return unit, events
    plan, navigator = plan_route(view, row, lane, navigator)
    return replace(unit, plan=plan, navigator=navigator), events


def _commands(drives: list[tuple[EmvUnit, DriveCommand]], view: StepView, events: tuple[Event, ...]) -> VehicleCommands:
    lights = [_lights(unit, view.world) for unit, _ in drives]
    return VehicleCommands(
        step=view.step,
        source=SOURCE,
        actor_id=np.array([unit.actor_id for unit, _ in drives], dtype=np.uint32),
        owner=np.full(len(drives), Owner.ROS, dtype=np.uint8),
        throttle=np.array([command.throttle for _, command in drives], dtype=np.float64),
        brake=np.array([command.brake for _, command in drives], dtype=np.float64),
        steer_rad=np.array([command.steer_rad for _, command in drives], dtype=np.float64),
        hand_brake=np.array([command.hand_brake for _, command in drives], dtype=np.uint8),
        mode=np.array([mode_of(unit) for unit, _ in drives], dtype=np.uint8),
        lights=np.array(lights, dtype=np.uint8),
        events=events,
    )


def _lights(unit: EmvUnit, world: BehaviourWorld) -> int:
    lights = Lights.BEACON | Lights.SIREN if world.policy.siren else Lights.NONE
    if unit.change_side > 0:
        lights |= Lights.INDICATOR_LEFT
    elif unit.change_side < 0:
        lights |= Lights.INDICATOR_RIGHT
    return int(lights)
