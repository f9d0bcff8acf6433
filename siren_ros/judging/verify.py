"""Checks of a recorded episode: continuity, ownership, message counts, stamps, hashes, and the predicate."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.errors import EpisodeError
from siren_ros.interfaces import topics
from siren_ros.judging.outcome import summarise_residuals
from siren_ros.judging.physics import (
    VerifyLimits,
    check_emv_accel,
    check_emv_braking,
    check_impact_speed,
    check_lateral_accel,
    check_overlap,
)
from siren_ros.judging.predicates import evaluate_predicate
from siren_ros.judging.verdict import Part, Verdict, at_least, at_most, equals
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.geometry import wrap_angle
from siren_ros.numerics.units import STEP_NS, STEP_S
from siren_ros.recording.episode_record import EpisodeRecord, StateRows, TopicRecord
from siren_ros.world.actors import Owner
from siren_ros.world.traffic_state import EventKind, hash_state

Check = Callable[[EpisodeRecord, VerifyLimits], Part]


@dataclass(frozen=True)
class Verification:
    """The result of all checks."""

    verdict: Verdict
    checks: tuple[Part, ...]

    @property
    def holds(self) -> bool:
        """Whether the interaction happened and every check holds."""
        return self.verdict.holds and all(part.holds for part in self.checks)

    @property
    def failing(self) -> tuple[Part, ...]:
        """Parts of the predicate and checks that do not hold."""
        return (*self.verdict.failing, *(part for part in self.checks if not part.holds))


@dataclass(frozen=True)
class _Moves:
    """Pairs of consecutive states of the same actor; arrays of shape ``(P,)``."""

    before: StateRows
    after: StateRows
    length_m: Floats

    @property
    def distance_m(self) -> Floats:
        return np.hypot(self.after.x_m - self.before.x_m, self.after.y_m - self.before.y_m)

    @property
    def speed_mps(self) -> Floats:
        return np.maximum(self.before.speed_mps, self.after.speed_mps)

    def check(self, name: str, values: Floats, limit: float) -> Part:
        """That the largest value is at most a limit; the detail names the actor and the step of that value."""
        if len(values) == 0:
            return at_most(name, 0.0, limit)
        row = int(np.argmax(values))
        changed = " as its owner changes" if self.before.owner[row] != self.after.owner[row] else ""
        detail = f"actor {self.after.actor_id[row]} at step {self.after.step[row]}{changed}"
        return at_most(name, values[row], limit, detail)


def _moves(record: EpisodeRecord) -> _Moves:
    rows = record.rows
    pairs = np.flatnonzero((rows.actor_id[1:] == rows.actor_id[:-1]) & (rows.step[1:] == rows.step[:-1] + 1))
    after = rows.select(pairs + 1)
    if not set(after.actor_id.tolist()) <= record.actors.keys():
        raise EpisodeError("the record has states of an actor that was never described")
    lengths = np.array([record.actors[key].length_m for key in after.actor_id.tolist()])
    return _Moves(rows.select(pairs), after, lengths)


def _velocity_jumps(moves: _Moves, record: EpisodeRecord) -> Floats:
    """Change of velocity of actors that a contact strikes between two steps, 0 for all others; shape ``(P,)``."""
    struck = {
        (event.step, actor)
        for event in record.events_of(EventKind.COLLISION)
        for actor in (event.actor_id, event.other_id)
    }
    after, before = moves.after, moves.before
    hit = [key in struck for key in zip(after.step.tolist(), after.actor_id.tolist(), strict=True)]
    change = np.hypot(after.vx_mps - before.vx_mps, after.vy_mps - before.vy_mps)
    return np.where(np.array(hit, dtype=np.bool_), change, 0.0)


def check_position_jumps(record: EpisodeRecord, limits: VerifyLimits) -> Part:
    """No position change between two steps exceeds ``v · dt`` plus the margin; v is the larger of both speeds."""
    moves = _moves(record)
    excess = moves.distance_m - moves.speed_mps * STEP_S
    return moves.check("position_jump_m", excess, limits.jump_m)


def check_yaw_jumps(record: EpisodeRecord, limits: VerifyLimits) -> Part:
    """No yaw rate exceeds a kinematic bicycle's at full lock (``v · tan δ / wheelbase``) or the tyres' grip."""
    moves = _moves(record)
    turned = np.abs(wrap_angle(moves.after.yaw_rad - moves.before.yaw_rad))
    by_steering = moves.speed_mps * np.tan(limits.steer_max_rad) / (limits.wheelbase_share * moves.length_m)
    by_grip = limits.lateral_accel_mps2 / np.maximum(moves.speed_mps, 0.1)
    excess = turned - np.minimum(by_steering, by_grip) * STEP_S
    return moves.check("yaw_jump_rad", excess, limits.turn_rad)


def check_speed(record: EpisodeRecord, limits: VerifyLimits) -> Part:
    """The recorded velocity equals the derivative of the recorded position within the limit, direction included.

    A contact within a step changes the velocity at once, and leaves the mean velocity within half the change.
    """
    moves = _moves(record)
    error_x = (moves.after.x_m - moves.before.x_m) / STEP_S - (moves.before.vx_mps + moves.after.vx_mps) / 2.0
    error_y = (moves.after.y_m - moves.before.y_m) / STEP_S - (moves.before.vy_mps + moves.after.vy_mps) / 2.0
    error = np.hypot(error_x, error_y) - 0.5 * _velocity_jumps(moves, record)
    return moves.check("speed_error_mps", error, limits.speed_error_mps)


def check_owners(record: EpisodeRecord, _limits: VerifyLimits) -> Part:
    """Every actor has exactly one owner at every step, and no two controllers drive the same actor."""
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


def check_teleports(record: EpisodeRecord, _limits: VerifyLimits) -> Part:
    """SUMO teleported no vehicle."""
    teleports = record.events_of(EventKind.TELEPORT)
    detail = ", ".join(f"actor {event.actor_id} at step {event.step}" for event in teleports)
    return equals("teleports", len(teleports), 0, detail)


def check_residual_p99(record: EpisodeRecord, limits: VerifyLimits) -> Part:
    """99th percentile of the distance between SUMO's and the simulated pose of actors that SUMO owns."""
    residuals = summarise_residuals(record)
    return at_most("residual_p99_m", residuals.p99_m, limits.residual_p99_m, f"median {residuals.median_m:.3f} m")


