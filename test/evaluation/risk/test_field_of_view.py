"""Who is in view, at the edges of the view, from cameras that are moved and turned on the vehicle."""

import numpy as np
import pytest
from evaluation.made_records import Track, moving, record_with

from siren_ros.evaluation.risk.field_of_view import in_view
from siren_ros.evaluation.surrogate_safety.encounters import encounters_of
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.sensors.suite.mount import Mount

LENGTH_M, WIDTH_M = 4.6, 1.8
TURNED_RAD = [0.0, 0.8, -2.4]


def placed(x_m: float, y_m: float, yaw_rad: float, turned_rad: float) -> Track:
    """A vehicle of one step in a scene that is turned about (40, −30)."""
    cos, sin = np.cos(turned_rad), np.sin(turned_rad)
    return moving(
        40.0 + x_m * cos - y_m * sin, -30.0 + x_m * sin + y_m * cos, 0.0, yaw_rad=yaw_rad + turned_rad, steps=1
    )


def sees(
    network: RoadNetwork,
    x_m: float,
    y_m: float,
    mount: Mount,
    fov_deg: float = 90.0,
    range_m: float = 50.0,
    turned_rad: float = 0.0,
) -> bool:
    """Whether a vehicle that stands along x is seen from the origin."""
    tracks = {1: placed(0.0, 0.0, 0.0, turned_rad), 2: placed(x_m, y_m, 0.0, turned_rad)}
    (found,) = in_view(encounters_of(record_with(tracks, network), 1), mount, np.radians(fov_deg), range_m).tolist()
    return bool(found)


@pytest.mark.parametrize("turned_rad", TURNED_RAD)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_corner_at_the_edge_of_the_view(straight_road: RoadNetwork, side: float, turned_rad: float) -> None:
    """The corner that lies foremost and inmost is at 45° where it is as far ahead as aside."""
    eye = Mount(2.0, 0.0, 1.0)
    for aside_m, seen in ((9.95, True), (10.05, False)):
        x, y = 2.0 + 10.0 - 0.5 * LENGTH_M, side * (aside_m + 0.5 * WIDTH_M)
        assert sees(straight_road, x, y, eye, turned_rad=turned_rad) is seen


@pytest.mark.parametrize("turned_rad", TURNED_RAD)
def test_a_camera_that_is_not_in_the_middle(straight_road: RoadNetwork, turned_rad: float) -> None:
    """1 m to the left it sees 1 m more on the left and 1 m less on the right."""
    eye = Mount(0.0, 1.0, 1.0)
    for y_m, seen in ((10.95, True), (11.05, False), (-8.95, True), (-9.05, False)):
        y = y_m + np.sign(y_m) * 0.5 * WIDTH_M
        assert sees(straight_road, 10.0 - 0.5 * LENGTH_M, y, eye, turned_rad=turned_rad) is seen


@pytest.mark.parametrize("turned_rad", TURNED_RAD)
def test_a_camera_that_looks_to_the_left(straight_road: RoadNetwork, turned_rad: float) -> None:
    eye = Mount(0.0, 0.0, 1.0, yaw_rad=np.pi / 2.0)
    assert sees(straight_road, 0.0, 20.0, eye, turned_rad=turned_rad)
    assert not sees(straight_road, 0.0, -20.0, eye, turned_rad=turned_rad)
    assert not sees(straight_road, 20.0, 0.0, eye, turned_rad=turned_rad)


def test_the_range_is_from_the_camera_to_the_nearest_corner(straight_road: RoadNetwork) -> None:
    eye = Mount(2.0, 0.0, 1.0)
    for x_m, seen in ((30.0, True), (30.2, False)):
        reach = np.hypot(30.1 - 2.0 - 0.5 * LENGTH_M, 0.5 * WIDTH_M)
        assert sees(straight_road, x_m, 0.0, eye, range_m=reach) is seen


def test_behind_is_never_in_view(straight_road: RoadNetwork) -> None:
    assert not sees(straight_road, -10.0, 0.0, Mount(0.0, 0.0, 1.0), fov_deg=170.0)
