"""Checks of a recorded episode: physics, people, continuity, ownership, message counts, stamps, hashes, the predicate.

Physics: the extremes of the recorded motion, and their limits. People: contacts with unprotected people, and speeds
near people on crossings.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely

from siren_ros.base.numerics.arrays import Brief, Flags, Floats, Points, Rows
from siren_ros.base.numerics.compiled import COS, SIN, X, Y, compiled
from siren_ros.base.numerics.geometry import footprint_corners, overlapping_pairs, wrap_angle
from siren_ros.base.numerics.units import STEP_NS, STEP_S
from siren_ros.data.interfaces import topics
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows, TopicRecord
from siren_ros.errors import EpisodeError
from siren_ros.scoring.judging.outcome import evaluate_predicate, summarise_residuals, verdicts_of_others
from siren_ros.scoring.judging.verdict import Moment, Part, Verdict, at_least, at_most, equals, listed, moments_of
from siren_ros.simulation.world.actors import ActorStates, Event, EventKind, Mode, Owner, hash_state

LATERAL_PERCENTILE: Final = 99.9
EMV_PERCENTILES: Final = (1.0, 99.0)
CIVILIAN_PERCENTILES: Final = (0.5, 99.5)
MOVING_MPS: Final = 0.3
"""Slower vehicles count as standing; their deceleration is not braking."""
PAPER_PRESET: Final = "paper"
"""The preset in which every driver reacts."""


@dataclass(frozen=True)
class VerifyLimits:
    """Limits of the checks."""

    jump_m: float = 0.05
    """Largest change of position between two steps beyond ``v · dt``."""
    turn_rad: float = 0.01
    """Largest change of yaw between two steps beyond the limits of steering and grip."""
    steer_max_rad: float = 0.7
    """Largest road-wheel angle of any class (40°)."""
    wheelbase_share: float = 0.5
    """Smallest wheelbase of any class relative to its length: that of buses and fire engines."""
    walker_turn_radps: float = 4.5
    """Largest turn rate of a pedestrian: a turn on the spot within a step."""
    lateral_accel_mps2: float = 12.0
    """Largest lateral acceleration: dry tyres give 1 g, plus a margin for transients."""
    speed_error_mps: float = 0.5
    """Largest difference between the mean velocity of two steps and the change of position between them."""
    residual_p99_m: float = 0.5
    """Limit for the 99th percentile of an actor's residual (SUMO's pose against the simulated pose)."""
    residual_max_m: float = 2.0
    """Limit for the largest residual of an actor."""
    overlap_m: float = 0.3
    """Largest overlap of two footprints: real bodies deform by as much at walking speed."""
    impact_speed_mps: float = 2.0
    """Largest impact speed: the paper's drivers all react, so that vehicles touch only while they manoeuvre."""
    comfort_lateral_mps2: float = 4.0
    """Limit for the 99.9th percentile of all vehicles' lateral acceleration: the most that drivers use in urban bends
    (Hugemann and Nickel, "Longitudinal and lateral accelerations in normal day driving", ITAI 2003)."""
    emv_brake_mps2: float = 4.0
    """Limit for the 1st percentile of an EMV's braking: that of an anticipating driver (same source, urban roads)."""
    emv_accel_mps2: float = 2.5
    """Limit for the 99th percentile of an EMV's acceleration: a brisk start of a van (same source)."""
    civilian_brake_mps2: float = 4.0
    """Limit for the 0.5th percentile of moving civilians' braking: what drivers use in traffic (same source). Emergency
    braking may be harder, but is rare."""
    civilian_accel_mps2: float = 3.0
    """Limit for the 99.5th percentile of moving civilians' acceleration: a brisk start of a car (same source)."""
    civilian_lateral_mps2: float = 5.0
    """Largest lateral acceleration of a civilian at any time: half of what dry tyres give, more than drivers use on
    roads."""


