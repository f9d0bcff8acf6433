"""Predictors without learning: constant motion, motion along the lane, Intelligent Driver Model, Kalman filter."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from busy_record import busy_record
from hypothesis import given
from hypothesis import strategies as st
from known_outputs import assert_known
from made_records import Track, moving, record_with, samples_in
from scenes import batch_of, showing, with_lines, with_signal
from scipy import stats

from siren_ros.data.tracks import locate
from siren_ros.scoring.evaluation.prediction.baselines import (
    ConstantVelocity,
    Idm,
    IdmPredictor,
    halting,
    leaders_of,
    make_ca,
    make_ca_lane,
    make_ctra,
    make_cv_lane,
    make_decay_lane,
    make_decay_stop,
    make_idm_stop,
    paths_from,
    straight_successors,
    turn_rate_of,
)
from siren_ros.scoring.evaluation.prediction.imm import Imm, ImmPredictor
from siren_ros.scoring.evaluation.prediction.predictors import PREDICTORS, is_simple, predictors_named
from siren_ros.scoring.evaluation.prediction.samples import (
    HistoryWindow,
    Population,
    SampleBatch,
    future_times_s,
    samples_of,
)
from siren_ros.simulation.roads.road_network import NO_LANE, Connection, LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import ActorClass

IDM = Idm()


def idm_acceleration(*values: float) -> float:
    """Of a single vehicle: its speed, its desired speed, its gap, and the closing speed."""
    return float(IDM.acceleration(*(np.array([value]) for value in values))[0])


def travelled_by(*values: float, times_s: np.ndarray) -> np.ndarray:
    """Distances of a single vehicle, from its speed, its desired speed, its gap, and its leader's speed."""
    return IDM.travel(*(np.array([value]) for value in values), times_s)[0]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ((0.0, 10.0, np.inf, 0.0), 1.5),
        ((5.0, 10.0, np.inf, 5.0), 1.5 * (1 - 0.5**4)),
        ((10.0, 10.0, np.inf, 10.0), 0.0),
        # s* = 2 + 10 · 1.5 + 10 · 2 / (2 √3) = 22.7735 m
        ((10.0, 15.0, 30.0, 2.0), 1.5 * (1 - (2 / 3) ** 4 - (22.773502691896 / 30.0) ** 2)),
        # v T + v Δv / (2 √(a b)) is negative here and counts as 0: s* = s0.
        ((10.0, 20.0, 10.0, -20.0), 1.5 * (1 - 0.5**4 - (2.0 / 10.0) ** 2)),
    ],
)
def test_acceleration_by_hand(given, expected) -> None:
    assert idm_acceleration(*given) == pytest.approx(expected)


@given(
    speed=st.floats(0.0, 30.0), desired=st.floats(5.0, 30.0), gap=st.floats(-3.0, 300.0), leader=st.floats(0.0, 30.0)
)
def test_no_vehicle_drives_backwards_or_through_a_leader_that_it_can_stop_behind(speed, desired, gap, leader) -> None:
    times = np.arange(1, 26) * 0.2
    travelled = travelled_by(speed, max(speed, desired), gap, leader, times_s=times)
    assert np.isfinite(travelled).all()
    assert (np.diff(travelled, prepend=0.0) >= 0.0).all()
    if gap > 2.0 + speed * IDM.time_headway_s:
        assert (gap + leader * times - travelled > 0.0).all()


def test_a_vehicle_that_stops_within_a_step_goes_as_far_as_braking_takes_it() -> None:
    """0.3 m/s and half a metre behind a standing leader: −(0.5 · v²) / a, and there it stays."""
    acceleration = idm_acceleration(0.3, 13.0, 0.5, 0.3)
    assert 0.3 + 0.1 * acceleration < 0.0
    travelled_m = travelled_by(0.3, 13.0, 0.5, 0.0, times_s=np.array([0.1, 0.2, 1.0]))
    assert travelled_m == pytest.approx([0.5 * 0.3**2 / -acceleration] * 3)


