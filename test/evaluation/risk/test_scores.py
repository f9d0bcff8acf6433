"""Scores of three classes: closed forms, and the paper's table from confusion matrices."""

import numpy as np
import pytest

from siren_ros.evaluation.risk.reports.paper_table import PAPER_BALANCE, PAPER_SCORES
from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.evaluation.risk.scores import (
    NO_ANSWER,
    SCORES,
    accuracy,
    balanced_accuracy,
    confusion,
    f1,
    macro_f1,
    precision,
    recall,
)

NORMAL, NEAR_MISS, COLLISION = RiskClass


def test_counts_are_label_by_answer() -> None:
    counts = confusion([NORMAL, NORMAL, NEAR_MISS, COLLISION], [NORMAL, COLLISION, None, NEAR_MISS])
    assert counts.tolist() == [[1, 0, 1, 0], [0, 0, 0, 1], [0, 1, 0, 0]]


def test_closed_forms() -> None:
    counts = np.array([[6, 2, 0, 2], [1, 3, 1, 0], [0, 1, 4, 0]])
    assert accuracy(counts).value == pytest.approx(13 / 20)
    assert precision(counts, NORMAL).value == pytest.approx(6 / 7)
    assert recall(counts, NORMAL).value == pytest.approx(6 / 10)
    assert precision(counts, NEAR_MISS).value == pytest.approx(3 / 6)
    assert recall(counts, NEAR_MISS).value == pytest.approx(3 / 5)
    assert f1(counts, COLLISION).value == pytest.approx(2 * 4 / (5 + 5))
    assert balanced_accuracy(counts).value == pytest.approx((0.6 + 0.6 + 0.8) / 3)
    assert macro_f1(counts).value == pytest.approx((12 / 17 + 6 / 11 + 8 / 10) / 3)


def test_what_divides_by_nothing_is_not_valid() -> None:
    counts = confusion([NORMAL, NEAR_MISS], [NORMAL, NORMAL])
    assert not precision(counts, COLLISION).valid
    assert not recall(counts, COLLISION).valid
    assert not precision(counts, NEAR_MISS).valid
    assert recall(counts, NEAR_MISS).valid
    assert not any(score(np.zeros((3, 4), dtype=np.int64)).valid for score in SCORES.values())


@pytest.mark.parametrize(
    ("model", "counts"),
    [
        ("MiniCPM-V-4.5-8B", [[49, 0, 25], [5, 0, 20], [3, 0, 3]]),
        ("Qwen3.5-9B", [[74, 0, 0], [25, 0, 0], [6, 0, 0]]),
        ("Gemma3-12B", [[9, 55, 10], [1, 19, 5], [0, 6, 0]]),
        ("LLaVA-Llama3-8B", [[0, 74, 0], [0, 24, 1], [0, 6, 0]]),
        ("Blaifa-InternVL3.5-8B", [[32, 41, 1], [5, 18, 2], [1, 5, 0]]),
    ],
)
def test_the_papers_table_from_counts(model: str, counts: list[list[int]]) -> None:
    """The paper's numbers give the right answers and the answers of each class, not how the wrong ones are spread."""
    matrix = np.concatenate((counts, np.zeros((3, 1), dtype=np.int64)), axis=1)
    assert tuple(matrix.sum(axis=1)) == PAPER_BALANCE
    for name, value in PAPER_SCORES[model].items():
        assert 100.0 * SCORES[name](matrix).value == pytest.approx(100.0 * value, abs=0.005), name


def test_an_unreadable_answer_counts_as_wrong_and_as_no_class() -> None:
    with_none, without = confusion([NORMAL, NORMAL], [NORMAL, None]), confusion([NORMAL], [NORMAL])
    assert with_none[NORMAL, NO_ANSWER] == 1
    assert accuracy(with_none).value == 0.5
    assert recall(with_none, NORMAL).value == 0.5
    assert precision(with_none, NORMAL).value == precision(without, NORMAL).value == 1.0
