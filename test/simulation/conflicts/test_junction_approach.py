"""What drivers see of streets from the side, and how they heed people on a crossing, in any direction."""

import math
from dataclasses import replace

import numpy as np
import pytest
from behaviour.lab import RoadBuilder
from hand_made_record import STRAIGHT, STRAIGHT_LEFT, crossing

from siren_ros.simulation.conflicts.junction_approach import (
    SETBACK_M,
    Line,
    LineBook,
    Lookout,
    Outlines,
    Passer,
    SideStreet,
    least_wait_for_people,
    outlines_of,
    people_at,
    safe_mps,
    side_streets,
)
from siren_ros.simulation.scenario.driver_parameters import JunctionEntryConfig
from siren_ros.simulation.scenario.presets import Attention, TruncatedNormal

STREET = SideStreet(near_m=4.0, far_m=10.0, aside_m=7.0, limit_mps=8.0)
LOOKOUT = Lookout(horizon_s=8.0, pet_s=1.0, brake_mps2=3.0, reaction_s=0.5, standoff_m=1.0, length_m=6.0)


def crossroads(streets=((8.0, 1.0), (4.0, -1.0))):
    """A lane to the east, 12 m over the junction, and two back; a street from the south and one from the north.

    They are 4 m and 8 m in. The other way from the lane is crossed by nobody.
    """
    road = RoadBuilder().edge([[-200, 0], [0, 0]], 1, ("W", "J"))
    road.edge([[0, 0], [12, 0]], 1, ("J", "J"), internal=True).edge([[12, 0], [200, 0]], 1, ("J", "E"))
    road.edge([[0, 6.6], [-200, 6.6]], 2, ("J", "W"))
    for x_m, way in streets:
        ends = [[-150, -8], [-8, 8], [8, 150]]
        for (begin, end), names in zip(ends, (("S", "J"), ("J", "J"), ("J", "N")), strict=True):
            road.edge([[x_m, way * begin], [x_m, way * end]], 1, names, internal=names == ("J", "J"))
    road.connect(0, 2, via=(1,)).connect(0, 4)
    for first in range(5, 5 + 3 * len(streets), 3):
        road.connect(first, first + 2, via=(first + 1,))
    return road.built()


def test_the_view_opens_at_the_facades():
    """From 5 m before the line the eye is 4 m before the façades and 11 m before the street: the view is 7 m · 11/4."""
    assert STREET.seen_m(5.0) == pytest.approx(7.0 * 11.0 / 4.0)
    assert math.isinf(STREET.seen_m(1.0))
    assert math.isinf(STREET.seen_m(0.0))


def test_who_comes_into_view_is_let_pass_after_a_stop():
    """5 m before the line 8 m are left to the stop, of which 0.5 s go by before braking with 3 m/s²."""
    speed = safe_mps(STREET, 5.0, LOOKOUT)
    assert 0.5 * speed + speed**2 / 6.0 == pytest.approx(8.0)
    assert safe_mps(replace(STREET, near_m=0.0), 5.0, replace(LOOKOUT, standoff_m=6.0)) == 0.0


def test_a_view_that_is_long_enough_asks_for_nothing():
    """With a view of 6.5 s who is not seen yet comes after an EMV that covers 18 m at the speed for a stop."""
    free = replace(STREET, aside_m=40.0 * 4.0 / 11.0 * 1.3)
    assert free.seen_m(5.0) / free.limit_mps == pytest.approx(6.5)
    stops_mps = safe_mps(STREET, 5.0, LOOKOUT)
    assert stops_mps * 5.5 > 5.0 + 10.0 + 6.0
    assert math.isinf(safe_mps(free, 5.0, LOOKOUT))
    assert math.isfinite(safe_mps(free, 5.0, replace(LOOKOUT, pet_s=4.0)))


def test_who_does_not_reckon_with_others_sees_enough_everywhere():
    assert math.isinf(safe_mps(STREET, 5.0, replace(LOOKOUT, horizon_s=0.2)))


@pytest.mark.parametrize("order", [1, -1])
def test_streets_from_both_sides_are_where_their_lanes_cross(order):
    network = crossroads(((8.0, 1.0), (4.0, -1.0))[::order])
    right, left = side_streets(network, network.connections[0])
    width, near = 3.3, pytest.approx(4.0, abs=0.3)
    assert left.near_m + 0.5 * width == near
    assert right.near_m + 0.5 * width == pytest.approx(8.0, abs=0.3)
    assert (right.far_m - right.near_m, left.far_m - left.near_m) == pytest.approx((width, width))
    assert right.aside_m == pytest.approx(0.5 * width + SETBACK_M)
    assert left.aside_m == pytest.approx(2.5 * width + SETBACK_M)
    assert right.limit_mps == pytest.approx(13.89)
    (across,) = side_streets(near_line := crossroads(((1.0, 1.0),)), near_line.connections[0])
    assert (across.near_m, across.far_m) == (0.0, pytest.approx(1.0 + 0.5 * width, abs=0.3)), "it begins at the line"