def test_bumpers_that_overlap_brake_as_hard_as_the_least_gap_does() -> None:
    overlap, least = (idm_acceleration(5.0, 13.0, gap, 0.0) for gap in (-2.0, 0.1))
    assert overlap == pytest.approx(least)
    assert idm_acceleration(5.0, 13.0, 0.2, 0.0) > least


MODEL = IdmPredictor()


def first_frame(tracks: dict[int, Track], network: RoadNetwork) -> tuple[SampleBatch, dict[int, int]]:
    """The samples of a record, and for each actor that of the first frame."""
    batch = samples_in(tracks, network).batch
    rows = np.flatnonzero(batch.actors.frame[batch.target] == 0)
    return batch, dict(zip(batch.actors.actor_id[batch.target[rows]].tolist(), rows.tolist(), strict=True))


def leaders_in(tracks: dict[int, Track], network: RoadNetwork) -> dict[int, tuple[float, float]]:
    """Gap to the leader and its speed at the first frame, by actor."""
    batch, sample = first_frame(tracks, network)
    places = locate(network, batch.actors.xy_m[:, -1], batch.actors.yaw_rad[:, -1], batch.actors.sumo_lane)
    lanes = np.unique(places.lane[batch.target])
    gap_m, speed_mps = leaders_of(batch, places, paths_from(network, lanes[lanes != NO_LANE], 250.0), 250.0)
    return {actor: (float(gap_m[row]), float(speed_mps[row])) for actor, row in sample.items()}


def test_the_leader_is_the_nearest_in_the_same_lane(straight_road) -> None:
    tracks = {
        1: moving(10.0, -5.25, 4.0),
        2: moving(60.0, -5.0, 5.0, length_m=8.0),
        3: moving(30.0, -1.75, 4.0),
        4: moving(90.0, -5.25, 6.0),
        5: moving(45.0, -5.25, 3.0, yaw_rad=np.pi),
    }
    leaders = leaders_in(tracks, straight_road)
    # 3 s of history lie before the first sample: 50 m apart at the start, 53 m then.
    assert leaders[1] == pytest.approx((53.0 - 6.3, 5.0))
    assert np.isinf(leaders[3][0])
    assert leaders[4] == (np.inf, 0.0)


def test_the_leader_may_be_beyond_a_junction(crossroads) -> None:
    tracks = {1: moving(-50.0, 0.0, 0.0), 2: moving(60.0, 0.0, 0.0), 3: moving(20.0, 40.0, 0.0, yaw_rad=np.pi / 2)}
    leaders = leaders_in(tracks, crossroads)
    assert leaders[1][0] == pytest.approx(110.0 - 4.6)
    assert np.isinf(leaders[3][0])


@pytest.mark.parametrize(
    ("kind", "speed_mps", "after_5_s_m"),
    [(ActorClass.PEDESTRIAN, 1.4, 7.0), (ActorClass.BICYCLE, 4.0, 20.0)],
)
def test_people_without_a_motor_keep_their_speed(straight_road, kind, speed_mps, after_5_s_m) -> None:
    record = record_with({1: moving(0.0, -5.25, speed_mps, actor_class=kind)}, straight_road)
    batch = samples_of(record, HistoryWindow(), Population.ALL, people=True).batch
    path_m = MODEL.predict(batch).xy_m[0, 0] - batch.xy_m[0]
    assert path_m[-1] == pytest.approx((after_5_s_m, 0.0), abs=0.05)


def test_no_samples_no_answer(straight_road) -> None:
    batch, _ = first_frame({1: moving(0.0, -5.25, 5.0, steps=20)}, straight_road)
    assert MODEL.predict(batch).xy_m.shape == (0, 1, 25, 2)


