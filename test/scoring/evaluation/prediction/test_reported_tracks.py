"""Tracks that a tracker reports: simulated errors, and the tracks of a detector."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from busy_record import busy_record
from known_outputs import assert_known
from made_records import moving, record_with

from siren_ros.data.recording.episode_record import StateRows
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.predictors import predictors_named
from siren_ros.scoring.evaluation.prediction.reported_tracks import (
    NOISES,
    BoxTracks,
    TrackNoise,
    reported_by,
    tracked,
    with_noise,
    with_own,
)
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, samples_of
from siren_ros.scoring.evaluation.prediction.scoring import score_episode
from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES

QUIET = TrackNoise(0.0, 0.0, 0.0, dropouts_per_s=0.0, swaps_per_s=0.0)
WINDOW = HistoryWindow()


@pytest.fixture(scope="module")
def record(straight_road):
    tracks = {number: moving(40.0 * number, -5.25, 5.0, 0.2, steps=2001) for number in range(12)}
    return record_with({**tracks, 20: moving(5.0, -1.75, 6.0, is_emv=True, steps=2001)}, straight_road)


def reported(record, noise):
    return samples_of(record, WINDOW, Population.ALL, reporter=with_noise(noise))


def same(one, other):
    """As ``pytest.approx`` has it, which takes seconds for arrays of this size."""
    assert one.shape == other.shape
    one, other = one.astype(float), other.astype(float)
    return bool((np.abs(one - other) <= np.maximum(1e-6 * np.abs(other), 1e-12)).all())


def pairs_of(record, noise):
    return samples_of(record, WINDOW, Population.ALL), reported(record, noise)


def test_the_truth_and_the_samples_stay(record) -> None:
    logged, noisy = pairs_of(record, TrackNoise())
    assert (noisy.future_xy_m == logged.future_xy_m).all()
    assert noisy.batch.actor_id.tolist() == logged.batch.actor_id.tolist()
    assert noisy.batch.sample_step.tolist() == logged.batch.sample_step.tolist()
    assert (noisy.batch.actors.past_sumo_lane == NO_LANE).all(), "SUMO's lanes are not measured"


def test_without_magnitudes_the_tracks_are_the_logged_ones(record) -> None:
    logged, noisy = (samples.batch.actors for samples in pairs_of(record, QUIET))
    for name in ("xy_m", "velocity_mps", "yaw_rad", "observed"):
        assert same(getattr(noisy, name), getattr(logged, name)), name


@pytest.mark.parametrize(
    ("changed", "name", "deviation"),
    [
        ({"position_m": 0.3}, "xy_m", 0.3),
        ({"velocity_mps": 0.4}, "velocity_mps", 0.4),
        ({"yaw_rad": 0.05}, "yaw_rad", 0.05),
    ],
)
def test_errors_have_the_stated_deviation_and_touch_nothing_else(record, changed, name, deviation) -> None:
    logged, noisy = (samples.batch.actors for samples in pairs_of(record, replace(QUIET, **changed)))
    errors = (getattr(noisy, name) - getattr(logged, name))[:, -1]
    assert errors.std() == pytest.approx(deviation, rel=0.1)
    assert errors.mean() == pytest.approx(0.0, abs=0.1 * deviation)
    for other in {"xy_m", "velocity_mps", "yaw_rad"} - {name}:
        assert same(getattr(noisy, other), getattr(logged, other)), other


def test_a_worse_tracker_has_larger_errors_of_another_draw(record) -> None:
    noise = TrackNoise(dropouts_per_s=0.0, swaps_per_s=0.0)
    logged, first = (samples.batch.actors for samples in pairs_of(record, noise))
    other, worse, none = (
        reported(record, noise.scaled(factor, draw)).batch.actors for factor, draw in ((1.0, 1), (1.5, 0), (0.0, 2))
    )
    errors = (first.xy_m - logged.xy_m)[:, -1]
    assert worse.xy_m[:, -1] - logged.xy_m[:, -1] == pytest.approx(1.5 * errors, abs=1e-6)
    assert same(none.xy_m, logged.xy_m)
    of_other = (other.xy_m - logged.xy_m)[:, -1]
    assert of_other.std() == pytest.approx(errors.std(), rel=0.1)
    assert abs(np.corrcoef(errors.ravel(), of_other.ravel())[0, 1]) < 0.1
    assert TrackNoise().scaled(2.0, 0) == TrackNoise(0.46, 0.48, 0.2, dropouts_per_s=0.1, swaps_per_s=0.02)


@pytest.mark.parametrize("correlation_s", [0.2, 1.0])
def test_errors_are_correlated_as_stated(record, correlation_s) -> None:
    noise = replace(QUIET, position_m=0.3, correlation_s=correlation_s)
    logged, noisy = (samples.batch.actors for samples in pairs_of(record, noise))
    errors = (noisy.xy_m - logged.xy_m)[logged.observed.all(axis=1)]
    between = np.mean(errors[:, -1] * errors[:, -2]) / np.mean(errors[:, -1] ** 2)
    assert between == pytest.approx(np.exp(-0.2 / correlation_s), abs=0.05)


def test_a_frame_has_the_same_errors_in_all_windows(record) -> None:
    noisy = reported(record, TrackNoise(swaps_per_s=0.0)).batch
    first, later = noisy.target[noisy.actor_id == 3][[0, 2]]
    assert (noisy.actors.xy_m[first, 1:] == noisy.actors.xy_m[later, :-1]).all()


def test_lost_vehicles_go_on_with_their_last_velocity(record) -> None:
    noise = replace(QUIET, dropouts_per_s=0.5, dropout_s=1.0)
    logged, noisy = (samples.batch.actors for samples in pairs_of(record, noise))
    away_m = np.hypot(*(noisy.xy_m - logged.xy_m)[:, -1].T)
    lost = away_m > 1e-9
    assert 0.2 < lost.mean() < 0.5, "a share of 1 / (1 + 2 s / 1 s)"
    assert noisy.observed[lost].all()
    # A vehicle that gains 0.2 m/s in each second and is lost for t has gone 0.1 t² farther than the tracker says.
    lost_s = np.sqrt(away_m[lost] / 0.1)
    assert lost_s * 10.0 == pytest.approx(np.round(lost_s * 10.0), abs=1e-3)
    assert lost_s.min() == pytest.approx(0.1)


def test_swapped_vehicles_have_the_past_of_each_other(straight_road) -> None:
    tracks = {1: moving(0.0, -5.25, 5.0, steps=801), 2: moving(0.0, -1.75, 5.0, steps=801, is_emv=True)}
    record = record_with(tracks, straight_road)
    batches = pairs_of(record, replace(QUIET, swaps_per_s=0.5))
    logged, noisy = (samples.batch.actors for samples in batches)
    moved = np.abs(noisy.xy_m[..., 1] - logged.xy_m[..., 1])
    assert set(np.round(moved[logged.observed], 6).tolist()) == {0.0, 3.5}
    assert (moved[:, -1] == 0.0).all(), "the present is that of the vehicle itself"
    changes = np.abs(np.diff((moved > 1.0).astype(int), axis=1)).sum(axis=1)
    assert changes.max() == 1, "the other's past up to the swap, then the own one"
    far = replace(QUIET, swaps_per_s=0.5, swap_reach_m=3.0)
    assert same(pairs_of(record, far)[1].batch.actors.xy_m, logged.xy_m), "they are 3.5 m apart"


def test_nobody_is_swapped_twice_within_a_window() -> None:
    """Windows of past and future have 8 s; three in a line, and the one between is near both."""
    table = np.arange(3 * 400).reshape(3, 400)
    rows = StateRows(table.ravel() % 400, **{name: np.zeros(table.size, of) for name, of in ACTOR_STATE_DTYPES.items()})
    rows.x_m[:] = np.repeat([0.0, 1.5, 2.5], 400)
    swaps = tracked(rows, table, replace(QUIET, swaps_per_s=9.0), np.random.default_rng(0)).swaps
    between = [frame for frame, *pair in swaps if 1 in pair]
    assert len(between) == len(swaps) > 2
    assert np.diff(between).min() >= 80


def test_predictors_get_the_tracks_and_are_scored_on_the_truth(record) -> None:
    models = predictors_named(["cv"])
    logged, noisy = (score_episode("one", record, models, Population.ALL, noise=name) for name in ("", "velocity"))
    assert (logged.noise, noisy.noise) == ("", "velocity")
    assert noisy.models["cv"]["ade_m"].samples == logged.models["cv"]["ade_m"].samples
    assert (noisy.models["cv"].moved_m == logged.models["cv"].moved_m).all()
    # Velocities that are off by 0.3 m/s per axis: 0.3 √(π/2) t, in the mean over 0.2 to 5 s 0.98 m.
    still = record_with({1: moving(0.0, -5.25, 5.0, steps=4001)}, record.network)
    scores = score_episode("still", still, models, Population.ALL, noise="velocity").models["cv"]
    assert scores["ade_m"].value == pytest.approx(0.3 * np.sqrt(np.pi / 2) * 2.6, rel=0.2)
    with pytest.raises(InputError, match="a bag, for a detector"):
        score_episode("live", still, models, Population.ALL, noise="classical")


def test_the_same_episode_has_the_same_errors_and_another_one_others(record) -> None:
    first, again = (reported(record, NOISES["tracker"]).batch for _ in range(2))
    assert (first.actors.xy_m == again.actors.xy_m).all()
    other = replace(record, description=replace(record.description, seed=record.description.seed + 1))
    assert not np.allclose(first.actors.xy_m, reported(other, NOISES["tracker"]).batch.actors.xy_m)


FIRST, SECOND = 1, 2


@pytest.fixture(scope="module")
def drive(straight_road):
    return record_with(
        {FIRST: moving(20.0, -5.25, 5.0, steps=401), SECOND: moving(24.5, -5.25, 5.0, steps=401)}, straight_road
    )


def samples_by(drive, tracks):
    return samples_of(drive, WINDOW, Population.ALL, reporter=lambda _, *given: reported_by(tracks, *given))


def boxes_of(drive, changes=lambda actor, _: (actor, True), yaw_rad=0.0):
    """A box at each state; ``changes`` gives its track, and whether there is one."""
    columns = [
        (step.step, *changes(actor, step.step), x, y, vx, vy)
        for step in drive.states
        for actor, x, y, vx, vy in zip(
            step.actor_id.tolist(), step.x_m, step.y_m, step.vx_mps, step.vy_mps, strict=True
        )
    ]
    table = np.array([row for row in columns if row[2]], np.float64)
    return BoxTracks(
        table[:, 0].astype(np.intp),
        table[:, 1].astype(np.intp),
        table[:, 3:5],
        np.full(len(table), yaw_rad),
        table[:, 5:7],
    )


@pytest.mark.parametrize("yaw_rad", [0.0, np.pi])
def test_boxes_at_the_true_places_give_the_logged_tracks_whichever_end_is_their_front(drive, yaw_rad) -> None:
    logged, seen = samples_of(drive, WINDOW, Population.ALL), samples_by(drive, boxes_of(drive, yaw_rad=yaw_rad))
    assert seen.batch.actor_id.tolist() == logged.batch.actor_id.tolist()
    assert seen.future_xy_m == pytest.approx(logged.future_xy_m)
    for name in ("xy_m", "velocity_mps", "yaw_rad", "accel_mps2"):
        told, true = getattr(seen.batch.actors, name), getattr(logged.batch.actors, name)
        assert told == pytest.approx(true, abs=1e-9), name
    assert seen.batch.actors.observed.all()


def test_a_vehicle_without_a_box_for_a_second_is_not_reported_before_it_goes_on(drive) -> None:
    gap = range(200, 260)  # 3 s
    boxes = boxes_of(
        drive,
        lambda actor, step: (7 if actor == SECOND and step >= gap.stop else actor, actor != SECOND or step not in gap),
    )
    seen = samples_by(drive, boxes).batch
    steps = seen.sample_step[seen.actor_id == SECOND]
    assert 198 in steps
    assert 260 in steps
    missing = [step for step in range(0, 300, 2) if step >= 60 and step not in steps]
    assert missing == [*range(220, 260, 2)], "it goes on for a second as it moved"
    going = seen.actors.xy_m[seen.target[(seen.actor_id == SECOND) & (seen.sample_step == 210)][0], -1]
    assert going == pytest.approx([24.5 + 5.0 * 210 * 0.05, -5.25])


def test_the_past_is_that_of_the_track(drive) -> None:
    """A young track has moved as at its first box; tracks that exchange their vehicles have each other's past."""
    late = samples_by(drive, boxes_of(drive, lambda actor, step: (actor, actor != SECOND or step >= 150))).batch
    steps = late.sample_step[late.actor_id == SECOND]
    assert steps.min() == 150
    row = late.target[(late.actor_id == SECOND) & (late.sample_step == 150)][0]
    assert np.diff(late.actors.xy_m[row, :, 0]) == pytest.approx(np.full(WINDOW.points - 1, 5.0 * 0.2), abs=1e-6)
    swapped = boxes_of(drive, lambda actor, step: (actor if step < 200 else FIRST + SECOND - actor, True))
    batch = samples_by(drive, swapped).batch
    row = batch.target[(batch.actor_id == FIRST) & (batch.sample_step == 210)][0]
    before, after = batch.actors.xy_m[row, [0, -1], 0]
    assert after == pytest.approx(20.0 + 5.0 * 210 * 0.05)
    assert before == pytest.approx(24.5 + 5.0 * (210 - 60) * 0.05), "three seconds ago the track was on the other one"
    assert len(samples_by(drive, replace(swapped, xy_m=swapped.xy_m + np.array([0.0, 3.0])))) == 0, "of nobody"


