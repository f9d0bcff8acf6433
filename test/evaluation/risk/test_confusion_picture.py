"""Panels of the confusion matrices: shades are shares of a label's videos, numbers are counts."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from matplotlib.figure import Figure

from siren_ros.evaluation.risk.risk_page import save_confusions
from siren_ros.evaluation.risk.scoring import ModelScores

COUNTS = np.array([[7, 3, 0, 0], [1, 1, 0, 2], [0, 0, 0, 0]])


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def drawn(monkeypatch: pytest.MonkeyPatch, templates: int, counts: npt.NDArray[np.intp] = COUNTS) -> Figure:
    kept: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **_: (kept.append(figure), path.touch()))
    by_template = {f"S{number}": (number + 1) * counts for number in range(templates)}
    save_confusions(ModelScores("mine", 14, 14, counts, by_template), Path("a.png"))
    (figure,) = kept
    return figure


def test_a_panel(monkeypatch: pytest.MonkeyPatch) -> None:
    figure = drawn(monkeypatch, 1)
    first, second = [axes for axes in figure.axes if axes.get_visible()]
    assert (first.get_title(), second.get_title()) == ("all templates (n = 14)", "S0 (n = 14)")
    (image,) = first.images
    assert np.asarray(image.get_array()) == pytest.approx(
        np.array([[0.7, 0.3, 0.0, 0.0], [0.25, 0.25, 0.0, 0.5], [0.0] * 4])
    )
    assert image.get_clim() == (0.0, 1.0)
    told = {text.get_position(): (text.get_text(), text.get_color()) for text in first.texts}
    assert len(told) == 12
    # Column, row. Dark from 60 % of a label's videos on.
    assert told[0, 0] == ("7", "white")
    assert told[1, 0] == ("3", "black")
    assert told[3, 1] == ("2", "black")
    assert told[2, 2] == ("0", "black")
    assert [text.get_text() for text in first.get_xticklabels()] == ["Normal", "Near-Miss", "Collision", "none"]
    assert [text.get_text() for text in first.get_yticklabels()] == ["Normal", "Near-Miss", "Collision"]
    assert (first.get_xlabel(), first.get_ylabel()) == ("answer", "label")
    assert figure.get_suptitle() == "mine"


def test_numbers_are_white_from_sixty_percent_on(monkeypatch: pytest.MonkeyPatch) -> None:
    figure = drawn(monkeypatch, 0, np.array([[3, 2, 0, 0], [41, 59, 0, 0], [0, 0, 60, 40]]))
    colours = {text.get_text(): text.get_color() for text in figure.axes[0].texts}
    assert {text for text, colour in colours.items() if colour == "white"} == {"3", "60"}


@pytest.mark.parametrize(("templates", "rows"), [(0, 1), (3, 1), (4, 2), (7, 2)])
def test_four_panels_stand_in_a_row(monkeypatch: pytest.MonkeyPatch, templates: int, rows: int) -> None:
    figure = drawn(monkeypatch, templates)
    assert len(figure.axes) == 4 * rows
    assert [axes.get_visible() for axes in figure.axes] == [True] * (1 + templates) + [False] * (
        4 * rows - 1 - templates
    )
    width, height = figure.get_size_inches()
    assert width / 4 == pytest.approx(height / rows, rel=0.1), "a panel is about square"
