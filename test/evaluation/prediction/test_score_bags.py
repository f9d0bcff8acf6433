"""Many bags: whose scores are whose, what an unreadable one does, and which predictions meet which bag."""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.prediction.predictors import Hypotheses
from siren_ros.evaluation.prediction.samples import HistoryWindow, Population, ScoredSamples, samples_of
from siren_ros.evaluation.prediction.score_bags import ScoringJob, answers_for, score_bags
from siren_ros.evaluation.prediction.submission import EpisodePredictions, Submission
from siren_ros.recording.bag_reader import read_episode

JOB = ScoringJob(("cv",), population=Population.ALL)
NAMES = ("near", "broken", "far")


@pytest.fixture(scope="module", name="bags")
def _bags(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> list[Path]:
    """Two bags of one synthetic episode, and between them a folder that is none."""
    folder = tmp_path_factory.mktemp("bags")
    bags = [folder / name for name in NAMES]
    write_bag(bags[0], duration_s=8.5)
    bags[1].mkdir()
    shutil.copytree(bags[0], bags[2])
    return bags


@pytest.fixture(scope="module", name="samples")
def _samples(bags: list[Path]) -> ScoredSamples:
    return samples_of(read_episode(bags[0]), HistoryWindow(), Population.ALL)


def off_by(metres: Mapping[str, float], samples: ScoredSamples) -> Submission:
    """The truth of each episode, moved aside."""
    batch = samples.batch
    order = np.lexsort((batch.actor_id, batch.sample_step))

    def part(rows: np.ndarray, aside_m: float) -> EpisodePredictions:
        hypotheses = Hypotheses.certain(samples.future_xy_m[rows] + np.array([0.0, aside_m]))
        return EpisodePredictions("made", HistoryWindow(), batch.actor_id[rows], batch.sample_step[rows], hypotheses)

    return Submission({name: part(order, aside_m) for name, aside_m in metres.items()}, part(order[:0], 0.0))


def test_every_bag_gets_its_result_in_order_and_one_that_cannot_be_read_does_not_stop_the_others(
    bags: list[Path],
) -> None:
    seen: list[int] = []
    results = score_bags(JOB, bags, lambda: seen.append(1))
    assert [result.bag for result in results] == bags
    assert [result.error is None for result in results] == [True, False, True]
    assert [result.scores is None for result in results] == [False, True, False]
    assert str(bags[1]) in str(results[1].error)
    assert len(seen) == len(bags)
    first, last = (result.scores for result in results if result.scores is not None)
    assert (first.name, last.name) == (str(bags[0]), str(bags[2]))
    assert first.models["cv"]["ade_m"] == last.models["cv"]["ade_m"]


def test_each_bag_meets_the_predictions_of_its_name(bags: list[Path], samples: ScoredSamples) -> None:
    job = replace(JOB, models=(), submissions={"mine": off_by({"far": 2.0, "near": 0.5}, samples)})
    results = score_bags(job, [bags[0], bags[2]])
    near, far = (result.scores for result in results if result.scores is not None)
    assert list(near.models) == ["mine"]
    assert near.models["mine"]["ade_m"].value == pytest.approx(0.5)
    assert far.models["mine"]["fde_m"].value == pytest.approx(2.0)
    assert near.models["mine"]["ade_m"].samples == len(samples.future_xy_m)


def test_predictions_of_bags_that_are_not_scored_and_models_that_are_none_are_refused_first(
    bags: list[Path], samples: ScoredSamples
) -> None:
    job = replace(JOB, submissions={"mine": off_by({"elsewhere": 0.0}, samples)})
    with pytest.raises(InputError, match="elsewhere"):
        score_bags(job, [bags[0]])
    with pytest.raises(InputError, match="nobody"):
        score_bags(replace(JOB, models=("nobody",)), [bags[1]])


def test_without_any_model_there_is_nothing_to_score(bags: list[Path]) -> None:
    (result,) = score_bags(ScoringJob(()), [bags[0]])
    assert result.scores is not None
    assert result.scores.models == {}


def test_answers_are_those_of_the_wanted_models(bags: list[Path], samples: ScoredSamples) -> None:
    job = replace(JOB, models=("cv", "idm"), submissions={"mine": off_by({"near": 1.0}, samples)})
    record, answers = answers_for(job, bags[0], ("idm", "mine"))
    assert record.steps == 170
    assert set(answers) == {"idm", "mine"}
    mine = answers["mine"]
    off_m = mine.hypotheses.xy_m[:, 0] - mine.samples.future_xy_m
    assert np.allclose(off_m, [0.0, 1.0])
    assert set(answers_for(job, bags[0], ("cv",))[1]) == {"cv"}
