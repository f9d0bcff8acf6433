"""The way back to the lane: when it is needed, where it leads, and when SUMO takes over."""

from dataclasses import replace

import numpy as np
import pytest
from behaviour.civilians.civilian_steps import UNIT as HOLDING

from siren_ros.simulation.behaviour.civilians.rejoin import LEAST_SIDEWAYS_M, is_over_red_line, rejoin, start_rejoin
from siren_ros.simulation.behaviour.driving.navigator import FULL_BRAKE, NavigatorState
from siren_ros.simulation.behaviour.paths.tracked_path import blend_length_m
from siren_ros.simulation.dynamics.parameters import load_vehicle_parameters
from siren_ros.simulation.world.actors import ActorClass, Mode
from siren_ros.simulation.world.traffic_state import SignalState

UNIT = replace(HOLDING, stopped_steps=30)
NEAR_M = 0.3
"""Offset from the lane's centre line at which a vehicle counts as in its lane."""


def view_at(lab, left, turned=0.0, speed=0.0, turn=0.0, s=100.0, length=400.0, kind=ActorClass.SEDAN):
    """A vehicle beside the centre line of the right one of two lanes that point anywhere."""
    network, along, across = lab.turned_road(turn, length=length)
    poses = np.array([[*(s * along + left * across), turn + turned, speed]])
    return lab.view(network, lab.L3, [lab.Car(2, 0, s, speed, (0,), kind)], poses=poses), along, across


@pytest.mark.parametrize("turn", [0.0, 0.7, -2.2])
@pytest.mark.parametrize(
    ("left", "degrees", "back"),
    [
        *[(0.29, 0.0, True), (-0.29, 0.0, True), (0.31, 0.0, False), (-0.31, 0.0, False)],
        *[(0.0, 7.0, True), (0.0, -7.0, True), (0.0, 9.0, False), (0.0, -9.0, False)],
    ],
)
def test_sumo_takes_over_at_once_who_is_in_the_lane_and_straight(lab, turn, left, degrees, back):
    outcome = start_rejoin(UNIT, view_at(lab, left, np.radians(degrees), turn=turn)[0].ego(0))
    assert (outcome.unit is None) is back
    assert [event.kind.value for event in outcome.events] == (["yield_released"] if back else [])


@pytest.mark.parametrize("turn", [0.0, 0.7, -2.2])
@pytest.mark.parametrize(("left", "side"), [(-0.8, 1), (0.8, -1)])
def test_the_path_leads_to_the_middle_of_the_lane_and_shows_that_side(lab, turn, left, side):
    view, along, across = view_at(lab, left, turn=turn)
    outcome = start_rejoin(UNIT, view.ego(0))
    unit, path = outcome.unit, outcome.unit.navigator.path
    assert (unit.phase, unit.side) == (Mode.REJOIN, side)
    assert unit.stopped_steps == 1, "the count of the hold is not taken over"
    assert path.curve.points[0] == pytest.approx(100.0 * along + left * across)
    assert path.curve.points[-1] @ across == pytest.approx(0.0, abs=1e-6)
    half = float(view.seen.half_length_m[0])
    assert path.curve.points[-1] @ along == pytest.approx(100.0 - 2.0 + 60.0 - half - 1.0, abs=0.01)
    assert path.speed_cap_mps(path.length_m) < 0.1
    assert np.sign(outcome.command.steer_rad) == side
    assert outcome.command.throttle > 0.0


def test_a_long_vehicle_comes_back_on_one_and_a_half_of_its_lengths(lab):
    for kind in (ActorClass.BUS, ActorClass.SEDAN):
        view, *_ = view_at(lab, -0.8, kind=kind)
        path = start_rejoin(UNIT, view.ego(0)).unit.navigator.path
        assert path.settled_m >= 3.0 * float(view.seen.half_length_m[0])


@pytest.mark.parametrize(("room", "left_at_end"), [(30.0, 0.0), (5.0, -0.8)])
def test_too_near_the_end_of_the_lane_it_comes_straight_where_it_is(lab, room, left_at_end):
    view, _, across = view_at(lab, -0.8, np.radians(10.0), s=100.0, length=100.0 + room)
    path = start_rejoin(UNIT, view.ego(0)).unit.navigator.path
    assert path.curve.points[-1] @ across == pytest.approx(left_at_end, abs=1e-6)
    assert np.sin(path.curve.heading_rad[-1]) == pytest.approx(0.0, abs=0.08)


def rejoining(lab, **place):
    view, _, _ = view_at(lab, -0.8, **place)
    return replace(start_rejoin(UNIT, view.ego(0)).unit, stopped_steps=0), view


def steps(unit, view, count):
    for _ in range(count):
        outcome = rejoin(unit, view.ego(0))
        if outcome.unit is None:
            return outcome
        unit = outcome.unit
    return outcome


def test_who_stands_for_two_seconds_is_handed_back_where_it_stands(lab):
    unit, view = rejoining(lab)
    patience = round(view.world.config.civilian_driver.yielding.rejoin_blocked_s / 0.05)
    assert steps(unit, view, patience - 1).unit is not None
    assert steps(unit, view, patience).unit is None


