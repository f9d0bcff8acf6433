"""Ways over a junction: the steps at which front, centre and rear cross its lines."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import (
    BESIDE,
    CAR_LENGTH_M,
    EAST,
    EASTBOUND,
    EMV,
    EMV_LENGTH_M,
    LEFT_X_M,
    NORTHBOUND,
    ON_SHOULDER,
    PARALLEL,
    RIGHT_X_M,
    SHOULDER_RIGHT,
    SOUTH,
    SOUTHBOUND,
    STRAIGHT,
    STRAIGHT_LEFT,
    Driven,
    at_speed,
    crossing,
    hand_made,
    line,
)

from siren_ros.base.numerics.units import STEP_S
from siren_ros.scoring.judging.traversals import Traversal, find_traversals

NETWORK = crossing()
SPEED_MPS, START_M = 10.0, 70.0


def _step_at(arc_m: float, start_m: float = START_M, speed_mps: float = SPEED_MPS) -> int:
    """First step at or beyond an arc length."""
    return int(np.ceil(round((arc_m - start_m) / (speed_mps * STEP_S), 6)))


def _traversal_of(points: np.ndarray, steps: int = 220, start_m: float = START_M) -> Traversal:
    (traversal,) = find_traversals(hand_made(NETWORK, {EMV: Driven(points, at_speed(start_m, SPEED_MPS, steps))}))
    return traversal


def test_front_centre_and_rear_cross_the_lines_where_the_poses_put_them():
    traversal = _traversal_of(NORTHBOUND)
    assert traversal.connection == STRAIGHT
    assert traversal.enter_step == _step_at(100.0 - EMV_LENGTH_M / 2.0)
    assert traversal.centre_steps == (_step_at(100.0), _step_at(130.0))
    assert traversal.leave_step == _step_at(130.0 + EMV_LENGTH_M / 2.0)
    assert traversal.enter_speed_mps == pytest.approx(SPEED_MPS)
    assert (traversal.approach_step, traversal.exit_step) == (0, 220)


@pytest.mark.parametrize(
    ("points", "movement"), [(EASTBOUND, EAST), (SOUTHBOUND, SOUTH), (PARALLEL, BESIDE), (ON_SHOULDER, SHOULDER_RIGHT)]
)
def test_the_movement_is_that_of_the_edges_and_the_path(points, movement):
    assert _traversal_of(points).connection == movement


def test_on_the_wrong_side_of_the_road_the_lines_are_the_same():
    """From the approach lane into the opposite one 30 m before the line, back on the exit."""
    weaving = line(
        (RIGHT_X_M, -120.0), (RIGHT_X_M, -60.0), (-1.75, -50.0), (-1.75, 20.0), (RIGHT_X_M, 30.0), (5.25, 110)
    )
    traversal = _traversal_of(weaving, start_m=40.0, steps=300)
    detour_m = 2.0 * (np.hypot(10.0, 7.0) - 10.0)
    assert traversal.connection == STRAIGHT_LEFT
    assert traversal.enter_step == _step_at(100.0 - EMV_LENGTH_M / 2.0 + detour_m / 2.0, 40.0)
    assert traversal.leave_step == _step_at(130.0 + EMV_LENGTH_M / 2.0 + detour_m / 2.0, 40.0)
    assert traversal.centre_steps == (_step_at(100.0 + detour_m / 2.0, 40.0), _step_at(130.0 + detour_m / 2.0, 40.0))


def test_a_vehicle_that_turns_round_is_on_its_exit_only_when_it_heads_along_it():
    """The exit lane lies beside the approach lane: front and rear pass its beginning on the way in, too."""
    turn = replace(NETWORK.connections[SOUTH], from_lane=NETWORK.connections[STRAIGHT_LEFT].from_lane, via=())
    network = replace(NETWORK, connections=(*NETWORK.connections, turn))
    there_and_back = line((LEFT_X_M, -120.0), (LEFT_X_M, -10.0), (-1.75, -10.0), (-1.75, -120.0))
    driven = Driven(there_and_back, at_speed(START_M, SPEED_MPS, 200))
    (traversal,) = find_traversals(hand_made(network, {EMV: driven}))
    across_m = 10.0 + 3.5 + 10.0
    assert traversal.connection == len(NETWORK.connections)
    assert traversal.centre_steps == (_step_at(100.0), _step_at(100.0 + across_m))
    assert traversal.leave_step == _step_at(100.0 + across_m + EMV_LENGTH_M / 2.0)


def test_who_starts_beyond_the_line_or_stops_before_it_has_no_traversal():
    beyond = Driven(NORTHBOUND, at_speed(99.0, SPEED_MPS, 100))
    before = Driven(EASTBOUND, np.minimum(at_speed(70.0, SPEED_MPS, 100), 100.0 - CAR_LENGTH_M / 2.0 - 0.1))
    assert find_traversals(hand_made(NETWORK, {EMV: beyond, 2: before})) == ()


def test_meeting_means_the_others_centre_inside_between_front_and_rear():
    traversal = Traversal(1, STRAIGHT, 50, 10.0, 100, (55, 95), 0, 200)
    other = replace(traversal, actor_id=2, enter_step=0, leave_step=300)
    meets = {(40, 50): False, (40, 51): True, (60, 70): True, (99, 120): True, (100, 120): False, (70, 70): False}
    assert {steps: traversal.meets(replace(other, centre_steps=steps)) for steps in meets} == meets


@pytest.mark.parametrize(("beyond", "count"), [(-1, 0), (0, 0), (1, 1), (2, 1)])
def test_a_record_that_ends_at_the_line_has_a_traversal_from_the_first_step_with_the_centre_inside(beyond, count):
    """The front has been over the line for six steps already."""
    first_inside = _step_at(100.05)
    arc_m = at_speed(START_M, SPEED_MPS, first_inside + beyond)
    traversals = find_traversals(hand_made(NETWORK, {EMV: Driven(NORTHBOUND, arc_m)}))
    assert [item.connection for item in traversals] == [STRAIGHT] * count
    for traversal in traversals:
        assert traversal.enter_step == _step_at(100.0 - EMV_LENGTH_M / 2.0)
        assert traversal.leave_step == first_inside + beyond


@pytest.mark.parametrize("steps_after", [-3, -2, -1, 0, 1, 2])
def test_a_record_that_ends_as_the_rear_reaches_the_exit_has_the_step_of_its_rear_or_of_its_end(steps_after):
    """The centre is on the exit lane for six steps before."""
    reaches = _step_at(130.0 + EMV_LENGTH_M / 2.0)
    traversal = _traversal_of(NORTHBOUND, steps=reaches + steps_after)
    assert traversal.leave_step == min(reaches, reaches + steps_after)
    assert traversal.exit_step == reaches + steps_after
    assert traversal.centre_steps == (_step_at(100.0), _step_at(130.0))


def test_the_last_time_over_the_line_counts():
    """The front is 1 m over the line, the vehicle is put back by 30 m, and then it drives across."""
    there, back = np.full(20, 98.0), at_speed(68.0, SPEED_MPS, 200)
    (traversal,) = find_traversals(hand_made(NETWORK, {EMV: Driven(NORTHBOUND, np.concatenate((there, back)))}))
    assert traversal.enter_step == 20 + _step_at(100.0 - EMV_LENGTH_M / 2.0, 68.0)
    assert traversal.approach_step == 0


def test_vehicles_and_their_junctions_come_by_actor_and_then_by_time():
    """The second vehicle starts later; ids are not in the order of arrival."""
    vehicles = {
        EMV: Driven(NORTHBOUND, at_speed(70.0, SPEED_MPS, 150)),
        7: Driven(EASTBOUND, at_speed(70.0, SPEED_MPS, 150), first_step=10),
        3: Driven(SOUTHBOUND, at_speed(60.0, SPEED_MPS, 150), first_step=30),
    }
    traversals = find_traversals(hand_made(NETWORK, vehicles))
    assert [(item.actor_id, item.connection) for item in traversals] == [(EMV, STRAIGHT), (3, SOUTH), (7, EAST)]
    assert [item.approach_step for item in traversals] == [0, 30, 10]
    half = CAR_LENGTH_M / 2.0
    assert [item.enter_step for item in traversals[1:]] == [
        30 + _step_at(100.0 - half, 60.0),
        10 + _step_at(100.0 - half),
    ]
    assert [item.exit_step for item in traversals] == [150, 180, 160]


def test_who_starts_with_a_single_step_before_the_stretch_at_the_line_has_a_traversal():
    """The search for the line begins 8 m before it; the first step is 8.1 m before it."""
    traversal = _traversal_of(NORTHBOUND, start_m=91.9, steps=160)
    assert traversal.enter_step == _step_at(100.0 - EMV_LENGTH_M / 2.0, 91.9)
    assert traversal.approach_step == 0
