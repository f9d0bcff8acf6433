"""Tracks at 10 Hz and their windows; lanes of poses on the hand-made crossing, and what can follow a lane."""

from dataclasses import replace

import hand_made_record as hand
import numpy as np
import pytest
from evaluation.made_records import moving, record_with

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.data import tracks
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.tracks import REGION, tracks_of, whole_windows
from siren_ros.errors import BagError
from siren_ros.simulation.roads.road_network import NO_LANE, Connection


def record(emv_ahead_m: float = 20.0) -> EpisodeRecord:
    """An EMV and a car in front of it, 41 steps; the car is not recorded at step 20."""
    tracks = {
        1: moving(0.0, 0.0, 10.0, steps=41, is_emv=True),
        5: moving(emv_ahead_m, 0.0, 10.0, accel_mps2=0.5, steps=41, without=frozenset({20})),
    }
    return record_with(tracks, hand.crossing())


def test_every_second_step_is_a_frame():
    emv, car = tracks_of(record())
    assert (emv.actor.is_emv, car.actor.actor_id) == (True, 5)
    assert emv.frame.tolist() == list(range(21))
    assert emv.x_m == pytest.approx(np.arange(21))
    assert car.frame.tolist() == [*range(10), *range(11, 21)]
    time_s = car.frame * 0.1
    assert car.x_m == pytest.approx(20.0 + 10.0 * time_s + 0.25 * time_s**2)
    assert car.speed_mps == pytest.approx(10.0 + 0.5 * time_s)
    assert len(car) == 20


def test_windows_are_whole_and_in_the_population():
    _, car = tracks_of(record())
    assert whole_windows(car, 10, "all").tolist() == [0, 11]
    assert whole_windows(car, 8, "all").tolist() == [0, 1, 2, 11, 12, 13]
    assert whole_windows(car, 21, "all").tolist() == []
    inside = car.frame != 3
    assert whole_windows(replace(car, in_region=inside), 6, REGION).tolist() == [4, 11, 12, 13, 14, 15]
    assert whole_windows(replace(car, in_region=inside), 6, "all").tolist() == [0, 1, 2, 3, 4, 11, 12, 13, 14, 15]
    part = car.window(8, 5)
    assert part.frame.tolist() == [8, 9, 11, 12]
    assert part.x_m == pytest.approx(car.x_m[8:12])


def test_the_region_is_around_the_emv_and_all_are_described():
    near, far = (tracks_of(record(ahead_m))[1] for ahead_m in (20.0, 300.0))
    assert near.in_region.all()
    assert not far.in_region.any()
    whole = record()
    with pytest.raises(BagError, match="5 is not"):
        tracks_of(replace(whole, actors={1: whole.actors[1]}))


NETWORK = hand.crossing()
INDEX = {lane.lane_id: lane.index for lane in NETWORK.lanes}
NORTH = np.pi / 2.0


def place_of(x, y, yaw, hint=NO_LANE):
    places = tracks.locate(NETWORK, np.array([[x, y]]), np.array([yaw]), np.array([hint], dtype=np.int32))
    index = int(places.lane[0])
    return ("" if index == NO_LANE else NETWORK.lanes[index].lane_id), float(places.arc_m[0]), float(places.offset_m[0])


@pytest.mark.parametrize(
    ("x", "y", "yaw", "lane", "arc", "left"),
    [
        (hand.RIGHT_X_M + 0.4, -90.0, NORTH, "s_in_1", 30.0, -0.4),
        (hand.RIGHT_X_M - 0.4, -90.0, NORTH, "s_in_1", 30.0, 0.4),
        (hand.LEFT_X_M, -90.0, NORTH + 1.5, "s_in_2", 30.0, 0.0),
        (hand.SHOULDER_X_M, -40.0, NORTH, "s_in_0", 80.0, 0.0),
        (-1.75 + 0.3, -50.0, -NORTH, "s_out_0", 30.0, 0.3),
        (-60.0, -5.0, 0.0, "w_in_0", 50.0, 0.25),
    ],
)
def test_lane_arc_length_and_offset(x, y, yaw, lane, arc, left):
    assert place_of(x, y, yaw) == (lane, pytest.approx(arc), pytest.approx(left))


@pytest.mark.parametrize(
    ("x", "y", "yaw"), [(hand.RIGHT_X_M, -90.0, -NORTH), (hand.RIGHT_X_M, -90.0, NORTH + 1.6), (60, 60, 0)]
)
def test_against_the_direction_and_off_the_road_is_no_lane(x, y, yaw):
    assert place_of(x, y, yaw)[0] == ""


def test_of_lanes_that_overlap_on_the_junction_sumos_decides_and_else_the_nearest():
    """Where the way straight on and the right turn begin together."""
    x, y = hand.RIGHT_X_M + 0.02, -19.0
    straight, right = NETWORK.connections[0].via[0], NETWORK.connections[3].via[0]
    assert place_of(x, y, NORTH, straight)[0] == NETWORK.lanes[straight].lane_id
    assert place_of(x, y, NORTH, right)[0] == NETWORK.lanes[right].lane_id
    # The rounding of their common end lies in both, and there a lane of the road comes before a path.
    assert place_of(hand.RIGHT_X_M, -20.0, NORTH)[0] == "s_in_1"


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
    ahead = tracks.lanes_ahead(NETWORK, INDEX[lane], reach)
    assert {NETWORK.lanes[index].lane_id for index in ahead} == names