def test_the_two_seconds_begin_again_after_moving(lab):
    unit, view = rejoining(lab)
    moving, _, _ = view_at(lab, -0.8, speed=1.0)
    patience = round(view.world.config.civilian_driver.yielding.rejoin_blocked_s / 0.05)
    unit = steps(unit, view, patience - 1).unit
    unit = steps(unit, moving, 1).unit
    assert unit.stopped_steps == 0
    assert steps(unit, view, patience - 1).unit is not None


def test_who_stands_at_an_angle_is_not_handed_back(lab):
    unit, view = rejoining(lab, turned=np.radians(12.0))
    assert steps(unit, view, 60).unit is not None


def test_at_the_end_of_its_path_and_in_its_lane_a_vehicle_is_handed_back(lab):
    unit, _ = rejoining(lab)
    assert rejoin(unit, view_at(lab, -NEAR_M + 0.02, speed=3.0, s=110.0)[0].ego(0)).unit is None
    beside, _, _ = view_at(lab, -NEAR_M - 0.05, speed=3.0, s=110.0)
    assert rejoin(unit, beside.ego(0)).unit is not None
    at_end = replace(unit.navigator, progress_m=unit.navigator.path.length_m)
    assert rejoin(replace(unit, navigator=at_end), beside.ego(0)).unit is None
    laid_out = rejoin(replace(unit, navigator=NavigatorState()), beside.ego(0)).unit
    assert laid_out.navigator.path is not None, "who has waited at the line gets a path then"


@pytest.mark.parametrize(("left", "speed"), [(-0.8, 0.0), (0.9, 4.0), (-0.5, 9.0)])
def test_the_way_back_is_laid_out_for_the_mean_of_the_present_and_the_wanted_speed(lab, left, speed):
    view, _, _ = view_at(lab, left, speed=speed)
    path = start_rejoin(UNIT, view.ego(0)).unit.navigator.path
    config = view.world.config.civilian_driver.pull_over
    expected = blend_length_m(
        left, 0.5 * (speed + 5.0), config.duration_s, LEAST_SIDEWAYS_M, view.ego(0).navigator_config
    )
    assert path.settled_m == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("spare", "left_at_end"), [(0.1, 0.0), (-0.1, -0.8)])
def test_the_middle_is_left_where_the_move_and_half_a_length_do_not_fit(lab, spare, left_at_end):
    """The way ends where the front is a metre before the end of the lane."""
    view, _, _ = view_at(lab, -0.8)
    half = float(view.seen.half_length_m[0])
    merge = start_rejoin(UNIT, view.ego(0)).unit.navigator.path.settled_m
    view, _, across = view_at(lab, -0.8, s=100.0, length=100.0 + merge + 2.0 * half + 1.0 + spare)
    path = start_rejoin(UNIT, view.ego(0)).unit.navigator.path
    assert path.curve.points[-1] @ across == pytest.approx(left_at_end, abs=0.02)


def over_the_line(lab, over_m, state, speed=0.0):
    """A vehicle at the lane's edge whose front is over the stop line at 150 m."""
    network = lab.junction_road()
    half = 0.5 * load_vehicle_parameters()[ActorClass.SEDAN].length_m
    car = lab.Car(2, 0, 100.0, speed, (0, 2))
    poses = np.array([[150.0 + over_m - half, -0.7, 0.0, speed]])
    traffic = replace(lab.traffic_of(network, [car], poses=poses), signals=(SignalState("J", state),))
    return lab.view_of(lab.world_of(network, lab.L3), traffic), 2.0 * half


@pytest.mark.parametrize("over_m", [0.2, 2.5, 4.3])
def test_who_stands_over_the_line_at_red_stays_there_until_green(lab, over_m):
    red, _ = over_the_line(lab, over_m, "r")
    outcome = start_rejoin(UNIT, red.ego(0))
    for _ in range(400):
        assert outcome.unit.phase is Mode.REJOIN
        assert (outcome.command, outcome.events) == (FULL_BRAKE, ())
        outcome = rejoin(outcome.unit, red.ego(0))
    moved = rejoin(outcome.unit, over_the_line(lab, over_m, "G")[0].ego(0))
    assert moved.unit is None or moved.command.throttle > 0.0, "on at green"


def test_who_is_over_the_line_at_yellow_or_green_does_not_wait(lab):
    for state in "Ggy":
        assert not is_over_red_line(over_the_line(lab, 2.0, state)[0].ego(0))
    assert is_over_red_line(over_the_line(lab, 2.0, "r")[0].ego(0))


def test_only_who_is_over_the_line_waits_there(lab):
    across = {-0.2: False, 0.2: True, 24.8: True, 25.2: False}
    assert {over: is_over_red_line(over_the_line(lab, over, "r")[0].ego(0)) for over in across} == across
    moving = over_the_line(lab, 2.0, "r", speed=1.0)[0].ego(0)
    assert 0.0 < start_rejoin(UNIT, moving).command.brake < 0.5, "who moves brakes as people do"
    assert not is_over_red_line(view_at(lab, -0.7)[0].ego(0)), "no line ahead"
