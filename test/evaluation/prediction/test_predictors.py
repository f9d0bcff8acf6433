import numpy as np
import pytest
from made_records import moving, record_with

from siren_ros.errors import InputError
from siren_ros.evaluation.prediction.prediction_samples import Population, SampleBatch, samples_of
from siren_ros.evaluation.prediction.prediction_window import HistoryWindow
from siren_ros.evaluation.prediction.predictors import PREDICTORS, hypotheses_of, predictors_named
from siren_ros.roads.road_network import RoadNetwork


class Answers:
    """A predictor that answers with a given array."""

    window = HistoryWindow()

    def __init__(self, answer: np.ndarray) -> None:
        self.answer = answer

    def predict(self, batch: SampleBatch) -> np.ndarray:
        del batch
        return self.answer


def test_models_come_in_the_order_asked_for() -> None:
    assert list(predictors_named(["idm", "cv"])) == ["idm", "cv"]


@pytest.mark.parametrize("names", [[], ["cv", "lstm"], ["cv", "cv"], ["CV"]])
def test_wrong_names_are_refused_with_what_is_known(names: list[str]) -> None:
    with pytest.raises(InputError, match="models") as caught:
        predictors_named(names)
    assert "each model once" in str(caught.value) or all(name in str(caught.value) for name in PREDICTORS)


@pytest.mark.parametrize(
    "answer",
    [np.zeros((21, 25, 2)), np.zeros((20, 1, 25, 2)), np.zeros((21, 0, 25, 2)), np.full((21, 3, 25, 2), np.nan)],
    ids=["no hypotheses", "samples missing", "none of each", "not finite"],
)
def test_answers_that_cannot_be_scored_are_refused(answer: np.ndarray, straight_road: RoadNetwork) -> None:
    batch = samples_of(record_with({1: moving(0.0, -5.25, 5.0)}, straight_road), HistoryWindow(), Population.ALL).batch
    with pytest.raises(InputError, match=r"model mine.*\(21, k, 25, 2\)"):
        hypotheses_of("mine", Answers(answer), batch)


def test_several_hypotheses_are_taken(straight_road: RoadNetwork) -> None:
    batch = samples_of(record_with({1: moving(0.0, -5.25, 5.0)}, straight_road), HistoryWindow(), Population.ALL).batch
    assert hypotheses_of("mine", Answers(np.zeros((21, 6, 25, 2))), batch).shape == (21, 6, 25, 2)
