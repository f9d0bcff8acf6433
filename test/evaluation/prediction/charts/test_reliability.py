from dataclasses import replace

import numpy as np
import pytest
from made_scores import episode_scores, model_scores

from siren_ros.evaluation.prediction.charts.reliability import draw_reliability
from siren_ros.evaluation.prediction.metrics.calibration import reliability_of
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.evaluation.prediction.reports.score_table import score_table


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
