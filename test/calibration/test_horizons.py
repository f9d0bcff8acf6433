import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.calibration.horizons import FIRST_S, GROWTH, LAST, WHOLE, horizons_of
from siren_ros.calibration.simulate import Situation, Target
from siren_ros.calibration.trajectory import Trajectory
from siren_ros.scenario.request import EpisodeRequest


def targets_of(*lengths_s: float) -> list[Target]:
    """Each begins at 3 s: what counts is how long they are, not when they end."""
    return [
        Target("made", Situation(EpisodeRequest()), Trajectory(np.array([3.0, 3.0 + length]), np.zeros((2, 2))))
        for length in lengths_s
    ]


@pytest.mark.parametrize(
    ("length_s", "horizons"),
    [(4.0, (WHOLE,)), (7.1, (WHOLE,)), (7.3, (6.0, WHOLE)), (18.0, (6.0, 9.0, 13.5, WHOLE))],
)
def test_a_horizon_grows_by_half_until_little_is_left_out(length_s: float, horizons: tuple[float, ...]) -> None:
    assert horizons_of(targets_of(length_s)) == horizons
    assert horizons_of(targets_of(2.0, length_s, 3.0)) == horizons, "the longest counts"


@given(st.floats(0.1, 300.0))
def test_the_horizons_rise_to_the_whole(length_s: float) -> None:
    *found, last = horizons_of(targets_of(length_s))
    assert last == WHOLE
    assert found == [pytest.approx(FIRST_S * GROWTH**number) for number in range(len(found))]
    assert all(horizon * LAST < length_s for horizon in found)
    assert FIRST_S * GROWTH ** len(found) * LAST >= length_s - 3.1e-14 * length_s - 1e-12
