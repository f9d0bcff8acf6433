"""Boxes around the two sides of a car that a LiDAR sees, at any place and heading."""

import numpy as np
import pytest

from siren_ros.evaluation.detection.detectors.box_fitting import fit_box

GROUND_M = -1.8


def sides(centre: tuple[float, float], yaw: float, length_m: float, width_m: float, top_m: float = 1.5) -> np.ndarray:
    """Points every 5 cm on the sides of a box that face the origin."""
    along, across = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    middle = np.array(centre)
    points = []
    for axis, half, other, other_half in (
        (along, length_m / 2, across, width_m / 2),
        (across, width_m / 2, along, length_m / 2),
    ):
        facing = -np.sign(middle @ axis)
        steps = np.arange(-other_half, other_half + 1e-9, 0.05)
        points.extend(middle + facing * half * axis + step * other for step in steps)
    flat = np.array(points)
    return np.concatenate([np.column_stack((flat, np.full(len(flat), GROUND_M + z))) for z in (0.4, top_m)])


@pytest.mark.parametrize("centre", [(12.0, 5.0), (12.0, -5.0), (-12.0, 5.0), (-10.0, -8.0), (3.0, 14.0)])
@pytest.mark.parametrize("degrees", [0.0, 30.0, 60.0, 90.0, 120.0, 150.0])
def test_a_car_is_where_it_is_and_as_long_as_it_is(centre: tuple[float, float], degrees: float) -> None:
    """5 m by 2 m, larger than a typical car, so that nothing is added."""
    yaw = np.radians(degrees)
    box = fit_box(sides(centre, yaw, 5.0, 2.0), GROUND_M)
    assert box.centre_m == pytest.approx([*centre, GROUND_M + 1.55 / 2.0], abs=0.06)
    assert box.size_m == pytest.approx([5.0, 2.0, 1.55], abs=0.06)
    assert box.seen_m == pytest.approx([5.0, 2.0], abs=0.06)
    assert np.cos(2.0 * (box.yaw_rad - yaw)) == pytest.approx(1.0, abs=0.01)
    assert abs(box.yaw_rad) <= np.pi / 2.0 + 1e-9


@pytest.mark.parametrize("turn", [0.0, 90.0, 180.0, 270.0])
def test_a_rear_alone_is_grown_away_from_the_sensor(turn: float) -> None:
    """1.8 m wide, 10 m ahead: a car of 4.5 m by 1.9 m stands behind it, and 3 m are its height."""
    angle = np.radians(turn)
    rear = np.stack((np.full(37, 10.0), np.arange(-0.9, 0.901, 0.05)), axis=-1)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    flat = rear @ rotation.T
    points = np.concatenate([np.column_stack((flat, np.full(len(flat), GROUND_M + z))) for z in (0.4, 3.0)])
    box = fit_box(points, GROUND_M)
    assert box.centre_m[:2] @ rotation == pytest.approx([10.0 + 2.25, 0.0], abs=0.06)
    assert box.size_m == pytest.approx([4.5, 1.9, 3.0], abs=0.06)
    assert box.seen_m == pytest.approx([0.0, 1.8], abs=0.06)
    assert np.cos(2.0 * (box.yaw_rad - angle)) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("turn", [0.0, 90.0])
def test_a_side_alone_is_the_length(turn: float) -> None:
    """3 m of a side are longer than a car is wide."""
    angle = np.radians(turn)
    side = np.stack((np.arange(8.0, 11.001, 0.05), np.full(61, 4.0)), axis=-1)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    points = np.column_stack((side @ rotation.T, np.full(61, GROUND_M + 1.0)))
    box = fit_box(points, GROUND_M)
    assert box.size_m == pytest.approx([4.5, 1.9, 1.55], abs=0.06)
    assert box.centre_m[:2] @ rotation == pytest.approx([8.0 + 2.25, 4.0 + 0.95], abs=0.06)


@pytest.mark.parametrize(("right_m", "left_m", "middle_m"), [(-1.2, 1.8, 1.05), (-1.8, 1.2, -1.05), (-1.4, 1.6, 0.85)])
@pytest.mark.parametrize("turn", [0.0, 90.0, 180.0])
def test_a_side_around_the_foot_of_the_sensor_grows_at_its_longer_part(
    turn: float, right_m: float, left_m: float, middle_m: float
) -> None:
    """3 m of a side 4 m ahead: of 4.5 m what is missing lies where more of it was seen."""
    angle = np.radians(turn)
    side = np.stack((np.full(61, 4.0), np.linspace(right_m, left_m, 61)), axis=-1)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    box = fit_box(np.column_stack((side @ rotation.T, np.full(61, GROUND_M + 1.0))), GROUND_M)
    assert box.centre_m[:2] @ rotation == pytest.approx([4.0 + 0.95, middle_m], abs=0.03)
