"""Precision over recall."""

from pathlib import Path

import numpy as np
import pytest
from made_detector_scores import detector_scores
from matplotlib.figure import Figure

from siren_ros.evaluation.detection.pictures import draw_curves


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Figures in place of files."""
    figures: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **_: (figures.append(figure), path.touch()))
    return figures


def test_a_panel_has_a_line_for_each_distance(kept: list[Figure]) -> None:
    draw_curves(detector_scores("mine", {"S1": 0.4}), Path("a.png"))
    (figure,) = kept
    (axes,) = figure.axes
    assert axes.get_title() == "S1: mAP 0.400"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("recall", "precision")
    assert axes.get_xlim() == (0.0, 1.0)
    assert axes.get_ylim() == pytest.approx((0.0, 1.0), abs=0.05)
    assert axes.get_ylim()[1] > 1.0, "a line at 1 is seen"
    labels = ["0.5 m, AP 0.25", "1 m, AP 0.35", "2 m, AP 0.45", "4 m, AP 0.55"]
    assert [line.get_label() for line in axes.lines] == labels
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == labels
    for place, line in enumerate(axes.lines):
        x, y = np.asarray(line.get_xydata()).T
        assert x == pytest.approx(np.arange(101) / 100.0)
        assert (y[0], y[-1]) == pytest.approx((1.0, 0.1 * place))
    assert figure.get_suptitle() == "mine: Car, for each largest distance of a match"


@pytest.mark.parametrize(("count", "rows", "columns"), [(1, 1, 1), (3, 1, 3), (4, 1, 4), (5, 2, 4), (7, 2, 4)])
def test_four_panels_stand_in_a_row(kept: list[Figure], count: int, rows: int, columns: int) -> None:
    draw_curves(detector_scores("mine", {f"S{number}": 0.4 for number in range(count)}), Path("a.png"))
    (figure,) = kept
    places = [axes.get_subplotspec() for axes in figure.axes]
    geometry = [place.get_geometry() for place in places if place is not None]
    assert geometry == [(rows, columns, number, number) for number in range(count)]
    width, height = figure.get_size_inches()
    # Panels of one size, whatever their number.
    assert (width / columns, height / rows) == pytest.approx((3.2, 3.0))
