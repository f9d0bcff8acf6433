"""The latched state of one emergency vehicle."""

from dataclasses import dataclass, field

from siren_ros.behaviour.driving.collision_watch import CollisionSnapshot
from siren_ros.behaviour.driving.lane_change import Refusal
from siren_ros.behaviour.driving.navigator import NavigatorState
from siren_ros.behaviour.driving.situation import StepView
from siren_ros.behaviour.emv.route import RoutePlan
from siren_ros.numerics.units import NEVER
from siren_ros.world.actors import NO_ACTOR
from siren_ros.world.events import Event, EventKind
from siren_ros.world.traffic_state import EmvAdvice


@dataclass(frozen=True)
class LateralRequest:
    """A wish for a lane change, alive while it is repeated."""

    side: int = 0
    reason: str = ""
    seen_step: int = NEVER
    deferred: Refusal | None = None
    """Why it could not be executed when it was last looked at."""


@dataclass(frozen=True, eq=False)
class EmvUnit:
    """Latched flags, timers and the navigator of one EMV (``emv_state`` in the paper's Algorithm 1)."""

    actor_id: int
    navigator: NavigatorState = field(default_factory=NavigatorState)
    plan: RoutePlan | None = None
    """The route that the navigator's path follows; None while the path comes from elsewhere."""
    snapshot: CollisionSnapshot | None = None
    """Who blocked the way at the last step."""
    stopped_s: float = 0.0
    blocker_free_s: float = 0.0
    gap_escape_active: bool = False
    escape_planned_step: int = NEVER
    escape_offset_m: float | None = None
    """Where the escape path leads beside the route; None while no free path exists."""
    escape_clearance_m: float = 0.0
    """Margin that the escape path keeps."""
    corridor: bool = False
    corridor_seen_step: int = NEVER
    corridor_planned_step: int = NEVER
    change_side: int = 0
    """Side of the forced lane change under way (``lane_change_forced``), 0 without one."""
    change_step: int = NEVER
    """Start of the last forced lane change."""
    request: LateralRequest = field(default_factory=LateralRequest)

    @property
    def lane_change_forced(self) -> bool:
        """Whether a forced lane change is under way."""
        return self.change_side != 0


def advice_of(view: StepView, actor_id: int) -> EmvAdvice | None:
    """SUMO's advice to an EMV."""
    return next((advice for advice in view.traffic.emvs if advice.actor_id == actor_id), None)


def event_of(view: StepView, row: int, kind: EventKind, other_id: int = NO_ACTOR, **detail: float | str) -> Event:
    """An event of the actor in a row at its present place."""
    x, y, _ = view.pose(row)
    return Event(view.step, kind, int(view.seen.actor_id[row]), other_id, x, y, detail)