@pytest.mark.parametrize("turned_rad", [0.0, 0.6, -2.2])
@pytest.mark.parametrize(
    ("ahead_m", "aside_m", "heading_rad", "gap_m", "speed_mps"),
    [
        (20.0, 1.75, 1.0, 15.4, 6.0 * np.cos(1.0)),
        (20.0, -1.75, -1.0, 15.4, 6.0 * np.cos(1.0)),
        (20.0, 1.85, 0.0, np.inf, 0.0),
        (20.0, -1.85, 0.0, np.inf, 0.0),
        (20.0, 0.0, 2.5, 15.4, 0.0),
        (2.0, 0.0, 0.0, 2.0 - 4.6, 6.0),
        (-2.0, 0.0, 0.0, np.inf, 0.0),
        (249.9, 0.0, 0.0, 245.3, 6.0),
        (250.1, 0.0, 0.0, np.inf, 0.0),
    ],
)
def test_off_the_lanes_gap_and_speed_are_along_the_heading_of_the_sample(
    straight_road, turned_rad, ahead_m, aside_m, heading_rad, gap_m, speed_mps
) -> None:
    """The strip is as wide as both vehicles; one that comes towards the own one counts as standing."""
    turn = np.array([[np.cos(turned_rad), -np.sin(turned_rad)], [np.sin(turned_rad), np.cos(turned_rad)]])
    yaw = heading_rad + turned_rad
    before_m = 3.0 * 6.0 * np.array([np.cos(yaw), np.sin(yaw)])
    start = np.array([0.0, 500.0]) + turn @ (ahead_m, aside_m) - before_m
    tracks = {1: moving(0.0, 500.0, 0.0, yaw_rad=turned_rad), 2: moving(*start, 6.0, yaw_rad=yaw)}
    assert leaders_in(tracks, straight_road)[1] == pytest.approx((gap_m, speed_mps))


@pytest.mark.parametrize(("speed_mps", "desired_mps"), [(8.0, 50.0 / 3.6), (20.0, 20.0)])
def test_off_the_lanes_the_limit_is_that_of_a_town(straight_road, speed_mps, desired_mps) -> None:
    batch, sample = first_frame({1: moving(0.0, 500.0, speed_mps, yaw_rad=-2.0)}, straight_road)
    way = MODEL.predict(batch).xy_m[sample[1], 0] - batch.xy_m[sample[1]]
    alone, there = np.full(1, np.inf), np.zeros(1)
    times = 0.2 * np.arange(1, 26)
    travelled = IDM.travel(np.array([speed_mps]), np.array([desired_mps]), alone, there, times)[0]
    assert way == pytest.approx(travelled[:, None] * np.array([np.cos(-2.0), np.sin(-2.0)]))


@pytest.mark.parametrize(("ahead_m", "led"), [(0.3, True), (-0.3, False)])
@pytest.mark.parametrize("y_m", [-5.25, 500.0])
def test_a_vehicle_alongside_leads_where_its_centre_is_ahead(straight_road, y_m, ahead_m, led) -> None:
    """In a lane and off all lanes."""
    tracks = {1: moving(40.0, y_m, 0.0), 2: moving(40.0 + ahead_m, y_m + 1.0, 0.0)}
    assert leaders_in(tracks, straight_road)[1][0] == pytest.approx(ahead_m - 4.6 if led else np.inf)


def predicted(tracks: dict[int, Track], network: RoadNetwork) -> dict[int, np.ndarray]:
    """What the model predicts at the first frame, by actor."""
    batch, sample = first_frame(tracks, network)
    return {actor: MODEL.predict(batch).xy_m[row, 0] for actor, row in sample.items()}


def test_straight_ahead_is_where_the_vehicle_looks_at_the_present(straight_road) -> None:
    """It turns on the spot by 0.5 rad/s and looks north after 3 s; the others stand 12 m to the north and the east."""
    heading = np.pi / 2.0 + 0.5 * (0.05 * np.arange(201) - 3.0)
    spot = np.stack((np.zeros(201), np.full(201, 500.0), *np.zeros((2, 201)), heading), axis=1)
    tracks = {1: Track(spot), 2: moving(0.0, 512.0, 0.0), 3: moving(5.0, 508.0, 0.0), 4: moving(1.0, 508.0, 0.0)}
    assert leaders_in(tracks, straight_road)[1][0] == pytest.approx(8.0 - 4.6)
    del tracks[4]
    assert leaders_in(tracks, straight_road)[1][0] == pytest.approx(12.0 - 4.6)


