"""State of one yielding civilian: its driver, its flags, and the rule of its release.

Each driver is one draw from the episode's seed. The release rule is the paper's (Algorithm 2, "Release (both
levels)"): a yield ends when the EMV has fully passed.
"""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.base.numerics.changed import changed
from siren_ros.base.numerics.units import NEVER
from siren_ros.simulation.behaviour.driving.navigator import DriveCommand, NavigatorState
from siren_ros.simulation.behaviour.driving.step_view import Ego
from siren_ros.simulation.behaviour.paths.lane_path import lane_heading
from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.scenario.presets import DriverPreset
from siren_ros.simulation.world.actors import Mode
from siren_ros.simulation.world.traffic_state import Event, EventKind


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
