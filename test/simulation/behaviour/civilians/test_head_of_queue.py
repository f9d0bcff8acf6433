"""Drivers at the head of a queue make room into the hand-made crossing; its stop line is at y = −20 m."""

from dataclasses import replace

import numpy as np
import pytest
from behaviour.civilians.civilian_steps import NEAR, UNIT
from hand_made_record import EAST, LEFT_X_M, STOP_LINE_Y_M, STRAIGHT, STRAIGHT_LEFT, crossing

from siren_ros.simulation.behaviour.civilians.pull_over import edge_offset_m, hold, pull_over, pull_over_path
from siren_ros.simulation.behaviour.civilians.yield_lane_change import (
    approach_lane_of,
    is_over_red_line,
    may_cross,
    on_junction,
)
from siren_ros.simulation.behaviour.driving.navigator import NavigatorState
from siren_ros.simulation.world.actors import ActorClass, Mode, SignalState

NETWORK = crossing()
ROUTE = tuple(NETWORK.edge_by_id[name].index for name in ("s_in", "n_out"))
WAITED = replace(UNIT, side=1, emv_waits_steps=30)
LEFT_LANE = NETWORK.lane_by_id["s_in_2"].index
INSIDE = NETWORK.connections[STRAIGHT_LEFT].via[0]
CROSSING_M = 14.75 - 0.5 * 3.5
"""From the stop line to the way of those who go east."""


def lights(own="r", east="G"):
    state = ["r"] * 7
    state[STRAIGHT] = state[STRAIGHT_LEFT] = own
    state[EAST] = east
    return (SignalState("J", "".join(state)),)


def head(lab, front_m, signals, speed=0.0, x_m=LEFT_X_M, comes=(5.0, 8.0)):
    """The driver in the left lane, its front that far beyond the stop line, and half its length.

    ``comes`` is how far before its line a car from the west is, and how fast.
    """
    half = 0.5 * lab.vehicles[ActorClass.SEDAN].length_m
    before_m, other_mps = comes
    east = tuple(NETWORK.edge_by_id[name].index for name in ("w_in", "e_out"))
    cars = [lab.Car(2, LEFT_LANE, 90.0, speed, ROUTE), lab.Car(3, NETWORK.edges[east[0]].lanes[0], 90.0, 0.0, east)]
    other_x_m, y_m = -10.0 - before_m - half, STOP_LINE_Y_M + front_m - half
    poses = [[x_m, y_m, np.pi / 2.0, speed], [other_x_m, -5.25, 0.0, other_mps]]
    traffic = replace(lab.traffic_of(NETWORK, cars, poses=np.array(poses)), signals=signals)
    return lab.view_of(lab.world_of(NETWORK, lab.L3), traffic).ego(0), half


def front_at_end_m(path, half):
    """Of a vehicle at the end of its path, beyond the stop line."""
    return path.curve.points[-1, 1] + half - STOP_LINE_Y_M


def test_at_red_the_driver_goes_as_far_as_the_move_needs_and_stays_clear_of_crossing_traffic(lab):
    ego, half = head(lab, -1.0, lights())
    first = front_at_end_m(pull_over_path(WAITED, ego, LEFT_LANE), half)
    assert 8.0 < first < CROSSING_M
    ego, half = head(lab, 8.5, lights())
    further = front_at_end_m(pull_over_path(WAITED, ego, INSIDE), half)
    assert first + 1.0 < further < CROSSING_M
    ego, _ = head(lab, 11.5, lights())
    assert pull_over_path(WAITED, ego, INSIDE) is None, "no room is left"


def with_way_east_nearer(lab, ego):
    """The driver where the way east is 9 m nearer to its line."""
    lane = NETWORK.lanes[NETWORK.connections[EAST].via[0]]
    nearer = replace(lane, centre=type(lane.centre).through(lane.centre.points - (0.0, 9.0)))
    lanes = tuple(nearer if item.index == lane.index else item for item in NETWORK.lanes)
    return lab.view_of(replace(ego.world, network=replace(NETWORK, lanes=lanes)), ego.traffic).ego(0)


@pytest.mark.parametrize(("comes", "crosses"), [((0.5, 0.0), True), ((16.5, 8.0), True), ((15.5, 8.0), False)])
def test_where_there_is_little_space_the_head_crosses_at_red_while_others_stand_or_can_stop(lab, comes, crosses):
    """From 8 m/s a gentle stop takes 16 m. Without an EMV that waits the head stays near the line."""
    ego, half = head(lab, -1.0, lights(), comes=comes)
    near = with_way_east_nearer(lab, ego)
    front_m = front_at_end_m(pull_over_path(WAITED, near, LEFT_LANE), half)
    assert front_m > 30.0 if crosses else 1.0 < front_m < CROSSING_M - 9.0
    assert front_at_end_m(pull_over_path(replace(UNIT, side=1), near, LEFT_LANE), half) < CROSSING_M - 9.0
    assert front_at_end_m(pull_over_path(WAITED, ego, LEFT_LANE), half) < CROSSING_M, "there is space before the way"


