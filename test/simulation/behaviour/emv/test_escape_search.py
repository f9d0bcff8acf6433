"""The nodes of an escape's lattice: where they are, what they cost, and how near others are there."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from siren_ros.simulation.behaviour.driving.navigator import Obstacles, separations_m
from siren_ros.simulation.behaviour.driving.speed_mechanisms import ESCAPE_HORIZON_M
from siren_ros.simulation.behaviour.driving.step_view import Body
from siren_ros.simulation.behaviour.driving.tracked_path import Curve
from siren_ros.simulation.behaviour.emv.escape_search import (
    OFFSET_COST,
    SLOPE_STEP,
    STATION_M,
    RoadSpace,
    Start,
    lattice_of,
    moved_costs,
    search_lattice,
)
from siren_ros.simulation.scenario.driver_parameters import GapEscapeConfig

CONFIG = GapEscapeConfig()
BODY = Body(3.25, 1.05)
REAR_M, WHEELBASE_M, SHARPEST_1PM = 1.7, 3.9, 0.16
START = Start(0.2, 0.05, BODY, REAR_M, WHEELBASE_M, SHARPEST_1PM)
STATIONS = 21
TURNS = np.radians([0.0, 50.0, -130.0])
GRAIN_M = 0.5 * STATION_M * SLOPE_STEP


def line(turn=0.0):
    along = np.array([np.cos(turn), np.sin(turn)])
    return Curve.through(np.array([-10.0 * along, 60.0 * along]))


def cars(turn, *rows):
    """Cars of 4.4 m by 1.8 m, ahead and to the left of the line's beginning, turned with the line."""
    ahead, left, yaw = np.array(rows, dtype=float).reshape(-1, 3).T
    cos, sin = np.cos(turn), np.sin(turn)
    n = len(ahead)
    return Obstacles(
        np.arange(2, 2 + n, dtype=np.uint32), cos * ahead - sin * left, sin * ahead + cos * left,
        np.cos(turn + yaw), np.sin(turn + yaw), np.full(n, 2.2), np.full(n, 0.9),
    )  # fmt: skip


def road(right=-1.75, driving=-1.75, left=5.25, opposite=5.25, middle=1.75):
    """Stations from the line's place 10 m, its origin, on."""
    s = 10.0 + STATION_M * np.arange(STATIONS)
    return RoadSpace(s, *(np.full(STATIONS, value) for value in (right, driving, left, opposite, middle)))


def lattice(space=None, start=START, obstacles=None, turn=0.0, curve=None):
    return lattice_of(curve or line(turn), space or road(), start, obstacles or cars(turn), CONFIG)


def index_of(values, value):
    return int(np.argmin(np.abs(values - value)))


def test_nodes_are_offsets_a_grain_apart_around_the_start_and_slopes_up_to_0_8():
    nodes = lattice()
    assert nodes.left_m[nodes.start[0]] == pytest.approx(START.left_m)
    assert np.diff(nodes.left_m) == pytest.approx(GRAIN_M)
    assert nodes.left_m[0] - GRAIN_M < -1.75 + BODY.half_width_m <= nodes.left_m[0] + GRAIN_M
    assert nodes.left_m[-1] - GRAIN_M <= 5.25 - BODY.half_width_m < nodes.left_m[-1] + GRAIN_M
    assert nodes.slope == pytest.approx(0.1 * np.arange(-8, 9))


@pytest.mark.parametrize(
    ("slope", "both"), [(0.05, (8, 9)), (-0.05, (7, 8)), (0.1, (9,)), (0.0, (8,)), (2.0, (16,)), (-2.0, (0,))]
)
def test_the_vehicles_own_direction_lies_between_two_slopes(slope, both):
    assert lattice(start=replace(START, slope=slope)).start[1] == both


@pytest.mark.parametrize("left", [-3.0, 7.0])
def test_who_stands_off_the_road_has_nodes_up_to_there(left):
    nodes = lattice(start=replace(START, left_m=left))
    assert nodes.left_m[nodes.start[0]] == pytest.approx(left)
    assert nodes.start[0] == (0 if left < 0.0 else len(nodes.left_m) - 1)


@pytest.mark.parametrize("bend", [0.0, 1.0 / 20.0, -1.0 / 20.0, 0.2, -0.2, 0.25, -0.25])
def test_the_change_of_slope_is_what_can_be_steered_less_the_bend_of_the_line(bend):
    """From −0.16 − κ to 0.16 − κ per metre, times 1.5 m, in steps of 0.1; going on as before is always one of them."""
    a = np.linspace(-10.0, 60.0, 1400)
    points = np.stack((a, np.zeros_like(a)), axis=-1)
    if bend:
        points = np.stack((np.sin(a * bend) / bend, (1.0 - np.cos(a * bend)) / bend), axis=-1)
    nodes = lattice(curve=Curve.through(points))
    low = min(int(np.ceil((-SHARPEST_1PM - bend) * 15.0)), 0)
    assert set(nodes.turns[3:-3]) == {range(low, max(int(np.floor((SHARPEST_1PM - bend) * 15.0)), 0) + 1)}


