"""Which drivers of SUMO keep to the side of their lane."""

import numpy as np
import pytest

from siren_ros.simulation.traffic.sumo.rescue_lane import (
    COMES_WITHIN_M,
    ENDS_ABOVE_MPS,
    FORMS_BELOW_MPS,
    coming_to_jam,
    kept_sides,
)

LEFT, RIGHT, MIDDLE = 1, -1, 0
NOBODY = np.zeros(3, np.bool_)


def sides(*values: int) -> np.ndarray:
    return np.array(values, np.int8)


@pytest.mark.parametrize("side", [LEFT, RIGHT])
def test_slow_drivers_keep_to_the_side_of_their_lane(side):
    speeds = np.array([0.0, FORMS_BELOW_MPS - 0.01, FORMS_BELOW_MPS + 0.01])
    kept = kept_sides(sides(side, side, side), sides(0, 0, 0), speeds, NOBODY)
    assert kept.tolist() == [side, side, MIDDLE]


def test_who_keeps_to_the_side_goes_back_when_traffic_flows():
    speeds = np.array([FORMS_BELOW_MPS + 0.01, ENDS_ABOVE_MPS - 0.01, ENDS_ABOVE_MPS + 0.01])
    assert kept_sides(sides(1, 1, 1), sides(1, 1, 1), speeds, NOBODY).tolist() == [LEFT, LEFT, MIDDLE]


def test_who_changes_lanes_changes_sides_and_towns_have_none():
    assert kept_sides(sides(LEFT, MIDDLE), sides(RIGHT, RIGHT), np.array([1.0, 1.0]), NOBODY[:2]).tolist() == [
        LEFT,
        MIDDLE,
    ]


def test_who_comes_to_a_jam_keeps_to_the_side_at_any_speed():
    comes = np.array([True, False])
    assert kept_sides(sides(LEFT, LEFT), sides(0, 0), np.array([30.0, 30.0]), comes).tolist() == [LEFT, MIDDLE]


@pytest.mark.parametrize("angle_deg", [0.0, 120.0, 315.0])
@pytest.mark.parametrize(
    ("ahead_m", "aside_m", "slow_mps", "turned_deg", "comes"),
    [
        (COMES_WITHIN_M - 1.0, 0.0, 1.0, 0.0, True),
        (COMES_WITHIN_M + 1.0, 0.0, 1.0, 0.0, False),
        (-10.0, 0.0, 1.0, 0.0, False),
        (100.0, 12.0, 1.0, 0.0, True),
        (100.0, -18.0, 1.0, 0.0, False),
        (100.0, 0.0, FORMS_BELOW_MPS + 1.0, 0.0, False),
        (100.0, 0.0, 1.0, 180.0, False),
    ],
)
def test_a_jam_is_slow_vehicles_close_ahead(angle_deg, ahead_m, aside_m, slow_mps, turned_deg, comes):
    angle = np.radians(angle_deg)
    forward, right = np.array([np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), -np.sin(angle)])
    x_m, y_m = np.array([[50.0, 20.0], np.array([50.0, 20.0]) + ahead_m * forward + aside_m * right]).T
    given = x_m, y_m, np.array([angle_deg, angle_deg + turned_deg]), np.array([30.0, slow_mps])
    assert coming_to_jam(*given, np.array([True, True])).tolist() == [comes, False]
    assert not coming_to_jam(*given, np.array([True, False])).any(), "not on a road with the duty"
