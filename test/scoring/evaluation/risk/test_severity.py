"""How severe a video is: measures of severity, and near crashes."""

import json
from dataclasses import replace

import numpy as np
import pytest
from evaluation.made_records import Track, moving, record_with

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.labels import (
    DEFINITIONS,
    Camera,
    Evidence,
    Moments,
    RiskClass,
    RiskThresholds,
    SeenEncroachment,
    evidence_of,
    label_of,
)
from siren_ros.scoring.evaluation.risk.severity import (
    Severity,
    read_severities,
    score_severities,
    severities_of,
    severity_of,
    template_means,
)
from siren_ros.scoring.evaluation.risk.tables import table_of_changes, table_of_severity
from siren_ros.scoring.evaluation.risk.video_set import changes_of_labels
from siren_ros.sensing.specification import Mount


def test_numbers_of_a_video(small_set):
    kinds = {key: severity_of(video.evidence, RiskThresholds()) for key, video in small_set.videos.items()}
    assert kinds["S4_000"] == Severity(3.0, 0.0)
    assert kinds["S4_002"] == Severity(pytest.approx(0.9), 0.0)
    assert kinds["S6_005"] == Severity(0.0, 3.5)


def test_slow_closing_does_not_count(small_set):
    evidence = small_set.videos["S4_002"].evidence
    slow = replace(evidence.moments, closing_mps=np.full(len(evidence.moments), 0.5))
    assert severity_of(Evidence(slow, (), ()), RiskThresholds()).least_ttc_s == 3.0


def test_the_truth_has_no_error_and_a_constant_has_no_rank(small_set):
    scores = score_severities(small_set, severities_of(small_set))
    assert (scores["least_ttc_s"].error.value, scores["least_ttc_s"].rank_correlation) == (0.0, pytest.approx(1.0))
    assert scores["contact_mps"].error.blocks == 1
    constant = dict.fromkeys(small_set.videos, Severity(1.0, 0.0))
    scores = score_severities(small_set, constant)
    truth = [value.least_ttc_s for value in severities_of(small_set).values()]
    assert scores["least_ttc_s"].error.value == pytest.approx(np.mean(np.abs(np.array(truth) - 1.0)))
    assert scores["least_ttc_s"].rank_correlation is None
    assert scores["contact_mps"].error.value == 3.5


def test_the_template_tells_its_mean(small_set):
    truth, means = severities_of(small_set), template_means(small_set)
    of_s4 = [truth[key].least_ttc_s for key in ("S4_000", "S4_001", "S4_002")]
    assert means["S4_001"].least_ttc_s == pytest.approx(np.mean(of_s4))
    assert means["S6_003"].contact_mps == pytest.approx(3.5 / 3.0)
    assert table_of_severity(small_set, {"x": truth}).rows[0][0] == "template_prior"


