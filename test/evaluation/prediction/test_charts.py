"""What charts share: colours, quiet axes, legends without a box, files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_scores import episode_scores, model_scores, reported_scores
from PIL import Image

from siren_ros.errors import InputError
from siren_ros.evaluation.prediction.charts import (
    DPI,
    colour_of_model,
    draw_horizon,
    draw_reliability,
    legend,
    new_figure,
    quiet,
    save,
)
from siren_ros.evaluation.prediction.metrics import reliability_of
from siren_ros.evaluation.prediction.predictors import Hypotheses
from siren_ros.evaluation.prediction.reports.score_table import score_table


def test_models_differ_in_their_colours_until_there_are_many() -> None:
    models = [f"model{number}" for number in range(11)]
    colours = [colour_of_model(models, model) for model in models]
    assert len(set(colours[:9])) == 9
    assert colours[9:] == colours[:2]


def test_quiet_axes_have_no_box_and_their_grid_is_behind() -> None:
    axes = new_figure(3.0, 2.0).add_subplot()
    quiet(axes)
    assert {side: axes.spines[side].get_visible() for side in ("top", "right", "left", "bottom")} == {
        "top": False, "right": False, "left": True, "bottom": True
    }  # fmt: skip
    assert axes.get_axisbelow() is True
    assert all(line.get_visible() for line in axes.get_xgridlines())


def test_a_legend_has_no_frame() -> None:
    axes = new_figure(3.0, 2.0).add_subplot()
    axes.plot([0.0, 1.0], [0.0, 1.0], label="a line")
    legend(axes)
    shown = axes.get_legend()
    assert shown is not None
    assert not shown.get_frame_on()


def test_a_figure_has_its_size_in_the_file(tmp_path: Path) -> None:
    save(new_figure(3.0, 2.0), tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (3 * DPI, 2 * DPI)
    with pytest.raises(InputError, match="deep"):
        save(new_figure(3.0, 2.0), tmp_path / "deep" / "a.png")


def test_a_line_for_each_model_from_the_present_on() -> None:
    models = {"cv": model_scores(np.array([1.0, 3.0])), "net": model_scores(np.array([]))}
    (axes,) = draw_horizon(score_table([episode_scores("S1", models)])).axes
    (line,) = axes.lines
    assert line.get_label() == "cv"
    assert line.get_xydata()[0].tolist() == [0.0, 0.0]
    assert line.get_xydata()[-1] == pytest.approx([5.0, 2.0])
    assert len(line.get_xydata()) == 26
    assert axes.get_xlim() == pytest.approx((0.0, 5.0))
    assert axes.get_ylim()[0] == 0.0
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time after the present, s", "mean distance, m")
    assert axes.get_title(loc="left") == "error over the horizon, all samples of 1 episodes"
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["cv"]


def test_without_samples_there_are_axes_and_no_line() -> None:
    table = score_table([episode_scores("S1", {"net": model_scores(np.array([]))})])
    (axes,) = draw_horizon(table).axes
    assert not axes.lines
    assert axes.get_legend() is None


def test_a_line_is_the_mean_over_all_samples() -> None:
    """Every sample is off by 0, 1, 2 … m at the points of the grid."""
    (axes,) = draw_horizon(score_table(reported_scores())).axes
    for line in axes.lines:
        assert np.asarray(line.get_xydata())[:, 1] == pytest.approx([0.0, *range(25)])


def test_models_that_state_probabilities_are_drawn() -> None:
    paths = np.zeros((4, 2, 25, 2))
    paths[:3, 1] = 5.0
    paths[3:, 0] = 5.0
    stated = reliability_of(Hypotheses(paths, np.tile([0.9, 0.1], (4, 1))), np.zeros((4, 25, 2)))
    models = {"cv": model_scores(np.ones(4)), "net": replace(model_scores(np.ones(4)), reliability=stated)}
    figure = draw_reliability(score_table([episode_scores("S1", models)]))
    assert figure is not None
    diagonal, line = figure.axes[0].lines
    assert diagonal.get_xydata().tolist() == [[0.0, 0.0], [1.0, 1.0]]
    assert line.get_xydata() == pytest.approx(np.array([[0.1, 0.25], [0.9, 0.75]]))
    assert line.get_label() == "net (error 0.15)"
    (dots,) = figure.axes[0].collections
    assert (figure.axes[0].get_xlim(), figure.axes[0].get_ylim()) == ((0.0, 1.0), (0.0, 1.0))
    assert figure.axes[0].get_aspect() == 1.0
    assert np.asarray(dots.get_offsets()) == pytest.approx(line.get_xydata())
    assert dots.get_sizes() == pytest.approx(np.full(2, 8.0 + 90.0 * np.sqrt(0.5))), "half of the hypotheses each"


def test_without_any_there_is_no_diagram() -> None:
    assert draw_reliability(score_table([episode_scores("S1", {"cv": model_scores(np.ones(4))})])) is None
