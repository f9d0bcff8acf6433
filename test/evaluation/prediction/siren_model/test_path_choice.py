import numpy as np
import pytest

from siren_ros.evaluation.prediction.siren_model.path_choice import PATH_POINTS, choose_paths
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
