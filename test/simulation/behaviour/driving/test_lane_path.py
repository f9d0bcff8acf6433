"""Reference lines along lanes, also of lanes that begin beside the end of the one before."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_episode import rotate

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.simulation.behaviour.driving import lane_path
from siren_ros.simulation.behaviour.driving.lane_path import path_on_lanes, without_jumps
from siren_ros.simulation.behaviour.driving.tracked_path import LaneEnd, Navigation, on_reference
from siren_ros.simulation.roads.road_network import NO_LANE

BENT = Polyline.through(np.array([[0.0, 0.0], [10.0, 0.0], [12.0, 6.0], [12.0, 15.0]]))


def route(*edges):
    return np.array(edges, dtype=np.int32)


def test_changes_needed_looks_beyond_the_next_edge(lab):
    road = lab.RoadBuilder().edge([[0, 0], [100, 0]], 3, ("A", "B"))
    road.edge([[100, 0], [200, 0]], 3, ("B", "C"))
    road.edge([[200, 6.6], [300, 6.6]], 1, ("C", "D"))
    for position in range(3):
        road.connect(position, 3 + position)
    road.connect(5, 6)
    needed = lane_path.changes_needed(road.built(), route(0, 1, 2), civilian=True)
    assert (needed[0], needed[1]) == ({0: 2, 1: 1, 2: 0}, {3: 2, 4: 1, 5: 0})


def test_civilians_need_lanes_of_their_own(lab):
    network = lab.straight_road(3, shoulder=True)
    assert set(lane_path.changes_needed(network, route(0), civilian=True)[0]) == {1, 2}
    assert set(lane_path.changes_needed(network, route(0), civilian=False)[0]) == {0, 1, 2}


def test_the_lanes_of_who_has_the_front_on_the_next_edge_lead_there(lab):
    """The route begins with the edge below the front, the lane is the one below the middle."""
    network = lab.junction_road(2)
    assert lane_path.lanes_along(network, 1, 149.0, route(2), 50.0) == ((1, 3, 5), lane_path.LaneEnd.HORIZON)
    assert lane_path.lanes_along(network, 1, 149.0, route(4), 50.0) == ((1,), lane_path.LaneEnd.ASTRAY)


def test_ends_say_why(lab):
    network = lab.junction_road(2)
    assert lane_path.lanes_along(network, 1, 0.0, route(0, 4), 500.0) == ((1,), lane_path.LaneEnd.ASTRAY)
    assert lane_path.lanes_along(network, 0, 0.0, route(0, 2), 900.0)[1] is lane_path.LaneEnd.ROUTE
    alone = lane_path.lanes_along(network, 0, 0.0, route(0, 2), 900.0, through_junctions=False)
    assert alone == ((0,), lane_path.LaneEnd.JUNCTION)


def test_plain_joints_do_not_stop_a_civilian(lab):
    road = lab.RoadBuilder().edge([[0, 0], [60, 0]], 2, ("A", "B"))
    road.edge([[60, 0], [200, 0]], 2, ("B", "C"))
    road.connect(0, 2).connect(1, 3)
    lanes, end = lane_path.lanes_along(road.built(), 0, 10.0, route(0, 1), 80.0, civilian=True, through_junctions=False)
    assert lanes == (0, 2)
    assert end is lane_path.LaneEnd.HORIZON


def test_where_a_lane_fans_out_the_way_goes_straight_on(lab):
    road = lab.RoadBuilder().edge([[0, 0], [60, 0]], 1, ("A", "B"))
    road.edge([[70, -3.3], [200, -3.3]], 3, ("B", "C"))
    for left in (-3.3, 0.0, 3.3):
        road.edge([[60, 0], [64, 0], [66, left], [70, left]], 1, ("B", "B"), internal=True)
    for position in range(3):
        road.connect(0, 1 + position, via=(4 + position,))
    assert lane_path.lanes_along(road.built(), 0, 10.0, route(0, 1), 80.0)[0] == (0, 5, 2)


def test_path_on_lanes_follows_the_turn_and_knows_its_lanes(lab):
    network = lab.junction_road(2)
    lanes, end = lane_path.lanes_along(network, 0, 100.0, route(0, 4), 120.0)
    path = lane_path.path_on_lanes(network, lanes, end, 90.0, 120.0)
    assert path.curve.points[0] == pytest.approx([90.0, 0.0], abs=1e-6)
    assert path.curve.length_m == pytest.approx(120.0, rel=0.02)
    assert path.lane_at(np.array([0.0, 55.0, 65.0, 100.0])).tolist() == [0, 0, 6, 7]
    assert path.curve.heading_rad[-1] == pytest.approx(-np.pi / 2.0, abs=1e-3)
    assert np.abs(path.curve.curvature_1pm).max() < 0.16


def test_neighbours_and_limits(lab):
    network = lab.straight_road(3, shoulder=True)
    assert (lane_path.neighbour_lane(network, 0, -1), lane_path.neighbour_lane(network, 1, 1)) == (NO_LANE, 2)
    limits = lane_path.road_limits(network, 1)
    assert (limits.right_m, limits.driving_right_m, limits.left_m, limits.opposite_m) == pytest.approx(
        (-4.95, -1.65, 4.95, 0.0)
    )


def test_an_internal_lane_belongs_to_the_movement_along_the_route_and_else_to_the_first(lab):
    """Two movements share the first of their lanes across the junction."""
    road = lab.RoadBuilder().edge([[0, 0], [100, 0]], 1, ("W", "J"))
    road.edge([[100, 0], [110, 0]], 1, ("J", "J"), internal=True)
    road.edge([[110, 0], [200, 0]], 1, ("J", "E"))
    road.edge([[110, 0], [110, 90]], 1, ("J", "N"))
    road.connect(0, 2, via=(1,)).connect(0, 3, via=(1,), direction="l")
    network = road.built()
    assert lane_path.connection_of_internal(network, 1, route(0, 2)).to_lane == 2
    assert lane_path.connection_of_internal(network, 1, route(0, 3)).to_lane == 3
    assert lane_path.connection_of_internal(network, 1, route(7)).to_lane == 2
    assert lane_path.connection_of_internal(network, 1, route(9, 0, 3)).to_lane == 3, "the third edge counts"
    assert lane_path.connection_of_internal(network, 1, route(9, 8, 0, 3)).to_lane == 2, "the fourth does not"
    assert lane_path.connection_of_internal(network, 2, route(0, 2)) is None
    assert lane_path.lanes_along(network, 1, 2.0, route(0, 3), 50.0)[0] == (1, 3)


@pytest.mark.parametrize("civilian", [True, False])
def test_a_lane_from_which_the_route_cannot_be_followed_is_missing(lab, civilian):
    """Lane 0 ends in nothing and may be left; on the third road nothing leads on at all."""
    road = lab.RoadBuilder().edge([[0, 0], [100, 0]], 2, ("A", "B"))
    road.edge([[100, 0], [200, 0]], 1, ("B", "C"))
    road.edge([[0, 50], [100, 50]], 1, ("D", "E"))
    road.connect(1, 2)
    network = road.built()
    assert lane_path.changes_needed(network, route(0, 1), civilian) == [{0: 1, 1: 0}, {2: 0}]
    assert lane_path.changes_needed(network, route(2, 1), civilian) == [{}, {2: 0}]


def test_of_several_movements_to_the_next_edge_the_fewest_changes_come_first_and_then_the_rightmost_lane(lab):
    """Two movements lead straight on from one lane; beyond, the route needs the left or any lane."""
    road = lab.RoadBuilder().edge([[0, 0], [60, 0]], 1, ("A", "B"))
    road.edge([[60, 0], [120, 0]], 2, ("B", "C"))
    road.edge([[120, 3.3], [200, 3.3]], 1, ("C", "D"))
    for to in (2, 1):
        road.connect(0, to)
    road.connect(2, 3)
    network = road.built()
    assert lane_path.lanes_along(network, 0, 50.0, route(0, 1, 2), 40.0)[0] == (0, 2)
    assert lane_path.lanes_along(network, 0, 50.0, route(0, 1), 40.0)[0] == (0, 1)


@pytest.mark.parametrize(("ahead", "expected"), [(49.9, (0,)), (50.1, (0, 2, 4)), (74.9, (0, 2, 4)), (275.1, None)])
def test_lanes_are_added_while_less_than_the_way_ahead_is_left(lab, ahead, expected):
    """100 m on the lane, 25 m over the junction, 225 m behind it."""
    lanes, end = lane_path.lanes_along(lab.junction_road(2), 0, 100.0, route(0, 2), ahead)
    if expected is None:
        assert ahead < 300.0
        assert (lanes, end) == ((0, 2, 4), lane_path.LaneEnd.HORIZON)
        assert lane_path.lanes_along(lab.junction_road(2), 0, 100.0, route(0, 2), 300.1)[1] is lane_path.LaneEnd.ROUTE
    else:
        assert (lanes, end) == (expected, lane_path.LaneEnd.HORIZON)


@pytest.mark.parametrize(("ahead", "ends"), [(40.0, lane_path.LaneEnd.HORIZON), (60.0, lane_path.LaneEnd.ASTRAY)])
def test_a_line_that_does_not_reach_the_end_of_its_lanes_ends_at_the_horizon(lab, ahead, ends):
    network = lab.junction_road(2)
    path = lane_path.path_on_lanes(network, (1,), lane_path.LaneEnd.ASTRAY, 100.0, ahead)
    assert path.end is ends
    assert path.curve.length_m == pytest.approx(min(ahead, 50.0), abs=0.01)
    assert lane_path.path_on_lanes(
        network, (1,), lane_path.LaneEnd.ASTRAY, 149.0, 60.0
    ).curve.length_m == pytest.approx(2.0, abs=0.01)
    before = lane_path.path_on_lanes(network, (1,), lane_path.LaneEnd.HORIZON, -5.0, 20.0)
    assert before.curve.points[0] == pytest.approx([-5.0, 3.3], abs=1e-6)
    assert before.start_m.tolist() == pytest.approx([5.0])


def test_the_opposite_road_is_as_wide_as_its_driving_lanes_and_the_nearest_of_them_is_the_leftmost(lab):
    road = lab.RoadBuilder().edge([[0, 0], [100, 0]], 2, ("A", "B"))
    road.edge([[100, 30.0], [0, 30.0]], 3, ("B", "A"), shoulder=True, width=4.0)
    road.edge([[0, 60], [100, 60]], 1, ("A", "C"))
    network = road.built()
    near, far = lane_path.road_limits(network, 0), lane_path.road_limits(network, 2)
    assert (near.opposite_m, near.opposite_road_m) == pytest.approx((4.0, 8.0))
    assert (far.opposite_m, far.opposite_road_m) == pytest.approx((3.3, 6.6))
    assert (far.right_m, far.driving_right_m, far.left_m) == pytest.approx((-2.0, 2.0, 10.0))
    assert lane_path.road_limits(network, 5).opposite_m == 0.0


@pytest.mark.parametrize(
    "point",
    [
        *((-5.0, 2.0), (12.5, 25.0), (6.0, -1.0), (-9.0, -20.0), (30.0, 15.1)),
        *((4.0, 1.0), (9.0, 0.5), (11.0, 3.0), (12.0, 20.0)),
    ],
)
def test_nearest_place_agrees_with_the_polyline(point):
    s, left, heading = lane_path.nearest_on_lane(BENT, *point)
    expected_s, expected_left = BENT.project(point)
    assert (s, left) == pytest.approx((float(expected_s), float(expected_left)))
    if 0.1 < s < BENT.length_m - 0.1 and min(abs(s - BENT.arc_m)) > 0.01:
        assert heading == pytest.approx(float(BENT.heading_rad(s)))
    assert lane_path.lane_heading(BENT, 11.0) == pytest.approx(float(BENT.heading_rad(11.0)))


@pytest.mark.parametrize(("s", "heading"), [(-3.0, 0.0), (5.0, 0.0), (13.0, np.arctan2(6.0, 2.0)), (20.0, np.pi / 2.0)])
def test_the_heading_at_an_arc_length_is_that_of_its_segment(s, heading):
    assert lane_path.lane_heading(BENT, s) == pytest.approx(heading)
    assert lane_path.lane_heading(BENT, 99.0) == pytest.approx(np.pi / 2.0)


def test_the_way_is_the_shoulders_up_to_the_turn(lab):
    network = lab.road_with_shoulder()
    far = lane_path.shoulder_into_turn(network, route(0, 2, 3), 100.0)
    assert (far.lane, far.onward.to_lane, far.edges) == (0, 4, (0, 2))
    near = lane_path.shoulder_into_turn(network, route(2, 3), 0.0)
    assert (near.lane, near.onward.to_lane, near.edges) == (4, 6, (2,))


@pytest.mark.parametrize(
    ("edges", "reach_m"), [((0, 2, 3), 49.0), ((0, 2), 100.0), ((3,), 100.0), ((2,), 100.0), ((0, 3), 100.0)]
)
def test_no_way_where_the_turn_is_far_or_not_on_the_route(lab, edges, reach_m):
    assert lane_path.shoulder_into_turn(lab.road_with_shoulder(), route(*edges), reach_m) is None


CONFIG = replace(Navigation(), curvature_rate_1pms=0.15)


def road(lab, *lanes, turn=0.6):
    """Lanes given by x from, x to and y, one after the other."""
    builder = lab.RoadBuilder()
    for number, (begin, end, y) in enumerate(lanes):
        builder.edge(rotate(np.array([[begin, y], [end, y]]), turn), 1, (f"n{number}", f"n{number + 1}"))
    return builder.built()


def path(network, count, from_m=0.0):
    line = path_on_lanes(network, tuple(range(count)), LaneEnd.HORIZON, from_m, 1000.0)
    return line, on_reference(line, CONFIG, stop_at_end=False, shorten_m=0.0)


@pytest.mark.parametrize("shift", [-1.75, -0.5, 0.5, 1.75])
def test_the_path_moves_over_gently_and_fast(lab, shift):
    """At least at 45 km/h; a line straight through the points is driven at walking pace."""
    network = road(lab, (0.0, 100.0, 0.0), (100.0, 200.0, shift))
    line, tracked = path(network, 2)
    assert tracked.speed_cap_mps(100.0) > 12.5
    assert min(tracked.speed_cap_mps(s) for s in range(60, 140)) > 12.5
    y = rotate(line.curve.points, -0.6)[:, 1]
    assert np.all(np.diff(np.sign(shift) * y) >= -1e-6)
    assert (y[0], y[-1]) == pytest.approx((0.0, shift), abs=1e-6)
    assert np.abs(y[line.curve.points @ np.array([np.cos(0.6), np.sin(0.6)]) < 82.0]).max() < 0.01
    assert line.start_m[1] == pytest.approx(100.0, abs=0.3)


def test_a_shifted_stub_between_two_roads_in_line_is_driven_straight_through(lab):
    network = road(lab, (0.0, 100.0, 0.0), (100.0, 103.0, 1.6), (103.0, 200.0, 0.0))
    line, tracked = path(network, 3)
    assert np.abs(rotate(line.curve.points, -0.6)[:, 1]).max() < 0.2
    assert min(tracked.speed_cap_mps(s) for s in range(60, 140)) > 12.5
    assert line.start_m == pytest.approx([0.0, 100.0, 103.0], abs=1.5)


def test_roads_without_a_jump_and_real_bends_stay_as_they_are():
    corner = Polyline.through([[0.0, 0.0], [50.0, 0.0], [50.0, 50.0]])
    dog_leg = Polyline.through([[0.0, 0.0], [50.0, 0.0], [50.0, 4.0], [100.0, 4.0]])
    straight = Polyline.through([[0.0, 0.0], [50.0, 0.0], [100.0, 1.0]])
    for line in (corner, dog_leg, straight):
        starts = np.array([0.0, 50.0])
        kept, begun = without_jumps(line, starts)
        assert kept is line
        assert begun is starts


def test_a_jump_near_an_end_of_the_line_is_blended_on_the_way_that_there_is():
    line = Polyline.through([[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [40.0, 1.0]])
    blended, starts = without_jumps(line, np.array([0.0, 4.0]))
    assert blended.points[0] == pytest.approx([0.0, 0.0])
    assert blended.points[-1] == pytest.approx([40.0, 1.0])
    assert np.abs(blended.heading_rad(np.arange(0.0, 39.0))).max() < 0.2
    assert 0.0 < starts[1] < 6.0
