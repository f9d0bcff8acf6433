"""State of each driver that SUMO does not drive: of an EMV and of a yielding civilian.

A guard (paper, Algorithms 1 and 2) is one of the steps that are evaluated from top to bottom; the end of this file
explains which of them act at one step, and why the others do not. Each civilian's driver is one draw from the episode's
seed. A yield ends by the paper's rule (Algorithm 2, "Release (both levels)"): when the EMV has fully passed.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import groupby
from typing import Final, NamedTuple, TypeAlias

from siren_ros.base.numerics.arrays import changed, random_stream
from siren_ros.base.numerics.units import NEVER, STEP_S
from siren_ros.simulation.behaviour.driving.lane_path import changes_needed, lane_heading
from siren_ros.simulation.behaviour.driving.navigator import DriveCommand, NavigatorState
from siren_ros.simulation.behaviour.driving.step_view import BehaviourWorld, Ego, StepView
from siren_ros.simulation.behaviour.driving.tracked_path import LaneEnd, blend_length_m, on_reference, path_onto
from siren_ros.simulation.roads.road_network import NO_LANE, LaneKind, RoadNetwork
from siren_ros.simulation.scenario.paper import CivilianResponse
from siren_ros.simulation.scenario.presets import DriverPreset
from siren_ros.simulation.world.actors import NO_ACTOR, EmvAdvice, Event, EventKind, Indices, Mode


class Refusal(StrEnum):
    """Reason why a lane change is not feasible at a step."""

    NO_LANE = "no_lane"
    JUNCTION = "junction"
    NO_ROOM = "no_room"
    ASTRAY = "leads_astray"
    BESIDE = "vehicle_beside"
    GAP_FRONT = "gap_front"
    GAP_REAR = "gap_rear"
    TURNING = "turning"
    """The vehicle is still turning onto its road."""


class Compliance(StrEnum):
    """Whether and when a driver yields."""

    COMPLIES = "complies"
    LATE = "late"
    NEVER = "never"


@dataclass(frozen=True)
class Driver:
    """One driver's response to a siren."""

    compliance: Compliance
    delay_s: float
    """Time from noticing the siren to the start of the manoeuvre, including the extra delay of late drivers."""
    response_distance_m: float
    """Free distance between the EMV's front and the vehicle's rear at which the driver notices the siren."""


def draw_driver(preset: DriverPreset, seed: int, actor_id: int) -> Driver:
    """The driver of one actor; the same for the same preset, seed and actor whatever else is drawn."""
    rng = random_stream(seed, "driver", actor_id)
    delay = preset.reaction_delay_s.draw(rng)
    late = preset.late_delay_s.draw(rng)
    distance = preset.response_distance_m.draw(rng)
    share = float(rng.random())
    if share < preset.compliance.complies:
        return Driver(Compliance.COMPLIES, delay, distance)
    if share < preset.compliance.complies + preset.compliance.late:
        return Driver(Compliance.LATE, delay + late, distance)
    return Driver(Compliance.NEVER, delay, distance)


@dataclass(frozen=True, eq=False)
class YieldUnit:
    """Flags and planner of one civilian (paper, Algorithm 2); the flags keep their values between steps."""

    actor_id: int
    emv_id: int
    driver: Driver
    react_step: int
    """Step at which the reaction time ends."""
    phase: Mode = Mode.YIELD_REACTING
    """NOMINAL for a driver that does not comply, until the EMV has passed."""
    side: int = 0
    """Side to which the vehicle goes: +1 left, −1 right (``alignment`` at L3)."""
    navigator: NavigatorState = field(default_factory=NavigatorState)
    deferred: str = ""
    """Reason why the yield could not start at the last check."""
    change_step: int = NEVER
    """Start of the last forced lane change."""
    off_path_steps: int = 0
    stopped_steps: int = 0
    in_lane_steps: int = 0
    """Number of steps with the EMV in the new lane: it has followed."""
    deferred_step: int = NEVER
    """Start of the current deferral."""
    seek: int = 0
    """How a gap is sought while deferred: +1 draw ahead, −1 fall back, 0 not at all."""
    emv_waits_steps: int = 0
    """Number of steps for which the EMV has stood behind the vehicle."""
    partial: bool = False
    """Whether the pull-over ended early behind a standing vehicle."""


