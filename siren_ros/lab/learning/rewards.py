"""The reward: weighted terms of each step.

Rulebooks are graded at an episode's end, over its whole record. A term with a clause is what that clause counts in a
step.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import InputError
from siren_ros.lab.learning.moment import Moment
from siren_ros.lab.learning.rollout import Seat
from siren_ros.simulation.world.actors import indicator_to

OFF_ROAD_M: Final = 12.0
"""A vehicle farther than this from its path has left the road."""
_STANDS_MPS: Final = 0.5
_STUCK_GAP_M: Final = 10.0
_STUCK_MPS: Final = 2.0
"""An EMV slower than this close behind the driver is stuck (clause ``obstruction`` of the rulebooks)."""
_ASIDE_MPS: Final = 0.2
"""Lateral speed of a move that needs an indicator (clause ``indicator``)."""
_GENTLE_MPS2: Final = 4.0
"""Deceleration above which the clause ``braking`` counts."""
_SHORT_S: Final = 1.0
"""Time to collision below which the clause ``time_to_collision`` counts."""


@dataclass(frozen=True)
class Term:
    """One term of the reward."""

    of: Callable[[Moment], float]
    """Computes its amount at a step."""
    unit: str
    meaning: str
    clause: str
    """Clause of the rulebooks that it applies step by step; empty if there is none."""
    weights: Mapping[Seat, float]
    """Reward per unit, by seat."""


def _contact(moment: Moment) -> float:
    return float(moment.contact)


def _off_road(moment: Moment) -> float:
    return float(abs(moment.sight.left_m) > OFF_ROAD_M)


def _obstruction(moment: Moment) -> float:
    stuck = False
    for siren in moment.sight.sirens:
        apart_m = 0.5 * (moment.sight.body.width_m + moment.sight.bodies[siren.actor_id].width_m)
        close = siren.behind and 0.0 < siren.gap_m <= _STUCK_GAP_M and abs(siren.left_m) < apart_m
        stuck = stuck or (close and siren.speed_mps < _STUCK_MPS)
    return STEP_S * stuck


def _junction(moment: Moment) -> float:
    stands = moment.sight.in_junction and moment.sight.speed_mps < _STANDS_MPS
    return STEP_S * (stands and any(siren.behind for siren in moment.sight.sirens))


def _red_line(moment: Moment) -> float:
    return float(moment.red_lines)


def _indicator(moment: Moment) -> float:
    rate_mps = (moment.sight.left_m - moment.before.left_m) / STEP_S
    shown = int(moment.sight.states.lights[moment.sight.row]) & indicator_to(rate_mps)
    return STEP_S * (abs(rate_mps) > _ASIDE_MPS and not shown and not moment.sight.in_junction)


def _braking(moment: Moment) -> float:
    return STEP_S * max(-float(moment.sight.states.accel_mps2[moment.sight.row]) - _GENTLE_MPS2, 0.0)


def _short_time(moment: Moment) -> float:
    sight, short = moment.sight, False
    for other in sight.others:
        closing_mps = sight.speed_mps - other.speed_mps
        in_line = abs(other.left_m - sight.left_m) < other.half_width_m + 0.5 * sight.width_m
        short = short or (in_line and 0.0 < other.gap_m < _SHORT_S * closing_mps)
    return STEP_S * short


def _emv_delay(moment: Moment) -> float:
    if moment.emv_row is None:
        return 0.0
    vx, vy = moment.sight.states.vx_mps[moment.emv_row], moment.sight.states.vy_mps[moment.emv_row]
    return STEP_S * max(1.0 - float((vx * vx + vy * vy) ** 0.5) / moment.emv_wanted_mps, 0.0)


def _progress(moment: Moment) -> float:
    limit_mps = float(moment.sight.way.limit_mps[moment.sight.way.row(moment.sight.s_m)])
    return (moment.sight.s_m - moment.before.s_m) / limit_mps


def _weights(civilian: float, emv: float) -> Mapping[Seat, float]:
    return {Seat.CIVILIAN: civilian, Seat.EMV: emv}


TERMS: Final[Mapping[str, Term]] = {
    "contact": Term(_contact, "contacts", "the own vehicle touches somebody", "contact", _weights(-20.0, -20.0)),
    "off_road": Term(_off_road, "times", "the own vehicle leaves the road", "", _weights(-10.0, -10.0)),
    "obstruction": Term(_obstruction, "s", "an EMV is stuck behind", "obstruction", _weights(-1.0, 0.0)),
    "junction": Term(_junction, "s", "standing in a junction before an EMV", "intersection", _weights(-1.0, 0.0)),
    "red_line": Term(_red_line, "lines", "a line is crossed at red", "red", _weights(-5.0, 0.0)),
    "indicator": Term(_indicator, "s", "moving to the side without an indicator", "indicator", _weights(-1.0, -0.2)),
    "braking": Term(_braking, "m/s", "speed lost by braking beyond 4 m/s²", "braking", _weights(-1.0, -0.2)),
    "short_time": Term(_short_time, "s", "time to collision below 1 s", "time_to_collision", _weights(-2.0, -2.0)),
    "emv_delay": Term(_emv_delay, "s", "time that the EMV loses against its own speed", "", _weights(-0.2, -1.0)),
    "progress": Term(_progress, "s", "way driven, as time at the speed limit", "return", _weights(0.1, 0.1)),
}
"""Terms by name."""


def weights_of(seat: Seat, changes: Mapping[str, float] | None = None) -> Mapping[str, float]:
    """Weight of each term in a seat, with some replaced by the user's.

    Raises:
        InputError: There is no such term.
    """
    unknown = sorted(set(changes or {}) - set(TERMS))
    if unknown:
        raise InputError("rewards", ", ".join(unknown), f"weights of {', '.join(TERMS)}")
    return {name: term.weights[seat] for name, term in TERMS.items()} | dict(changes or {})


def terms_of(moment: Moment) -> dict[str, float]:
    """The amount of every term at a moment."""
    return {name: term.of(moment) for name, term in TERMS.items()}