@pytest.mark.parametrize("front_m", [-1.0, 5.0])
def test_at_green_the_driver_crosses_and_leaves_the_junction_free(lab, front_m):
    ego, half = head(lab, front_m, lights("G", "r"))
    path = pull_over_path(WAITED, ego, LEFT_LANE if front_m < half else INSIDE)
    assert front_at_end_m(path, half) > 30.0 + 2.0 * half


def test_who_is_in_the_way_of_others_crosses_at_red_too(lab):
    ego, _ = head(lab, 11.0, lights())
    movement = NETWORK.connections[STRAIGHT_LEFT]
    assert [may_cross(ego, movement, front_m) for front_m in (0.0, 11.0, 17.0)] == [False, False, True]
    assert may_cross(head(lab, 0.0, lights("G"))[0], movement, 0.0)
    assert not may_cross(head(lab, 0.0, lights("y"))[0], movement, 0.0)


def test_who_crosses_holds_beyond_the_junction_only(lab):
    """At the lane's edge and aligned all the way, with an EMV that has begun to move again."""
    begin, half = head(lab, -1.0, lights("G", "r"))
    path = pull_over_path(WAITED, begin, LEFT_LANE)
    unit = replace(UNIT, side=1, phase=Mode.YIELD_PULL_OVER)
    edge_m = edge_offset_m(begin, LEFT_LANE, 1)
    held = {}
    for front_m in (10.0, 20.0, 30.0 + 2.0 * half + 2.0):
        ego, _ = head(lab, front_m, lights("G", "r"), 2.0, LEFT_X_M - edge_m)
        driven = replace(unit, navigator=NavigatorState().following(path, *ego.place))
        held[front_m] = pull_over(driven, ego, NEAR).unit.phase is Mode.YIELD_HOLD
    assert list(held.values()) == [False, False, True]


def test_a_light_that_turns_red_before_the_line_ends_the_crossing(lab):
    begin, half = head(lab, -8.0, lights("G", "r"))
    path = pull_over_path(WAITED, begin, LEFT_LANE)
    ego, _ = head(lab, -6.0, lights("r"), 2.0)
    driven = replace(WAITED, phase=Mode.YIELD_PULL_OVER, navigator=NavigatorState().following(path, *ego.place))
    planned = pull_over(driven, ego, NEAR).unit.navigator.path
    assert front_at_end_m(path, half) > 30.0
    assert front_at_end_m(planned, half) < CROSSING_M


def test_on_a_junction_what_lies_beside_the_lane_before_it_counts(lab):
    """In the left lane there is nothing on the left, and the right lane on the right; the same on its way across."""
    ego, _ = head(lab, 5.0, lights())
    assert on_junction(ego, INSIDE)
    assert not on_junction(ego, LEFT_LANE)
    assert approach_lane_of(ego, INSIDE) == LEFT_LANE
    for side in (1, -1):
        assert edge_offset_m(ego, INSIDE, side) == edge_offset_m(ego, LEFT_LANE, side)
    wide = replace(NETWORK.lanes[-1], civilian_allowed=True, width_m=9.0)
    world = replace(ego.world, network=replace(NETWORK, lanes=(*NETWORK.lanes[:-1], wide)))
    assert edge_offset_m(lab.view_of(world, ego.traffic).ego(0), INSIDE, 1) == edge_offset_m(ego, LEFT_LANE, 1)


def test_after_the_yield_who_stands_in_nobodys_way_waits_there_for_green(lab):
    """Also wholly beyond the line: others come from the side."""
    over = {front_m: is_over_red_line(head(lab, front_m, lights())[0]) for front_m in (-0.5, 2.0, 9.0, 17.0, 36.0)}
    assert over == {-0.5: False, 2.0: True, 9.0: True, 17.0: False, 36.0: False}
    assert not is_over_red_line(head(lab, 9.0, lights("G", "r"))[0])


def test_a_hold_whose_emv_has_turned_off_ends_after_a_second(lab):
    ego, _ = head(lab, -5.0, lights())
    unit, gone = replace(UNIT, side=1, navigator=NavigatorState()), replace(NEAR, turned_off=True)
    for _ in range(20):
        outcome = hold(unit, ego, gone)
        assert outcome.unit.phase is Mode.YIELD_HOLD
        unit = outcome.unit
    assert hold(unit, ego, NEAR).unit.off_path_steps == 0
    outcome = hold(unit, ego, gone)
    assert outcome.unit is None or outcome.unit.phase is Mode.REJOIN
    assert outcome.events[0].detail["reason"] == "off_path"