@dataclass(frozen=True, eq=False)
class EmvView:
    """The EMV of one civilian at one step."""

    row: int
    """Row of the EMV; −1 after it has left the simulation."""
    passed: bool
    """The paper's condition ``EmvFullyPassed``."""
    in_region: bool
    on_path: bool
    """Whether the civilian is on lanes that the EMV will use (L2), or on any lane of its road (L3)."""
    on_road: bool
    """Whether the civilian is still on the EMV's road."""
    dawdles: bool = False
    """Whether the EMV is near and slow."""
    turned_off: bool = False
    """Whether the EMV is far and its path no longer passes the civilian."""


@dataclass(frozen=True)
class YieldStep:
    """Result of one step for a civilian; ``unit`` is None when SUMO drives it as before."""

    unit: YieldUnit | None
    command: DriveCommand | None = None
    """Command of the driver; None while SUMO drives."""
    events: tuple[Event, ...] = ()

    def preceded_by(self, *events: Event) -> "YieldStep":
        """The same result with earlier events in front."""
        return changed(self, events=(*events, *self.events))


def yield_event(unit: YieldUnit, ego: Ego, kind: EventKind, **detail: float | str) -> Event:
    """An event of a yielding civilian, with the EMV as the second actor."""
    return Event(ego.step, kind, unit.actor_id, unit.emv_id, *ego.place, detail)


def lane_of(unit: YieldUnit, ego: Ego) -> int:
    """Lane of a civilian: that of its path, or SUMO's if it has no path."""
    return ego.lane if unit.navigator.lane == NO_LANE else unit.navigator.lane


STANDING_MPS: Final = 0.2
"""Speed below which a civilian counts as standing."""


def standing(ego: Ego) -> bool:
    """Whether a vehicle stands still."""
    return ego.speed_mps < STANDING_MPS


_STICK_OUT_M: Final = 0.33
"""How far an end of an aligned vehicle may stick out sideways: the paper's 8° for a car of 4.7 m."""


def aligned_within_rad(ego: Ego) -> float:
    """Heading error within which a vehicle counts as aligned: the paper's, smaller for long vehicles."""
    sideways = _STICK_OUT_M / ego.half_length_m
    return min(ego.world.constants.heading_aligned_rad, sideways)


def release_reason(emv: EmvView) -> str:
    """Reason of a civilian's release: the EMV has passed or has left the interaction region; otherwise empty."""
    if emv.passed:
        return "emv_passed"
    return "" if emv.in_region else "emv_gone"


def emv_fully_passed(ego: Ego, emv_row: int) -> bool:
    """``EmvFullyPassed``: the EMV's rear is ahead of a vehicle's front along the vehicle's lane, by a clearance."""
    seen, (x, y, heading) = ego.seen, ego.pose
    if ego.lane != NO_LANE:
        heading = lane_heading(ego.network.lanes[ego.lane].centre, float(ego.traffic.lane_position_m[ego.row]))
    cos, sin = math.cos(heading), math.sin(heading)
    ahead = cos * (float(seen.x_m[emv_row]) - x) + sin * (float(seen.y_m[emv_row]) - y)
    turned = float(seen.yaw_rad[emv_row]) - heading
    rear = abs(math.cos(turned)) * float(seen.half_length_m[emv_row])
    rear += abs(math.sin(turned)) * float(seen.half_width_m[emv_row])
    return ahead - rear - ego.half_length_m >= ego.world.constants.emv_passed_clearance_m


