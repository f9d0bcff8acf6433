import numpy as np
import pytest
from made_scores import scored

from siren_ros.scoring.evaluation.prediction.joint import world_min_ade_6, world_min_fde_6
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses


def world(errors_m: list[list[float]], frame: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Joint errors of samples whose hypotheses are off by some metres at all times."""
    off = np.array(errors_m)
    truth = np.cumsum(np.ones((len(off), 25, 2)), axis=1)
    paths = truth[:, None] + np.stack((off, np.zeros_like(off)), axis=-1)[:, :, None]
    hypotheses = Hypotheses(paths, np.full(off.shape, 1.0 / off.shape[1]))
    samples = scored(truth, frame)
    return world_min_ade_6(hypotheses, samples), world_min_fde_6(hypotheses, samples)


def test_a_world_is_right_for_all_vehicles_or_for_none() -> None:
    """Each vehicle has an exact path, but of another rank: no world is exact."""
    for values in world([[0.0, 4.0], [6.0, 0.0]], [0, 0]):
        assert values[0] == pytest.approx(2.0), "the second world: 4 m and 0 m"
        assert np.isnan(values[1]), "a frame counts once"


def test_one_vehicle_is_a_world_of_its_own() -> None:
    ade, fde = world([[3.0, 1.0], [0.5, 2.0]], [0, 1])
    assert ade.tolist() == pytest.approx([1.0, 0.5])
    assert fde.tolist() == pytest.approx([1.0, 0.5])


def test_only_six_worlds_count() -> None:
    assert world([[9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 0.0]], [0])[0].tolist() == pytest.approx([4.0])


def test_the_end_and_the_mean_over_time_differ() -> None:
    truth = np.zeros((1, 25, 2))
    path = np.zeros((1, 1, 25, 2))
    path[..., 0] = np.arange(1, 26)
    hypotheses, samples = Hypotheses(path, np.ones((1, 1))), scored(truth, [0])
    assert world_min_ade_6(hypotheses, samples).tolist() == [13.0]
    assert world_min_fde_6(hypotheses, samples).tolist() == [25.0]


def test_without_samples_there_is_no_value() -> None:
    hypotheses = Hypotheses(np.zeros((0, 1, 25, 2)), np.zeros((0, 1)))
    assert world_min_fde_6(hypotheses, scored(np.zeros((0, 25, 2)))).shape == (0,)
