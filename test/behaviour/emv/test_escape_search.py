import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from siren_ros.behaviour.config import GapEscapeConfig
from siren_ros.behaviour.driving.free_space import Body, Obstacles, separations_m
from siren_ros.behaviour.emv.escape_lattice import RoadSpace, Start
from siren_ros.behaviour.emv.escape_search import _moved, search_lattice
from siren_ros.behaviour.paths.curve import Curve

CONFIG = GapEscapeConfig()
BODY = Body(3.25, 1.05)
REAR_M = 1.7
LINE = Curve.through(np.array([[-10.0, 0.0], [60.0, 0.0]]))


def boxes(*rows):
    x, y, yaw, length, width = np.array(rows, dtype=float).reshape(-1, 5).T
    return Obstacles(np.arange(2, 2 + len(x), dtype=np.uint32), x, y, np.cos(yaw), np.sin(yaw), length, width)


def car(x, y, yaw=0.0):
    return (x, y, yaw, 2.2, 0.9)


def road(right=-1.75, left=5.25, shoulder=0.0, opposite=0.0):
    s = 10.0 + CONFIG.station_m * np.arange(21)
    lines = (right - shoulder, right, left, left + opposite, 0.5 * (right + left))
    return RoadSpace(s, *(np.full(21, line) for line in lines))


def search(obstacles, space=None, left=0.0, slope=0.0):
    start = Start(left, slope, BODY, REAR_M, 3.9, 0.16)
    return search_lattice(LINE, space or road(), start, obstacles, CONFIG)


def poses(found):
    centre = found.centre_line(LINE, REAR_M)
    rear = LINE.offset_at(found.s_m, found.left_m)
    return centre, np.arctan2(*(centre - rear).T[::-1])


def distance(found, obstacles):
    centre, yaw = poses(found)
    return separations_m(centre[:, 0], centre[:, 1], yaw, BODY, obstacles).min()


def test_straight_on_where_the_road_is_free():
    found = search(boxes())
    assert found.complete
    assert found.length_m == pytest.approx(30.0)
    assert found.clearance_m == 0.3
    assert np.abs(np.diff(found.left_m)).max() < 0.06


def test_goes_round_a_blocker_with_the_margin_and_what_can_be_steered():
    blocker = boxes(car(12.0, 0.0))
    found = search(blocker)
    assert found.complete
    assert distance(found, blocker) > 0.2
    slope = np.gradient(found.left_m, found.s_m)
    assert np.abs(np.gradient(slope, found.s_m)).max() < 0.16 + 1e-6


def test_takes_a_tight_gap_with_a_smaller_margin_only_where_no_other_is_wide_enough():
    tight = boxes(car(18.0, -0.75), car(18.0, 3.45))
    found = search(tight)
    assert found.complete
    assert found.clearance_m == 0.08
    assert 0.0 < distance(found, tight) < 0.16
    assert search(boxes(car(18.0, -0.75), car(18.0, 4.0))).clearance_m == 0.3


def test_prefers_the_road_to_the_shoulder_and_the_shoulder_to_the_opposite_lane():
    both = boxes(car(20.0, 0.0), car(20.0, 3.5))
    shoulder = search(both, road(shoulder=2.6, opposite=3.5))
    assert shoulder.left_m.min() < -1.9
    assert search(both, road(opposite=3.5)).left_m.max() > 4.8
    assert search(both, road()) is None or not search(both, road()).complete
    assert 2.0 < search(boxes(car(20.0, 0.0)), road(shoulder=2.6, opposite=3.5)).left_m.max() < 4.3


def test_finds_nothing_right_behind_two_queues():
    assert search(boxes(car(8.0, 0.0), car(8.0, 3.5))) is None


def test_a_path_that_ends_early_ends_along_the_road():
    walls = boxes(*(car(24.0, y) for y in (-1.0, 1.0, 3.0, 5.0)))
    found = search(walls)
    assert not found.complete
    assert 8.0 <= found.length_m < 24.0
    assert abs(found.left_m[-1] - found.left_m[-2]) / (found.s_m[-1] - found.s_m[-2]) < 0.12