@dataclass(frozen=True)
class PhysicsSummary:
    """Measured extremes over all actors and steps of an episode; zeros if there is nothing to measure."""

    contacts: int = 0
    impact_mps: float = 0.0
    """Largest impact speed."""
    overlap_m: float = 0.0
    """Largest penetration of two footprints."""
    overlap_moment: Moment | None = None
    """Step and actors of the largest overlap."""
    lateral_accel_mps2: float = 0.0
    """99.9th percentile of lateral acceleration over all vehicles."""
    emv_accel_low_mps2: float = 0.0
    """1st percentile of the longitudinal acceleration of all EMVs."""
    emv_accel_high_mps2: float = 0.0
    """99th percentile of the longitudinal acceleration of all EMVs."""
    civilian_accel_low_mps2: float = 0.0
    """0.5th percentile of the longitudinal acceleration of moving civilians."""
    civilian_accel_high_mps2: float = 0.0
    """99.5th percentile of the longitudinal acceleration of moving civilians."""
    civilian_lateral_mps2: float = 0.0
    """Largest lateral acceleration of moving civilians."""


def summarise_physics(record: EpisodeRecord) -> PhysicsSummary:
    """Measure contacts, overlap and accelerations of an episode."""
    rows = record.rows
    speeds = [float(event.detail["impact_speed_mps"]) for event in record.events_of(EventKind.COLLISION)]
    lateral = np.abs(rows.lateral_accel_mps2)
    is_emv = np.isin(rows.actor_id, np.array(record.emv_ids, dtype=np.uint32))
    low, high = _extremes(rows.accel_mps2[is_emv], EMV_PERCENTILES)
    overlaps = (deepest_overlap(state, record) for state in record.states)
    overlap_m, overlap_moment = max(overlaps, key=lambda overlap: overlap[0], default=(0.0, None))
    walks = np.isin(rows.actor_id, record.walker_ids)
    driven = ~is_emv & ~walks & (rows.speed_mps > MOVING_MPS) & (rows.mode != Mode.STOPPED)
    civilian_low, civilian_high = _extremes(rows.accel_mps2[driven], CIVILIAN_PERCENTILES)
    return PhysicsSummary(
        contacts=len(speeds),
        impact_mps=max(speeds, default=0.0),
        overlap_m=overlap_m,
        overlap_moment=overlap_moment,
        lateral_accel_mps2=float(np.percentile(lateral, LATERAL_PERCENTILE)) if len(lateral) else 0.0,
        emv_accel_low_mps2=low,
        emv_accel_high_mps2=high,
        civilian_accel_low_mps2=civilian_low,
        civilian_accel_high_mps2=civilian_high,
        civilian_lateral_mps2=float(lateral[driven].max(initial=0.0)),
    )


def _extremes(values: Floats, percentiles: tuple[float, float]) -> tuple[float, float]:
    low, high = np.percentile(values, percentiles) if len(values) else (0.0, 0.0)
    return float(low), float(high)


def deepest_overlap(state: ActorStates, record: EpisodeRecord) -> tuple[float, Moment | None]:
    """Largest penetration depth of two footprints at a step (separating axis theorem), 0 if none overlap, and whose.

    People who pass each other on foot do not count: they turn their shoulders.
    """
    sizes = np.array([(record.actors[int(i)].length_m, record.actors[int(i)].width_m) for i in state.actor_id])
    if len(sizes) < 2:
        return 0.0, None
    length, width = sizes.T
    first, second, depth_m = overlapping_pairs(state.x_m, state.y_m, state.yaw_rad, length, width)
    walks = np.isin(state.actor_id, record.walker_ids)
    counts = ~(walks[first] & walks[second])
    if not counts.any():
        return 0.0, None
    deepest = int(np.argmax(np.where(counts, depth_m, -np.inf)))
    return float(depth_m[deepest]), Moment(state.step, int(state.actor_id[first[deepest]]))


