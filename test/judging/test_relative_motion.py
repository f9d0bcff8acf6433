from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EMV, NORTHBOUND, Driven, at_speed, crossing, hand_made

from siren_ros.judging.relative_motion import ALIGNED_RAD, ahead_and_left_m, common_rows, in_same_direction


def rows_at(x_m, y_m, yaw_rad, first_step=0):
    """The rows of a vehicle with these poses."""
    count = len(np.atleast_1d(x_m))
    record = hand_made(crossing(), {EMV: Driven(NORTHBOUND, at_speed(0.0, 1.0, count + 1), first_step=first_step)})
    values = np.broadcast_arrays(*(np.atleast_1d(np.asarray(value, dtype=float)) for value in (x_m, y_m, yaw_rad)))
    return replace(
        record.track(EMV).select(np.arange(count)), **dict(zip(("x_m", "y_m", "yaw_rad"), values, strict=True))
    )


@pytest.mark.parametrize("yaw", np.radians([0.0, 30.0, 60.0, 135.0, -120.0]))
def test_ahead_and_left_in_the_axes_of_a_vehicle_that_points_anywhere(yaw):
    ahead, left = 7.0, 2.0
    x = 10.0 + ahead * np.cos(yaw) - left * np.sin(yaw)
    y = -4.0 + ahead * np.sin(yaw) + left * np.cos(yaw)
    found = ahead_and_left_m(rows_at(10.0, -4.0, yaw), rows_at(x, y, yaw + 1.0))
    assert (found[0][0], found[1][0]) == pytest.approx((ahead, left))


@pytest.mark.parametrize(("turned", "same"), [(0.0, True), (0.98, True), (-0.98, True), (1.02, False), (-1.02, False)])
@pytest.mark.parametrize("yaw", [0.0, 3.0, -3.0])
def test_the_same_direction_is_within_60_degrees_on_both_sides_and_across_pi(turned, same, yaw):
    other = rows_at(0.0, 0.0, np.remainder(yaw + turned * ALIGNED_RAD + np.pi, 2.0 * np.pi) - np.pi)
    assert in_same_direction(rows_at(0.0, 0.0, yaw), other).tolist() == [same]
    assert np.degrees(ALIGNED_RAD) == pytest.approx(60.0)


def test_common_rows_are_those_of_the_steps_that_both_have():
    first, second = rows_at(np.arange(6.0), 0.0, 0.0), rows_at(np.arange(5.0), 1.0, 0.0, first_step=3)
    one, two = common_rows(first, second)
    assert one.step.tolist() == two.step.tolist() == [3, 4, 5]
    assert one.x_m.tolist() == [3.0, 4.0, 5.0]
    assert two.x_m.tolist() == [0.0, 1.0, 2.0]