@pytest.mark.parametrize("suffix", ["json", "csv"])
def test_guesses_are_read_from_both_formats(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    given = {"a": {"class": "Normal", "least_ttc_s": 1.5, "contact_mps": 0.0}}
    rows = "video,class,least_ttc_s,contact_mps\na,Normal,1.5,0\n"
    path.write_text(json.dumps(given) if suffix == "json" else rows)
    assert read_severities(path) == {"a": Severity(1.5, 0.0)}
    path.write_text('{"a": "Normal"}' if suffix == "json" else "video,class\na,Normal\n")
    assert read_severities(path) == {}
    path.write_text(
        json.dumps({"a": {"least_ttc_s": float("nan"), "contact_mps": 0}})
        if suffix == "json"
        else rows + "b,Normal,nan,0\n"
    )
    with pytest.raises(InputError, match="finite"):
        read_severities(path)
    path.write_text('{"a": {"least_ttc_s": 1}}' if suffix == "json" else rows + "b,Normal,x,0\n")
    with pytest.raises(InputError, match="numbers"):
        read_severities(path)


def test_labels_change_with_their_thresholds(small_set):
    """Two near-misses by a TTC of 0.9 to 1.2 s, DRAC 3 m/s²: half of 1.5 s makes them normal."""
    rows = {(row.name, row.value): row for row in changes_of_labels(small_set)}
    now = rows["as they are", 1.0]
    assert (now.counts, now.changed) == ((3, 2, 1), 0)
    half = rows["time_to_collision_s", 0.75]
    assert (half.counts, half.changed) == ((5, 0, 1), 2)
    assert rows["gap_m", 15.0].changed == 0
    assert {row.counts[RiskClass.COLLISION] for row in rows.values()} == {1}
    assert any("as they are" in line for line in table_of_changes(small_set).text())


NOTHING = Moments(*(np.zeros(0) for _ in range(7)))
CAMERA = Camera(Mount(2.0, 0.0, 1.5), 1.75)
EMV, CAR = 1, 5


@pytest.mark.parametrize(
    ("time_s", "braked", "needed", "near"),
    [
        (0.6, 0.0, 0.0, False),
        (0.6, 3.39, 8.44, False),
        (0.6, 3.4, 0.0, True),
        (0.6, 0.0, 8.45, True),
        (1.0, 9.0, 9.0, False),
        (0.6, None, None, True),
    ],
)
def test_a_controlled_passing_is_normal(time_s, braked, needed, near):
    evidence = Evidence(NOTHING, (SeenEncroachment(5, 50, time_s, braked, needed),), ())
    label = label_of(evidence, DEFINITIONS["near_crash"])
    assert label.risk is (RiskClass.NEAR_MISS if near else RiskClass.NORMAL)
    assert label_of(evidence, DEFINITIONS["paper"]).risk is (RiskClass.NEAR_MISS if time_s < 1.0 else RiskClass.NORMAL)


def crossing(emv_mps, car_mps, later_s, accel_mps2=0.0, road=None):
    """The EMV drives along x through the origin at 3 s and the car along y so many seconds before it."""
    tracks = {
        EMV: moving(-3.0 * emv_mps, 0.0, emv_mps, accel_mps2=accel_mps2, steps=121, is_emv=True),
        CAR: moving(0.0, -(3.0 - later_s) * car_mps, car_mps, yaw_rad=np.pi / 2, steps=121),
    }
    return evidence_of(record_with(tracks, road), EMV, CAMERA, (0, 121)).encroachments


@pytest.mark.parametrize("emv_mps", [4.0, 8.0, 16.0])
def test_the_needed_braking_at_constant_speed_is_half_the_speed_by_the_pet(emv_mps, straight_road):
    (found,) = crossing(emv_mps, 8.0, 1.6, road=straight_road)
    assert found.time_s > 0.1
    assert found.needed_mps2 == pytest.approx(emv_mps / (2.0 * found.time_s))
    assert found.braked_mps2 == 0.0


def test_the_hardest_braking_of_both_counts(straight_road):
    (found,) = crossing(12.0, 8.0, 1.6, accel_mps2=-2.0, road=straight_road)
    assert found.braked_mps2 == pytest.approx(2.0)
    (gaining,) = crossing(8.0, 8.0, 1.6, accel_mps2=1.0, road=straight_road)
    assert gaining.braked_mps2 == 0.0


@pytest.mark.parametrize(("braked", "near"), [(0.0, False), (3.39, False), (3.4, True), (np.nan, True)])
@pytest.mark.parametrize("measures", [(1.0, 8.0, 2.0, 15.0), (2.0, 8.0, 5.0, 8.0)], ids=["TTC", "DRAC"])
def test_a_course_that_nobody_has_to_leave_is_normal(braked, near, measures):
    columns = (np.full(6, value) for value in (*measures, braked))
    evidence = Evidence(Moments(np.arange(6), np.full(6, CAR), *columns), (), ())
    label = label_of(evidence, DEFINITIONS["near_crash"])
    assert label.risk is (RiskClass.NEAR_MISS if near else RiskClass.NORMAL)
    assert label_of(evidence, DEFINITIONS["paper"]).risk is RiskClass.NEAR_MISS


@pytest.mark.parametrize("driver", [EMV, CAR])
@pytest.mark.parametrize(("step", "counts"), [(5, range(45)), (30, range(60)), (60, range(60)), (61, range(0))])
def test_braking_counts_from_two_seconds_before_until_they_would_touch(straight_road, driver, step, counts):
    """The EMV comes to a car at 10 m/s and reaches it at step 60; one of the two brakes at one step."""
    tracks = {EMV: moving(0.0, 0.0, 10.0, steps=81, is_emv=True), CAR: moving(34.6, 0.0, 0.0, steps=81)}
    record = record_with(tracks, straight_road)
    record.states[step].accel_mps2[record.states[step].actor_id == driver] = -4.0
    moments = evidence_of(record, EMV, CAMERA, (0, 81)).moments
    before = moments.step < 60
    assert moments.time_to_collision_s[before] == pytest.approx(3.0 - 0.05 * moments.step[before])
    assert moments.braked_mps2[before].tolist() == [4.0 if step in counts else 0.0 for step in moments.step[before]]


@pytest.mark.parametrize("braked_mps2", [0.0, 5.0])
def test_an_oncoming_car_that_ends_its_turn_is_normal(straight_road, braked_mps2):
    """It comes in its own lane, and for a moment its turn leads to the EMV's; it may have braked for the turn."""
    steps, lane_m = 81, 3.5
    angle = np.clip(0.5 * (1.0 - np.arange(steps) * 0.05), 0.0, None)
    yaw = np.pi + angle
    x = 42.0 + np.concatenate(([0.0], np.cumsum(8.0 * 0.05 * np.cos(yaw))[:-1]))
    y = np.concatenate(([0.0], np.cumsum(8.0 * 0.05 * np.sin(yaw))[:-1]))
    y += lane_m - y[-1]
    turning = Track(np.stack((x, y, 8.0 * np.cos(yaw), 8.0 * np.sin(yaw), yaw), axis=1))
    record = record_with({EMV: moving(0.0, 0.0, 14.0, steps=steps, is_emv=True), CAR: turning}, straight_road)
    record.states[0].accel_mps2[record.states[0].actor_id == CAR] = -braked_mps2
    evidence = evidence_of(record, EMV, CAMERA, (0, steps))
    assert len(evidence.moments), "it points at the EMV"
    assert not evidence.encroachments
    assert label_of(evidence, DEFINITIONS["near_crash"]).risk is RiskClass.NORMAL
    assert label_of(evidence, DEFINITIONS["paper"]).risk is RiskClass.NEAR_MISS
