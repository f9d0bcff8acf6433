from dataclasses import replace

import numpy as np
import pytest
from scenes import with_lines

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.scoring.evaluation.prediction.siren_model.paths import (
    PATH_POINTS,
    PathChoice,
    RoadPaths,
    choose_paths,
    lane_candidates,
)
from siren_ros.simulation.roads.road_network import RoadNetwork


def chosen(
    network: RoadNetwork, x_m: float, y_m: float = 0.0, yaw_rad: float = 0.0, speed_mps: float = 0.0
) -> PathChoice:
    """The paths of one vehicle."""
    return choose_paths(network, np.array([[x_m, y_m]]), np.array([yaw_rad]), np.array([speed_mps]))


def test_the_likeliest_lane_is_the_nearest_in_the_direction_of_the_vehicle(straight_road) -> None:
    candidates = lane_candidates(straight_road, np.array([[50.0, -5.0], [50.0, -1.75]]), np.array([0.0, 0.1]))
    first = candidates.lane[np.searchsorted(candidates.row, [0, 1])]
    centres = [straight_road.lanes[index].centre.points[0, 1] for index in first]
    assert centres == pytest.approx([-5.25, -1.75])
    row = np.flatnonzero(candidates.row == 0)[0]
    assert (candidates.arc_m[row], candidates.offset_m[row]) == pytest.approx((50.0, 0.25))
    assert candidates.turned_rad[row] == pytest.approx(0.0)
    assert candidates.turned_rad[np.searchsorted(candidates.row, 1)] == pytest.approx(0.1)


def test_the_heading_distinguishes_paths_across_a_junction(crossroads) -> None:
    candidates = lane_candidates(crossroads, np.array([[7.0, 2.5]]), np.array([0.5]))
    assert candidates.lane.tolist() == [4, 5]
    assert (np.diff(candidates.cost) > 0.0).all()


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
        (50.0, -5.25, 180, False),
    ],
)
def test_how_far_a_lane_reaches(straight_road, x_m, y_m, turned_deg, fits) -> None:
    """1.5 m to each side, 60 degrees, half a metre at each end."""
    (lane,) = (lane.index for lane in straight_road.lanes if lane.centre.points[0, 1] == -5.25)
    candidates = lane_candidates(straight_road, np.array([[x_m, y_m]]), np.array([np.radians(turned_deg)]))
    assert (lane in candidates.lane.tolist()) is fits


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_radian_costs_as_much_as_three_metres(straight_road, side) -> None:
    candidates = lane_candidates(straight_road, np.array([[50.0, -5.25 + 0.4 * side]]), np.array([-0.2 * side]))
    (row,) = (row for row in range(len(candidates.row)) if abs(candidates.offset_m[row]) < 1.0)
    assert candidates.offset_m[row] == pytest.approx(0.4 * side)
    assert candidates.turned_rad[row] == pytest.approx(-0.2 * side)
    assert candidates.cost[row] == pytest.approx(0.4 + 3.0 * 0.2)
    assert row == 0, "the likeliest comes first"


@pytest.mark.parametrize("xy_m", [np.zeros((0, 2)), np.array([[5000.0, 5000.0], [-700.0, 0.0], [50.0, 100.0]])])
def test_poses_far_from_all_lanes_have_no_candidate(straight_road, xy_m) -> None:
    candidates = lane_candidates(straight_road, xy_m, np.zeros(len(xy_m)))
    assert {name: len(values) for name, values in vars(candidates).items()} == dict.fromkeys(vars(candidates), 0)


def test_paths_begin_at_the_vehicle_and_keep_its_offset(crossroads) -> None:
    choice = chosen(crossroads, -10.0, 0.4, speed_mps=8.0)
    points = choice.points()
    assert choice.there.tolist() == [[True, True, True, False]]
    assert points[0, :3, 0] == pytest.approx(np.tile([-10.0, 0.4], (3, 1)))
    assert points[0, 0, :, 1] == pytest.approx(0.4)
    assert points[0, 0, -1, 0] == pytest.approx(-10.0 + choice.spacing_m[0] * (PATH_POINTS - 1))
    assert (points[0, 3] == 0.0).all()


