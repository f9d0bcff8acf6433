"""The options of a learning environment: episodes, spaces, and the reward with its terms.

Rulebooks are graded at an episode's end, over its whole record. A term with a clause is what that clause counts in a
step.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import InputError
from siren_ros.lab.learning.rollout import Seat, SeatState
from siren_ros.lab.learning.top_view import RASTER_SHAPE
from siren_ros.running.seat.policy import VECTOR_SIZE, Manoeuvre
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import EmergencyLevel, level_name
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

    of: Callable[[SeatState], float]
    """Computes its amount at a step."""
    unit: str
    meaning: str
    clause: str
    """Clause of the rulebooks that it applies step by step; empty if there is none."""
    weights: Mapping[Seat, float]
    """Reward per unit, by seat."""


def _contact(state: SeatState) -> float:
    return float(state.contact)


def _off_road(state: SeatState) -> float:
    return float(abs(state.sight.left_m) > OFF_ROAD_M)


def _obstruction(state: SeatState) -> float:
    stuck = False
    for siren in state.sight.sirens:
        apart_m = 0.5 * (state.sight.body.width_m + state.sight.bodies[siren.actor_id].width_m)
        close = siren.behind and 0.0 < siren.gap_m <= _STUCK_GAP_M and abs(siren.left_m) < apart_m
        stuck = stuck or (close and siren.speed_mps < _STUCK_MPS)
    return STEP_S * stuck


def _junction(state: SeatState) -> float:
    stands = state.sight.in_junction and state.sight.speed_mps < _STANDS_MPS
    return STEP_S * (stands and any(siren.behind for siren in state.sight.sirens))


def _red_line(state: SeatState) -> float:
    return float(state.red_lines)


def _indicator(state: SeatState) -> float:
    rate_mps = (state.sight.left_m - state.before.left_m) / STEP_S
    shown = int(state.sight.states.lights[state.sight.row]) & indicator_to(rate_mps)
    return STEP_S * (abs(rate_mps) > _ASIDE_MPS and not shown and not state.sight.in_junction)


def _braking(state: SeatState) -> float:
    return STEP_S * max(-float(state.sight.states.accel_mps2[state.sight.row]) - _GENTLE_MPS2, 0.0)


def _short_time(state: SeatState) -> float:
    sight, short = state.sight, False
    for other in sight.others:
        closing_mps = sight.speed_mps - other.speed_mps
        in_line = abs(other.left_m - sight.left_m) < other.half_width_m + 0.5 * sight.width_m
        short = short or (in_line and 0.0 < other.gap_m < _SHORT_S * closing_mps)
    return STEP_S * short


def _emv_delay(state: SeatState) -> float:
    if state.emv_row is None:
        return 0.0
    vx, vy = state.sight.states.vx_mps[state.emv_row], state.sight.states.vy_mps[state.emv_row]
    return STEP_S * max(1.0 - float((vx * vx + vy * vy) ** 0.5) / state.emv_wanted_mps, 0.0)


def _progress(state: SeatState) -> float:
    limit_mps = float(state.sight.way.limit_mps[state.sight.way.row(state.sight.s_m)])
    return (state.sight.s_m - state.before.s_m) / limit_mps


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


def terms_of(state: SeatState) -> dict[str, float]:
    """The amount of every term at a state."""
    return {name: term.of(state) for name, term in TERMS.items()}


DECISION_S: Final = 0.2
SEEDS: Final = (0, 1000)
"""Seeds from which episodes are drawn; seeds from 1000 on are reserved for tests of learned drivers."""
_PEDALS: Final = 3


class Observation(StrEnum):
    """Kinds of observations."""

    VECTOR = "vector"
    RASTER = "raster"


class Action(StrEnum):
    """Kinds of actions."""

    MANOEUVRE = "manoeuvre"
    CONTINUOUS = "continuous"


_OF_SPACES: Final = frozenset({"observation", "action"})
"""Options that cannot change between episodes, because the spaces depend on them."""


def _refuse_unknown(options: Mapping[str, Any], known: Collection[str]) -> None:
    for name in options:
        if name not in known:
            raise InputError("option", name, f"one of {', '.join(known)}")


@dataclass(frozen=True)
class EnvOptions:
    """The options of an environment.

    Raises:
        InputError: An option cannot be used.
    """

    template: str = "S2"
    """Template of the episodes, as in a request."""
    level: str | int | None = None
    """Level, such as ``2`` or ``L2``; None for the template's own."""
    map: str = ""
    """Map, as in a request."""
    site: str = ""
    """Site on the map, as in a request; if empty, the seed decides."""
    preset: str = "paper"
    """Preset of the other civilians' behaviour."""
    values: str = ""
    """Values of the template's parameters, as in a request."""
    duration_s: float = 0.0
    """Simulated time of an episode; 0 for the template's own."""
    observation: str = Observation.VECTOR.value
    """Kind of observations: ``vector`` or ``raster``."""
    action: str = Action.MANOEUVRE.value
    """Kind of actions: ``manoeuvre`` or ``continuous``."""
    decision_s: float = DECISION_S
    """Simulated time between actions, a multiple of 0.05 s."""
    rewards: Mapping[str, float] = field(default_factory=dict)
    """Weights that replace those in the table of rewards."""
    rulebook: str = "international"
    """Rulebook that grades the driver in ``info`` at the end; empty for none."""
    seeds: tuple[int, int] = SEEDS
    """Range of seeds that are drawn: the first one, and the one after the last."""
    snapshots: int = 0
    """Number of episodes that wait after their warm-up, so that a reset to one of them begins at once."""

    def __post_init__(self) -> None:
        for name, kinds in (("observation", Observation), ("action", Action)):
            if getattr(self, name) not in [*kinds]:
                raise InputError(name, getattr(self, name), f"one of {', '.join(kinds)}")
        if self._level not in ("", *EmergencyLevel.__members__):
            raise InputError("level", self.level, f"0 to 3, or one of {', '.join(EmergencyLevel.__members__)}")
        steps = self.decision_s / STEP_S
        if not (1.0 - 1e-6 <= steps <= 200.0 and abs(steps - round(steps)) < 1e-6):
            raise InputError("decision_s", self.decision_s, f"a multiple of {STEP_S} s, at most 10 s")
        first, after = self.seeds
        if not 0 <= first < after:
            raise InputError("seeds", self.seeds, "the first seed and the one after the last")
        if self.snapshots < 0:
            raise InputError("snapshots", self.snapshots, "0 or more")

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> "EnvOptions":
        """Add the defaults of the other options; InputError also for an unknown option."""
        _refuse_unknown(options, [*cls.__dataclass_fields__])
        return cls(**options)

    def changed(self, options: Mapping[str, Any]) -> "EnvOptions":
        """The options of one episode, with those of its reset.

        Raises:
            InputError: An option does not exist, cannot be used, or would change a space.
        """
        _refuse_unknown(options, [name for name in self.__dataclass_fields__ if name not in _OF_SPACES])
        return replace(self, **options)

    def check_action(self, action: Any) -> None:
        """Check an action; InputError unless it is in the action space.

        Numbers beyond −1 and 1 of a continuous action are no error: they count as −1 and 1.
        """
        array = np.asarray(action)
        if self.action == Action.MANOEUVRE:
            if array.size != 1 or array.dtype.kind not in "iu" or int(array.item()) not in {*Manoeuvre}:
                names = ", ".join(f"{one.value} ({one.name.lower()})" for one in Manoeuvre)
                raise InputError("action", action, f"a whole number: {names}")
        elif array.shape != (_PEDALS,) or array.dtype.kind not in "iuf" or not np.isfinite(array).all():
            raise InputError("action", action, f"{_PEDALS} finite numbers: acceleration, wheel and indicator")

    @property
    def steps_per_decision(self) -> int:
        """Number of simulated steps between actions."""
        return round(self.decision_s / STEP_S)

    @property
    def _level(self) -> str:
        return "" if self.level is None else level_name(self.level)

    def request(self, seed: int, *, with_av: bool) -> EpisodeRequest:
        """Request of the episode with a seed."""
        return EpisodeRequest(
            template=self.template,
            level=self._level,
            seed=seed,
            map=self.map,
            site=self.site,
            preset=self.preset,
            values=self.values,
            duration_s=self.duration_s,
            sensors="none",
            av="civilian" if with_av else "",
        )

    def observation_space(self) -> spaces.Box:
        """Space of the observations."""
        if self.observation == Observation.RASTER:
            return spaces.Box(0, 255, RASTER_SHAPE, np.uint8)
        return spaces.Box(-1.0, 1.0, (VECTOR_SIZE,), np.float32)

    def action_space(self) -> spaces.Space[Any]:
        """Space of the actions."""
        if self.action == Action.CONTINUOUS:
            return spaces.Box(-1.0, 1.0, (_PEDALS,), np.float32)
        return spaces.Discrete(len(Manoeuvre))