@dataclass(frozen=True)
class RoutePlan:
    """Lanes that the present path follows."""

    edges: tuple[int, ...]
    """Edges of the path in order, without internal ones."""
    end: LaneEnd
    planned_step: int

    def agrees_with(self, route: Indices) -> bool:
        """Whether the path still follows the route."""
        ahead = tuple(route.tolist())
        if ahead and ahead[0] not in self.edges:  # the vehicle is on the junction after the first edge
            ahead = ahead[1:]
        if not ahead or ahead[0] not in self.edges:
            return False
        rest = self.edges[self.edges.index(ahead[0]) :]
        common = min(len(rest), len(ahead))
        return rest[:common] == ahead[:common]


PATH_AHEAD_M: Final = 120.0
"""Least length of a path along the route."""
_PATH_BEHIND_M: Final = 10.0
"""A path begins this far behind the EMV."""
_REJOIN_OFFSET_M: Final = 0.5
"""Smaller offsets are corrected by path tracking."""
_STOP_BEFORE_ROUTE_END_M: Final = 3.0
"""Distance between the EMV's front and the end of its route when it stops."""
_ALIGNED_RAD: Final = 0.3
"""Smaller heading errors are corrected by path tracking."""


def plan_route(
    ego: Ego, lane: int, navigator: NavigatorState, merge_m: float | None = None
) -> tuple[RoutePlan, NavigatorState]:
    """Plan a new path along the route from a lane, which may be an internal one.

    ``merge_m`` is the length of the move onto the lane, by default what offset and speed ask for.
    """
    network = ego.network
    ahead_m = max(PATH_AHEAD_M, 1.5 * ego.far_m(0.0))
    reference = ego.line_along(lane, ahead_m, _PATH_BEHIND_M, length_m=ahead_m + _PATH_BEHIND_M)
    before_m = {LaneEnd.ROUTE: _STOP_BEFORE_ROUTE_END_M, LaneEnd.ASTRAY: 1.0}.get(reference.end)
    shorten = 0.0 if before_m is None else before_m + ego.half_length_m
    stop = reference.end is not LaneEnd.HORIZON
    s, left = reference.curve.project_one(*ego.place)
    aligned = abs(math.remainder(ego.pose[2] - reference.curve.place(s)[2], 2.0 * math.pi)) < _ALIGNED_RAD
    if merge_m is None and abs(left) < _REJOIN_OFFSET_M and aligned:
        path = on_reference(reference, ego.navigator_config, stop, shorten)
    else:
        change = ego.emv_driver.lane_change
        if merge_m is None:
            least = change.duration_s, change.length_min_m
            merge_m = blend_length_m(left, ego.speed_mps, *least, ego.navigator_config)
        path = path_onto(reference, ego.pose, merge_m, ego.navigator_config, stop_at_end=stop, shorten_m=shorten)
    edges = [network.lanes[item].edge for item in reference.lanes]
    edges = [edge for edge, _ in groupby(edge for edge in edges if not network.edges[edge].internal)]
    return RoutePlan(tuple(edges), reference.end, ego.step), navigator.following(path, *ego.place)


def strategic_side(network: RoadNetwork, lane: int, route: Indices) -> int:
    """Side to which a vehicle must change lanes to follow its route: +1 left, −1 right, 0 if not on this edge."""
    position, best = network.lanes[lane].position, network.lanes[best_lane(network, lane, route)].position
    return (best > position) - (best < position)


def present_lane(ego: Ego, navigator: NavigatorState) -> int:
    """Lane of the EMV: that of its path if this follows the route, otherwise SUMO's."""
    lane = navigator.lane
    if lane == NO_LANE:
        return ego.lane
    here = ego.network.lanes[lane]
    return lane if here.kind is LaneKind.INTERNAL or here.edge in ego.route else ego.lane


