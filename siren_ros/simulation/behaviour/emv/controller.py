"""Control of the EMV at each step (paper, Algorithm 1): guards, evaluated from top to bottom."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from siren_ros.base.numerics.changed import changed
from siren_ros.base.numerics.units import steps_from_s
from siren_ros.simulation.behaviour.driving.emv_unit import EmvUnit, Guard, GuardResult, plan_route, present_lane
from siren_ros.simulation.behaviour.driving.navigator import DriveCommand
from siren_ros.simulation.behaviour.driving.speed_mechanisms import navigate
from siren_ros.simulation.behaviour.driving.step_view import ActorTable, BehaviourWorld, Ego
from siren_ros.simulation.behaviour.emv.forced_lane_change import (
    cancel_lane_change,
    complete_lane_change,
    forced_lane_change,
)
from siren_ros.simulation.behaviour.emv.gap_escape import (
    escape_path,
    escape_speed_mps,
    gap_escape_mode,
    lane_change_stuck,
)
from siren_ros.simulation.behaviour.emv.rescue_corridor import corridor_mode, corridor_path
from siren_ros.simulation.behaviour.paths.lane_path import LaneEnd
from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.world.actors import Lights, Mode, Owner
from siren_ros.simulation.world.commands import CommandRow, VehicleCommands
from siren_ros.simulation.world.traffic_state import Event, TrafficState

SOURCE: Final = "emv_controller"


@dataclass(frozen=True, eq=False)
class EmvState:
    """State of all emergency vehicles by id, and the descriptions of all actors."""

    units: Mapping[int, EmvUnit] = field(default_factory=dict)
    actors: ActorTable = field(default_factory=ActorTable.empty)


def step_emv(state: EmvState, traffic: TrafficState, world: BehaviourWorld) -> tuple[EmvState, VehicleCommands]:
    """One step of every EMV that is in traffic.

    Returns:
        The next state, and one command row per EMV, owned by ROS. At a level without privilege (L0) SUMO drives the
        EMV and there are no rows.
    """
    traffic = world.seen(traffic)
    if not world.policy.privileged:
        return EmvState({}, state.actors.updated(traffic)), VehicleCommands.empty(traffic.step, SOURCE)
    view = world.view(traffic, state.actors)
    units: dict[int, EmvUnit] = {}
    rows: list[CommandRow] = []
    events: tuple[Event, ...] = ()
    for row in view.seen.is_emv.nonzero()[0].tolist():
        actor_id = int(traffic.actor_id[row])
        ego = view.ego(row)
        unit, command, happened = _step_unit(state.units.get(actor_id, EmvUnit(actor_id)), ego)
        units[actor_id] = unit
        lights = ego.indicators(unit.change_side)
        lights |= Lights.BEACON | Lights.SIREN if world.policy.siren else Lights.NONE
        rows.append((actor_id, Owner.ROS, *command, mode_of(unit), int(lights)))
        events += happened
    commands = VehicleCommands.of(traffic.step, SOURCE, rows, events)
    return EmvState(units, view.actors), world.said(commands)


def mode_of(unit: EmvUnit) -> Mode:
    """Active behaviour, by priority."""
    if unit.gap_escape_active:
        return Mode.GAP_ESCAPE
    if unit.corridor:
        return Mode.COPY_SUMO
    return Mode.FORCED_LANE_CHANGE if unit.lane_change_forced else Mode.ROUTE_FOLLOW


def target_speed_mps(unit: EmvUnit, ego: Ego) -> float:
    """Guard 5: target speed by priority (paper, table of target speeds)."""
    if unit.gap_escape_active:
        return escape_speed_mps(unit, ego)
    speeds = ego.world.speeds
    if unit.corridor:
        return speeds.emv_copy_sumo_mps
    return speeds.emv_lane_change_mps if unit.lane_change_forced else speeds.emv_route_follow_mps


def _step_unit(unit: EmvUnit, ego: Ego) -> tuple[EmvUnit, DriveCommand, tuple[Event, ...]]:
    guards: tuple[Guard, ...] = (forced_lane_change, waypoints, complete_lane_change)
    guards = (gap_escape_mode, corridor_mode, *guards) if ego.world.policy.corridor else (lane_change_stuck, *guards)
    events: tuple[Event, ...] = ()
    for guard in guards:
        unit, happened = guard(unit, ego)
        events += happened
    navigator, command, blocker_id = navigate(unit, ego, target_speed_mps(unit, ego), ego.world.emv_navigator)
    return changed(unit, navigator=navigator, blocker_id=blocker_id), command, events


def waypoints(unit: EmvUnit, ego: Ego) -> GuardResult:
    """Guard 4: the path comes from the gap escape, the corridor, or the route, in this order."""
    if unit.gap_escape_active:
        return escape_path(unit, ego)
    if unit.corridor:
        return corridor_path(unit, ego), ()
    return follow_route(unit, ego)


_REBUILD_BELOW_M: Final = 80.0
"""The path is extended if less than this remains."""
OFF_PATH_M: Final = 1.5
"""Beyond this distance from the path it is planned again from the present pose."""
_REPLAN_S: Final = 1.0
"""Least time between two plans if SUMO's route and the path disagree."""


def follow_route(unit: EmvUnit, ego: Ego) -> GuardResult:
    """Give the EMV a path along its route: the present one while it is useful, otherwise a new one."""
    navigator = unit.navigator
    plan, path = unit.plan, navigator.path
    events: tuple[Event, ...] = ()
    if plan is None or path is None:
        lane = present_lane(ego, navigator)
    elif abs(navigator.left_m) > OFF_PATH_M or not plan.agrees_with(ego.route):
        if ego.step - plan.planned_step < steps_from_s(_REPLAN_S):
            return unit, ()
        lane = ego.lane
        unit, events = cancel_lane_change(unit, ego, "off_path")
    else:
        ends = plan.end is LaneEnd.HORIZON and navigator.remaining_m < ego.far_m(_REBUILD_BELOW_M)
        if not ends or navigator.progress_m <= path.settled_m:
            return unit, ()
        lane = present_lane(ego, navigator)
    if lane == NO_LANE:
        return unit, events
    plan, navigator = plan_route(ego, lane, navigator)
    return changed(unit, plan=plan, navigator=navigator), events
