"""Where the two probabilities of the sequence model are cut: chosen on validation clips."""

from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.evaluation.risk.reports.paper_table import PAPER_BALANCE
from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.numerics.arrays import Floats32

Logits = npt.NDArray[np.float32]
_STEPS: Final = 40


def operating_point(logits: Logits, labels: npt.NDArray[np.int64]) -> Floats32:
    """The offsets of both logits that give the best macro F1 at the paper's balance of classes, shape ``(2,)``.

    Clips of a class count so that the classes have the paper's shares. Among equally good offsets the middle one is
    taken.

    Args:
        logits: Of the clips, shape ``(N, 2)``.
        labels: Their classes, shape ``(N,)``.
    """
    counts = np.bincount(labels, minlength=len(RiskClass))
    weight = np.array(PAPER_BALANCE) / np.maximum(counts, 1)
    tried = [_between(logits[:, question]) for question in range(2)]
    score = np.array([[_macro_f1(logits, labels, weight, (near, hit)) for hit in tried[1]] for near in tried[0]])
    best = np.argwhere(score >= score.max() - 1e-9)
    near, hit = best[np.argsort(np.abs(best - best.mean(axis=0)).sum(axis=1), kind="stable")[0]]
    return np.array([tried[0][near], tried[1][hit]], dtype=np.float32)


def classes_at(logits: Logits, offsets: tuple[float, float]) -> npt.NDArray[np.int64]:
    """The class of each clip: the more severe question first."""
    near, hit = (logits[:, question] > offsets[question] for question in range(2))
    return np.where(hit, RiskClass.COLLISION, np.where(near, RiskClass.NEAR_MISS, RiskClass.NORMAL)).astype(np.int64)


def _between(values: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
    return np.quantile(values.astype(np.float64), (np.arange(_STEPS) + 0.5) / _STEPS)


def _macro_f1(
    logits: Logits, labels: npt.NDArray[np.int64], weight: npt.NDArray[np.float64], offsets: tuple[float, float]
) -> float:
    answers = classes_at(logits, offsets)
    counts = np.zeros((len(RiskClass), len(RiskClass)))
    np.add.at(counts, (labels, answers), weight[labels])
    whole = counts.sum(axis=0) + counts.sum(axis=1)
    return float(np.mean(2.0 * np.diag(counts) / np.maximum(whole, 1e-12)))
