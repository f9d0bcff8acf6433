import numpy as np
import pytest
from made_scores import episode_scores, model_scores, reported_scores

from siren_ros.evaluation.prediction.charts.horizon import draw_horizon
from siren_ros.evaluation.prediction.reports.score_table import score_table


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