def test_the_lane_is_that_of_the_present_heading(crossroads) -> None:
    """Where the ways across part, it looked straight on until just now, and now to the left."""
    heading = np.where(np.arange(201) < 60, 0.0, 0.6)
    turned = np.stack((np.full(201, 7.0), np.full(201, 3.0), *np.zeros((2, 201)), heading), axis=1)
    way = predicted({1: Track(turned)}, crossroads)[1]
    _, left = crossroads.lanes[4].centre.project(way)
    assert np.abs(left).max() < 0.2
    assert way[-1, 1] > 10.0


def test_the_straightest_movement_follows_and_junction_paths_lead_out(crossroads) -> None:
    assert straight_successors(crossroads).tolist() == [5, NO_LANE, NO_LANE, NO_LANE, 1, 2, 3]


@pytest.mark.parametrize("angle_rad", [0.0, 0.7, 3.0])
@pytest.mark.parametrize(
    ("lines", "straightest"),
    [
        ({2: [(40.0, 3.5), (140.0, 3.5)], 3: [(40.0, -1.0), (140.0, -1.0)]}, 3),
        ({2: [(40.0, 1.0), (140.0, 1.0)], 3: [(40.0, -3.5), (140.0, -3.5)]}, 2),
        ({2: [(40.0, 0.0), (140.0, 40.0)], 3: [(40.0, -9.0), (140.0, -12.0)]}, 3),
        ({2: [(40.0, 0.0), (140.0, -40.0)], 3: [(40.0, -9.0), (140.0, -12.0)]}, 3),
        ({2: [(40.0, 0.0), (40.0, 0.7), (140.0, 0.7)], 3: [(40.0, -9.0), (140.0, -12.0)]}, 3),
    ],
    ids=["right nearer", "left nearer", "left turn", "right turn", "turns at its start"],
)
def test_the_straightest_and_then_the_nearest_follows(crossroads, angle_rad, lines, straightest) -> None:
    assert straight_successors(with_lines(crossroads, lines, angle_rad))[0] == straightest + 3


def test_a_lane_of_the_same_kind_comes_before_a_straighter_one(crossroads) -> None:
    first, second, *others = crossroads.lanes
    shoulders = [replace(lane, kind=LaneKind.SHOULDER) for lane in (first, second)]
    assert straight_successors(replace(crossroads, lanes=(*shoulders, *others)))[0] == 4


def test_paths_know_where_their_lanes_start_and_end_with_their_reach(crossroads) -> None:
    paths = paths_from(crossroads, np.array([0, 4], dtype=np.int32), 200.0)
    assert paths.path_of_lane.tolist() == [0, -1, -1, -1, 1, -1, -1]
    assert paths.start_m[0].tolist() == [0.0, np.inf, 140.0, np.inf, np.inf, 100.0, np.inf]
    assert paths.start_m[1, 1] == pytest.approx(crossroads.lanes[4].length_m)
    short = paths_from(crossroads, np.array([0], dtype=np.int32), 30.0)
    assert np.isfinite(short.start_m[0]).tolist() == [True, False, False, False, False, True, False]


def test_points_keep_their_offset_and_go_straight_on_past_the_end(crossroads) -> None:
    paths = paths_from(crossroads, np.array([0, 1], dtype=np.int32), 200.0)
    points = paths.points(np.array([1, 0]), np.array([[50.0, 150.0], [10.0, 260.0]]), np.array([0.5, -1.0]))
    assert np.allclose(points, [[(19.5, 70.0), (19.5, 170.0)], [(-90.0, -1.0), (160.0, -1.0)]])


@pytest.mark.parametrize("angle_rad", [0.0, 0.7])
def test_lanes_are_near_by_their_ends_and_not_by_their_middle(crossroads, angle_rad) -> None:
    """Lane 0 comes from the side and bends; behind the crossing lane 3 begins nearer and then goes farther away."""
    lines = {
        0: [(-100.0, 9.0), (-50.0, 0.0), (0.0, 0.0)],
        2: [(40.0, 3.0), (41.0, 3.0), (141.0, -20.0)],
        3: [(40.0, -2.0), (41.0, -2.0), (141.0, -30.0)],
    }
    assert straight_successors(with_lines(crossroads, lines, angle_rad))[0] == 6
    lines[3] = [(40.0, -4.0), (41.0, -4.0), (141.0, 4.0)]
    assert straight_successors(with_lines(crossroads, lines, angle_rad))[0] == 5


