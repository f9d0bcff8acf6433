"""Checks of a recorded episode: continuity, ownership, message counts, stamps, hashes, and the predicate."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.base.numerics.units import STEP_NS, STEP_S
from siren_ros.base.tables.brief import Brief
from siren_ros.data.interfaces import topics
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows, TopicRecord
from siren_ros.errors import EpisodeError
from siren_ros.scoring.judging.near_people import check_people
from siren_ros.scoring.judging.outcome import summarise_residuals
from siren_ros.scoring.judging.physics import VerifyLimits, check_physics
from siren_ros.scoring.judging.predicates import evaluate_predicate, verdicts_of_others
from siren_ros.scoring.judging.verdict import Moment, Part, Verdict, at_least, at_most, equals, listed, moments_of
from siren_ros.simulation.world.actors import Owner
from siren_ros.simulation.world.traffic_state import EventKind, hash_state

CHECKS: Final = {
    "steps": "The episode ended as planned, after at least the number of steps of its description",
    "position_jump_m": "Between two steps no position changes by more than `v · dt` and a margin (v: larger speed)",
    "yaw_jump_rad": "No yaw rate exceeds a bicycle's at full lock (`v · tan δ / wheelbase`) or that of the tyres' grip",
    "speed_error_mps": "The recorded velocity is the derivative of the position within the limit, direction included",
    "ownership_faults": "Every actor has exactly one owner at every step, and no two controllers drive the same actor",
    "teleports": "SUMO teleported no vehicle",
    "residual_p99_m": "99th percentile of the distance between SUMO's and the simulated pose of actors that SUMO owns",
    "residual_max_m": "Largest distance between SUMO's and the simulated pose of actors that SUMO owns",
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