def check_physics(record: EpisodeRecord, limits: VerifyLimits) -> tuple[Part, ...]:
    """Compare the summary with its limits; drawn drivers may crash at any speed."""
    summary = summarise_physics(record)
    impact_mps = limits.impact_speed_mps if record.description.preset == PAPER_PRESET else np.inf
    contacts = record.events_of(EventKind.COLLISION)
    first = min((state.step for state in record.states), default=0)
    at_start = moments_of(event for event in contacts if event.step == first)
    hardest = sorted(contacts, key=lambda event: float(event.detail["impact_speed_mps"]))[-1:]
    return (
        equals("contacts_at_start", len(at_start), 0, listed(at_start), *at_start),
        at_most("overlap_m", summary.overlap_m, limits.overlap_m, "", *filter(None, [summary.overlap_moment])),
        at_most(
            "impact_speed_mps", summary.impact_mps, impact_mps, f"{summary.contacts} contacts", *moments_of(hardest)
        ),
        at_most("lateral_accel_p99_9_mps2", summary.lateral_accel_mps2, limits.comfort_lateral_mps2),
        at_least("emv_accel_p1_mps2", summary.emv_accel_low_mps2, -limits.emv_brake_mps2),
        at_most("emv_accel_p99_mps2", summary.emv_accel_high_mps2, limits.emv_accel_mps2),
        at_least("civilian_accel_p0_5_mps2", summary.civilian_accel_low_mps2, -limits.civilian_brake_mps2),
        at_most("civilian_accel_p99_5_mps2", summary.civilian_accel_high_mps2, limits.civilian_accel_mps2),
        at_most("civilian_lateral_mps2", summary.civilian_lateral_mps2, limits.civilian_lateral_mps2),
    )


WALKING_PACE_MPS: Final = 2.0
"""Largest speed at which vehicles should pass people on a crossing, 7 km/h."""
NEAR_WAY_M: Final = 2.0
"""A person on a crossing is near a vehicle within this distance of the area that it sweeps there."""


@dataclass(frozen=True)
class NearPass:
    """A vehicle's passage over a crossing with a person near its path, at the vehicle's fastest step."""

    actor_id: int
    walker_id: int
    step: int
    speed_mps: float


def contacts_with_people(record: EpisodeRecord) -> tuple[Event, ...]:
    """Contacts of vehicles with pedestrians, cyclists and motorcyclists."""
    people = set(record.people_ids.tolist())
    return tuple(event for event in record.events_of(EventKind.COLLISION) if {event.actor_id, event.other_id} & people)


def near_passes(record: EpisodeRecord) -> tuple[NearPass, ...]:
    """Find every passage of a vehicle over a crossing with a pedestrian within 2 m of the area that it sweeps."""
    if not len(record.walker_ids):
        return ()
    rows = record.rows
    walks = np.isin(rows.actor_id, record.walker_ids)
    walkers, vehicles = np.flatnonzero(walks), np.flatnonzero(~walks)
    half_m = np.array([(0.5 * actor.length_m, 0.5 * actor.width_m) for actor in record.actors.values()])
    sizes_m = half_m[np.searchsorted(np.array(list(record.actors), np.uint32), rows.actor_id)]
    found: list[NearPass | None] = []
    for outline in record.network.crossings:
        area = shapely.Polygon(outline)
        across = walkers[shapely.contains_xy(area, rows.x_m[walkers], rows.y_m[walkers])]
        across = across[np.argsort(rows.step[across], kind="stable")]
        passages = _passages(record, area, vehicles, sizes_m) if len(across) else ()
        found += [_fastest(record, passage, across, sizes_m) for passage in passages]
    return tuple(near for near in found if near is not None)