def best_lane(network: RoadNetwork, lane: int, route: Indices) -> int:
    """Lane of the present edge that serves the route best; of equal ones the nearest.

    An internal lane is returned as is.

    Of lanes as good and as near on both sides, it is the right one.
    """
    here = network.lanes[lane]
    if len(route) == 0 or here.edge != int(route[0]):
        return lane
    needed = changes_needed(network, route, civilian=False)[0]
    if not needed or needed.get(lane) == min(needed.values()):
        return lane
    return min(needed, key=lambda item: (needed[item], abs(network.lanes[item].position - here.position)))


ROUTE: Final = "route"
"""Reason of a lane change that the route needs."""


@dataclass(frozen=True)
class LateralRequest:
    """A wish for a lane change; it ends when it is not repeated."""

    side: int = 0
    reason: str = ""
    seen_step: int = NEVER
    deferred: Refusal | None = None
    """Reason why it was not feasible at the last check."""


@dataclass(frozen=True, eq=False)
class EmvUnit:
    """Flags, timers and navigator of one EMV (``emv_state`` in the paper's Algorithm 1)."""

    actor_id: int
    navigator: NavigatorState = field(default_factory=NavigatorState)
    plan: RoutePlan | None = None
    """Route of the navigator's path; None while the path has another origin."""
    blocker_id: int = NO_ACTOR
    """Actor that blocked the EMV at the last step."""
    stopped_s: float = 0.0
    blocker_free_s: float = 0.0
    gap_escape_active: bool = False
    escape_planned_step: int = NEVER
    escape_offset_m: float | None = None
    """Offset of the escape path next to the route; None while there is no free path."""
    escape_clearance_m: float = 0.0
    """Margin of the escape path."""
    corridor: bool = False
    corridor_seen_step: int = NEVER
    corridor_planned_step: int = NEVER
    change_side: int = 0
    """Side of the current forced lane change (``lane_change_forced``), 0 without one."""
    change_step: int = NEVER
    """Start of the last forced lane change."""
    request: LateralRequest = field(default_factory=LateralRequest)

    @property
    def between(self) -> bool:
        """Whether the EMV drives between other vehicles, in the corridor or a gap escape."""
        return self.corridor or self.gap_escape_active

    @property
    def lane_change_forced(self) -> bool:
        """Whether a forced lane change is under way."""
        return self.change_side != 0


def advice_of(view: StepView, actor_id: int) -> EmvAdvice | None:
    """SUMO's advice to an EMV."""
    return next((advice for advice in view.traffic.emvs if advice.actor_id == actor_id), None)


def event_of(ego: Ego, kind: EventKind, other_id: int = NO_ACTOR, **detail: float | str) -> Event:
    """An event of the EMV at its present position."""
    return Event(ego.step, kind, ego.actor_id, other_id, *ego.place, detail)


GuardResult: TypeAlias = tuple[EmvUnit, tuple[Event, ...]]
"""The EMV after a guard, and the guard's events."""
Guard: TypeAlias = Callable[[EmvUnit, Ego], GuardResult]
"""One guard: takes the EMV's state, and the step as the EMV sees it."""


class GuardState(NamedTuple):
    """Result of one guard at a step."""

    name: str
    acts: bool
    why: str


_ONLY_L3: Final = "this level has no rescue corridor"


def emv_guards(unit: EmvUnit, step: int, world: BehaviourWorld) -> tuple[GuardState, ...]:
    """The guards of Algorithm 1, from top to bottom."""
    source = "gap escape" if unit.gap_escape_active else "rescue corridor" if unit.corridor else "route"
    return (
        GuardState("gap escape", unit.gap_escape_active, _of_escape(unit, world)),
        GuardState("rescue corridor", unit.corridor, _of_corridor(unit, step, world)),
        GuardState("forced lane change", unit.lane_change_forced, _of_lane_change(unit, step, world)),
        GuardState("waypoints", True, f"the path comes from the {source}"),
    )


