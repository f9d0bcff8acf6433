import numpy as np
import pytest

from siren_ros.evaluation.prediction.siren_model.lane_candidates import lane_candidates
from siren_ros.roads.road_network import RoadNetwork


def test_the_likeliest_lane_is_the_nearest_in_the_own_direction(straight_road: RoadNetwork) -> None:
    found = lane_candidates(straight_road, np.array([[50.0, -5.0], [50.0, -1.75]]), np.array([0.0, 0.1]))
    first = found.lane[np.searchsorted(found.row, [0, 1])]
    centres = [straight_road.lanes[index].centre.points[0, 1] for index in first]
    assert centres == pytest.approx([-5.25, -1.75])
    row = np.flatnonzero(found.row == 0)[0]
    assert (found.arc_m[row], found.offset_m[row], found.turned_rad[row]) == pytest.approx((50.0, 0.25, 0.0))
    assert found.turned_rad[np.searchsorted(found.row, 1)] == pytest.approx(0.1)


def test_lanes_of_the_other_direction_and_far_ones_are_none(straight_road: RoadNetwork) -> None:
    found = lane_candidates(straight_road, np.array([[50.0, 1.75], [50.0, 100.0], [900.0, -5.0]]), np.zeros(3))
    assert {straight_road.lanes[index].centre.points[0, 1] for index in found.lane.tolist()} <= {-1.75}
    assert set(found.row.tolist()) <= {0}


def test_paths_across_a_junction_are_told_apart_by_the_heading(crossroads: RoadNetwork) -> None:
    found = lane_candidates(crossroads, np.array([[7.0, 2.5]]), np.array([0.5]))
    assert found.lane.tolist() == [4, 5]
    assert (np.diff(found.cost) > 0.0).all()


def test_nobody_is_in_no_lane(crossroads: RoadNetwork) -> None:
    assert len(lane_candidates(crossroads, np.empty((0, 2)), np.empty(0)).row) == 0


@pytest.mark.parametrize(
    ("x_m", "y_m", "turned_deg", "fits"),
    [
        (50.0, -5.25 - 1.75 - 1.45, 0, True),
        (50.0, -5.25 - 1.75 - 1.55, 0, False),
        (50.0, -5.25 + 1.75 + 1.45, 0, True),
        (50.0, -5.25 + 1.75 + 1.55, 0, False),
        (50.0, -5.25, 59, True),
        (50.0, -5.25, -59, True),
        (50.0, -5.25, 61, False),
        (50.0, -5.25, -61, False),
        (-0.45, -5.25, 0, True),
        (-0.55, -5.25, 0, False),
        (300.45, -5.25, 0, True),
        (300.55, -5.25, 0, False),
    ],
)
def test_how_far_a_lane_reaches(
    straight_road: RoadNetwork, x_m: float, y_m: float, turned_deg: int, fits: bool
) -> None:
    """1.5 m to each side, 60 degrees, half a metre at each end."""
    (lane,) = (lane.index for lane in straight_road.lanes if lane.centre.points[0, 1] == -5.25)
    found = lane_candidates(straight_road, np.array([[x_m, y_m]]), np.array([np.radians(turned_deg)]))
    assert (lane in found.lane.tolist()) is fits


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_radian_costs_as_much_as_three_metres(straight_road: RoadNetwork, side: float) -> None:
    found = lane_candidates(straight_road, np.array([[50.0, -5.25 + 0.4 * side]]), np.array([-0.2 * side]))
    (row,) = (row for row in range(len(found.row)) if abs(found.offset_m[row]) < 1.0)
    assert found.offset_m[row] == pytest.approx(0.4 * side)
    assert found.turned_rad[row] == pytest.approx(-0.2 * side)
    assert found.cost[row] == pytest.approx(0.4 + 3.0 * 0.2)
    assert row == 0, "the likeliest comes first"


@pytest.mark.parametrize("xy_m", [np.zeros((0, 2)), np.array([[5000.0, 5000.0], [-700.0, 0.0]])])
def test_nobody_near_a_lane_has_no_candidate(straight_road: RoadNetwork, xy_m: np.ndarray) -> None:
    found = lane_candidates(straight_road, xy_m, np.zeros(len(xy_m)))
    assert {name: len(values) for name, values in vars(found).items()} == dict.fromkeys(vars(found), 0)
