"""A driver that has learned: a network that chooses manoeuvres, as an ONNX file with its card."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.errors import InputError
from siren_ros.evaluation.network_file import NetworkFile, open_network
from siren_ros.numerics.units import STEP_S
from siren_ros.seat.features import SIZE, features_of
from siren_ros.seat.manoeuvres import Aim, Manoeuvre, aim_of, by_manoeuvre
from siren_ros.seat.sight import Sight
from siren_ros.world.commands import AvControl

INPUT: Final = "observation"
"""The network's input, ``(N, SIZE)``…"""
OUTPUT: Final = "logits"
"""…and its output, one number for each manoeuvre."""
SHIPPED: Final = Path("drivers", "learned.onnx")
"""Place of the driver that the project ships, below the parameter files."""
_NEVER: Final = -(10**9)


@dataclass(frozen=True)
class LearnedState:
    """Of the driver."""

    aim: Aim = field(default_factory=Aim)
    decided: int = _NEVER
    """Step of the last decision."""


@dataclass(frozen=True)
class LearnedDriver:
    """Chooses the manoeuvre with the greatest output, and decides as often as it did when it learned."""

    network: NetworkFile
    steps_per_decision: int

    @property
    def start(self) -> LearnedState:
        """It keeps its lane until the first decision."""
        return LearnedState()

    def step(self, state: LearnedState, sight: Sight) -> tuple[LearnedState, AvControl]:
        """The answer to a step."""
        if sight.step - state.decided >= self.steps_per_decision:
            (logits,) = self.network.session.run([OUTPUT], {INPUT: features_of(sight)[None]})
            state = LearnedState(aim_of(state.aim, Manoeuvre(int(np.argmax(logits[0]))), sight), sight.step)
        return state, by_manoeuvre(state.aim, sight)


def open_driver(path: Path) -> LearnedDriver:
    """Loads a driver that has learned.

    Raises:
        InputError: The file, its card or its observations cannot be used.
    """
    network = open_network(path)
    task = network.card.get("task", {})
    known = (network.session.get_inputs()[0].shape[-1], task.get("observation"), task.get("action"))
    if known != (SIZE, "vector", "manoeuvre"):
        raise InputError("driver", str(path), f"a network that chooses manoeuvres by {SIZE} numbers")
    return LearnedDriver(network, round(float(task["decision_s"]) / STEP_S))
