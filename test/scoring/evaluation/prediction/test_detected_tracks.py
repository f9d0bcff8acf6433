"""Tracks of a detector in place of the logged states: boxes made by hand from two vehicles on one road."""

import numpy as np
import pytest
from made_records import moving, record_with

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.detected_tracks import BoxTracks, reported_by, with_own
from siren_ros.scoring.evaluation.prediction.predictors import predictors_named
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, samples_of
from siren_ros.scoring.evaluation.prediction.scoring import score_episode

STEPS = 401
WINDOW = HistoryWindow()
FIRST, SECOND = 1, 2


@pytest.fixture(scope="module")
def record(straight_road):
    return record_with(
        {FIRST: moving(20.0, -5.25, 5.0, steps=STEPS), SECOND: moving(24.5, -5.25, 5.0, steps=STEPS)}, straight_road
    )


def boxes_of(record, changes=lambda actor, _: (actor, True), yaw_rad=0.0):
    """A box at each state; ``changes`` gives its track, and whether there is one."""
    columns = [
        (step.step, *changes(actor, step.step), x, y, vx, vy)
        for step in record.states
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


def samples_by(record, tracks):
    return samples_of(record, WINDOW, Population.ALL, reporter=lambda _, rows, table: reported_by(tracks, rows, table))


@pytest.mark.parametrize("yaw_rad", [0.0, np.pi])
def test_boxes_at_the_true_places_give_the_logged_tracks_whichever_end_is_their_front(record, yaw_rad) -> None:
    logged, seen = samples_of(record, WINDOW, Population.ALL), samples_by(record, boxes_of(record, yaw_rad=yaw_rad))
    assert seen.batch.actor_id.tolist() == logged.batch.actor_id.tolist()
    assert seen.future_xy_m == pytest.approx(logged.future_xy_m)
    for name in ("xy_m", "velocity_mps", "yaw_rad", "accel_mps2"):
        told, true = getattr(seen.batch.actors, name), getattr(logged.batch.actors, name)
        assert told == pytest.approx(true, abs=1e-9), name
    assert seen.batch.actors.observed.all()


def test_a_vehicle_without_a_box_for_a_second_is_not_reported_before_it_goes_on(record) -> None:
    gap = range(200, 260)  # 3 s
    boxes = boxes_of(
        record,
        lambda actor, step: (7 if actor == SECOND and step >= gap.stop else actor, actor != SECOND or step not in gap),
    )
    seen = samples_by(record, boxes).batch
    steps = seen.sample_step[seen.actor_id == SECOND]
    assert 198 in steps
    assert 260 in steps
    missing = [step for step in range(0, 300, 2) if step >= 60 and step not in steps]
    assert missing == [*range(220, 260, 2)], "it goes on for a second as it moved"
    going = seen.actors.xy_m[seen.target[(seen.actor_id == SECOND) & (seen.sample_step == 210)][0], -1]
    assert going == pytest.approx([24.5 + 5.0 * 210 * 0.05, -5.25])


def test_a_young_track_has_moved_as_at_its_first_box(record) -> None:
    late = samples_by(record, boxes_of(record, lambda actor, step: (actor, actor != SECOND or step >= 150))).batch
    steps = late.sample_step[late.actor_id == SECOND]
    assert steps.min() == 150
    row = late.target[(late.actor_id == SECOND) & (late.sample_step == 150)][0]
    assert np.diff(late.actors.xy_m[row, :, 0]) == pytest.approx(np.full(WINDOW.points - 1, 5.0 * 0.2), abs=1e-6)


def test_tracks_that_exchange_their_vehicles_have_each_others_past(record) -> None:
    swapped = boxes_of(record, lambda actor, step: (actor if step < 200 else FIRST + SECOND - actor, True))
    batch = samples_by(record, swapped).batch
    row = batch.target[(batch.actor_id == FIRST) & (batch.sample_step == 210)][0]
    before, after = batch.actors.xy_m[row, 0, 0], batch.actors.xy_m[row, -1, 0]
    assert after == pytest.approx(20.0 + 5.0 * 210 * 0.05)
    assert before == pytest.approx(24.5 + 5.0 * (210 - 60) * 0.05), "three seconds ago the track was on the other one"


def test_boxes_of_nobody_are_nobodys(record) -> None:
    far = boxes_of(record)
    far = BoxTracks(far.step, far.track, far.xy_m + np.array([0.0, 3.0]), far.yaw_rad, far.velocity_mps)
    assert len(samples_by(record, far)) == 0


def test_a_detector_needs_a_bag(record) -> None:
    with pytest.raises(InputError, match="a bag, for a detector"):
        score_episode("live", record, predictors_named(["cv"]), Population.ALL, noise="classical")


def test_the_vehicle_with_the_lidar_knows_its_own_motion(record) -> None:
    blind = boxes_of(record, lambda actor, _: (actor, actor == SECOND))
    steps = np.arange(0, STEPS, 4)
    places = np.stack((20.0 + 5.0 * steps * 0.05, np.full(len(steps), -5.25)), axis=-1)
    seen = samples_of(
        record,
        WINDOW,
        Population.ALL,
        reporter=lambda _, rows, table: reported_by(with_own(blind, rows, steps, places), rows, table),
    ).batch
    assert set(seen.actor_id.tolist()) == {FIRST, SECOND}
    assert seen.xy_m[seen.actor_id == FIRST][0] == pytest.approx([20.0 + 5.0 * 60 * 0.05, -5.25])
    elsewhere = samples_of(
        record,
        WINDOW,
        Population.ALL,
        reporter=lambda _, rows, table: reported_by(with_own(blind, rows, steps, places + 30.0), rows, table),
    ).batch
    assert set(elsewhere.actor_id.tolist()) == {SECOND}
