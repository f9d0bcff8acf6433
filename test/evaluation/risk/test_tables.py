"""Tables of made counts, cell by cell."""

import numpy as np
import pytest

from siren_ros.evaluation.risk.scoring import SCORES, ModelScores
from siren_ros.evaluation.risk.tables import PAPER_BALANCE, PAPER_SCORES, csv_of_scores, scores_as_json, tables_of
from siren_ros.tables.table import Table

FIRST = np.array([[6, 2, 0, 0], [1, 3, 0, 1], [0, 0, 0, 0]])
SECOND = np.array([[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 4, 0]])


def scores(name: str, first: np.ndarray = FIRST, second: np.ndarray = SECOND) -> ModelScores:
    """Of S1 and S6."""
    return ModelScores(name, 24, int((first + second).sum()), first + second, {"S1": first, "S6": second})


def tables(*models: ModelScores, compare_paper: bool = False) -> dict[str, Table]:
    return {table.key: table for table in tables_of(scores_as_json(models), compare_paper=compare_paper)}


def test_scores_in_percent() -> None:
    """Of 20 videos 16 are right. Recalls 8/10, 4/6, 4/4; precisions 8/9, 4/6, 4/4; F1 16/19, 8/12, 1."""
    found = tables(scores("m"))
    assert found["scores"].head == ("model", "videos", "accuracy", "balanced accuracy", "macro F1")
    ((name, videos, *cells),) = found["scores"].cells()
    assert (name, videos) == ("m", "20/24")
    assert [cell.split()[0] for cell in cells] == ["80.00", "82.22", "83.63"]
    assert cells[0] == "80.00 [58.40, 91.93]"
    assert found["classes"].head[1:4] == ("P Normal", "R Normal", "F1 Normal")
    ((_, *cells),) = found["classes"].cells()
    assert [cell.split()[0] for cell in cells] == [
        "88.89", "80.00", "84.21", "66.67", "66.67", "66.67", "100.00", "100.00", "100.00",
    ]  # fmt: skip
    assert [place for place, cell in enumerate(cells) if "[" in cell] == [2, 5, 8], "intervals of F1"
    none = np.zeros_like(FIRST)
    few = tables(scores("m", none, np.diag([2, 1, 1, 0])[:3]))["scores"]
    assert few.cells()[0][2] == "100.00 [–]", "four videos"
    assert few.has_unbounded


def test_the_papers_rows_stand_below_ours() -> None:
    found = tables(scores("m"), compare_paper=True)
    overall, of_classes = ({row[0]: row[1:] for row in found[key].cells()} for key in ("scores", "classes"))
    assert overall["Qwen3.5-9B (paper)"] == ("105", "70.48", "–", "–")
    assert of_classes["Qwen3.5-9B (paper)"] == ("70.48", "–", "82.68", "0.00", "–", "0.00", "0.00", "–", "0.00")
    assert len(overall) == len(of_classes) == 1 + len(PAPER_SCORES)
    assert len(found["scores"].reference) == len(PAPER_SCORES)


def test_csv() -> None:
    lines = csv_of_scores([scores("m"), scores("n")]).splitlines()
    assert lines[0] == "model,group,score,value,low,high,videos"
    assert "m,all,accuracy,0.800000,0.583983,0.919342,20" in lines
    assert "n,S1,accuracy,0.692308,,,13" in lines
    assert "m,S1,recall_collision,,,,13" in lines, "there are none"
    assert "m,S6,precision_collision,1.000000,,,7" in lines
    assert len(lines) == 1 + 2 * 3 * len(SCORES)


def test_json() -> None:
    found = scores_as_json([scores("m")])
    assert found["classes"] == ["Normal", "Near-Miss", "Collision"]
    model = found["models"]["m"]
    assert (model["videos"], model["answered"]) == (24, 20)
    assert model["scores"]["accuracy"] == pytest.approx(
        {"value": 0.8, "low": 0.583983, "high": 0.919342, "episodes": 20}
    )
    assert model["confusion"] == [[8, 2, 0, 0], [1, 4, 0, 1], [0, 0, 4, 0]]
    assert model["confusion_by_template"] == {"S1": FIRST.tolist(), "S6": SECOND.tolist()}


def test_confusion_matrices() -> None:
    found = tables(scores("m"), scores("oracle"))
    overall, by_template = found["confusion"], found["confusion_by_template"]
    answers = ("label", "answered Normal", "answered Near-Miss", "answered Collision", "unreadable")
    assert (overall.head, by_template.head) == (("model", *answers), ("model", "template", *answers))
    assert overall.cells()[:3] == [
        ("m", "Normal", "8", "2", "0", "0"),
        ("m", "Near-Miss", "1", "4", "0", "1"),
        ("m", "Collision", "0", "0", "4", "0"),
    ]
    assert len(overall.rows) == 6
    assert by_template.cells()[0] == ("m", "S1", "Normal", "6", "2", "0", "0")
    assert by_template.cells()[3] == ("m", "S6", "Normal", "2", "0", "0", "0")
    assert len(by_template.rows) == 6, "not of the oracle"


@pytest.mark.parametrize("name", PAPER_SCORES)
def test_the_papers_accuracies_are_counts_of_its_videos(name: str) -> None:
    videos = sum(PAPER_BALANCE)
    right = PAPER_SCORES[name]["accuracy"] * videos
    assert videos == 105
    assert right == pytest.approx(round(right), abs=0.01)