TIMES_S = future_times_s()
NOWHERE = RoadNetwork((), (), (), {}, (0.0, 0.0), "!")


def one(network: RoadNetwork, *values: float) -> SampleBatch:
    return samples_of(record_with({1: moving(*values, steps=161)}, network), HistoryWindow(), Population.ALL).batch


def circling(radius_m: float, speed_mps: float) -> SampleBatch:
    """A vehicle on a circle around the origin, counter-clockwise, now at angle 0 and heading north."""
    batch = one(NOWHERE, 0.0, 0.0, speed_mps)
    angle = speed_mps / radius_m * batch.window.times_s
    actors = batch.actors
    heading = angle + 0.5 * np.pi
    actors.xy_m[:] = radius_m * np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    actors.yaw_rad[:] = heading
    actors.velocity_mps[:] = speed_mps * np.stack((np.cos(heading), np.sin(heading)), axis=-1)
    return batch


@pytest.mark.parametrize(("radius_m", "speed_mps"), [(20.0, 6.0), (-15.0, 8.0), (200.0, 12.0)])
def test_ctra_stays_on_a_circle(radius_m, speed_mps) -> None:
    batch = circling(radius_m, speed_mps)
    angle = speed_mps / radius_m * TIMES_S
    xy_m = make_ctra().predict(batch).xy_m[0, 0]
    assert turn_rate_of(batch)[0] == pytest.approx(speed_mps / radius_m)
    assert xy_m == pytest.approx(radius_m * np.stack((np.cos(angle), np.sin(angle)), axis=-1), abs=1e-3)


def test_each_vehicle_of_a_batch_has_the_way_of_its_own_state(straight_road) -> None:
    """Three vehicles, two frames, all on straight ways: east aside of the centre line, west, and off the lanes."""
    tracks = {1: (3.0, -5.0, 5.0, 0.4, 0.0), 2: (280.0, 1.5, 9.0, -0.6, np.pi), 4: (50.0, 40.0, 6.0, 0.9, 0.7)}
    batch = samples_in({key: moving(*track, steps=163) for key, track in tracks.items()}, straight_road).batch
    rows = [(key, step) for step in (60, 62) for key in tracks]
    assert [*zip(batch.actor_id.tolist(), batch.sample_step.tolist(), strict=True)] == rows
    gains = {
        ConstantVelocity: 0.0 * TIMES_S,
        make_cv_lane: 0.0 * TIMES_S,
        make_ca: 0.5 * TIMES_S**2,
        make_ctra: 0.5 * TIMES_S**2,
        make_ca_lane: 0.5 * TIMES_S**2,
        make_decay_lane: TIMES_S - 1.0 + np.exp(-TIMES_S),
    }
    for make, gained_s2 in gains.items():
        answer = make().predict(batch)
        assert answer.xy_m.shape == (6, 1, 25, 2)
        for row, (key, step) in enumerate(rows):
            x_m, y_m, mps, mps2, yaw = tracks[key]
            now_s = 0.05 * step
            way_m = mps * now_s + 0.5 * mps2 * now_s**2 + (mps + mps2 * now_s) * TIMES_S + mps2 * gained_s2
            places = np.stack((x_m + way_m * np.cos(yaw), y_m + way_m * np.sin(yaw)), axis=-1)
            np.testing.assert_allclose(answer.xy_m[row, 0], places, atol=3e-3, err_msg=f"{make.__name__} of {key}")


