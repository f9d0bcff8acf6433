"""Scores of three-class answers: confusion matrices and what is read from them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.evaluation.risk.risk_class import RiskClass

Confusion = npt.NDArray[np.int64]
"""Counts of videos, shape ``(3, 4)``: row the reference class, column the answer, the last one for no usable answer."""

NO_ANSWER: Final = len(RiskClass)
"""Column of the videos whose answer could not be read. They count as wrong, and as no answer of any class."""


@dataclass(frozen=True)
class Score:
    """A score between 0 and 1; 0 and not valid where it would divide by nothing. The paper prints 0 there, too."""

    value: float
    valid: bool = True


def confusion(reference: Sequence[RiskClass], answers: Sequence[RiskClass | None]) -> Confusion:
    """Counts of each reference class and answer; None is an answer that could not be read."""
    counts = np.zeros((len(RiskClass), len(RiskClass) + 1), dtype=np.int64)
    columns = [NO_ANSWER if answer is None else answer for answer in answers]
    np.add.at(counts, (np.array(reference, dtype=np.intp), np.array(columns, dtype=np.intp)), 1)
    return counts


def accuracy(counts: Confusion) -> Score:
    """Share of right answers."""
    return _share(int(np.trace(counts)), int(counts.sum()))


def precision(counts: Confusion, risk: RiskClass) -> Score:
    """Share of the answers of a class that are right; not valid where the class was never answered."""
    return _share(int(counts[risk, risk]), int(counts[:, risk].sum()))


def recall(counts: Confusion, risk: RiskClass) -> Score:
    """Share of the videos of a class that were recognised; not valid where there are none."""
    return _share(int(counts[risk, risk]), int(counts[risk].sum()))


def f1(counts: Confusion, risk: RiskClass) -> Score:
    """Harmonic mean of precision and recall: 2·TP / (answers + videos) of the class."""
    return _share(2 * int(counts[risk, risk]), int(counts[:, risk].sum() + counts[risk].sum()))


def balanced_accuracy(counts: Confusion) -> Score:
    """Mean recall of the classes that have videos."""
    return _mean([recall(counts, risk) for risk in RiskClass])


def macro_f1(counts: Confusion) -> Score:
    """Mean F1 of the classes that have videos or answers."""
    return _mean([f1(counts, risk) for risk in RiskClass])


def _of_class(score: Callable[[Confusion, RiskClass], Score], risk: RiskClass) -> Callable[[Confusion], Score]:
    return lambda counts: score(counts, risk)


SCORES: Final[Mapping[str, Callable[[Confusion], Score]]] = {
    "accuracy": accuracy,
    "balanced_accuracy": balanced_accuracy,
    "macro_f1": macro_f1,
    **{
        f"{name}_{risk.name.lower()}": _of_class(score, risk)
        for name, score in (("precision", precision), ("recall", recall), ("f1", f1))
        for risk in RiskClass
    },
}
"""Every score by its name in tables and files."""


def _share(part: int, whole: int) -> Score:
    return Score(part / whole) if whole else Score(0.0, valid=False)


def _mean(scores: Sequence[Score]) -> Score:
    known = [score.value for score in scores if score.valid]
    return Score(float(np.mean(known))) if known else Score(0.0, valid=False)
