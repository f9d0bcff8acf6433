"""The options of a learning environment: episodes, spaces, reward."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import InputError
from siren_ros.lab.learning.raster import SHAPE
from siren_ros.running.seat.features import SIZE
from siren_ros.running.seat.manoeuvres import Manoeuvre
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import EmergencyLevel, level_name

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
            return spaces.Box(0, 255, SHAPE, np.uint8)
        return spaces.Box(-1.0, 1.0, (SIZE,), np.float32)

    def action_space(self) -> spaces.Space[Any]:
        """Space of the actions."""
        if self.action == Action.CONTINUOUS:
            return spaces.Box(-1.0, 1.0, (_PEDALS,), np.float32)
        return spaces.Discrete(len(Manoeuvre))
