"""Lanes of poses on the hand-made crossing, and what can follow a lane."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import (
    EASTBOUND,
    EMV,
    LEFT_X_M,
    NORTHBOUND,
    RIGHT_X_M,
    SHOULDER_X_M,
    SOUTHBOUND,
    Driven,
    at_speed,
    crossing,
    hand_made,
)

from siren_ros.judging.lane_location import lanes_ahead, locate, sumo_lanes
from siren_ros.numerics.polyline import Polyline
from siren_ros.roads.road_network import NO_LANE, Connection

NETWORK = crossing()
INDEX = {lane.lane_id: lane.index for lane in NETWORK.lanes}
NORTH = np.pi / 2.0


def place_of(x, y, yaw, hint=NO_LANE):
    found = locate(NETWORK, np.array([[x, y]]), np.array([yaw]), np.array([hint], dtype=np.int32))
    index = int(found.lane[0])
    return ("" if index == NO_LANE else NETWORK.lanes[index].lane_id), float(found.arc_m[0]), float(found.offset_m[0])


@pytest.mark.parametrize(
    ("x", "y", "yaw", "lane", "arc", "left"),
    [
        (RIGHT_X_M + 0.4, -90.0, NORTH, "s_in_1", 30.0, -0.4),
        (RIGHT_X_M - 0.4, -90.0, NORTH, "s_in_1", 30.0, 0.4),
        (LEFT_X_M, -90.0, NORTH + 1.5, "s_in_2", 30.0, 0.0),
        (SHOULDER_X_M, -40.0, NORTH, "s_in_0", 80.0, 0.0),
        (-1.75 + 0.3, -50.0, -NORTH, "s_out_0", 30.0, 0.3),
        (-60.0, -5.0, 0.0, "w_in_0", 50.0, 0.25),
    ],
)
def test_lane_arc_length_and_offset(x, y, yaw, lane, arc, left):
    assert place_of(x, y, yaw) == (lane, pytest.approx(arc), pytest.approx(left))


@pytest.mark.parametrize(("x", "y", "yaw"), [(RIGHT_X_M, -90.0, -NORTH), (RIGHT_X_M, -90.0, NORTH + 1.6), (60, 60, 0)])
def test_against_the_direction_and_off_the_road_is_no_lane(x, y, yaw):
    assert place_of(x, y, yaw)[0] == ""


def test_of_lanes_that_overlap_on_the_junction_sumos_decides_and_else_the_nearest():
    """Where the way straight on and the right turn begin together."""
    x, y = RIGHT_X_M + 0.02, -19.0
    straight, right = NETWORK.connections[0].via[0], NETWORK.connections[3].via[0]
    assert place_of(x, y, NORTH, straight)[0] == NETWORK.lanes[straight].lane_id
    assert place_of(x, y, NORTH, right)[0] == NETWORK.lanes[right].lane_id


def test_a_lane_of_the_road_comes_before_a_path_across_the_junction():
    """Both hold the pose within the rounding of their common end."""
    assert place_of(RIGHT_X_M, -20.0, NORTH)[0] == "s_in_1"


@pytest.mark.parametrize(
    ("lane", "reach", "names"),
    [
        ("s_in_1", 100.0, {"s_in_1", ":J_0_0", "n_out_0", ":J_3_0", "e_out_1"}),
        ("s_in_2", 0.0, {"s_in_2", ":J_1_0", "n_out_1"}),
        (":J_3_0", 50.0, {":J_3_0", "e_out_1"}),
        ("n_out_0", 100.0, {"n_out_0"}),
        ("w_in_0", 10.0, {"w_in_0", ":J_4_0", "e_out_1"}),
    ],
)
def test_what_can_follow_without_a_lane_change(lane, reach, names):
    found = lanes_ahead(NETWORK, INDEX[lane], reach)
    assert {NETWORK.lanes[index].lane_id for index in found} == names


def test_a_way_that_is_too_far_hides_no_nearer_one():
    """To the right the road is 200 m long; straight on, 130 m ahead, another lane begins."""
    lanes = list(NETWORK.lanes)
    right = INDEX["e_out_1"]
    lanes[right] = replace(lanes[right], centre=Polyline.through([(20.0, -5.25), (220.0, -5.25)]))
    onward = Connection(INDEX["n_out_0"], INDEX["w_in_0"], (), "s", None, -1, must_stop=False, junction="n_out")
    network = replace(NETWORK, lanes=tuple(lanes), connections=(*NETWORK.connections, onward))
    assert INDEX["w_in_0"] in lanes_ahead(network, INDEX["s_in_1"], 150.0)
    assert INDEX["w_in_0"] not in lanes_ahead(network, INDEX["s_in_1"], 120.0)


def test_sumos_lane_is_that_of_the_actor_and_the_step():
    """The rows are sorted by actor, SUMO's states by step; one actor is unknown to SUMO, one step has no state."""
    driven = {
        EMV: Driven(NORTHBOUND, at_speed(10.0, 5.0, 6)),
        2: Driven(EASTBOUND, at_speed(10.0, 5.0, 4), first_step=2),
        4: Driven(SOUTHBOUND, at_speed(10.0, 5.0, 6)),
    }
    record = hand_made(NETWORK, driven)
    traffic = tuple(
        replace(
            state,
            actor_id=np.array([EMV, 2] if state.step >= 2 else [EMV], np.uint32),
            lane=np.array([10 + state.step, 20 + state.step] if state.step >= 2 else [10 + state.step], np.int32),
        )
        for state in record.traffic
        if state.step != 4
    )
    found = sumo_lanes(replace(record, traffic=traffic), record.rows)
    assert found.tolist() == [10, 11, 12, 13, NO_LANE, 15, 22, 23, NO_LANE, 25, *[NO_LANE] * 6]
