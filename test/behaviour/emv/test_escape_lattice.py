"""The nodes of an escape's lattice: where they are, what they cost, and how near others are there."""

from dataclasses import replace

import numpy as np
import pytest

from siren_ros.behaviour.config import GapEscapeConfig
from siren_ros.behaviour.driving.free_space import Body, Obstacles, separations_m
from siren_ros.behaviour.emv.escape_lattice import RoadSpace, Start, lattice_of
from siren_ros.behaviour.paths.curve import Curve

CONFIG = GapEscapeConfig()
BODY = Body(3.25, 1.05)
REAR_M, WHEELBASE_M, SHARPEST_1PM = 1.7, 3.9, 0.16
START = Start(0.2, 0.05, BODY, REAR_M, WHEELBASE_M, SHARPEST_1PM)
STATIONS = 21
TURNS = np.radians([0.0, 50.0, -130.0])
GRAIN_M = 0.5 * CONFIG.station_m * CONFIG.slope_step


def line(turn=0.0):
    along = np.array([np.cos(turn), np.sin(turn)])
    return Curve.through(np.array([-10.0 * along, 60.0 * along]))


def nobody():
    return Obstacles(np.empty(0, np.uint32), *(np.empty(0) for _ in range(6)))


def cars(turn, *rows):
    """Cars of 4.4 m by 1.8 m, ahead and to the left of the line's beginning, turned with the line."""
    ahead, left, yaw = np.array(rows, dtype=float).T
    cos, sin = np.cos(turn), np.sin(turn)
    n = len(ahead)
    return Obstacles(
        np.arange(2, 2 + n, dtype=np.uint32),
        cos * ahead - sin * left,
        sin * ahead + cos * left,
        np.cos(turn + yaw),
        np.sin(turn + yaw),
        np.full(n, 2.2),
        np.full(n, 0.9),
    )


def road(right=-1.75, driving=-1.75, left=5.25, opposite=5.25, middle=1.75):
    """Stations from the line's place 10 m, its origin, on."""
    s = 10.0 + CONFIG.station_m * np.arange(STATIONS)
    return RoadSpace(s, *(np.full(STATIONS, value) for value in (right, driving, left, opposite, middle)))


def lattice(space=None, start=START, obstacles=None, turn=0.0, curve=None):
    return lattice_of(curve or line(turn), space or road(), start, obstacles or nobody(), CONFIG)


def index_of(values, value):
    return int(np.argmin(np.abs(values - value)))


def test_nodes_are_offsets_a_grain_apart_around_the_start_and_slopes_up_to_0_8():
    found = lattice()
    assert found.left_m[found.start[0]] == pytest.approx(START.left_m)
    assert np.diff(found.left_m) == pytest.approx(GRAIN_M)
    assert found.left_m[0] - GRAIN_M < -1.75 + BODY.half_width_m <= found.left_m[0] + GRAIN_M
    assert found.left_m[-1] - GRAIN_M <= 5.25 - BODY.half_width_m < found.left_m[-1] + GRAIN_M
    assert found.slope == pytest.approx(0.1 * np.arange(-8, 9))


@pytest.mark.parametrize(
    ("slope", "both"), [(0.05, (8, 9)), (-0.05, (7, 8)), (0.1, (9,)), (0.0, (8,)), (2.0, (16,)), (-2.0, (0,))]
)
def test_the_vehicles_own_direction_lies_between_two_slopes(slope, both):
    assert lattice(start=replace(START, slope=slope)).start[1] == both


@pytest.mark.parametrize("left", [-3.0, 7.0])
def test_who_stands_off_the_road_has_nodes_up_to_there(left):
    found = lattice(start=replace(START, left_m=left))
    assert found.left_m[found.start[0]] == pytest.approx(left)
    assert found.start[0] == (0 if left < 0.0 else len(found.left_m) - 1)


@pytest.mark.parametrize("bend", [0.0, 1.0 / 20.0, -1.0 / 20.0, 0.2, -0.2, 0.25, -0.25])
def test_the_change_of_slope_is_what_can_be_steered_less_the_bend_of_the_line(bend):
    """From −0.16 − κ to 0.16 − κ per metre, times 1.5 m, in steps of 0.1; going on as before is always one of them."""
    a = np.linspace(-10.0, 60.0, 1400)
    points = np.stack((a, np.zeros_like(a)), axis=-1)
    if bend:
        points = np.stack((np.sin(a * bend) / bend, (1.0 - np.cos(a * bend)) / bend), axis=-1)
    found = lattice(curve=Curve.through(points))
    low = min(int(np.ceil((-SHARPEST_1PM - bend) * 15.0)), 0)
    high = max(int(np.floor((SHARPEST_1PM - bend) * 15.0)), 0)
    assert set(found.turns[3:-3]) == {range(low, high + 1)}