def test_samples_that_share_paths_get_them_at_their_own_places(crossroads) -> None:
    xy = np.array([[-10.0, 0.0], [300.0, 300.0], [-5.0, 0.0], [5.0, 0.0]])
    together = choose_paths(crossroads, xy, np.zeros(4), np.full(4, 8.0))
    for row in range(4):
        alone = choose_paths(crossroads, xy[[row]], np.zeros(1), np.full(1, 8.0))
        assert alone.there[0].tolist() == together.there[row].tolist()
        assert alone.points()[0] == pytest.approx(together.points()[row])
    assert not together.there[1].any()


@pytest.mark.parametrize(("speed_mps", "reach_m"), [(0.0, 30.0), (5.0, 60.0), (14.0, 114.0), (16.0, 120.0)])
def test_the_ways_beyond_the_lane_are_shown_where_the_reach_ends_behind_it(crossroads, speed_mps, reach_m) -> None:
    """6 s and 30 m, at most 120 m; the lane ends at x = 0."""
    for beyond_m, ways in ((-0.1, 1), (0.1, 3)):
        if reach_m - beyond_m > 100.0:
            continue
        assert chosen(crossroads, beyond_m - reach_m, speed_mps=speed_mps).there.sum() == ways
    spacing = chosen(crossroads, -50.0, speed_mps=speed_mps).spacing_m
    assert spacing * (PATH_POINTS - 1) == pytest.approx([reach_m])


def side_by_side(network: RoadNetwork, *aside_m: float) -> RoadNetwork:
    """Lanes of 100 m to the east, at distances to the left of y = 0; nothing follows them."""
    lanes = [
        replace(network.lanes[0], index=number, edge=number, centre=Polyline.through([(0.0, y_m), (100.0, y_m)]))
        for number, y_m in enumerate(aside_m)
    ]
    edges = tuple(replace(network.edges[0], index=number, lanes=(number,)) for number in range(len(lanes)))
    return RoadNetwork(tuple(lanes), edges, (), {}, (0.0, 0.0), "!")


def test_three_lanes_are_looked_at_the_nearest_first(crossroads) -> None:
    choice = chosen(side_by_side(crossroads, 1.0, -0.4, 0.2, -1.2, 0.7), 20.0)
    assert choice.there.tolist() == [[True, True, True, False]]
    assert choice.offset_m[0, :3] == pytest.approx([-0.2, 0.4, -0.7])
    assert choice.turned_rad[0, :3] == pytest.approx(np.zeros(3))
    assert choice.arc_m[0, :3] == pytest.approx(np.full(3, 20.0))


@pytest.mark.parametrize(("second_m", "first"), [(0.9997, -1.0), (0.998, 0.998)])
def test_costs_that_differ_by_less_than_a_thousandth_are_alike(crossroads, second_m, first) -> None:
    """Of alike ones the first of the map comes first."""
    choice = chosen(side_by_side(crossroads, -1.0, second_m), 20.0)
    assert -choice.offset_m[0, 0] == pytest.approx(first)


def test_all_ways_out_of_a_junction_the_straight_one_first(crossroads) -> None:
    paths = RoadPaths(crossroads).ahead(0, 30.0)
    assert [path.curve.points[-1].tolist() for path in paths] == [[140.0, 0.0], [20.0, 120.0], [20.0, -120.0]]
    assert [path.turn_rad for path in paths] == pytest.approx([0.0, np.pi / 2, np.pi / 2])
    assert [line.arc_m for path in paths for line in path.stop_lines] == pytest.approx([100.0] * 3)
    assert [path.stop_lines[0].movement.direction for path in paths] == ["s", "l", "r"]


@pytest.mark.parametrize(
    ("lane", "reach_m", "end_m"), [(0, 0.0, [0.0, 0.0]), (4, 30.0, [20.0, 120.0]), (1, 50.0, [20.0, 120.0])]
)
def test_one_path_ends_with_its_lane_leads_out_of_a_junction_or_ends_with_the_road(
    crossroads, lane, reach_m, end_m
) -> None:
    (path,) = RoadPaths(crossroads).ahead(lane, reach_m)
    assert path.curve.points[-1].tolist() == end_m
    assert path.stop_lines == ()