def _passages(record: EpisodeRecord, area: shapely.Polygon, vehicles: Rows, sizes_m: Points) -> Iterator[Rows]:
    """Rows of each vehicle's consecutive steps on a crossing."""
    rows, (half_length, half_width) = record.rows, sizes_m[vehicles].T
    west, south, east, north = area.bounds
    around = np.hypot(half_length, half_width)
    x, y = rows.x_m[vehicles], rows.y_m[vehicles]
    inside = (x > west - around) & (x < east + around) & (y > south - around) & (y < north + around)
    near = vehicles[inside]
    corners = footprint_corners(rows.x_m[near], rows.y_m[near], rows.yaw_rad[near], *(2.0 * sizes_m[near].T))
    shapely.prepare(area)
    near = near[shapely.intersects(area, shapely.polygons(corners))]
    same = (np.diff(rows.actor_id[near]) == 0) & (np.diff(rows.step[near]) == 1)
    yield from np.split(near, np.flatnonzero(~same) + 1) if len(near) else ()


def _fastest(record: EpisodeRecord, passage: Rows, across: Rows, sizes_m: Points) -> NearPass | None:
    """The fastest step of a passage with a person near; ``across`` are people on the crossing, by step."""
    rows = record.rows
    first, last = np.searchsorted(rows.step[across], (rows.step[passage[0]], rows.step[passage[-1]] + 1))
    people = across[first:last]
    poses = rows.x_m[passage], rows.y_m[passage], np.cos(rows.yaw_rad[passage]), np.sin(rows.yaw_rad[passage])
    half_length_m, half_width_m = sizes_m[passage[0]].tolist()
    near = _near(np.stack(poses), rows.xy_m[people], half_length_m, half_width_m, NEAR_WAY_M)
    if not near.any():
        return None
    people = people[near]
    at = passage[rows.step[people] - rows.step[passage[0]]]
    most = int(np.argmax(rows.speed_mps[at]))
    ids = int(rows.actor_id[at[most]]), int(rows.actor_id[people[most]])
    return NearPass(*ids, int(rows.step[at[most]]), float(rows.speed_mps[at[most]]))


@compiled
def _near(poses: Floats, points: Points, half_length_m: float, half_width_m: float, near_m: float) -> Flags:
    """Which points ``(P, 2)`` are near a box in one of some poses: x, y, cosine and sine of the yaw, ``(4, K)``."""
    near = np.zeros(len(points), np.bool_)
    for p in range(len(points)):
        for k in range(poses.shape[1]):
            dx, dy = points[p, X] - poses[X, k], points[p, Y] - poses[Y, k]
            ahead = max(abs(dx * poses[COS, k] + dy * poses[SIN, k]) - half_length_m, 0.0)
            left = max(abs(dy * poses[COS, k] - dx * poses[SIN, k]) - half_width_m, 0.0)
            if ahead * ahead + left * left <= near_m * near_m:
                near[p] = True
                break
    return near


def check_people(record: EpisodeRecord) -> tuple[Part, Part]:
    """Checks: no contact with unprotected people, and walking pace near people on crossings.

    Drawn drivers may crash.
    """
    contacts = contacts_with_people(record)
    places = ", ".join(f"actors {event.actor_id} and {event.other_id} at step {event.step}" for event in contacts)
    passes = near_passes(record)
    worst = max(passes, key=lambda item: item.speed_mps, default=NearPass(0, 0, 0, 0.0))
    faster = sum(item.speed_mps > WALKING_PACE_MPS for item in passes)
    detail = f"actor {worst.actor_id} near {worst.walker_id} at step {worst.step}, {faster} of {len(passes)} passes"
    allowed = 0 if record.description.preset == PAPER_PRESET else np.inf
    fastest = (Moment(worst.step, worst.actor_id),) if passes else ()
    return (
        at_most("contacts_with_people", len(contacts), allowed, places, *moments_of(contacts)),
        at_most("speed_near_people_mps", worst.speed_mps, WALKING_PACE_MPS, detail if passes else "", *fastest),
    )


