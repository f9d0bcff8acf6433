"""Pedals and wheel."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_sights import LIMIT_MPS, sight

from siren_ros.running.seat.steering import steered


def test_who_is_as_fast_as_wanted_in_the_middle_does_nothing():
    answer = steered(sight(), LIMIT_MPS, 0.0)
    assert (answer.throttle, answer.brake, answer.steer_rad, answer.step) == (0.0, 0.0, 0.0, 100)


@given(
    wanted_mps=st.floats(0.0, 40.0),
    speed_mps=st.floats(0.0, 30.0),
    offset_m=st.floats(-8.0, 8.0),
    turn_rad=st.floats(-1.5, 1.5),
)
def test_every_answer_can_be_asked_of_a_vehicle(wanted_mps, speed_mps, offset_m, turn_rad):
    steered(sight(speed_mps=speed_mps, turn_rad=turn_rad), wanted_mps, offset_m).check()


def test_the_hardest_braking_is_that_of_the_limit():
    assert steered(sight(), 0.0, 0.0).brake == pytest.approx(3.5 / 9.0)
    assert steered(sight(), 0.0, 0.0, hardest_mps2=8.5).brake == pytest.approx(8.5 / 9.0)


@given(offset_m=st.floats(0.2, 3.0))
def test_the_wheel_turns_to_the_wanted_place_by_pure_pursuit(offset_m):
    # The target lies 10 m ahead, as far as it drives in a second.
    expected = math.atan(2.0 * 2.7 * offset_m / (10.0**2 + offset_m**2))
    assert steered(sight(), LIMIT_MPS, offset_m).steer_rad == pytest.approx(expected)
    assert steered(sight(), LIMIT_MPS, -offset_m).steer_rad == pytest.approx(-expected)
    assert steered(sight(left_m=offset_m), LIMIT_MPS, offset_m).steer_rad == pytest.approx(0.0, abs=1e-9)