def blom_and_bar_shalom(imm: Imm, measured: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """States of both models of one vehicle and their probabilities, model by model, with a period of 0.2 s."""
    t, half = 0.2, np.eye(4, 6)
    moves = [np.kron(np.array(rows), np.eye(2)) for rows in (
        [[1, t, 0], [0, 1, 0], [0, 0, 0]], [[1, t, t**2 / 2], [0, 1, t], [0, 0, 1]]
    )]  # fmt: skip
    pushes = imm.accelerations_mps2 * np.array([t**2 / 2, t, 0]), imm.jerk_mps3 * np.array([t**3 / 6, t**2 / 2, t])
    noise = np.diag([imm.position_m**2] * 2 + [imm.velocity_mps**2] * 2)
    stays = np.array([[imm.stays, 1 - imm.stays], [1 - imm.stays, imm.stays]])
    states = [np.append(measured[0], [0.0, 0.0])] * 2
    spreads, shares = [np.diag([*np.diag(noise), 4.0, 4.0])] * 2, np.array([0.5, 0.5])
    for seen in measured[1:]:
        found = []
        for model in (0, 1):
            weight = shares * stays[:, model] / (shares @ stays[:, model])
            mean = weight[0] * states[0] + weight[1] * states[1]
            apart = [np.outer(state - mean, state - mean) for state in states]
            spread = sum(weight[k] * (spreads[k] + apart[k]) for k in (0, 1))
            state, push = moves[model] @ mean, np.kron(np.outer(pushes[model], pushes[model]), np.eye(2))
            spread = moves[model] @ spread @ moves[model].T + push
            innovation = half @ spread @ half.T + noise
            gain = spread @ half.T @ np.linalg.inv(innovation)
            likely = stats.multivariate_normal.pdf(seen, half @ state, innovation) * (shares @ stays[:, model])
            found.append((state + gain @ (seen - half @ state), (np.eye(6) - gain @ half) @ spread, likely))
        (*states,), (*spreads,), likelihoods = zip(*found, strict=True)
        shares = np.array(likelihoods) / sum(likelihoods)
    return states, shares


def test_imm_is_blom_and_bar_shaloms_filter_of_each_vehicle_and_who_brakes_stops(straight_road) -> None:
    """One speeds up, one brakes from 4 m/s by 3 m/s², one keeps its speed."""
    imm = Imm(position_m=0.3, velocity_mps=0.7, stays=0.9)
    tracks = {1: moving(3.0, -5.0, 2.0, 4.0, 0.2), 2: moving(280.0, 1.5, 13.0, -3.0, np.pi), 4: moving(50.0, 40.0, 6.0)}
    batch, _ = first_frame(tracks, straight_road)
    batch.actors.xy_m[:] += np.random.default_rng(0).normal(0.0, 0.2, batch.actors.xy_m.shape)
    answer = ImmPredictor(imm).predict(batch)
    for row in range(3):
        place = batch.target[row]
        measured = np.hstack((batch.actors.xy_m[place], batch.actors.velocity_mps[place]))
        states, shares = blom_and_bar_shalom(imm, measured)
        for rank, model in enumerate(np.argsort(-shares)):
            (xy, velocity, gain), times = np.split(states[model], 3), TIMES_S[:, None]
            gain = gain * model
            stops = gain @ velocity < 0.0
            times = np.minimum(times, -(gain @ velocity) / (gain @ gain)) if stops else times
            assert (times[-1, 0] < 2.0) == (row == model == 1)
            assert answer.xy_m[row, rank] == pytest.approx(xy + velocity * times + 0.5 * gain * times**2)
            assert answer.probability[row, rank] == pytest.approx(shares[model])


def test_who_halts_brakes_as_late_as_it_can_and_ends_at_the_line() -> None:
    times_s = np.array([1.0, 2.0, 3.0, 5.0, 20.0])
    # From 10 m/s a braking of 2 m/s² takes 25 m and 5 s: it begins after 1 s.
    assert halting(np.array([10.0]), np.array([35.0]), 2.0, times_s)[0] == pytest.approx([10.0, 19.0, 26.0, 34.0, 35.0])
    # 10 m are too short: v² / 2 s = 5 m/s², at once.
    assert halting(np.array([10.0]), np.array([10.0]), 2.0, times_s)[0] == pytest.approx([7.5, 10.0, 10.0, 10.0, 10.0])
    assert halting(np.array([0.0]), np.array([5.0]), 2.0, times_s)[0] == pytest.approx(np.zeros(5))
    assert np.isinf(halting(np.array([10.0]), np.array([np.inf]), 2.0, times_s)).all()


@pytest.mark.parametrize("make", [make_idm_stop, make_decay_stop])
@pytest.mark.parametrize(
    ("letters", "is_emv", "stops"),
    [("rrr", False, True), ("GGG", False, False), ("yyy", False, False), ("rrr", True, False)],
)
def test_a_red_signal_stops_whoever_is_no_emv(crossroads, make, letters: str, is_emv: bool, stops: bool) -> None:
    network = with_signal(crossroads, letters)
    batch = showing(batch_of({1: moving(-70.0, 0.0, 10.0)}, network), letters)
    batch = replace(batch, actors=replace(batch.actors, is_emv=np.full(len(batch.actors), is_emv)))
    line_m = min(lane.centre.points[-1, 0] for lane in network.lanes if network.connections_from.get(lane.index))
    front_m = make().predict(batch).xy_m[0, 0, -1, 0] + 0.5 * batch.actors.length_m[batch.target[0]]
    assert bool(front_m <= line_m + 0.01) is stops  # the first sample is 3 s later, at −40 m
    free = make_decay_lane() if make is make_decay_stop else IdmPredictor()
    assert stops or np.array_equal(make().predict(batch).xy_m, free.predict(batch).xy_m)


@pytest.mark.parametrize("letter", "rG")
@pytest.mark.parametrize(("ahead", "line_m"), [((2, 3), 0.0), ((2, 0), -100.0)])
def test_of_several_lines_the_nearest_red_one_stops(
    crossroads, letter: str, ahead: tuple[int, int], line_m: float
) -> None:
    """The further line, or the nearer one, is that of a lane with a greater number."""
    network = crossroads if line_m == 0.0 else with_lines(crossroads, {2: [(-200.0, 0.0), (-100.0, 0.0)]})
    turns = network.connections if line_m == 0.0 else network.connections[::2]
    further, nearer = ("rrr", letter) if line_m == 0.0 else (letter * 2, "r")
    letters = further + nearer
    link = Connection(*ahead, (), "s", None, -1, False, "k")
    network = with_signal(replace(network, connections=(*turns, link)), letters)
    batch = showing(batch_of({1: moving(line_m - 70.0, 0.0, 10.0)}, network), letters)
    front_m = make_idm_stop().predict(batch).xy_m[0, 0, -1, 0] + 0.5 * batch.actors.length_m[batch.target[0]]
    assert line_m - 10.0 < front_m <= line_m


def test_who_has_stopped_at_a_stop_sign_goes_on(crossroads) -> None:
    network = replace(crossroads, connections=tuple(replace(one, must_stop=True) for one in crossroads.connections))
    starts = ((-30.0, 6.0), (-12.0, 0.0))
    coming, standing = (batch_of({1: moving(x_m, 0.0, speed)}, network) for x_m, speed in starts)
    went_m = [make_idm_stop().predict(batch).xy_m[0, 0, -1, 0] - batch.xy_m[0, 0] for batch in (coming, standing)]
    assert went_m[0] < 12.0
    assert went_m[1] > 10.0


def test_where_every_simple_model_sees_vehicles_and_people_go() -> None:
    """Ways from the present after 1, 3 and 5 s of ten samples, before, on and behind the junction."""
    batch = samples_of(busy_record(), HistoryWindow(), Population.ALL).batch
    found: dict[str, object] = {"actor_id": batch.actor_id[5::71], "step": batch.sample_step[5::71]}
    for name, predictor in predictors_named([name for name in PREDICTORS if is_simple(name)]).items():
        answer = predictor.predict(batch)
        ways = answer.xy_m[5::71, :, 4::10] - batch.xy_m[5::71, None, None]
        found[name] = ways.reshape(len(ways), -1), answer.probability[5::71].tolist()
    assert_known(Path(__file__).parent / "known" / "baselines.json", found, digits=5, decimals=6)