CHECKS: Final = {
    "steps": "The episode ended as planned, after at least the number of steps of its description",
    "position_jump_m": "Between two steps no position changes by more than `v · dt` and a margin (v: larger speed)",
    "yaw_jump_rad": "No yaw rate exceeds a bicycle's at full lock (`v · tan δ / wheelbase`) or that of the tyres' grip",
    "speed_error_mps": "The recorded velocity is the derivative of the position within the limit, direction included",
    "ownership_faults": "Every actor has exactly one owner at every step, and no two controllers drive the same actor",
    "teleports": "SUMO teleported no vehicle",
    "residual_p99_m": "99th percentile of the distance between SUMO's and the simulated pose of actors that SUMO owns",
    "residual_max_m": "Largest distance between SUMO's and the simulated pose of actors that SUMO owns",
    "contacts_at_start": "At the first step no two bodies touch: they would be pushed apart and then not overlap",
    "overlap_m": "No two bodies overlap by more than the limit",
    "impact_speed_mps": "With the preset `paper` vehicles touch only slowly; with other presets at any speed",
    "lateral_accel_p99_9_mps2": "All vehicles' lateral acceleration, 99.9th percentile, is what drivers use in bends",
    "emv_accel_p1_mps2": "The EMV brakes no harder than an anticipating driver (1st percentile of its acceleration)",
    "emv_accel_p99_mps2": "The EMV accelerates no harder than a van's brisk start (99th percentile)",
    "civilian_accel_p0_5_mps2": "Civilians that move brake no harder than drivers in traffic (0.5th percentile)",
    "civilian_accel_p99_5_mps2": "Civilians accelerate no harder than a car's brisk start (99.5th percentile)",
    "civilian_lateral_mps2": "No civilian's lateral acceleration is more than half of what dry tyres give",
    "contacts_with_people": "With the preset `paper` no vehicle touches a pedestrian, a cyclist or a motorcyclist",
    "speed_near_people_mps": "With somebody on a crossing within 2 m of its way no vehicle is there faster than 2 m/s",
    "topics_with_lost_messages": "Each topic has one message at each step of its rate; no core topic is missing",
    "topics_with_wrong_stamps": "Stamps are simulated time on the 20 Hz grid; a message's own stamp is the bag's",
    "wrong_state_hashes": "Each step has its recorded `state_hash`: BLAKE2b of every actor and traffic light",
}
"""What each check requires, by the name of the check."""


@dataclass(frozen=True)
class Verification(Brief):
    """The result of all checks."""

    verdict: Verdict
    checks: tuple[Part, ...]
    others: Mapping[int, Verdict] = field(default_factory=dict)
    """Verdict for each EMV except the first, by its id. Only EMVs that cross its path count."""

    def facts(self) -> dict[str, object]:
        """The result, and what does not hold, as plain values."""
        failing = ", ".join(part.name for part in self.failing)
        return {"holds": self.holds, "verdict": self.verdict.text, "checks": len(self.checks), "failing": failing}

    @property
    def holds(self) -> bool:
        """Whether the interaction happened and every check holds."""
        return self.verdict.holds and all(part.holds for part in self.checks)

    @property
    def failing(self) -> tuple[Part, ...]:
        """Parts of the predicate and checks that do not hold."""
        return (*self.verdict.failing, *(part for part in self.checks if not part.holds))


