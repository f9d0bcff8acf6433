import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.evaluation.prediction.baselines.idm import IdmConfig, idm_acceleration, idm_travel

CONFIG = IdmConfig()
LONG_S = np.arange(1, 1201) * 0.1


def one(value: float) -> np.ndarray:
    return np.array([value])


def test_parameters_are_the_protocols() -> None:
    values = (CONFIG.time_headway_s, CONFIG.standstill_gap_m, CONFIG.acceleration_mps2, CONFIG.comfortable_braking_mps2)
    assert values == (1.5, 2.0, 1.5, 2.0)
    assert CONFIG.integration_s == 0.1


def test_acceleration_on_a_free_road() -> None:
    speed = np.array([0.0, 5.0, 10.0])
    acceleration = idm_acceleration(speed, np.full(3, 10.0), np.full(3, np.inf), speed, CONFIG)
    assert acceleration == pytest.approx([1.5, 1.5 * (1 - 0.5**4), 0.0])


def test_acceleration_behind_a_leader_by_hand() -> None:
    # s* = 2 + 10 · 1.5 + 10 · 2 / (2 √3) = 22.7735 m
    acceleration = idm_acceleration(one(10.0), one(15.0), one(30.0), one(2.0), CONFIG)
    assert acceleration == pytest.approx(1.5 * (1 - (2 / 3) ** 4 - (22.773502691896 / 30.0) ** 2))


def test_a_leader_that_pulls_away_does_not_repel() -> None:
    # v T + v Δv / (2 √(a b)) is negative here and counts as 0: s* = s0.
    acceleration = idm_acceleration(one(10.0), one(20.0), one(10.0), one(-20.0), CONFIG)
    assert acceleration == pytest.approx(1.5 * (1 - 0.5**4 - (2.0 / 10.0) ** 2))


def test_free_road_speed_converges_to_the_desired_speed() -> None:
    travelled = idm_travel(one(0.0), one(13.89), one(np.inf), one(0.0), LONG_S, CONFIG)[0]
    speed = np.diff(travelled) / 0.1
    assert speed[-1] == pytest.approx(13.89, abs=1e-3)
    assert (speed <= 13.89 + 1e-6).all()


@pytest.mark.parametrize("leader_mps", [3.0, 8.0])
def test_gap_behind_a_moving_leader_converges_to_the_equilibrium(leader_mps: float) -> None:
    travelled = idm_travel(one(12.0), one(13.89), one(60.0), one(leader_mps), LONG_S, CONFIG)[0]
    gap = 60.0 + leader_mps * LONG_S - travelled
    equilibrium = (2.0 + 1.5 * leader_mps) / np.sqrt(1 - (leader_mps / 13.89) ** 4)
    assert gap[-1] == pytest.approx(equilibrium, abs=0.01)
    assert (gap > 0.0).all()


def test_it_stops_behind_a_standing_leader_with_the_standstill_gap() -> None:
    travelled = idm_travel(one(12.0), one(13.89), one(60.0), one(0.0), LONG_S, CONFIG)[0]
    gap = 60.0 - travelled
    assert gap[-1] == pytest.approx(2.0, abs=0.25)
    assert gap.min() > 1.5
    assert (np.diff(travelled) >= 0.0).all()


@given(
    speed=st.floats(0.0, 30.0),
    desired=st.floats(5.0, 30.0),
    gap=st.floats(-3.0, 300.0),
    leader=st.floats(0.0, 30.0),
)
def test_nobody_drives_backwards_or_through_a_leader_that_it_can_stop_behind(
    speed: float, desired: float, gap: float, leader: float
) -> None:
    times = np.arange(1, 26) * 0.2
    travelled = idm_travel(one(speed), one(max(speed, desired)), one(gap), one(leader), times, CONFIG)[0]
    assert np.isfinite(travelled).all()
    assert (np.diff(travelled, prepend=0.0) >= 0.0).all()
    if gap > 2.0 + speed * CONFIG.time_headway_s:
        assert (gap + leader * times - travelled > 0.0).all()


def test_the_answer_is_the_same_at_the_same_times() -> None:
    fine = idm_travel(one(8.0), one(13.0), one(25.0), one(5.0), np.arange(1, 51) * 0.1, CONFIG)
    coarse = idm_travel(one(8.0), one(13.0), one(25.0), one(5.0), np.arange(1, 26) * 0.2, CONFIG)
    assert np.array_equal(fine[:, 1::2], coarse)


def test_the_first_steps_by_hand() -> None:
    """Two steps of a tenth of a second behind a leader at 5 m/s, 20 m ahead."""
    speed, travelled, expected = 8.0, 0.0, []
    for step in range(2):
        gap = 20.0 + 5.0 * 0.1 * step - travelled
        wanted = 2.0 + speed * 1.5 + speed * (speed - 5.0) / (2.0 * np.sqrt(3.0))
        acceleration = 1.5 * (1.0 - (speed / 13.0) ** 4 - (wanted / gap) ** 2)
        travelled += 0.1 * speed + 0.005 * acceleration
        speed += 0.1 * acceleration
        expected.append(travelled)
    found = idm_travel(one(8.0), one(13.0), one(20.0), one(5.0), np.array([0.1, 0.2]), CONFIG)
    assert found[0] == pytest.approx(expected)


def test_who_stops_within_a_step_goes_no_further_than_braking_takes_it() -> None:
    """0.3 m/s and half a metre behind a standing leader: −(0.5 · v²) / a, and there it stays."""
    acceleration = float(idm_acceleration(one(0.3), one(13.0), one(0.5), one(0.3), CONFIG)[0])
    assert 0.3 + 0.1 * acceleration < 0.0
    found = idm_travel(one(0.3), one(13.0), one(0.5), one(0.0), np.array([0.1, 0.2, 1.0]), CONFIG)
    assert found[0] == pytest.approx([0.5 * 0.3**2 / -acceleration] * 3)
    # As one who drives backwards never does, the distance is that of a mean speed between 0.3 m/s and none.
    assert 0.0 < found[0, 0] < 0.03


def test_bumpers_that_overlap_brake_as_hard_as_the_least_gap_does() -> None:
    overlap, least = (idm_acceleration(one(5.0), one(13.0), one(gap), one(0.0), CONFIG) for gap in (-2.0, 0.1))
    assert overlap == pytest.approx(least)
    assert idm_acceleration(one(5.0), one(13.0), one(0.2), one(0.0), CONFIG) > least
