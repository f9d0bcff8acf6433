"""Drivers that choose manoeuvres: learned ones, each an ONNX file with its card, and the rule that they imitate."""

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from math import inf, isfinite
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.params.plain_files import NetworkFile, open_network
from siren_ros.errors import InputError
from siren_ros.running.seat.policy import VECTOR_SIZE, Aim, Manoeuvre, aim_of, by_manoeuvre, features_of
from siren_ros.running.seat.sight import Sight
from siren_ros.simulation.world.commands import AvControl

INPUT: Final = "observation"
"""Name of the network's input, ``(N, VECTOR_SIZE)``."""
OUTPUT: Final = "logits"
"""Name of the network's output, one number per manoeuvre."""
SHIPPED: Final = Path("drivers", "learned.onnx")
"""Place of the shipped driver below the parameter files."""
_NEVER: Final = -(10**9)
IN_LINE_M: Final = 3.0
"""Distance across the road within which a siren comes in the own lane."""
_IN_LINE_GAP_M: Final = 40.0
_RULE_STEPS: Final = round(0.5 / STEP_S)
"""A rule decides as often as the shipped network."""
DECISION_LIMIT_S: Final = 10.0
"""Limit on the wall time of a decision. Networks of this size need microseconds, but loops in a foreign file might not
end."""
_LONGEST_S: Final = 60.0
"""Largest simulated time between two decisions."""


@dataclass(frozen=True)
class LearnedState:
    """State of the driver."""

    aim: Aim = field(default_factory=Aim)
    decided: int = _NEVER
    """Step of the last decision."""


@dataclass(frozen=True)
class LearnedDriver:
    """Chooses a manoeuvre again and again, at the rate at which it was trained."""

    choose: Callable[[Sight], Manoeuvre]
    steps_per_decision: int

    @property
    def start(self) -> LearnedState:
        """State before the first decision: the driver keeps its lane."""
        return LearnedState()

    def step(self, state: LearnedState, sight: Sight) -> tuple[LearnedState, AvControl]:
        """Decide a step; InputError if a network gives no answer."""
        if sight.step - state.decided >= self.steps_per_decision:
            state = LearnedState(aim_of(state.aim, self.choose(sight), sight), sight.step)
        return state, by_manoeuvre(state.aim, sight)


def comes_from_behind(sight: Sight, gap_m: float, aside_m: float = inf) -> bool:
    """Whether a siren comes from behind within a gap along the road and a distance across it."""
    return any(siren.behind and siren.gap_m < gap_m and abs(siren.left_m) < aside_m for siren in sight.sirens)


def pulls_over(sight: Sight) -> Manoeuvre:
    """Rule that pulls over while a siren comes from behind in the own lane."""
    return Manoeuvre.PULL_OVER if comes_from_behind(sight, _IN_LINE_GAP_M, IN_LINE_M) else Manoeuvre.KEEP


BY_RULE: Final = LearnedDriver(pulls_over, _RULE_STEPS)
"""The best of the rules that ``siren train driver`` imitates."""


def outputs_of(network: NetworkFile, path: str, features: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Compute one finite number per manoeuvre from the ``VECTOR_SIZE`` features of a sight.

    Raises:
        InputError: The network fails, does not end in time, or gives other outputs.
    """
    import onnxruntime  # noqa: PLC0415 - as in base/params/plain_files.py

    options = onnxruntime.RunOptions()
    options.log_severity_level = 4  # errors of the network are raised, not logged
    watch = threading.Timer(DECISION_LIMIT_S, setattr, (options, "terminate", True))
    watch.daemon = True
    watch.start()
    try:
        (outputs,) = network.session.run([OUTPUT], {INPUT: features[None]}, options)
    except Exception as error:
        reason = f"it did not end within {DECISION_LIMIT_S:g} s" if options.terminate else str(error)
        raise InputError("driver", path, f"a network that decides ({reason:.200})") from error
    finally:
        watch.cancel()
    values = np.asarray(outputs)
    if values.shape != (1, len(Manoeuvre)) or values.dtype.kind != "f" or not np.isfinite(values).all():
        raise InputError("driver", path, f"a network that gives {len(Manoeuvre)} finite numbers")
    return values[0]


def _chosen(network: NetworkFile, path: str, sight: Sight) -> Manoeuvre:
    """The manoeuvre with the largest output."""
    return Manoeuvre(int(np.argmax(outputs_of(network, path, features_of(sight)))))


def open_driver(path: Path) -> LearnedDriver:
    """Load a learned driver.

    Raises:
        InputError: The file, its card or its observations cannot be used.
    """
    network = open_network(path)
    card = network.card.get("task")
    task: Mapping[str, Any] = card if isinstance(card, dict) else {}
    sizes = [each.shape[-1:] for each in network.session.get_inputs()]
    if (sizes, task.get("observation"), task.get("action")) != ([[VECTOR_SIZE]], "vector", "manoeuvre"):
        raise InputError("driver", str(path), f"a network that chooses manoeuvres by {VECTOR_SIZE} numbers")
    decision_s = task.get("decision_s")
    if not isinstance(decision_s, int | float) or not isfinite(decision_s) or not STEP_S <= decision_s <= _LONGEST_S:
        allowed = f"a card with task.decision_s from {STEP_S:g} to {_LONGEST_S:g} s"
        raise InputError("driver", f"{path}: {decision_s!r:.40}", allowed)
    nothing = np.zeros(VECTOR_SIZE, np.float32)
    outputs_of(network, str(path), nothing)  # a network that cannot decide is refused before an episode begins
    return LearnedDriver(partial(_chosen, network, str(path)), round(decision_s / STEP_S))
