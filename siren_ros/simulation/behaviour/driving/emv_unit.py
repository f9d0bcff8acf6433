"""State of one emergency vehicle (route, flags), and the result of its guards.

A guard (paper, Algorithm 1) is one of the steps that are evaluated from top to bottom.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import groupby
from typing import Final, TypeAlias

from siren_ros.base.numerics.units import NEVER
from siren_ros.simulation.behaviour.driving.lane_change import Refusal
from siren_ros.simulation.behaviour.driving.navigator import NavigatorState
from siren_ros.simulation.behaviour.driving.step_view import Ego, StepView
from siren_ros.simulation.behaviour.paths.lane_path import LaneEnd, changes_needed
from siren_ros.simulation.behaviour.paths.tracked_path import blend_length_m, on_reference, path_onto
from siren_ros.simulation.roads.road_network import NO_LANE, LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import NO_ACTOR
from siren_ros.simulation.world.traffic_state import EmvAdvice, Event, EventKind, Indices


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