def test_a_vehicle_beside_that_is_too_near_already_does_not_keep_the_emv_there():
    beside = boxes(car(2.0, 2.0))
    assert separations_m(np.array(REAR_M), np.array(0.0), np.array(0.0), BODY, beside)[0] == pytest.approx(0.05)
    found = search(beside)
    assert found is not None
    assert found.complete
    assert found.left_m.max() <= 0.05


def test_leaves_a_shoulder_at_whose_edge_it_stands():
    edge = -1.75 + 1.05
    found = search(boxes(car(14.0, edge + 0.5)), left=edge)
    assert found is not None
    assert found.left_m.max() > edge + 2.0


@settings(max_examples=25, deadline=None)
@example([(9.75, 0.0, 0.25)], 0.0, -0.125)  # a corner reaches in between the places that the lattice looks at
@example([(6.0, -1.0, -0.28125)], 1.5, 0.03125)  # near at the start: nearer still only without touching
@given(
    st.lists(st.tuples(st.floats(6.0, 35.0), st.floats(-2.0, 5.5), st.floats(-0.3, 0.3)), max_size=5),
    st.floats(-0.5, 3.5),
    st.floats(-0.4, 0.4),
)
def test_no_path_touches_anybody(cars, left, slope):
    obstacles = boxes(*(car(*item) for item in cars))
    yaw = math.atan(slope)
    centre = np.array([REAR_M * math.cos(yaw), left + REAR_M * math.sin(yaw)])
    assume(np.all(separations_m(centre[0], centre[1], np.array(yaw), BODY, obstacles) > 0.0))
    found = search(obstacles, left=left, slope=slope)
    if found is not None and cars:
        assert distance(found, obstacles) > -0.02
        assert math.isclose(found.left_m[0], left, abs_tol=1e-9)


def moved_one_by_one(cost, turn, blocked):
    """Each node for itself: slope j of n is j − (n − 1)/2 steps; an offset changes by the mean of both slopes."""
    offsets, slopes = cost.shape
    middle = slopes // 2
    found = np.full(cost.shape, np.inf)
    for i in range(offsets):
        for j in range(slopes):
            before = j - turn
            if not 0 <= before < slopes:
                continue
            start = i - (before - middle) - (j - middle)
            if not 0 <= start < offsets:
                continue
            half = min(max(start + before - middle, 0), offsets - 1)
            low, high = before + math.floor(turn / 2), before + math.ceil(turn / 2)
            if not blocked[half, low] and not blocked[half, high]:
                found[i, j] = cost[start, before]
    return found


@pytest.mark.parametrize("turn", range(-4, 5))
def test_costs_move_by_the_mean_of_both_slopes_where_it_is_free_half_way(turn):
    rng = np.random.default_rng(turn + 10)
    cost = rng.random((13, 7))
    blocked = rng.random(cost.shape) < 0.2
    np.testing.assert_array_equal(_moved(cost, turn, blocked), moved_one_by_one(cost, turn, blocked))
    np.testing.assert_array_equal(
        _moved(cost, turn, np.zeros_like(blocked)), moved_one_by_one(cost, turn, np.zeros_like(blocked))
    )


@pytest.mark.parametrize(("worth", "clearance"), [(0.01, 0.3), (6.0, 0.08)])
def test_a_tight_margin_is_taken_for_as_much_way_as_it_costs(worth, clearance):
    """With 0.3 m the path ends before two cars; between them 0.08 m are left, two steps of 6 m dearer."""
    tight = boxes(car(18.0, -0.75), car(18.0, 3.45))
    config = replace(CONFIG, way_worth=worth)
    start = Start(0.0, 0.0, BODY, REAR_M, 3.9, 0.16)
    found = search_lattice(LINE, road(), start, tight, config)
    assert found.clearance_m == clearance
    assert found.complete is (clearance < 0.1)