def test_the_vehicle_with_the_lidar_knows_its_own_motion(drive) -> None:
    blind = boxes_of(drive, lambda actor, _: (actor, actor == SECOND))
    steps = np.arange(0, 401, 4)
    places = np.stack((20.0 + 5.0 * steps * 0.05, np.full(len(steps), -5.25)), axis=-1)
    seen, elsewhere = (
        samples_of(
            drive,
            WINDOW,
            Population.ALL,
            reporter=lambda _, rows, table, at=at: reported_by(with_own(blind, rows, steps, at), rows, table),
        ).batch
        for at in (places, places + 30.0)
    )
    assert set(seen.actor_id.tolist()) == {FIRST, SECOND}
    assert seen.xy_m[seen.actor_id == FIRST][0] == pytest.approx([20.0 + 5.0 * 60 * 0.05, -5.25])
    assert set(elsewhere.actor_id.tolist()) == {SECOND}


def test_what_a_tracker_and_a_detector_report_of_a_busy_episode() -> None:
    """The boxes are every other step of four vehicles, a few centimetres aside, the last one lost from 6 s to 8 s."""
    record = busy_record()
    logged = samples_of(record, WINDOW, Population.ALL).batch.actors
    reporters = {name: with_noise(replace(noise, swaps_per_s=0.3)) for name, noise in NOISES.items()}
    rows = record.rows.select(np.isin(record.rows.actor_id, (1, 2, 3, 9)) & (record.rows.step % 2 == 0))
    rows = rows.select((rows.actor_id != 9) | (rows.step < 120) | (rows.step > 160))
    rows = rows.select(np.lexsort((rows.actor_id, rows.step)))
    aside = 0.05 * np.sin(np.arange(len(rows)))[:, None] * np.array([1.0, -0.5])
    tracks = BoxTracks(
        rows.step,
        np.where(rows.actor_id == 9, 20 + (rows.step > 160), rows.actor_id).astype(np.intp),
        rows.xy_m + aside,
        rows.yaw_rad + np.where(rows.actor_id == 2, np.pi, 0.0),
        np.stack((rows.vx_mps, rows.vy_mps), axis=-1) + aside,
    )
    carrier = record.track(12)
    own = with_own(tracks, record.rows, carrier.step, carrier.xy_m)
    reporters["boxes"] = lambda _record, logged_rows, table: reported_by(own, logged_rows, table)
    found: dict[str, object] = {"logged": len(logged.frame)}
    for name, reporter in reporters.items():
        seen = samples_of(record, WINDOW, Population.ALL, reporter=reporter).batch
        actors, some = seen.actors, slice(7, None, max(len(seen.actors.frame) // 12, 1))
        found[name] = {
            "samples": len(seen),
            "actors": np.bincount(actors.actor_id),
            "actor_id": actors.actor_id[some],
            "frame": actors.frame[some],
            "observed": actors.observed[some].sum(axis=1),
            "place": np.round(actors.xy_m[some, ::5], 3).reshape(len(actors.frame[some]), -1),
            "now": np.column_stack(
                (actors.velocity_mps[some, -1], actors.yaw_rad[some, -1], actors.accel_mps2[some, -1])
            ),
        }
    assert_known(Path(__file__).parent / "known" / "reported_tracks.json", found, digits=6, decimals=4)