def in_two_parts(network: RoadNetwork) -> RoadNetwork:
    """The way straight across is lane 5 up to x = 15 and lane 7 from there on."""
    first = with_lines(network, {5: [(0.0, 0.0), (15.0, 0.0)]}).lanes
    second = replace(first[5], index=7, edge=7, centre=Polyline.through([(15.0, 0.0), (40.0, 0.0)]))
    edges = (*network.edges, replace(network.edges[5], index=7, lanes=(7,)))
    across = replace(network.connections[1], via=(5, 7))
    return replace(network, lanes=(*first, second), edges=edges, connections=(across,))


@pytest.mark.parametrize(("lane", "start_m", "length_m"), [(0, -100.0, 240.0), (5, 0.0, 140.0), (7, 15.0, 125.0)])
def test_what_is_left_of_a_way_across_a_junction(crossroads, lane, start_m, length_m) -> None:
    (path,) = RoadPaths(in_two_parts(crossroads)).ahead(lane, 30.0)
    assert path.curve.points[0].tolist() == [start_m, 0.0]
    assert path.curve.length_m == pytest.approx(length_m)
    assert path.first_lane == lane
    assert [line.arc_m for line in path.stop_lines] == ([100.0] if lane == 0 else [])


def test_what_a_way_turns_by_is_up_to_the_start_of_the_lane_behind_the_junction(crossroads) -> None:
    """Lane 1 leaves the junction northwards, and bends to the east after half a metre."""
    paths = RoadPaths(with_lines(crossroads, {1: [(20.0, 20.0), (20.0, 20.5), (120.0, 20.5)]})).ahead(0, 30.0)
    assert [path.turn_rad for path in paths] == pytest.approx([0.0, np.pi / 2.0, np.pi / 2.0])


def test_no_more_than_four_ways_the_straightest(crossroads) -> None:
    """Lane 2 ends at a second junction like the first: five ways in all, of which one turns twice as little."""
    lanes, edges = list(crossroads.lanes), list(crossroads.edges)
    onward = []
    for number, (direction, end) in enumerate((("l", (170.0, 90.0)), ("s", (260.0, 0.0)), ("r", (170.0, -50.0)))):
        index = 7 + number
        centre = Polyline.through([(140.0, 0.0), end])
        lanes.append(replace(lanes[2], index=index, edge=index, centre=centre))
        edges.append(replace(edges[2], index=index, lanes=(index,)))
        onward.append(replace(crossroads.connections[1], from_lane=2, to_lane=index, via=(), direction=direction))
    network = replace(
        crossroads, lanes=tuple(lanes), edges=tuple(edges), connections=(*crossroads.connections, *onward)
    )
    paths = RoadPaths(network).ahead(0, 200.0)
    right, left = np.arctan2(50.0, 30.0), np.arctan2(90.0, 30.0)
    assert [path.turn_rad for path in paths] == pytest.approx([0.0, right, left, np.pi / 2.0])
    assert [line.arc_m for line in paths[1].stop_lines] == pytest.approx([100.0, 240.0])
    assert RoadPaths(network).ahead(0, 30.0)[0].curve.length_m == pytest.approx(240.0), "as far as is asked for"


@pytest.mark.parametrize(("less_rad", "order"), [(0.0002, ["s", "l", "r"]), (0.002, ["s", "r", "l"])])
def test_ways_that_turn_alike_come_in_the_order_of_their_lanes(crossroads, less_rad, order) -> None:
    """The way to the right turns by a little less than the one to the left."""
    angle = -np.pi / 2.0 + less_rad
    end = (20.0 + 100.0 * np.cos(angle), -20.0 + 100.0 * np.sin(angle))
    paths = RoadPaths(with_lines(crossroads, {3: [(20.0, -20.0), end]})).ahead(0, 30.0)
    assert [path.stop_lines[0].movement.direction for path in paths] == order
