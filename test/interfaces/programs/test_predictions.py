from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.errors import EpisodeError
from siren_ros.interfaces.messages import stamp, typestore
from siren_ros.interfaces.programs.predictions import from_predicted_paths, to_predicted_paths
from siren_ros.world.carrier import PredictedPaths

STORE = typestore()


def through_cdr(message: Any) -> Any:
    name = message.__msgtype__
    return STORE.deserialize_cdr(STORE.serialize_cdr(message, name), name)


def made(seed: int, paths: int, points: int, step: int = 40) -> PredictedPaths:
    rng = np.random.default_rng(seed)
    ids = rng.integers(1, 2**32 - 1, paths).astype(np.uint32)
    return PredictedPaths(step, ids, rng.random(paths), rng.normal(scale=1e3, size=(paths, points, 2)))


@given(seed=st.integers(0, 1000), paths=st.integers(1, 7), points=st.sampled_from([25, 30, 60]))
def test_paths_come_back_to_the_last_bit(seed: int, paths: int, points: int) -> None:
    given_paths = made(seed, paths, points)
    found = from_predicted_paths(through_cdr(to_predicted_paths(given_paths)))
    assert found.step == 40
    for name in ("actor_id", "probability", "xy_m"):
        assert np.array_equal(getattr(found, name), getattr(given_paths, name))
    assert found.actor_id.dtype == np.uint32


def test_nobody_predicted_is_an_empty_message() -> None:
    found = from_predicted_paths(through_cdr(to_predicted_paths(made(0, 0, 25))))
    assert len(found) == 0
    assert found.xy_m.shape == (0, 0, 2)


@pytest.mark.parametrize(
    ("field", "told"),
    [
        ("probability", r"paths of step 40 with 3 actor_id, 2 probability, 75 x_m, 75 y_m"),
        ("y_m", "75 x_m, 74 y_m"),
        ("actor_id", "2 actor_id, 3 probability"),
    ],
)
def test_lengths_that_do_not_fit_are_refused(field: str, told: str) -> None:
    message = to_predicted_paths(made(0, 3, 25))
    setattr(message, field, getattr(message, field)[:-1])
    with pytest.raises(EpisodeError, match=told):
        from_predicted_paths(message)


def test_a_stamp_of_another_step_is_refused() -> None:
    message = to_predicted_paths(made(0, 3, 25))
    message.stamp = stamp(0)
    with pytest.raises(EpisodeError, match=r"the stamp 0 s is not the time of step 40"):
        from_predicted_paths(message)