@pytest.mark.parametrize("order", [1, -1])
def test_each_way_from_a_lane_has_a_view_of_its_own(order):
    """Where nobody crosses, the driver comes to the line at the speed that it draws."""
    network = crossroads()
    fast = Attention(emv_line_mps=TruncatedNormal(9.0, 0.0, 9.0, 9.0))
    book = LineBook(network, JunctionEntryConfig(), fast, 1)
    found = [book.approach_mps(1, 6.5, network.connections[at], 3.0) for at in (0, 1)[::order]][::order]
    assert found[0] < found[1] == pytest.approx(math.sqrt(81.0 + 2.0 * JunctionEntryConfig().brake_mps2 * 3.0))


@pytest.mark.parametrize("order", [1, -1])
def test_streets_from_one_side_count_from_the_nearest_to_the_farthest_with_the_highest_limit(order):
    network = crossroads(((4.0, 1.0), (8.0, 1.0))[::order])
    lanes = [replace(lane, speed_limit_mps=lane.index + 10.0) for lane in network.lanes]
    network = replace(network, lanes=tuple(lanes))
    (street,) = side_streets(network, network.connections[0])
    assert (street.near_m, street.far_m) == pytest.approx((4.0 - 0.5 * 3.3, 8.0 + 0.5 * 3.3), abs=0.3)
    fastest = max(network.connections[2:], key=lambda one: lanes[one.from_lane].speed_limit_mps)
    assert street.limit_mps == lanes[fastest.from_lane].speed_limit_mps
    slow = replace(network, lanes=tuple(replace(lane, speed_limit_mps=30.0 - lane.index) for lane in lanes))
    assert side_streets(slow, slow.connections[0])[0].limit_mps == 30.0 - min(
        one.from_lane for one in network.connections[2:]
    )


@pytest.mark.parametrize(("movement", "beside_m"), [(STRAIGHT, 1.75 + 3.5), (STRAIGHT_LEFT, 1.75)])
def test_the_lanes_on_the_side_of_a_street_are_before_it(movement, beside_m):
    network = crossing()
    (left,) = side_streets(network, network.connections[movement])
    assert left.aside_m == pytest.approx(beside_m + SETBACK_M)


def test_a_movement_that_nobody_crosses_has_no_streets():
    network = crossroads()
    assert side_streets(replace(network, connections=network.connections[:1]), network.connections[0]) == ()


HALF_LENGTH_M, HALF_WIDTH_M = 2.0, 1.0
BEGINS_M, ENDS_M = 20.0, 24.0
"""Of the crossing, from the driver's centre on."""
PACE_MPS, GENTLE_MPS2, EARLY_M = 1.6, 2.0, 0.4


def turned(points, turn):
    cos, sin = np.cos(turn), np.sin(turn)
    return np.asarray(points, float) @ np.array([[cos, sin], [-sin, cos]]) + [30.0, -12.0]


def wait(
    along_m,
    left_m,
    turn=0.3,
    speed_mps=8.0,
    walks_mps=(0.0, 0.0),
    beside_mps=np.inf,
    begins_m=BEGINS_M,
    ends=(-8.0, 8.0),
):
    """The wait for people at places along the way and to its left, walking along it and to its left."""
    corners = turned([(begins_m, ends[0]), (ENDS_M, ends[0]), (ENDS_M, ends[1]), (begins_m, ends[1])], turn)
    outlines = Outlines(corners, np.array([0, 4]))
    points = turned(np.stack((np.arange(0.0, 60.0), np.zeros(60)), axis=-1), turn)
    x, y = turned(np.stack((np.atleast_1d(along_m), np.atleast_1d(left_m)), axis=-1), turn).T
    pose = (x, y, np.full(len(x), turn + np.arctan2(walks_mps[1], walks_mps[0])), np.full(len(x), np.hypot(*walks_mps)))
    own = Passer(0.0, 0.0, HALF_LENGTH_M, HALF_WIDTH_M, speed_mps, beside_mps)
    way = Line(points, 0, len(points), 1.0)
    return least_wait_for_people(way, own, people_at(7 + np.arange(len(x)), pose, outlines), outlines)


@pytest.mark.parametrize("turn", [0.0, 2.2, -1.1])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_past_somebody_near_the_way_the_driver_goes_at_walking_pace(turn, side):
    worst, speed, _, free = wait(22.0, side * 2.5, turn)
    assert worst == 0
    assert free == pytest.approx(BEGINS_M - HALF_LENGTH_M, abs=0.6)
    assert speed == pytest.approx(np.sqrt(PACE_MPS**2 + 2.0 * GENTLE_MPS2 * (free - EARLY_M)))
    assert wait(22.0, side * 2.5, turn, speed_mps=14.0)[2] == 4.0, "no harder, though 5.4 m/s2 were needed"


@pytest.mark.parametrize(("left_m", "worst"), [(3.3, 0), (3.5, -1), (-3.3, 0), (-3.5, -1)])
def test_somebody_who_stands_farther_beside_the_way_does_not_count(left_m, worst):
    assert wait(22.0, left_m)[0] == worst