def check_residual_max(record: EpisodeRecord, limits: VerifyLimits) -> Part:
    """Largest distance between SUMO's and the simulated pose of actors that SUMO owns."""
    return at_most("residual_max_m", summarise_residuals(record).max_m, limits.residual_max_m)


def check_complete(record: EpisodeRecord, _limits: VerifyLimits) -> Part:
    """The episode ended as planned, after at least the number of steps of its description."""
    planned = round(record.description.duration_s / STEP_S)
    if record.complete:
        return at_least("steps", record.steps, planned)
    ended = "no outcome" if record.outcome is None else f"{record.outcome.end}: {record.outcome.reason}"
    return Part("steps", float(record.steps), float(planned), False, ">=", f"the episode is not complete, {ended}")


def check_message_counts(record: EpisodeRecord, _limits: VerifyLimits) -> Part:
    """Every topic has exactly one message at each step of its rate, and no core topic is missing."""
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
        # The suite sets a sensor's rate: its shortest interval is its period.
        period_ns = int(np.diff(topic.times_ns).min(initial=steps * STEP_NS))
        if period_ns <= 0:
            yield "has two messages at one time"
            return
    expected = np.arange(0, steps * STEP_NS, period_ns, dtype=np.int64)
    if not np.array_equal(topic.times_ns, expected):
        yield f"has {topic.count} messages instead of {len(expected)}, or not at their steps"


def check_stamps(record: EpisodeRecord, _limits: VerifyLimits) -> Part:
    """Every stamp is simulated time on the 20 Hz grid, and the stamp inside a message is that of the bag."""
    wrong = []
    for topic in record.topics.values():
        faults = int((topic.times_ns % STEP_NS != 0).sum()) + topic.stamp_mismatches
        if faults:
            wrong.append(f"{topic.name}: {faults}")
    return equals("topics_with_wrong_stamps", len(wrong), 0, ", ".join(wrong))


def check_state_hashes(record: EpisodeRecord, _limits: VerifyLimits) -> Part:
    """Each step has its recorded ``state_hash``: BLAKE2b of every actor and traffic light."""
    signals = {traffic.step: traffic.signals for traffic in record.traffic}
    wrong = [
        state.step
        for state in record.states
        if record.state_hashes.get(state.step) != hash_state(state, signals.get(state.step, ()))
    ]
    return equals("wrong_state_hashes", len(wrong), 0, f"first at step {wrong[0]}" if wrong else "")


STATE_CHECKS: Final[tuple[Check, ...]] = (
    check_position_jumps,
    check_yaw_jumps,
    check_speed,
    check_owners,
    check_teleports,
    check_residual_p99,
    check_residual_max,
    check_overlap,
    check_impact_speed,
    check_lateral_accel,
    check_emv_braking,
    check_emv_accel,
)
"""The checks that need no topics; they also apply to an episode that was simulated and not recorded."""
CHECKS: Final[tuple[Check, ...]] = (
    check_complete,
    *STATE_CHECKS,
    check_message_counts,
    check_stamps,
    check_state_hashes,
)


def verify_episode(record: EpisodeRecord, limits: VerifyLimits | None = None) -> Verification:
    """Evaluates the episode's predicate and runs every check.

    Raises:
        EpisodeError: The record contradicts itself: states of an actor that was never described.
        BagError: The predicate that the record names is not known.
    """
    bounds = limits or VerifyLimits()
    return Verification(evaluate_predicate(record), tuple(check(record, bounds) for check in CHECKS))
