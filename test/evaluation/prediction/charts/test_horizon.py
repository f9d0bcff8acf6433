import numpy as np
import pytest
from made_scores import episode_scores, model_scores

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