def test_a_way_that_is_too_far_hides_no_nearer_one():
    """To the right the road is 200 m long; straight on, 130 m ahead, another lane begins."""
    lanes = list(NETWORK.lanes)
    right = INDEX["e_out_1"]
    lanes[right] = replace(lanes[right], centre=Polyline.through([(20.0, -5.25), (220.0, -5.25)]))
    onward = Connection(INDEX["n_out_0"], INDEX["w_in_0"], (), "s", None, -1, must_stop=False, junction="n_out")
    network = replace(NETWORK, lanes=tuple(lanes), connections=(*NETWORK.connections, onward))
    assert INDEX["w_in_0"] in tracks.lanes_ahead(network, INDEX["s_in_1"], 150.0)
    assert INDEX["w_in_0"] not in tracks.lanes_ahead(network, INDEX["s_in_1"], 120.0)


def test_sumos_lane_is_that_of_the_actor_and_the_step():
    """The rows are sorted by actor, SUMO's states by step; one actor is unknown to SUMO, one step has no state."""
    driven = {
        hand.EMV: hand.Driven(hand.NORTHBOUND, hand.at_speed(10.0, 5.0, 6)),
        2: hand.Driven(hand.EASTBOUND, hand.at_speed(10.0, 5.0, 4), first_step=2),
        4: hand.Driven(hand.SOUTHBOUND, hand.at_speed(10.0, 5.0, 6)),
    }
    record = hand.hand_made(NETWORK, driven)
    traffic = tuple(
        replace(
            state,
            actor_id=np.array([hand.EMV, 2] if state.step >= 2 else [hand.EMV], np.uint32),
            lane=np.array([10 + state.step, 20 + state.step] if state.step >= 2 else [10 + state.step], np.int32),
        )
        for state in record.traffic
        if state.step != 4
    )
    lanes = tracks.sumo_lanes(replace(record, traffic=traffic), record.rows)
    assert lanes.tolist() == [10, 11, 12, 13, NO_LANE, 15, 22, 23, NO_LANE, 25, *[NO_LANE] * 6]


def rows_at(x_m, y_m, yaw_rad, first_step=0):
    """The rows of a vehicle with these poses."""
    count = len(np.atleast_1d(x_m))
    record = hand.hand_made(
        hand.crossing(),
        {hand.EMV: hand.Driven(hand.NORTHBOUND, hand.at_speed(0.0, 1.0, count + 1), first_step=first_step)},
    )
    values = np.broadcast_arrays(*(np.atleast_1d(np.asarray(value, dtype=float)) for value in (x_m, y_m, yaw_rad)))
    return replace(
        record.track(hand.EMV).select(np.arange(count)), **dict(zip(("x_m", "y_m", "yaw_rad"), values, strict=True))
    )


@pytest.mark.parametrize("yaw", np.radians([0.0, 30.0, 60.0, 135.0, -120.0]))
def test_ahead_and_left_in_the_axes_of_a_vehicle_that_points_anywhere(yaw):
    ahead, left = 7.0, 2.0
    x = 10.0 + ahead * np.cos(yaw) - left * np.sin(yaw)
    y = -4.0 + ahead * np.sin(yaw) + left * np.cos(yaw)
    offsets_m = tracks.ahead_and_left_m(rows_at(10.0, -4.0, yaw), rows_at(x, y, yaw + 1.0))
    assert (offsets_m[0][0], offsets_m[1][0]) == pytest.approx((ahead, left))


@pytest.mark.parametrize(("turned", "same"), [(0.0, True), (0.98, True), (-0.98, True), (1.02, False), (-1.02, False)])
@pytest.mark.parametrize("yaw", [0.0, 3.0, -3.0])
def test_the_same_direction_is_within_60_degrees_on_both_sides_and_across_pi(turned, same, yaw):
    other = rows_at(0.0, 0.0, np.remainder(yaw + turned * tracks.ALIGNED_RAD + np.pi, 2.0 * np.pi) - np.pi)
    assert tracks.in_same_direction(rows_at(0.0, 0.0, yaw), other).tolist() == [same]
    assert np.degrees(tracks.ALIGNED_RAD) == pytest.approx(60.0)


def test_common_rows_are_those_of_the_steps_that_both_have():
    first, second = rows_at(np.arange(6.0), 0.0, 0.0), rows_at(np.arange(5.0), 1.0, 0.0, first_step=3)
    of_first, of_second = tracks.common_rows(first, second)
    assert of_first.step.tolist() == of_second.step.tolist() == [3, 4, 5]
    assert of_first.x_m.tolist() == [3.0, 4.0, 5.0]
    assert of_second.x_m.tolist() == [0.0, 1.0, 2.0]