def check_motion(record: EpisodeRecord, limits: VerifyLimits) -> tuple[Part, Part, Part]:
    """Check that consecutive states of an actor are consistent; a part names its worst actor and step.

    A contact within a step changes the velocity at once, and leaves the mean velocity within half the change. Raises
    EpisodeError: the record has states of an actor that was never described.
    """
    rows = record.rows
    pairs = np.flatnonzero((rows.actor_id[1:] == rows.actor_id[:-1]) & (rows.step[1:] == rows.step[:-1] + 1))
    before, after = rows.select(pairs), rows.select(pairs + 1)
    if not set(after.actor_id.tolist()) <= record.actors.keys():
        raise EpisodeError("the record has states of an actor that was never described")
    length_m = np.array([record.actors[key].length_m for key in after.actor_id.tolist()])
    moved_x, moved_y = after.x_m - before.x_m, after.y_m - before.y_m
    speed_mps = np.maximum(before.speed_mps, after.speed_mps)
    turned = np.abs(wrap_angle(after.yaw_rad - before.yaw_rad))
    by_steering = speed_mps * np.tan(limits.steer_max_rad) / (limits.wheelbase_share * length_m)
    by_grip = limits.lateral_accel_mps2 / np.maximum(speed_mps, 0.1)
    error_x = moved_x / STEP_S - (before.vx_mps + after.vx_mps) / 2.0
    error_y = moved_y / STEP_S - (before.vy_mps + after.vy_mps) / 2.0
    jump_m = np.hypot(moved_x, moved_y) - speed_mps * STEP_S
    walking = np.isin(after.actor_id, record.walker_ids)
    turn_rad = turned - np.where(walking, limits.walker_turn_radps, np.minimum(by_steering, by_grip)) * STEP_S
    error_mps = np.hypot(error_x, error_y) - 0.5 * _velocity_jumps(before, after, record)

    def worst(name: str, values: Floats, limit: float) -> Part:
        if len(values) == 0:
            return at_most(name, 0.0, limit)
        row = int(np.argmax(values))
        changed = " as its owner changes" if before.owner[row] != after.owner[row] else ""
        moment = Moment(int(after.step[row]), int(after.actor_id[row]))
        return at_most(name, values[row], limit, f"actor {moment.actor_id} at step {moment.step}{changed}", moment)

    return (
        worst("position_jump_m", jump_m, limits.jump_m),
        worst("yaw_jump_rad", turn_rad, limits.turn_rad),
        worst("speed_error_mps", error_mps, limits.speed_error_mps),
    )


def _velocity_jumps(before: StateRows, after: StateRows, record: EpisodeRecord) -> Floats:
    """Change of velocity of actors in a contact between two steps, 0 for all others; shape ``(P,)``."""
    contacts = record.events_of(EventKind.COLLISION)
    struck = {(event.step, actor) for event in contacts for actor in (event.actor_id, event.other_id)}
    hit = [key in struck for key in zip(after.step.tolist(), after.actor_id.tolist(), strict=True)]
    change = np.hypot(after.vx_mps - before.vx_mps, after.vy_mps - before.vy_mps)
    return np.where(np.array(hit, dtype=np.bool_), change, 0.0)


def check_owners(record: EpisodeRecord) -> Part:
    """Check that every actor has exactly one owner per step, and that no two controllers drive the same actor."""
    faults = 0
    for state in record.states:
        known = np.isin(state.owner, [int(owner) for owner in Owner])
        faults += int((~known).sum()) + len(state) - len(np.unique(state.actor_id))
    claimed: dict[int, list[npt.NDArray[np.uint32]]] = {}
    for commands in record.commands.values():
        for command in commands:
            claimed.setdefault(command.step, []).append(command.actor_id[command.owner == Owner.ROS])
    for claims in claimed.values():
        ids = np.concatenate(claims)
        faults += len(ids) - len(np.unique(ids))
    return equals("ownership_faults", faults, 0)


def check_states(record: EpisodeRecord, limits: VerifyLimits) -> tuple[Part, ...]:
    """Run the checks that need no topics; they also apply to an episode that was not recorded.

    Beside motion, owners, physics and people: SUMO teleported no vehicle, and the residuals of actors that SUMO
    owns are small.
    """
    teleports = record.events_of(EventKind.TELEPORT)
    places = ", ".join(f"actor {event.actor_id} at step {event.step}" for event in teleports)
    residuals, rows = summarise_residuals(record), record.rows
    from_sumo = np.flatnonzero(rows.owner == Owner.SUMO)
    farthest = rows.select(from_sumo[np.argsort(rows.residual_m[from_sumo], kind="stable")[-1:]])
    worst = [Moment(int(step), int(actor)) for step, actor in zip(farthest.step, farthest.actor_id, strict=True)]
    return (
        *check_motion(record, limits),
        check_owners(record),
        equals("teleports", len(teleports), 0, places, *moments_of(teleports)),
        at_most("residual_p99_m", residuals.p99_m, limits.residual_p99_m, f"median {residuals.median_m:.3f} m"),
        at_most("residual_max_m", residuals.max_m, limits.residual_max_m, listed(worst), *worst),
        *check_physics(record, limits),
        *check_people(record),
    )


