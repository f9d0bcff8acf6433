"""Rows of submitted hypotheses, before anything is concluded from them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.errors import InputError
from siren_ros.evaluation.prediction.protocol.window import FUTURE_POINTS, HistoryWindow, future_times_s
from siren_ros.numerics.arrays import Flags, Floats, Rows

Integers = npt.NDArray[np.int64]

PERIODS_S: Final = {25: 0.2, 30: 0.2, 50: 0.1, 60: 0.1, 80: 0.1}
"""Time between the points of a path, by their number: 5 or 6 s at 0.2 s, 5, 6 or 8 s at 0.1 s."""


@dataclass(frozen=True)
class SubmittedRows:
    """R hypotheses, one row each."""

    source: str
    """File or topic, for errors."""
    episode: npt.NDArray[np.object_]
    """Name of the episode, shape ``(R,)``."""
    actor_id: Integers
    step: Integers
    """The present."""
    mode: Integers
    """Number of the hypothesis within its sample."""
    probability: Floats
    xy_m: Floats
    """On the common grid, frame ``map``, shape ``(R, FUTURE_POINTS, 2)``."""
    window: HistoryWindow
    """Which samples the model answers."""

    def __len__(self) -> int:
        return len(self.episode)

    def named(self, row: int) -> str:
        """A row in words."""
        return f"episode {self.episode[row]}, actor {self.actor_id[row]}, step {self.step[row]}, mode {self.mode[row]}"

    def select(self, rows: Rows | Flags) -> "SubmittedRows":
        """Some of the rows."""
        arrays: dict[str, Any] = {
            name: values[rows] for name, values in vars(self).items() if isinstance(values, np.ndarray)
        }
        return SubmittedRows(source=self.source, window=self.window, **arrays)


def refuse(source: str, wrong: Flags, what: str, named: Callable[[int], str], allowed: str) -> None:
    """Refuses rows that are wrong.

    Args:
        source: File or topic.
        wrong: Which rows are, shape ``(R,)``.
        what: What is wrong with them.
        named: A row in words.
        allowed: What would be right.

    Raises:
        InputError: With their number and the first, where there is one.
    """
    if wrong.any():
        told = f"{source}: {wrong.sum()} of {len(wrong)} {what}; the first is {named(int(np.argmax(wrong)))}"
        raise InputError("predictions", told, allowed)


def on_grid(xy_m: Floats) -> Floats:
    """Paths on the common grid, from paths of a length of ``PERIODS_S``.

    Every time of the grid is a time of these paths, so nothing is interpolated: of 60 points at 0.1 s, every second
    up to 5 s.

    Args:
        xy_m: Shape ``(R, L, 2)``; the first point lies one period after the present.

    Returns:
        Shape ``(R, FUTURE_POINTS, 2)``.
    """
    period_s = PERIODS_S[xy_m.shape[1]]
    points = np.round(future_times_s() / period_s).astype(np.intp) - 1
    return np.ascontiguousarray(xy_m[:, points[:FUTURE_POINTS]])
