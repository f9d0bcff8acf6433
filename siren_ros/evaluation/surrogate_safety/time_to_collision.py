"""Time to collision (TTC): when two footprints would touch if both drivers went on as they do now."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.evaluation.surrogate_safety.encounters import Encounters
from siren_ros.numerics.arrays import Flags, Floats, Rows
from siren_ros.numerics.geometry import footprint_corners, separation_m
from siren_ros.recording.episode_record import StateRows

HORIZON_S: Final = 3.0
"""How far ahead a contact is looked for; a TTC above it is no conflict by any threshold in use."""
INTERVAL_S: Final = 0.05
_TURN_MIN_RADPS: Final = 1e-6
"""Below this rate of turn the motion is a straight line."""


@dataclass(frozen=True)
class PredictedContacts:
    """What the present motion of each pair leads to; arrays of shape ``(N,)`` like the encounters."""

    time_s: Floats
    """TTC; infinite where the swept footprints do not touch within the horizon, 0 where they overlap already."""
    closing_mps: Floats
    """How fast the gap shrinks along the contact's normal just before the contact; 0 without one."""
    gap_m: Floats
    """Present gap of the two footprints along their best separating axis, negative where they overlap."""

    @property
    def required_deceleration_mps2(self) -> Floats:
        """Deceleration to avoid the crash (DRAC), 0 where none is ahead.

        The closing speed has to vanish over the gap that is left: v² / (2·gap) with gap = v·TTC, hence v / (2·TTC)
        (Cooper and Ferguson 1976; Archer 2005).
        """
        ahead = np.isfinite(self.time_s)
        needed = np.zeros(len(self.time_s))
        with np.errstate(divide="ignore", invalid="ignore"):  # 0 s are left where they touch already
            needed[ahead] = np.where(
                self.closing_mps[ahead] > 0.0, self.closing_mps[ahead] / (2.0 * self.time_s[ahead]), 0.0
            )
        return needed


def predicted_contacts(encounters: Encounters) -> PredictedContacts:
    """TTC of each pair by swept oriented boxes.

    Both vehicles keep their speed and their rate of turn, so that one that follows a bend is not expected to leave it.
    The footprints are compared every 0.05 s; between two instants the gap is taken as linear.
    """
    count = len(encounters)
    time, closing = np.full(count, np.inf), np.zeros(count)
    gap = _gaps(encounters, np.arange(count), 0.0, exact=True)
    touching = gap <= 0.0
    time[touching] = 0.0
    candidates = np.flatnonzero(~touching & _can_meet(encounters))
    before = gap[candidates]
    for instant in np.arange(INTERVAL_S, HORIZON_S + 0.5 * INTERVAL_S, INTERVAL_S):
        if not len(candidates):
            break
        after = _gaps(encounters, candidates, float(instant))
        met = after <= 0.0
        change = before[met] - after[met]
        time[candidates[met]] = instant - INTERVAL_S * (-after[met] / change)
        closing[candidates[met]] = change / INTERVAL_S
        candidates, before = candidates[~met], after[~met]
    if touching.any():
        closing[touching] = _closing_now(encounters, np.flatnonzero(touching), gap[touching])
    return PredictedContacts(time, closing, gap)


def _can_meet(encounters: Encounters) -> Flags:
    """Pairs that are near enough for a contact within the horizon, whatever way they turn."""
    a, b = encounters.subject, encounters.other
    distance = np.hypot(a.x_m - b.x_m, a.y_m - b.y_m)
    return np.asarray(distance <= encounters.reach_m + (a.speed_mps + b.speed_mps) * HORIZON_S)


def _closing_now(encounters: Encounters, rows: Rows, gap: Floats) -> Floats:
    later = _gaps(encounters, rows, INTERVAL_S)
    return np.asarray(np.maximum(0.0, (gap - later) / INTERVAL_S))


def _gaps(encounters: Encounters, rows: Rows, after_s: float, *, exact: bool = False) -> Floats:
    """Gap of each pair after some time of unchanged motion.

    Unless exact, a lower bound serves for pairs that are too far apart to touch within the next interval.
    """
    a, b = _moved(encounters.subject, rows, after_s), _moved(encounters.other, rows, after_s)
    gap = np.hypot(a[0] - b[0], a[1] - b[1]) - encounters.reach_m[rows]
    speed = encounters.subject.speed_mps[rows] + encounters.other.speed_mps[rows]
    near = np.flatnonzero(exact | (gap <= speed * INTERVAL_S + 1.0))
    length, width = encounters.subject_size_m
    (ax, ay, a_yaw), (bx, by, b_yaw) = (tuple(part[near] for part in pose) for pose in (a, b))
    mine = footprint_corners(ax, ay, a_yaw, np.full(len(near), length), np.full(len(near), width))
    theirs = footprint_corners(bx, by, b_yaw, *encounters.other_size_m[rows[near]].T)
    gap[near] = separation_m(mine, theirs)
    return np.asarray(gap)


def _moved(states: StateRows, rows: Rows, after_s: float) -> tuple[Floats, Floats, Floats]:
    """Position and yaw after a time of constant speed and rate of turn; the velocity turns with the yaw."""
    vx, vy, rate = states.vx_mps[rows], states.vy_mps[rows], states.yaw_rate_radps[rows]
    turn = rate * after_s
    straight = np.abs(rate) < _TURN_MIN_RADPS
    safe = np.where(straight, 1.0, rate)
    along = np.where(straight, after_s, np.sin(turn) / safe)
    aside = np.where(straight, 0.0, (1.0 - np.cos(turn)) / safe)
    x = states.x_m[rows] + vx * along - vy * aside
    y = states.y_m[rows] + vx * aside + vy * along
    return x, y, states.yaw_rad[rows] + turn
