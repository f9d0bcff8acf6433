"""A driver that has learned: a network that chooses manoeuvres, as an ONNX file with its card."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.errors import InputError
from siren_ros.evaluation.network_file import NetworkFile, open_network
from siren_ros.learning.features import SIZE
from siren_ros.learning.moment import Moment
from siren_ros.learning.task import Action, Observation, Task
from siren_ros.numerics.arrays import Floats32

INPUT: Final = "observation"
"""The network's input, ``(N, SIZE)``…"""
OUTPUT: Final = "logits"
"""…and its output, one number for each manoeuvre."""


@dataclass(frozen=True)
class Policy:
    """A network that chooses the manoeuvre with the greatest output."""

    network: NetworkFile

    def __call__(self, observation: Floats32, _moment: Moment) -> int:
        """The action for an observation of the kind ``vector``."""
        (logits,) = self.network.session.run([OUTPUT], {INPUT: observation[None]})
        return int(np.argmax(logits[0]))

    @property
    def task(self) -> Task:
        """The task that it was trained for."""
        known = {field.name for field in fields(Task)}
        values: dict[str, Any] = {name: value for name, value in self.network.card["task"].items() if name in known}
        return Task(**{**values, "seeds": tuple(values["seeds"])})


def open_policy(path: Path) -> Policy:
    """Loads a policy.

    Raises:
        InputError: The file, its card or its observations cannot be used.
    """
    policy = Policy(open_network(path))
    asked = policy.network.session.get_inputs()[0].shape[-1]
    task = policy.task
    if asked != SIZE or task.observation != Observation.VECTOR or task.action != Action.MANOEUVRE:
        raise InputError("checkpoint", str(path), f"a driver for manoeuvres by observations of {SIZE} numbers")
    return policy