def test_prices_are_of_the_shoulder_the_opposite_lane_and_the_distance_from_the_middle():
    nodes = lattice(road(right=-4.25, driving=-1.75, left=5.25, opposite=8.75))
    share, half = STATION_M / ESCAPE_HORIZON_M, BODY.half_width_m
    for near, shoulder, beyond in (
        *[(-0.65, 0, 0.0), (-0.8, 1, 0.0), (1.75, 0, 0.0), (4.1, 0, 0.0)],
        *[(4.3, 0, 0.2), (4.7, 0, None), (6.5, 0, 1.0), (-2.9, 1, 0.0)],
    ):
        row = index_of(nodes.left_m, near)
        left = nodes.left_m[row]
        opposite = left + half - 5.25 if beyond is None else beyond
        aside = OFFSET_COST * min(abs(left - 1.75), 4.0)
        expected = share * (CONFIG.shoulder_cost_m * shoulder + CONFIG.opposite_cost_m * opposite) + aside
        assert nodes.price[:, row] == pytest.approx(expected), left


@pytest.mark.parametrize("turn", TURNS)
def test_the_clearance_of_a_node_is_that_of_the_body_whose_rear_axle_is_there(turn):
    others = cars(turn, (14.0, 2.6, 0.2), (21.0, -0.4, -0.3), (9.0, 4.2, np.pi))
    grid = lattice(obstacles=others, turn=turn)
    for station, left, slope in ((3, 0.2, 0.1), (4, 1.1, -0.2), (7, -0.4, 0.3), (9, 2.0, 0.0), (11, 1.0, 0.4)):
        row, column = index_of(grid.left_m, left), index_of(grid.slope, slope)
        for half_way, nodes in ((0.0, grid.clearance_m), (0.5, grid.between_m)):
            yaw = turn + np.arctan(grid.slope[column])
            ahead = STATION_M * (station + half_way)
            rear = ahead * np.array([np.cos(turn), np.sin(turn)])
            rear += grid.left_m[row] * np.array([-np.sin(turn), np.cos(turn)])
            x, y = rear + REAR_M * np.array([np.cos(yaw), np.sin(yaw)])
            gap = separations_m(np.array(x), np.array(y), np.array(yaw), BODY, others).min()
            assert nodes[station, row, column] == pytest.approx(gap, abs=1e-6)


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(("aside", "present"), [(0.25, 0.25), (-0.25, 0.25), (0.35, np.inf), (-0.35, np.inf)])
def test_who_is_nearer_than_0_3_m_at_the_start_is_noted(turn, aside, present):
    """The vehicle stands straight at the line's beginning; the other is alongside."""
    start = replace(START, left_m=0.0, slope=0.0)
    left = np.sign(aside) * (BODY.half_width_m + 0.9 + abs(aside))
    nodes = lattice(start=start, obstacles=cars(turn, (REAR_M + 0.5, left, 0.0)), turn=turn)
    assert nodes.present_m.tolist() == pytest.approx([present])


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("slope", [-3, 0, 3])
def test_the_wheels_stay_within_the_road_and_an_overhang(side, slope):
    """At an angle the front wheels are farther to one side by the wheelbase times its sine."""
    start = replace(START, left_m=0.0, slope=0.0)
    nodes = lattice(road(middle=0.0, right=-4.0, left=4.0, opposite=4.0, driving=-4.0), start)
    angle = np.arctan(0.1 * slope)
    wheels = BODY.half_width_m * np.cos(angle) + max(side * WHEELBASE_M * np.sin(angle), 0.0)
    beyond = side * nodes.left_m > 0.0
    clear = nodes.clearance_m[5, beyond, len(nodes.slope) // 2 + slope] > 0.0
    on_road = side * nodes.left_m[beyond] + wheels <= 4.0 + CONFIG.edge_overhang_m
    assert clear.tolist() == on_road.tolist()
    assert slope * side < 3 or not on_road.all()


@pytest.mark.parametrize("side", [1, -1])
def test_who_stands_over_the_edge_may_stay_as_far_over_it(side):
    """The left edge that counts is that of the opposite lane."""
    start = replace(START, left_m=side * 3.6, slope=0.0)
    nodes = lattice(road(middle=0.0, right=-4.0, left=2.0, opposite=4.0, driving=-4.0), start)
    assert 3.6 + BODY.half_width_m - 4.0 > CONFIG.edge_overhang_m
    clear = nodes.clearance_m[6, :, len(nodes.slope) // 2] > 0.0
    assert clear[nodes.start[0]]
    over = side * nodes.left_m > 3.6 + 1e-9
    assert not clear[over].any()
    assert clear[~over & (side * nodes.left_m > 0.0)].all()


LINE = line()


def boxes(*rows):
    return cars(0.0, *rows)


def car(x, y, yaw=0.0):
    return x, y, yaw


def wide_road(shoulder=0.0, opposite=0.0):
    return road(right=-1.75 - shoulder, opposite=5.25 + opposite)


def search(obstacles, space=None, left=0.0, slope=0.0):
    return search_lattice(LINE, space or road(), replace(START, left_m=left, slope=slope), obstacles, CONFIG)


def poses(path):
    centre = path.centre_line(LINE, REAR_M)
    return centre, np.arctan2(*(centre - LINE.offset_at(path.s_m, path.left_m)).T[::-1])


def distance(path, obstacles):
    centre, yaw = poses(path)
    return separations_m(centre[:, 0], centre[:, 1], yaw, BODY, obstacles).min()


def test_straight_on_where_the_road_is_free():
    path = search(boxes())
    assert path.complete
    assert (path.length_m, path.clearance_m) == (pytest.approx(30.0), 0.3)
    assert np.abs(np.diff(path.left_m)).max() < 0.06


def test_goes_round_a_blocker_with_the_margin_and_what_can_be_steered():
    blocker = boxes(car(12.0, 0.0))
    path = search(blocker)
    assert path.complete
    assert distance(path, blocker) > 0.2
    slope = np.gradient(path.left_m, path.s_m)
    assert np.abs(np.gradient(slope, path.s_m)).max() < 0.16 + 1e-6


def test_takes_a_tight_gap_with_a_smaller_margin_only_where_no_other_is_wide_enough():
    tight = boxes(car(18.0, -0.75), car(18.0, 3.45))
    path = search(tight)
    assert path.complete
    assert path.clearance_m == 0.08
    assert 0.0 < distance(path, tight) < 0.16
    assert search(boxes(car(18.0, -0.75), car(18.0, 4.0))).clearance_m == 0.3


def test_prefers_the_road_to_the_shoulder_and_the_shoulder_to_the_opposite_lane():
    both = boxes(car(20.0, 0.0), car(20.0, 3.5))
    assert search(both, wide_road(shoulder=2.6, opposite=3.5)).left_m.min() < -1.9
    assert search(both, wide_road(opposite=3.5)).left_m.max() > 4.8
    assert search(both, road()) is None or not search(both, road()).complete
    assert 2.0 < search(boxes(car(20.0, 0.0)), wide_road(shoulder=2.6, opposite=3.5)).left_m.max() < 4.3


def test_finds_nothing_right_behind_two_queues():
    assert search(boxes(car(8.0, 0.0), car(8.0, 3.5))) is None


def test_a_path_that_ends_early_ends_along_the_road():
    path = search(boxes(*(car(24.0, y) for y in (-1.0, 1.0, 3.0, 5.0))))
    assert not path.complete
    assert 8.0 <= path.length_m < 24.0
    assert abs(path.left_m[-1] - path.left_m[-2]) / (path.s_m[-1] - path.s_m[-2]) < 0.12


def test_a_vehicle_beside_that_is_too_near_already_does_not_keep_the_emv_there():
    beside = boxes(car(2.0, 2.0))
    assert separations_m(np.array(REAR_M), np.array(0.0), np.array(0.0), BODY, beside)[0] == pytest.approx(0.05)
    path = search(beside)
    assert path is not None
    assert path.complete
    assert path.left_m.max() <= 0.05


def test_leaves_a_shoulder_at_whose_edge_it_stands():
    edge = -1.75 + 1.05
    path = search(boxes(car(14.0, edge + 0.5)), left=edge)
    assert path is not None
    assert path.left_m.max() > edge + 2.0


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
    path = search(obstacles, left=left, slope=slope)
    if path is not None and cars:
        assert distance(path, obstacles) > -0.02
        assert math.isclose(path.left_m[0], left, abs_tol=1e-9)


def moved_one_by_one(cost, turn, blocked):
    """Each node for itself: slope j of n is j − (n − 1)/2 steps; an offset changes by the mean of both slopes."""
    offsets, slopes = cost.shape
    middle = slopes // 2
    moved = np.full(cost.shape, np.inf)
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
                moved[i, j] = cost[start, before]
    return moved


@pytest.mark.parametrize("turn", range(-4, 5))
def test_costs_move_by_the_mean_of_both_slopes_where_it_is_free_half_way(turn):
    rng = np.random.default_rng(turn + 10)
    cost = rng.random((13, 7))
    blocked = rng.random(cost.shape) < 0.2
    np.testing.assert_array_equal(moved_costs(cost, turn, blocked), moved_one_by_one(cost, turn, blocked))
    np.testing.assert_array_equal(
        moved_costs(cost, turn, np.zeros_like(blocked)), moved_one_by_one(cost, turn, np.zeros_like(blocked))
    )