def _of_escape(unit: EmvUnit, world: BehaviourWorld) -> str:
    constants = world.constants.gap_escape
    if not (world.policy.corridor or unit.between or unit.lane_change_forced):
        return "at this level only from a lane change that stands still"
    if unit.gap_escape_active:
        free = f"{unit.blocker_free_s:.1f} of {constants.blocker_grace_s:g} s free"
        return "no free path yet" if unit.escape_offset_m is None else f"drives past the blocker; {free}"
    if unit.blocker_free_s > 0.0:
        return "nobody blocks the way"
    return f"stands for {unit.stopped_s:.1f} s, enters after {constants.stop_before_entry_s:g} s"


def _of_corridor(unit: EmvUnit, step: int, world: BehaviourWorld) -> str:
    if not world.policy.corridor:
        return _ONLY_L3
    if not unit.corridor:
        return "nobody ahead forms a rescue lane or brakes for the EMV"
    since_s = (step - unit.corridor_seen_step) * STEP_S
    return "vehicles ahead make way" if since_s == 0.0 else f"none has made way for {since_s:.1f} s"


def _of_lane_change(unit: EmvUnit, step: int, world: BehaviourWorld) -> str:
    request, cooldown_s = unit.request, (world.cooldown_steps - step + unit.change_step) * STEP_S
    if unit.between:
        return "not between other vehicles"
    if unit.lane_change_forced:
        return f"to the {_side(unit.change_side)}"
    if request.side == 0:
        return "neither route nor traffic ask for one"
    asked = f"asked for to the {_side(request.side)} ({_words(request.reason)})"
    if request.deferred is not None:
        return f"{asked}, deferred: {_words(request.deferred.value)}"
    return f"{asked}, not before {cooldown_s:.1f} s" if cooldown_s > 0.0 else asked


_DONE: Final = {Mode.YIELD_KEEP_LANE, Mode.YIELD_HOLD, Mode.REJOIN}
_UNDER_WAY: Final = {Mode.YIELD_LANE_CHANGE: "the lane change", Mode.YIELD_PULL_OVER: "the pull-over"}


def civilian_guards(unit: YieldUnit, step: int, world: BehaviourWorld) -> tuple[GuardState, ...]:
    """The guards of Algorithm 2 in the order in which a yield passes them."""
    complies, left_s = unit.driver.compliance is not Compliance.NEVER, (unit.react_step - step) * STEP_S
    pulls_over = world.policy.response is CivilianResponse.PULL_OVER
    heard = f"heard the EMV within {unit.driver.response_distance_m:.0f} m"
    reacts = "this driver does not comply" if not complies else f"{unit.driver.compliance.value}, "
    if complies:
        reacts += f"in {left_s:.1f} s" if left_s > 0.0 else f"{abs(left_s):.1f} s ago"
    return (
        GuardState("notices", True, f"{heard}: EMV {unit.emv_id}" if unit.emv_id != NO_ACTOR else heard),
        GuardState("reacts", complies and left_s <= 0.0, reacts),
        GuardState("pulls over" if pulls_over else "changes lane", unit.phase in _UNDER_WAY, _of_manoeuvre(unit)),
        GuardState("holds" if pulls_over else "keeps its lane", unit.phase in _DONE - {Mode.REJOIN}, _of_end(unit)),
        GuardState("rejoins", unit.phase is Mode.REJOIN, "once the EMV has passed, or is gone"),
    )


def _of_manoeuvre(unit: YieldUnit) -> str:
    if unit.phase in _UNDER_WAY:
        return f"to the {_side(unit.side)}"
    if unit.deferred:
        return f"deferred: {_words(unit.deferred)}"
    return "done" if unit.phase in _DONE else "not begun"


def _of_end(unit: YieldUnit) -> str:
    under_way = _UNDER_WAY.get(unit.phase)
    if under_way:
        return f"{under_way} is not finished"
    return "until the EMV has passed" if unit.phase in _DONE else "not begun"


def _side(side: int) -> str:
    return "left" if side > 0 else "right"


def _words(name: str) -> str:
    return name.replace("_", " ")
