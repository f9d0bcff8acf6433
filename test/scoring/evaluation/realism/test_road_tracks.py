"""Ordinary traffic without a map: closed-form gaps, headways, starts, stops, and queues that discharge."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.scoring.evaluation.realism import road_tracks
from siren_ros.scoring.evaluation.realism.road_tracks import RoadTracks

LENGTH_M, WIDTH_M = 4.0, 1.8


def lane(*arcs: np.ndarray, turned_rad: float = 0.0, every_s: float = 0.1, last_m: float = LENGTH_M) -> RoadTracks:
    """Cars in one straight lane, at arc lengths of their middles over time; the length of the last one may differ."""
    ids = np.repeat(np.arange(len(arcs)), [len(arc) for arc in arcs]).astype(float)
    along = np.concatenate(arcs)
    time_s = np.concatenate([every_s * np.arange(len(arc)) for arc in arcs])
    place = along * np.cos(turned_rad), along * np.sin(turned_rad), np.full(len(along), turned_rad)
    return RoadTracks.of_columns(
        ids, time_s, *place, np.where(ids < ids[-1], LENGTH_M, last_m), np.full(len(along), WIDTH_M)
    )


def stands(at_m: float, frames: int = 60) -> np.ndarray:
    return np.full(frames, at_m)


def drives(from_m: float, speed_mps: float, frames: int = 60) -> np.ndarray:
    return from_m + 0.1 * speed_mps * np.arange(frames)


@given(st.floats(-np.pi, np.pi))
def test_gap_of_standing_cars_is_between_their_bodies_in_any_direction(turned_rad: float) -> None:
    tracks = lane(stands(0.0), stands(LENGTH_M + 1.7), stands(2 * LENGTH_M + 1.7 + 2.4), turned_rad=turned_rad)
    assert sorted(road_tracks.standing_gaps_m(tracks)) == pytest.approx([1.7, 2.4])


def test_cars_far_apart_or_moving_or_side_by_side_are_no_queue() -> None:
    far, moving = lane(stands(0.0), stands(14.0)), lane(drives(0.0, 3.0), drives(6.0, 3.0))
    beside = lane(stands(0.0), stands(6.0))
    other_lane = RoadTracks.of_columns(
        *(beside.track_id, beside.time_s, beside.x_m, np.where(beside.track_id == 1, 3.2, 0.0), beside.yaw_rad),
        *(beside.length_m, beside.width_m),
    )
    for tracks in (far, moving, other_lane):
        assert len(road_tracks.standing_gaps_m(tracks)) == 0


def test_headway_is_front_to_front_once_a_second_and_only_of_followers() -> None:
    tracks = lane(drives(0.0, 10.0), drives(20.0, 10.0), last_m=8.0)
    headways = road_tracks.following_headways_s(tracks)
    assert headways == pytest.approx(np.full(6, 2.2))
    assert road_tracks.following_gaps_m(tracks) == pytest.approx(np.full(6, 14.0))
    assert len(road_tracks.following_headways_s(lane(drives(0.0, 10.0), drives(18.0, 12.0)))) == 0
    assert len(road_tracks.following_headways_s(lane(drives(0.0, 2.0), drives(8.0, 2.0)))) == 0


def test_lag_is_the_time_until_somebody_comes_across_the_same_place() -> None:
    along = drives(-30.0, 10.0)
    for lag_s, expected in ((2.0, [2.0]), (-3.0, [3.0]), (14.0, [])):
        other = RoadTracks.of_columns(
            np.repeat([0.0, 1.0], 60),
            np.concatenate((0.1 * np.arange(60), 0.1 * np.arange(60) + lag_s)),
            *(np.concatenate((along, np.zeros(60))), np.concatenate((np.zeros(60), along))),
            *(np.repeat([0.0, 0.5 * np.pi], 60), np.full(120, LENGTH_M), np.full(120, WIDTH_M)),
        )
        assert road_tracks.crossing_lags_s(other) == pytest.approx(expected, abs=0.21)
    assert len(road_tracks.crossing_lags_s(lane(drives(0.0, 10.0), drives(18.0, 10.0)))) == 0


def test_changes_of_speed_are_those_of_whole_seconds() -> None:
    time_s = 0.1 * np.arange(100)
    steady, speeding_up = lane(drives(0.0, 10.0, 100)), lane(5.0 * time_s + 0.5 * 1.5 * time_s**2)
    assert road_tracks.changes_of_speed(steady, 1) == pytest.approx(np.zeros(9), abs=1e-9)
    assert road_tracks.changes_of_speed(speeding_up, 1)[1:-1] == pytest.approx(np.full(7, 1.5))
    assert road_tracks.changes_of_speed(speeding_up, 2)[1:-1] == pytest.approx(np.zeros(6), abs=1e-9)
    assert len(road_tracks.changes_of_speed(lane(stands(0.0)), 1)) == 0
    mixed = lane(drives(0.0, 10.0), stands(50.0), drives(90.0, 7.0, 9), drives(200.0, 5.0, 9))
    assert road_tracks.moving_speeds_mps(mixed) == pytest.approx([10.0] * 6 + [7.0, 5.0])


def test_start_and_stop_are_mean_accelerations_between_1_and_6_mps() -> None:
    time_s = 0.1 * np.arange(100)
    start = np.concatenate((np.zeros(20), 0.5 * 2.0 * time_s**2))
    tracks = lane(start)
    assert road_tracks.starts_mps2(tracks) == pytest.approx([2.0], abs=0.02)
    assert len(road_tracks.stops_mps2(tracks)) == 0
    assert road_tracks.stops_mps2(lane(-start[::-1])) == pytest.approx([2.0], abs=0.02)
    slow = np.minimum(0.2 * np.arange(100), 5.0)
    assert len(road_tracks.starts_mps2(lane(np.cumsum(0.1 * slow)))) == 0, "it ends below 6 m/s"
    again = np.concatenate((0.2 * np.arange(40), np.full(20, 4.0), np.full(20, 8.0)))
    assert road_tracks.starts_mps2(lane(np.cumsum(0.1 * again))) == pytest.approx([2.0], abs=0.05), "it never stopped"


def test_queue_discharges_from_the_fourth_vehicle_on() -> None:
    """Five vehicles with gaps of 2 m start one after the other by 2 s, and drive at 6 m/s at once.

    The last one is 10 m long. It comes nearer at 0.5 m/s just before the first one starts.
    """
    arcs = []
    for place in range(5):
        waits, at_m = 60 + 20 * place, -6.0 * place - 3.0 * (place == 4)
        arcs.append(np.concatenate((np.full(waits, at_m), at_m + 0.6 * np.arange(250 - waits))))
    arcs[4][:60] -= 0.05 * np.minimum(np.arange(60, 0, -1), 20)
    tracks = lane(*arcs, last_m=10.0)
    headways = road_tracks.discharge_headways_s(tracks)
    assert headways == pytest.approx([3.0, 3.0], abs=0.05)  # 2 s later, and 6 m more at 6 m/s
    # the fourth one waits until 12 s, and passes the place at 15 s
    for middle_s, hole_s, seen in ((15.0, 0.8, 2), (15.0, 1.4, 0), (10.0, 1.4, 0), (18.0, 1.4, 2)):
        hidden = (tracks.track_id == 3) & (np.abs(tracks.time_s - middle_s) < 0.5 * hole_s)
        assert len(road_tracks.discharge_headways_s(tracks.select(~hidden))) == seen, (middle_s, hole_s)


@pytest.mark.parametrize(("speed_mps", "counts"), [(3.5, True), (2.5, False)])
def test_vehicles_that_pass_the_place_slowly_do_not_discharge(speed_mps: float, counts: bool) -> None:
    """Five vehicles as at a stop sign: each comes to the place at this speed and goes on as slowly, 4 s apart."""
    rolls = [
        np.concatenate((np.full(20 + 40 * k, -6.0 * k), -6.0 * k + 0.1 * speed_mps * np.arange(380 - 40 * k)))
        for k in range(5)
    ]
    assert len(road_tracks.discharge_headways_s(lane(*rolls))) == (2 if counts else 0)


def test_speed_of_a_noisy_track_is_that_of_its_way_in_a_second() -> None:
    rng = np.random.default_rng(0)
    tracks = lane(drives(0.0, 8.0, 100) + rng.normal(scale=0.05, size=100))
    assert np.abs(tracks.speed_mps[10:-10] - 8.0).max() < 0.4


def test_states_without_a_pose_are_left_out_and_vehicles_stay_apart() -> None:
    nan = float("nan")
    tracks = RoadTracks.of_columns(
        np.array([2.0, 1.0, 1.0, 2.0]),
        np.array([0.1, 0.0, 0.1, 0.0]),
        *(np.array([5.0, 0.0, nan, 4.0]), np.zeros(4), np.zeros(4), np.full(4, 4.0), np.full(4, 2.0)),
    )
    assert [track.track_id.tolist() for track in tracks.each()] == [[1], [2, 2]]
    assert [len(frame) for frame in tracks.frames()] == [2]
