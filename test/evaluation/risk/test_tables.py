"""Tables of made counts, cell by cell."""

import numpy as np
import pytest

from siren_ros.evaluation.risk.scoring import SCORES, ModelScores
from siren_ros.evaluation.risk.tables import (
    PAPER_BALANCE,
    PAPER_SCORES,
    as_json,
    confusion_lines,
    csv_table,
    latex_table,
    text_table,
)

FIRST = np.array([[6, 2, 0, 0], [1, 3, 0, 1], [0, 0, 0, 0]])
SECOND = np.array([[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 4, 0]])


def scores(name: str, first: np.ndarray = FIRST, second: np.ndarray = SECOND) -> ModelScores:
    """Of S1 and S6."""
    return ModelScores(name, 24, int((first + second).sum()), first + second, {"S1": first, "S6": second})


def test_text() -> None:
    """Of 20 videos 16 are right. Recalls 8/10, 4/6, 4/4; precisions 8/9, 4/6, 4/4; F1 16/19, 8/12, 1."""
    head, row = (line.split("  ") for line in text_table([scores("m")], compare_paper=False))
    assert [cell.strip() for cell in head if cell][:5] == ["model", "videos", "Acc.", "bal. Acc.", "macro F1"]
    assert [cell.strip() for cell in row if cell] == [
        "m", "20/24", "80.00 [58, 92]", "82.22", "83.63 [67, 92]",
        "88.89", "80.00", "84.21", "66.67", "66.67", "66.67", "100.00", "100.00", "100.00",
    ]  # fmt: skip
    none = np.zeros_like(FIRST)
    (_, row, why) = text_table([scores("m", none, np.diag([2, 1, 1, 0])[:3])], compare_paper=False)
    assert "100.00 [-]" in row, "four videos"
    assert why.startswith("[-] is no interval: it takes 5 episodes")


def test_text_next_to_the_papers() -> None:
    lines = text_table([scores("m")], compare_paper=True)
    (qwen,) = [line for line in lines if line.startswith("Qwen3.5-9B (paper)")]
    assert qwen.split()[2:] == ["105", "70.48", "70.48", "82.68", *["0.00"] * 4]
    assert len(lines) == 2 + len(PAPER_SCORES)


def test_csv() -> None:
    lines = csv_table([scores("m"), scores("n")]).splitlines()
    assert lines[0] == "model,group,score,value,low,high,videos"
    assert "m,all,accuracy,0.800000,0.583983,0.919342,20" in lines
    assert "n,S1,accuracy,0.692308,,,13" in lines
    assert "m,S1,recall_collision,,,,13" in lines, "there are none"
    assert "m,S6,precision_collision,1.000000,,,7" in lines
    assert len(lines) == 1 + 2 * 3 * len(SCORES)


def test_latex() -> None:
    lines = latex_table([scores("m_%&")], compare_paper=True).splitlines()
    assert lines[0] == r"\begin{tabular}{@{}lccccccc@{}}"
    assert lines[2] == (
        r" & & \multicolumn{2}{c}{Normal} & \multicolumn{2}{c}{Near-Miss} & \multicolumn{2}{c}{Collision} \\"
    )
    assert lines[3] == r"Model & Acc. & Prec. & F1 & Prec. & F1 & Prec. & F1 \\"
    assert lines[5] == r"m\_\%\& & 80.00 & 88.89 & 84.21 & 66.67 & 66.67 & 100.00 & 100.00 \\"
    assert lines[6] == r"\midrule"
    assert lines[7] == r"Blaifa-InternVL3.5-8B (paper) & 47.62 & 84.21 & 57.14 & 28.12 & 40.45 & 0.00 & 0.00 \\"
    assert lines[7 + len(PAPER_SCORES) :] == [r"\bottomrule", r"\end{tabular}"]
    assert len(latex_table([scores("m")], compare_paper=False).splitlines()) == 8


def test_json() -> None:
    found = as_json([scores("m")])
    assert found["classes"] == ["Normal", "Near-Miss", "Collision"]
    model = found["models"]["m"]
    assert (model["videos"], model["answered"]) == (24, 20)
    assert model["scores"]["accuracy"] == pytest.approx(
        {"value": 0.8, "low": 0.583983, "high": 0.919342, "episodes": 20}
    )
    assert model["confusion"] == [[8, 2, 0, 0], [1, 4, 0, 1], [0, 0, 4, 0]]
    assert model["confusion_by_template"] == {"S1": FIRST.tolist(), "S6": SECOND.tolist()}


def test_matrices_as_text() -> None:
    lines = [line.split() for line in confusion_lines(scores("m"))]
    assert lines[0] == ["m", "label", "Normal", "Near-Miss", "Collision", "unreadable"]
    assert lines[1:4] == [
        ["all", "Normal", "8", "2", "0", "0"],
        ["Near-Miss", "1", "4", "0", "1"],
        ["Collision", "0", "0", "4", "0"],
    ]
    assert lines[4] == ["S1", "Normal", "6", "2", "0", "0"]
    assert lines[7] == ["S6", "Normal", "2", "0", "0", "0"]


@pytest.mark.parametrize("name", PAPER_SCORES)
def test_the_papers_accuracies_are_counts_of_its_videos(name: str) -> None:
    videos = sum(PAPER_BALANCE)
    right = PAPER_SCORES[name]["accuracy"] * videos
    assert videos == 105
    assert right == pytest.approx(round(right), abs=0.01)
