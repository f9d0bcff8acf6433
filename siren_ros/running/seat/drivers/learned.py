"""A learned driver: a network that chooses manoeuvres, as an ONNX file with its card."""

import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
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
    """Chooses the manoeuvre with the largest output, at the rate at which it was trained."""

    network: NetworkFile
    steps_per_decision: int
    path: str

    @property
    def start(self) -> LearnedState:
        """State before the first decision: the driver keeps its lane."""
        return LearnedState()

    def step(self, state: LearnedState, sight: Sight) -> tuple[LearnedState, AvControl]:
        """Decide a step; InputError if the network gives no answer."""
        if sight.step - state.decided >= self.steps_per_decision:
            chosen = Manoeuvre(int(np.argmax(self.outputs_of(features_of(sight)))))
            state = LearnedState(aim_of(state.aim, chosen, sight), sight.step)
        return state, by_manoeuvre(state.aim, sight)

    def outputs_of(self, features: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
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
            (outputs,) = self.network.session.run([OUTPUT], {INPUT: features[None]}, options)
        except Exception as error:
            reason = f"it did not end within {DECISION_LIMIT_S:g} s" if options.terminate else str(error)
            raise InputError("driver", self.path, f"a network that decides ({reason:.200})") from error
        finally:
            watch.cancel()
        values = np.asarray(outputs)
        if values.shape != (1, len(Manoeuvre)) or values.dtype.kind != "f" or not np.isfinite(values).all():
            raise InputError("driver", self.path, f"a network that gives {len(Manoeuvre)} finite numbers")
        return values[0]


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
    driver = LearnedDriver(network, round(decision_s / STEP_S), str(path))
    driver.outputs_of(
        np.zeros(VECTOR_SIZE, np.float32)
    )  # a network that cannot decide is refused before an episode begins
    return driver