def test_prices_are_of_the_shoulder_the_opposite_lane_and_the_distance_from_the_middle():
    space = road(right=-4.25, driving=-1.75, left=5.25, opposite=8.75)
    found = lattice(space)
    share, half = CONFIG.station_m / CONFIG.horizon_m, BODY.half_width_m
    for near, shoulder, beyond in (
        (-0.65, 0, 0.0),
        (-0.8, 1, 0.0),
        (1.75, 0, 0.0),
        (4.1, 0, 0.0),
        (4.3, 0, 0.2),
        (4.7, 0, None),
        (6.5, 0, 1.0),
        (-2.9, 1, 0.0),
    ):
        row = index_of(found.left_m, near)
        left = found.left_m[row]
        opposite = left + half - 5.25 if beyond is None else beyond
        aside = CONFIG.offset_cost * min(abs(left - 1.75), 4.0)
        expected = share * (CONFIG.shoulder_cost_m * shoulder + CONFIG.opposite_cost_m * opposite) + aside
        assert found.price[:, row] == pytest.approx(expected), left


@pytest.mark.parametrize("turn", TURNS)
def test_the_clearance_of_a_node_is_that_of_the_body_whose_rear_axle_is_there(turn):
    others = cars(turn, (14.0, 2.6, 0.2), (21.0, -0.4, -0.3), (9.0, 4.2, np.pi))
    found = lattice(obstacles=others, turn=turn)
    for station, left, slope in ((3, 0.2, 0.1), (4, 1.1, -0.2), (7, -0.4, 0.3), (9, 2.0, 0.0), (11, 1.0, 0.4)):
        row, column = index_of(found.left_m, left), index_of(found.slope, slope)
        for half_way, nodes in ((0.0, found.clearance_m), (0.5, found.between_m)):
            yaw = turn + np.arctan(found.slope[column])
            ahead = CONFIG.station_m * (station + half_way)
            rear = ahead * np.array([np.cos(turn), np.sin(turn)])
            rear += found.left_m[row] * np.array([-np.sin(turn), np.cos(turn)])
            x, y = rear + REAR_M * np.array([np.cos(yaw), np.sin(yaw)])
            gap = separations_m(np.array(x), np.array(y), np.array(yaw), BODY, others).min()
            assert nodes[station, row, column] == pytest.approx(gap, abs=1e-6)


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(("aside", "present"), [(0.25, 0.25), (-0.25, 0.25), (0.35, np.inf), (-0.35, np.inf)])
def test_who_is_nearer_than_0_3_m_at_the_start_is_noted(turn, aside, present):
    """The vehicle stands straight at the line's beginning; the other is alongside."""
    start = replace(START, left_m=0.0, slope=0.0)
    left = np.sign(aside) * (BODY.half_width_m + 0.9 + abs(aside))
    found = lattice(start=start, obstacles=cars(turn, (REAR_M + 0.5, left, 0.0)), turn=turn)
    assert found.present_m.tolist() == pytest.approx([present])


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("slope", [-3, 0, 3])
def test_the_wheels_stay_within_the_road_and_an_overhang(side, slope):
    """At an angle the front wheels are farther to one side by the wheelbase times its sine."""
    start = replace(START, left_m=0.0, slope=0.0)
    found = lattice(road(middle=0.0, right=-4.0, left=4.0, opposite=4.0, driving=-4.0), start)
    angle = np.arctan(0.1 * slope)
    wheels = BODY.half_width_m * np.cos(angle) + max(side * WHEELBASE_M * np.sin(angle), 0.0)
    beyond = side * found.left_m > 0.0
    clear = found.clearance_m[5, beyond, len(found.slope) // 2 + slope] > 0.0
    on_road = side * found.left_m[beyond] + wheels <= 4.0 + CONFIG.edge_overhang_m
    assert clear.tolist() == on_road.tolist()
    assert slope * side < 3 or not on_road.all()


@pytest.mark.parametrize("side", [1, -1])
def test_who_stands_over_the_edge_may_stay_as_far_over_it(side):
    """The left edge that counts is that of the opposite lane."""
    start = replace(START, left_m=side * 3.6, slope=0.0)
    found = lattice(road(middle=0.0, right=-4.0, left=2.0, opposite=4.0, driving=-4.0), start)
    assert 3.6 + BODY.half_width_m - 4.0 > CONFIG.edge_overhang_m
    clear = found.clearance_m[6, :, len(found.slope) // 2] > 0.0
    assert clear[found.start[0]]
    over = side * found.left_m > 3.6 + 1e-9
    assert not clear[over].any()
    assert clear[~over & (side * found.left_m > 0.0)].all()