def test_before_somebody_in_the_way_the_driver_stops():
    _, speed, brake, free = wait(22.0, 0.5)
    assert free == pytest.approx(BEGINS_M - HALF_LENGTH_M - 1.0, abs=0.6)
    assert speed == pytest.approx(np.sqrt(2.0 * GENTLE_MPS2 * free))
    assert brake == pytest.approx(64.0 / (2.0 * free))


@pytest.mark.parametrize("turn", [1, -1])
def test_of_several_people_the_one_who_asks_for_most_counts(turn):
    in_way, *answer = wait(22.0, 0.5)
    places = np.array([(22.0, 2.5), (22.0, 0.5), (22.0, -2.6)])[[0, 1] if turn > 0 else [1, 2]]
    assert wait(*places.T) == (in_way + (turn > 0), *(pytest.approx(number) for number in answer))


def test_on_the_crossing_the_driver_stops_before_the_person():
    _, speed, _, free = wait(3.5, 0.0, speed_mps=1.0, begins_m=-2.0)
    assert free == pytest.approx(3.5 - HALF_LENGTH_M - 1.0)
    assert speed == pytest.approx(np.sqrt(2.0 * GENTLE_MPS2 * free))


def test_on_the_crossing_the_driver_goes_at_walking_pace_towards_the_person():
    assert wait(9.0, 0.0, speed_mps=1.0, begins_m=-2.0)[1] == PACE_MPS


def test_people_are_expected_to_go_on_as_they_walk():
    """The front comes to the crossing in 2.1 s, the rear leaves it in 3.3 s."""
    assert wait(22.0, 3.0, walks_mps=(0.0, 1.4))[0] == -1, "will be away"
    worst, speed, *_ = wait(22.0, 4.2, walks_mps=(0.0, -1.4))
    assert worst == 0, "will be in the way"
    assert speed < np.sqrt(2.0 * GENTLE_MPS2 * 18.0)


def test_a_driver_who_slows_down_for_somebody_near_stops_if_it_would_be_in_the_way_then():
    """At 8 m/s it leaves the crossing in 3.3 s, at walking pace some seconds later."""
    assert wait(22.0, 7.2, walks_mps=(0.0, -1.2))[1] == pytest.approx(np.sqrt(2.0 * GENTLE_MPS2 * 17.0), rel=0.02)
    assert wait(22.0, 10.2, walks_mps=(0.0, -1.2))[0] == -1


def test_nobody_waits_for_people_off_the_crossing_or_behind_it():
    assert wait(18.5, 2.0)[0] == -1
    assert wait(22.0, 2.0, begins_m=-20.0, speed_mps=2.0)[0] == 0
    assert wait(40.0, 2.0)[0] == -1


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_crossing_that_ends_beside_the_way_is_no_matter_of_the_driver(side):
    """Its end is 10 cm inside the body's flank, or 10 cm beside it."""
    for more_m, waits in ((-0.1, True), (0.1, False)):
        ends = sorted((side * (HALF_WIDTH_M + more_m), side * 8.0))
        assert (wait(22.0, side * 1.5, ends=ends)[0] == 0) is waits


def test_an_emv_slows_down_for_people_beside_the_crossing():
    _, speed, brake, free = wait(19.0, 2.0, beside_mps=8.0)
    assert (speed, brake) == (pytest.approx(np.sqrt(64.0 + 2.0 * GENTLE_MPS2 * (free - EARLY_M))), 0.0)
    assert wait(17.5, 2.0, beside_mps=8.0)[0] == -1, "farther than 2 m from it"


@pytest.mark.parametrize("order", [1, -1])
def test_each_person_is_at_the_nearest_crossing_and_on_it_or_beside_it(order):
    """Two crossings 2 m apart; on the first, near it, near the second, beside that, and away from both."""
    squares = [np.array([(x, 0.0), (x + 4.0, 0.0), (x + 4.0, 4.0), (x, 4.0)]) for x in (0.0, 6.0)[::order]]
    x_m = np.array([3.0, 4.5, 5.5, 11.9, 12.1])
    poses = x_m, np.full(5, 2.0), np.array([0.0, 1.0, 2.0, 3.0, -1.0]), np.array([0.0, 1.0, 1.5, 0.5, 1.0])
    people = people_at([4, 9, 2, 7, 5], poses, Outlines(np.concatenate(squares), np.array([0, 4, 8])))
    crossing = np.array([0.0, 0.0, 1.0, 1.0]) if order > 0 else np.array([1.0, 1.0, 0.0, 0.0])
    velocity = poses[3] * np.cos(poses[2]), poses[3] * np.sin(poses[2])
    rows = *poses[:2], *velocity, [*crossing, -1.0], [1.0, 0.0, 0.0, 0.0, 0.0], [4.0, 9.0, 2.0, 7.0, 5.0]
    np.testing.assert_allclose(people, rows)


def test_the_outlines_of_a_map_stand_one_after_the_other():
    assert len(outlines_of(crossing()).points) == 0
    assert outlines_of(crossing()).begins.tolist() == [0]
