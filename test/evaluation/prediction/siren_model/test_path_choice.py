from dataclasses import replace

import numpy as np
import pytest

from siren_ros.evaluation.prediction.siren_model.path_choice import PATH_POINTS, choose_paths
from siren_ros.numerics.polyline import Polyline
from siren_ros.roads.road_network import RoadNetwork


def test_paths_begin_at_the_vehicle_and_keep_its_offset(crossroads: RoadNetwork) -> None:
    choice = choose_paths(crossroads, np.array([[-10.0, 0.4]]), np.zeros(1), np.array([8.0]))
    points = choice.points()
    assert choice.there.tolist() == [[True, True, True, False]]
    assert points[0, :3, 0] == pytest.approx(np.tile([-10.0, 0.4], (3, 1)))
    assert points[0, 0, :, 1] == pytest.approx(0.4)
    assert points[0, 0, -1, 0] == pytest.approx(-10.0 + choice.spacing_m[0] * (PATH_POINTS - 1))
    assert (points[0, 3] == 0.0).all()


def test_a_fast_vehicle_is_shown_more_of_the_road(crossroads: RoadNetwork) -> None:
    xy = np.tile([-90.0, 0.0], (3, 1))
    choice = choose_paths(crossroads, xy, np.zeros(3), np.array([0.0, 8.0, 90.0]))
    assert choice.spacing_m * (PATH_POINTS - 1) == pytest.approx([30.0, 78.0, 120.0])
    assert choice.there.sum(axis=1).tolist() == [1, 1, 3]


def test_samples_that_share_paths_get_them_at_their_own_places(crossroads: RoadNetwork) -> None:
    xy = np.array([[-10.0, 0.0], [300.0, 300.0], [-5.0, 0.0], [5.0, 0.0]])
    together = choose_paths(crossroads, xy, np.zeros(4), np.full(4, 8.0))
    for row in range(4):
        alone = choose_paths(crossroads, xy[[row]], np.zeros(1), np.full(1, 8.0))
        assert alone.there[0].tolist() == together.there[row].tolist()
        assert alone.points()[0] == pytest.approx(together.points()[row])
    assert not together.there[1].any()


@pytest.mark.parametrize(("speed_mps", "reach_m"), [(0.0, 30.0), (5.0, 60.0), (14.0, 114.0), (16.0, 120.0)])
def test_the_ways_beyond_the_lane_are_shown_where_the_reach_ends_behind_it(
    crossroads: RoadNetwork, speed_mps: float, reach_m: float
) -> None:
    """6 s and 30 m, at most 120 m; the lane ends at x = 0."""
    for beyond_m, ways in ((-0.1, 1), (0.1, 3)):
        if reach_m - beyond_m > 100.0:
            continue
        xy = np.array([[beyond_m - reach_m, 0.0]])
        choice = choose_paths(crossroads, xy, np.zeros(1), np.array([speed_mps]))
        assert choice.there.sum() == ways
    spacing = choose_paths(crossroads, np.array([[-50.0, 0.0]]), np.zeros(1), np.array([speed_mps])).spacing_m
    assert spacing * (PATH_POINTS - 1) == pytest.approx([reach_m])


def side_by_side(network: RoadNetwork, *aside_m: float) -> RoadNetwork:
    """Lanes of 100 m to the east, at distances to the left of y = 0; nothing follows them."""
    lanes = [
        replace(network.lanes[0], index=number, edge=number, centre=Polyline.through([(0.0, y_m), (100.0, y_m)]))
        for number, y_m in enumerate(aside_m)
    ]
    edges = tuple(replace(network.edges[0], index=number, lanes=(number,)) for number in range(len(lanes)))
    return RoadNetwork(tuple(lanes), edges, (), {}, (0.0, 0.0), "!")


def test_three_lanes_are_looked_at_the_nearest_first(crossroads: RoadNetwork) -> None:
    network = side_by_side(crossroads, 1.0, -0.4, 0.2, -1.2, 0.7)
    choice = choose_paths(network, np.array([[20.0, 0.0]]), np.zeros(1), np.zeros(1))
    assert choice.there.tolist() == [[True, True, True, False]]
    assert choice.offset_m[0, :3] == pytest.approx([-0.2, 0.4, -0.7])
    assert choice.turned_rad[0, :3] == pytest.approx(np.zeros(3))
    assert choice.arc_m[0, :3] == pytest.approx(np.full(3, 20.0))


@pytest.mark.parametrize(("second_m", "first"), [(0.9997, -1.0), (0.998, 0.998)])
def test_costs_that_differ_by_less_than_a_thousandth_are_alike(
    crossroads: RoadNetwork, second_m: float, first: float
) -> None:
    """Of alike ones the first of the map comes first."""
    choice = choose_paths(side_by_side(crossroads, -1.0, second_m), np.array([[20.0, 0.0]]), np.zeros(1), np.zeros(1))
    assert -choice.offset_m[0, 0] == pytest.approx(first)


def test_an_angle_costs_three_metres_for_each_radian(crossroads: RoadNetwork) -> None:
    """A vehicle turned by 0.2 rad: 0.6 m. A lane along its heading is likelier up to that distance."""
    for away_m, aligned in ((0.55, True), (0.65, False)):
        network = side_by_side(crossroads, 0.0, 0.0)
        cos, sin = np.cos(0.2), np.sin(0.2)
        start = np.array([20.0, 0.0]) + away_m * np.array([-sin, cos])
        lanes = list(network.lanes)
        lanes[1] = replace(
            lanes[1],
            centre=Polyline.through([start - 10.0 * np.array([cos, sin]), start + 60.0 * np.array([cos, sin])]),
        )
        choice = choose_paths(
            replace(network, lanes=tuple(lanes)), np.array([[20.0, 0.0]]), np.array([0.2]), np.zeros(1)
        )
        assert choice.turned_rad[0, 0] == pytest.approx(0.0 if aligned else 0.2)
