from dataclasses import replace

import numpy as np
import pytest

from siren_ros.evaluation.prediction.baselines.lane_following import paths_from, straight_successors
from siren_ros.numerics.polyline import Polyline
from siren_ros.roads.road_network import NO_LANE, LaneKind, RoadNetwork


def test_the_straightest_movement_follows_and_junction_paths_lead_out(crossroads: RoadNetwork) -> None:
    assert straight_successors(crossroads).tolist() == [5, NO_LANE, NO_LANE, NO_LANE, 1, 2, 3]


def with_lane_ends(network: RoadNetwork, angle_rad: float, lines: dict[int, list[tuple[float, float]]]) -> RoadNetwork:
    """The crossroads with other centre lines, all turned about the origin."""
    turn = np.array([[np.cos(angle_rad), np.sin(angle_rad)], [-np.sin(angle_rad), np.cos(angle_rad)]])
    lanes = [
        replace(lane, centre=Polyline.through(np.asarray(lines.get(lane.index, lane.centre.points)) @ turn))
        for lane in network.lanes
    ]
    return replace(network, lanes=tuple(lanes))


@pytest.mark.parametrize("angle_rad", [0.0, 0.7, 3.0])
@pytest.mark.parametrize(
    ("lines", "straightest"),
    [
        ({2: [(40.0, 3.5), (140.0, 3.5)], 3: [(40.0, -1.0), (140.0, -1.0)]}, 3),
        ({2: [(40.0, 1.0), (140.0, 1.0)], 3: [(40.0, -3.5), (140.0, -3.5)]}, 2),
        ({2: [(40.0, 0.0), (140.0, 40.0)], 3: [(40.0, -9.0), (140.0, -12.0)]}, 3),
        ({2: [(40.0, 0.0), (140.0, -40.0)], 3: [(40.0, -9.0), (140.0, -12.0)]}, 3),
        ({2: [(40.0, 0.0), (40.0, 0.7), (140.0, 0.7)], 3: [(40.0, -9.0), (140.0, -12.0)]}, 3),
    ],
    ids=["right nearer", "left nearer", "left turn", "right turn", "turns at its start"],
)
def test_the_straightest_and_then_the_nearest_follows(
    crossroads: RoadNetwork, angle_rad: float, lines: dict[int, list[tuple[float, float]]], straightest: int
) -> None:
    assert straight_successors(with_lane_ends(crossroads, angle_rad, lines))[0] == straightest + 3


def test_a_lane_of_the_same_kind_comes_before_a_straighter_one(crossroads: RoadNetwork) -> None:
    lanes = list(crossroads.lanes)
    lanes[0] = replace(lanes[0], kind=LaneKind.SHOULDER)
    lanes[1] = replace(lanes[1], kind=LaneKind.SHOULDER)
    assert straight_successors(replace(crossroads, lanes=tuple(lanes)))[0] == 4


def test_paths_know_where_their_lanes_start(crossroads: RoadNetwork) -> None:
    paths = paths_from(crossroads, np.array([0, 4], dtype=np.int32), 200.0)
    assert paths.path_of_lane.tolist() == [0, -1, -1, -1, 1, -1, -1]
    assert paths.start_m[0, [0, 5, 2]].tolist() == [0.0, 100.0, 140.0]
    assert np.isinf(paths.start_m[0, [1, 3, 4, 6]]).all()
    assert paths.start_m[1, 1] == pytest.approx(crossroads.lanes[4].length_m)


def test_the_reach_ends_the_path(crossroads: RoadNetwork) -> None:
    paths = paths_from(crossroads, np.array([0], dtype=np.int32), 30.0)
    assert np.isfinite(paths.start_m[0, 5])
    assert np.isinf(paths.start_m[0, 2])


def test_points_keep_their_offset_and_go_straight_on_past_the_end(crossroads: RoadNetwork) -> None:
    paths = paths_from(crossroads, np.array([0, 1], dtype=np.int32), 200.0)
    points = paths.points(np.array([1, 0]), np.array([[50.0, 150.0], [10.0, 260.0]]), np.array([0.5, -1.0]))
    assert np.allclose(points, [[(19.5, 70.0), (19.5, 170.0)], [(-90.0, -1.0), (160.0, -1.0)]])


@pytest.mark.parametrize("angle_rad", [0.0, 0.7])
def test_lanes_are_near_by_their_ends_and_not_by_their_middle(crossroads: RoadNetwork, angle_rad: float) -> None:
    """Lane 0 comes from the side and bends; behind the crossing lane 3 begins nearer and then goes farther away."""
    lines = {
        0: [(-100.0, 9.0), (-50.0, 0.0), (0.0, 0.0)],
        2: [(40.0, 3.0), (41.0, 3.0), (141.0, -20.0)],
        3: [(40.0, -2.0), (41.0, -2.0), (141.0, -30.0)],
    }
    assert straight_successors(with_lane_ends(crossroads, angle_rad, lines))[0] == 6
    lines[3] = [(40.0, -4.0), (41.0, -4.0), (141.0, 4.0)]
    assert straight_successors(with_lane_ends(crossroads, angle_rad, lines))[0] == 5