def check_complete(record: EpisodeRecord) -> Part:
    """Check that the episode ended as planned with the number of steps in its description."""
    planned = round(record.description.duration_s / STEP_S)
    if record.complete:
        return at_least("steps", record.steps, planned)
    ended = "no outcome" if record.outcome is None else f"{record.outcome.end}: {record.outcome.reason}"
    return Part("steps", float(record.steps), float(planned), False, ">=", f"the episode is not complete, {ended}")


def check_message_counts(record: EpisodeRecord) -> Part:
    """Check that every topic has one message per step of its rate, and that no core topic is missing."""
    wrong = [f"{topic.name} {fault}" for topic in record.topics.values() for fault in _rate_faults(topic, record.steps)]
    wrong += [f"{topic.name} is missing" for topic in topics.CORE_TOPICS if topic.name not in record.topics]
    return equals("topics_with_lost_messages", len(wrong), 0, "; ".join(wrong))


def _rate_faults(topic: TopicRecord, steps: int) -> Iterator[str]:
    known = topics.FIXED_TOPICS.get(topic.name)
    if (known is not None and known.latched) or (known is None and topic.count == 1):
        if topic.count != 1:
            yield f"has {topic.count} messages instead of 1"
        return
    if known is not None:
        period_ns = known.period_steps * STEP_NS
    else:
        # A suite sets the rates of its sensors; the shortest interval is taken as the period.
        period_ns = int(np.diff(topic.times_ns).min(initial=steps * STEP_NS))
        if period_ns <= 0:
            yield "has two messages at one time"
            return
    expected = np.arange(0, steps * STEP_NS, period_ns, dtype=np.int64)
    if not np.array_equal(topic.times_ns, expected):
        yield f"has {topic.count} messages instead of {len(expected)}, or not at their steps"


def check_stamps(record: EpisodeRecord) -> Part:
    """Check that every stamp is a step's simulated time and equals the bag's time."""
    wrong = []
    for topic in record.topics.values():
        faults = int((topic.times_ns % STEP_NS != 0).sum()) + topic.stamp_mismatches
        if faults:
            wrong.append(f"{topic.name}: {faults}")
    return equals("topics_with_wrong_stamps", len(wrong), 0, ", ".join(wrong))


def check_state_hashes(record: EpisodeRecord) -> Part:
    """Check that the hash of the recorded states and signals equals the recorded hash at every step."""
    signals = {traffic.step: traffic.signals for traffic in record.traffic}
    wrong = [
        state.step
        for state in record.states
        if record.state_hashes.get(state.step) != hash_state(state, signals.get(state.step, ()))
    ]
    return equals("wrong_state_hashes", len(wrong), 0, f"first at step {wrong[0]}" if wrong else "")


def verify_episode(record: EpisodeRecord, limits: VerifyLimits | None = None) -> Verification:
    """Evaluate the episode's predicate and run every check.

    Raises EpisodeError as ``check_motion``, and BagError where the predicate that the record names is not known.
    """
    verdict = evaluate_predicate(record)
    checks = (
        check_complete(record),
        *check_states(record, limits or VerifyLimits()),
        check_message_counts(record),
        check_stamps(record),
        check_state_hashes(record),
    )
    return Verification(verdict, checks, verdicts_of_others(record))
