"""Detections as tracks: the tracker by hand, tracks over episodes, and their scores (HOTA, AMOTA, AMOTP).

TrackEval's own code and the devkit's evaluation of the export give the same scores.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_detections import found_boxes, made_frames, truth_boxes
from reader_environments import read_with

from siren_ros.scoring.evaluation.detection.boxes import FoundBoxes, FoundSet
from siren_ros.scoring.evaluation.detection.frames import Frames, frames_of
from siren_ros.scoring.evaluation.detection.metrics import (
    ALPHAS,
    ZERO_M,
    DevkitTracking,
    Hota,
    TrackTable,
    devkit_tracking,
    hota_sums,
)
from siren_ros.scoring.evaluation.detection.scoring import VEHICLE_NAMES
from siren_ros.scoring.evaluation.detection.tracking import Tracker, score_tracking, tracks_of
from siren_ros.scoring.evaluation.scores import Score
from siren_ros.simulation.world.actors import ActorClass

SIDES_M = (5.0, 15.0, 30.0)
FRAMES = 40
EPISODES = 2


def made(*, classes: tuple[ActorClass, ...] = (ActorClass.SEDAN, ActorClass.POLICE, ActorClass.SUV)) -> Frames:
    """Three vehicles that stand to the left of a LiDAR, 40 frames of 10 Hz in each of two episodes."""
    first = made_frames(camera=False).episodes[0]
    frame = np.repeat(np.arange(FRAMES), len(SIDES_M))
    centre = np.column_stack((np.zeros(len(frame)), np.tile(SIDES_M, FRAMES), np.ones(len(frame))))
    truth = truth_boxes(frame, centre, np.zeros((len(frame), 2)), np.zeros(len(frame)))
    truth = replace(
        truth,
        actor_id=np.tile(np.arange(1, 4, dtype=np.uint32), FRAMES),
        actor_class=np.tile(np.array(classes, dtype=np.uint8), FRAMES),
    )
    places = {"map_from_lidar": np.tile(np.eye(4), (FRAMES, 1, 1)), "vehicle_m": np.zeros((FRAMES, 2))}
    steps = {"step": np.arange(FRAMES) * 2, "pictured": np.ones(FRAMES, dtype=np.bool_)}
    return frames_of([replace(first, episode_id=f"e{one}", truth=truth, **places, **steps) for one in range(EPISODES)])


def seen(frames: Frames, labels: tuple[str, ...] = ("car", "police", "car")) -> FoundBoxes:
    truth = frames.truth
    boxes = found_boxes(truth.frame, truth.centre_m, truth.velocity_mps, truth.yaw_rad, np.full(len(truth), 0.5))
    return replace(boxes, label=np.tile(np.array(labels), FRAMES * EPISODES))


def scores(frames: Frames, boxes: FoundBoxes) -> dict[str, dict[str, Score]]:
    """Rows by class and metric."""
    found = FoundSet("made", "made", boxes, frames.scored, has_velocity=True)
    by_class: dict[str, dict[str, Score]] = {}
    for row in score_tracking(frames, found, VEHICLE_NAMES, lambda tables: [devkit_tracking(*one) for one in tables]):
        assert (row.model, row.kind) == ("made", "tracking")
        by_class.setdefault(row.group, {})[row.metric] = row
    return by_class


def test_vehicles_have_one_track_in_each_episode() -> None:
    frames = made()
    tracks = tracks_of(frames, seen(frames))
    assert np.unique(tracks.track).tolist() == list(range(6))
    for number in range(6):
        rows = tracks.track == number
        assert len(np.unique(tracks.boxes.centre_m[rows, 1])) == 1
        assert len(np.unique(frames.episode[tracks.boxes.frame[rows]])) == 1


def test_a_track_has_the_name_of_its_most_confident_boxes() -> None:
    frames = made()
    boxes = seen(frames)
    boxes.label[1::9] = "car"  # a third of the police car's
    tracks = tracks_of(frames, boxes)
    assert set(tracks.boxes.label[tracks.boxes.centre_m[:, 1] == SIDES_M[1]].tolist()) == {"police"}


def test_kinds_have_scores_of_their_own_where_they_are_named() -> None:
    frames = made()
    found = scores(frames, seen(frames))
    assert set(found) == {"vehicle", "car", "police"}, "there is no ambulance and no fire truck"
    assert [score["AMOTA"].samples for score in found.values()] == [6, 4, 2]
    for score in found.values():
        assert [score[metric].value for metric in ("AMOTA", "HOTA", "AMOTP", "MOTA")] == [1.0, 1.0, 0.0, 1.0]


def test_the_confidence_of_a_track_is_that_of_its_boxes_however_many_there_are() -> None:
    """Of 120 labels a detector finds 88, the last vehicle in 8 frames of 40; it doubts a track where nobody is."""
    frames = made()
    truth, every = frames.truth, np.arange(FRAMES * EPISODES)
    sure = (truth.centre_m[:, 1] < SIDES_M[2]) | (truth.frame % FRAMES < 8)
    nobody = np.column_stack((np.zeros(len(every)), np.full(len(every), -20.0), np.ones(len(every))))
    frame = np.concatenate((truth.frame[sure], every))
    zeros, score = np.zeros((len(frame), 2)), np.where(np.arange(len(frame)) < sure.sum(), 0.9, 0.3)
    boxes = found_boxes(frame, np.concatenate((truth.centre_m[sure], nobody)), zeros, zeros[:, 0], score)
    found = scores(frames, replace(boxes, label=np.full(len(frame), "car")))
    assert found["vehicle"]["MOTA"].value == pytest.approx(
        88 / 120, abs=1 / 40
    )  # recalls are looked at in steps of 1 / 40


def test_a_police_car_by_another_name_is_a_vehicle_all_the_same_and_people_are_followed_apart() -> None:
    frames = made()
    found = scores(frames, seen(frames, ("car", "car", "police")))
    assert [found[name]["AMOTA"].value for name in ("vehicle", "police")] == [1.0, 0.0]
    assert set(scores(frames, seen(frames, ("car", "car", "car")))) == {"vehicle"}
    frames = made(classes=(ActorClass.SEDAN, ActorClass.PEDESTRIAN, ActorClass.SUV))
    found = scores(frames, seen(frames, ("car", "person", "car")))
    assert {name: score["AMOTA"].samples for name, score in found.items()} == {"vehicle": 4, "pedestrian": 2}
    assert found["pedestrian"]["HOTA"].value == 1.0


@pytest.mark.parametrize("lost", [20, 30])
def test_what_is_lost_for_long_gets_another_number(lost: int) -> None:
    """Kept for a second: without 20 frames of 10 Hz the track is another one, and HOTA falls below 1."""
    frames = made()
    boxes = seen(frames)
    gone = (boxes.frame % FRAMES >= 5) & (boxes.frame % FRAMES < 5 + lost)
    found = scores(frames, boxes.at(~gone))
    assert found["vehicle"]["switches"].value == 6
    assert found["vehicle"]["HOTA"].value < np.sqrt(1.0 - lost / FRAMES)


STEP_S = 0.05


def at(*places: tuple[float, float]) -> np.ndarray:
    return np.array(places, dtype=float).reshape(-1, 2)


@pytest.fixture
def tracker() -> Tracker:
    """Of one vehicle at the origin at step 0."""
    tracker = Tracker()
    velocity, sweeps, _ = tracker.follow(0, at((0.0, 0.0)), STEP_S)
    assert (velocity.tolist(), sweeps.tolist()) == ([[0.0, 0.0]], [1])
    return tracker


def test_a_short_track_is_the_straight_line_through_its_boxes() -> None:
    places = 0.3 * np.random.default_rng(0).normal(size=(5, 2)) + np.arange(5)[:, None] * [0.8, -0.4]
    tracker, times_s = Tracker(), 0.1 * np.arange(5)
    tracker.follow(0, places[:1], STEP_S)
    for number in range(1, 5):
        velocity, sweeps, _ = tracker.follow(2 * number, places[[number]], STEP_S)
        slope, start = np.polyfit(times_s[: number + 1], places[: number + 1], 1)
        assert velocity[0] == pytest.approx(slope)
        assert tracker.place_m[0] == pytest.approx(start + slope * times_s[number])
        assert sweeps.tolist() == [number + 1]


def test_a_long_track_forgets_with_constant_gains(tracker: Tracker) -> None:
    for step in range(2, 40, 2):
        tracker.follow(step, at((0.0, 0.0)), STEP_S)
    velocity, *_ = tracker.follow(40, at((1.0, 0.0)), STEP_S)
    assert velocity[0] == pytest.approx([0.15 / 0.1, 0.0])
    assert tracker.place_m[0] == pytest.approx([0.5, 0.0])


@pytest.mark.parametrize(("away_m", "same"), [(2.4, True), (2.6, False)])
def test_a_box_beyond_the_gate_is_another_vehicle(tracker: Tracker, away_m: float, *, same: bool) -> None:
    _, sweeps, _ = tracker.follow(2, at((0.0, away_m)), STEP_S)
    assert sweeps.tolist() == [2 if same else 1]
    assert len(tracker.place_m) == (1 if same else 2)


@pytest.mark.parametrize(("missed", "known"), [(20, True), (22, False)])
def test_a_track_is_kept_for_a_second(tracker: Tracker, missed: int, *, known: bool) -> None:
    for step in range(2, missed, 2):
        tracker.follow(step, at(), STEP_S)
    _, sweeps, _ = tracker.follow(missed, at((0.0, 0.0)), STEP_S)
    assert sweeps.tolist() == [2 if known else 1]
    velocity, sweeps, _ = tracker.follow(missed + 2, at(), STEP_S)
    assert (velocity.shape, sweeps.shape) == ((0, 2), (0,))


def test_numbers_of_tracks_stay_and_are_never_given_twice(tracker: Tracker) -> None:
    numbers = [tracker.follow(2, at((20.0, 0.0), (0.1, 0.0)), STEP_S).track.tolist()]
    numbers.append(tracker.follow(4, at((0.2, 0.0), (20.0, 0.0)), STEP_S).track.tolist())
    numbers.append(tracker.follow(30, at((20.0, 0.0), (0.2, 0.0)), STEP_S).track.tolist())
    assert numbers == [[1, 0], [0, 1], [2, 3]], "the last ones are new: the old ones were forgotten"


@pytest.mark.parametrize(("stated", "begins"), [((3.0, -4.0), (3.0, -4.0)), ((np.nan, np.nan), (0.0, 0.0))])
def test_a_track_begins_with_the_velocity_that_the_detector_states(
    stated: tuple[float, float], begins: tuple[float, float]
) -> None:
    tracker = Tracker()
    velocity, *_ = tracker.follow(0, at((0.0, 0.0)), STEP_S, np.array([stated]))
    assert velocity.tolist() == [list(begins)]
    tracker.follow(2, at(), STEP_S, at())
    assert tracker.place_m[0] == pytest.approx(0.1 * np.array(begins))


def test_the_nearest_pairs_are_the_same_vehicles_and_answers_are_in_the_order_of_the_boxes() -> None:
    """Both boxes are within the gate of both tracks: the sum of the ways decides. Then a new one between two known."""
    tracker = Tracker()
    tracker.follow(0, at((0.0, 0.0), (2.0, 0.0)), STEP_S)
    velocity, *_ = tracker.follow(2, at((1.9, 0.0), (0.2, 0.0)), STEP_S)
    assert velocity[:, 0] == pytest.approx([-1.0, 2.0])
    tracker = Tracker()
    for step in (0, 2):
        tracker.follow(step, at((0.0, 0.0), (20.0, 0.0)), STEP_S)
    velocity, sweeps, _ = tracker.follow(4, at((20.0, 1.0), (10.0, 0.0), (-1.0, 0.0)), STEP_S)
    assert sweeps.tolist() == [3, 1, 3]
    assert velocity == pytest.approx(np.array([[0.0, 5.0], [0.0, 0.0], [-5.0, 0.0]]))


def test_the_same_instant_moves_nobody(tracker: Tracker) -> None:
    velocity, sweeps, _ = tracker.follow(0, at((1.0, 0.0)), STEP_S)
    assert (velocity.tolist(), sweeps.tolist()) == ([[0.0, 0.0]], [2])
    assert tracker.place_m.tolist() == [[0.0, 0.0]]


def table(*rows: tuple[int, float, int], episode: int = 0) -> TrackTable:
    """Rows of frame, x and track."""
    frame, x, track = (np.array(column) for column in zip(*rows, strict=True)) if rows else np.zeros((3, 0))
    places = np.stack((x, np.zeros(len(x))), axis=-1)
    return TrackTable(
        np.full(len(x), episode), frame.astype(np.intp), places, track.astype(np.intp), np.full(len(x), 0.5)
    )


def joined(*tables: TrackTable) -> TrackTable:
    columns = [[getattr(one, name) for one in tables] for name in TrackTable.__dataclass_fields__]
    return TrackTable(*(np.concatenate(column) for column in columns))


def whole(labels: TrackTable, found: TrackTable, episodes: int = 1) -> Hota:
    return hota_sums(labels, found, episodes).of(np.ones(episodes))


STANDS = tuple((frame, 0.0, 7) for frame in range(4))


def test_hota_by_hand() -> None:
    """The labels themselves, two tracks for a vehicle, a false alarm in each frame, and nothing found."""
    labels = table(*STANDS)
    assert whole(labels, labels) == (1.0, 1.0, 1.0)
    # Each hit shares 2 of 4 boxes.
    changed = table((0, 0.0, 1), (1, 0.0, 1), (2, 0.0, 2), (3, 0.0, 2))
    assert whole(labels, changed) == pytest.approx((np.sqrt(0.5), 1.0, 0.5))
    alarms = joined(labels, table(*((frame, 50.0, 9) for frame in range(4))))
    alarms = alarms.at(np.argsort(alarms.frame, kind="stable"))
    assert whole(labels, alarms) == pytest.approx((np.sqrt(0.5), 0.5, 1.0))
    assert np.isnan(whole(table(), table())).all()
    assert whole(labels, table()) == whole(table(), labels) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("away_m", [0.3, 1.0, 1.7])
def test_a_track_aside_is_found_as_long_as_it_is_near_enough(away_m: float) -> None:
    found = table(*((frame, away_m, 1) for frame in range(4)))
    share = float(np.mean(1.0 - away_m / ZERO_M >= ALPHAS - 1e-12))
    assert whole(table(*STANDS), found) == pytest.approx((share, share, share))


def random_tables(seed: int, episodes: int = 3) -> tuple[TrackTable, TrackTable]:
    """Vehicles that move at random, found with errors, gaps, changes of numbers and false alarms."""
    rng = np.random.default_rng(seed)
    labels, found = [], []
    for episode in range(episodes):
        rows: list[tuple[int, float, int]] = []
        seen: list[tuple[int, float, int]] = []
        for frame in range(100 * episode, 100 * episode + 8):
            for vehicle in range(int(rng.integers(1, 6))):
                x = 4.0 * vehicle + 0.2 * (frame % 100)
                rows.append((frame, x, vehicle))
                if rng.random() < 0.8:
                    seen.append((frame, x + rng.normal(0.0, 0.8), vehicle + 10 * int(rng.random() < 0.2)))
            seen += [(frame, rng.uniform(-10.0, 30.0), 90 + k) for k in range(int(rng.integers(0, 3)))]
        labels.append(table(*rows, episode=episode))
        found.append(table(*seen, episode=episode))
    return joined(*labels), joined(*found)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_numbers_mean_nothing_and_a_farther_track_is_never_better(seed: int) -> None:
    labels, found = random_tables(seed, episodes=1)
    value = whole(labels, found)
    other = TrackTable(found.episode, found.frame, found.centre_m, 1000 - found.track, found.score)
    assert whole(labels, other) == pytest.approx(value)
    assert 0.0 <= value.hota <= 1.0
    assert value.hota <= np.sqrt(value.detection * value.association) + 1e-12, "the mean of roots is below that"
    away = TrackTable(found.episode, found.frame, found.centre_m + np.array([100.0, 0.0]), found.track, found.score)
    assert whole(labels, away).hota == 0.0


def test_trackeval_gives_the_same(tmp_path: Path) -> None:
    labels, found = random_tables(4)
    ours = whole(labels, found, 3)
    assert 0.1 < ours.hota < 0.9
    sequences = {}
    for episode in range(3):
        frames = []
        for frame in range(100 * episode, 100 * episode + 8):
            one, other = (side.at(side.frame == frame) for side in (labels, found))
            way = one.centre_m[:, None] - other.centre_m[None]
            alike = np.maximum(0.0, 1.0 - np.linalg.norm(way, axis=-1) / 2.0)
            frames.append({"labels": one.track.tolist(), "tracks": other.track.tolist(), "alike": alike.tolist()})
        sequences[str(episode)] = frames
    file = tmp_path / "sequences.json"
    file.write_text(json.dumps(sequences))
    told = read_with("trackeval", "read_hota.py", file)
    assert ours == pytest.approx((told["HOTA"], told["DetA"], told["AssA"]), abs=1e-9)


SCORED_FRAMES = 8


def along(episode: int, x_m: float, track: int, away_m: float = 0.0) -> TrackTable:
    first = SCORED_FRAMES * episode
    return table(*((frame, x_m + away_m, track) for frame in range(first, first + SCORED_FRAMES)), episode=episode)


def amota_of(labels: TrackTable, found: TrackTable, episodes: int = 1) -> DevkitTracking:
    frames = [list(range(SCORED_FRAMES * one, SCORED_FRAMES * (one + 1))) for one in range(episodes)]
    return devkit_tracking(labels, found, frames)


def test_amota_by_hand() -> None:
    """The labels themselves, a vehicle half a metre away, nothing found, and a change of the number."""
    labels = joined(along(0, 0.0, 1), along(0, 20.0, 2))
    best = amota_of(labels, labels)
    assert (best.labels, best.amota, best.amotp_m, best.mota, best.switches) == (2, 1.0, 0.0, 1.0, 0.0)
    assert best.confidence == 0.5
    whole = along(0, 0.0, 1)
    aside, nothing = (amota_of(whole, along(0, 0.0, 1, away_m=away_m)) for away_m in (0.5, 50.0))
    assert (aside.amota, aside.amotp_m) == pytest.approx((1.0, 0.5))
    assert (nothing.amota, nothing.amotp_m) == (0.0, 2.0)
    assert np.isnan(nothing.confidence)
    changed = amota_of(whole, replace(whole, track=np.repeat([1, 2], SCORED_FRAMES // 2)))
    assert (changed.switches, changed.mota) == (1.0, pytest.approx(1.0 - 1.0 / SCORED_FRAMES))


def test_without_an_episode_the_score_is_that_of_the_others() -> None:
    """All confidences are equal, so that the thresholds do not depend on the episodes: an exact comparison."""
    labels = joined(*(along(one, 10.0 * place, 10 * one + place) for one in range(3) for place in range(3)))
    found = joined(
        *(along(one, 10.0 * place, 10 * one + place, away_m=0.3 * one) for one in range(3) for place in range(3)),
        *(along(one, 60.0 + 5.0 * place, 100 + 10 * one + place) for one in range(3) for place in range(one)),
    )
    found = found.at(np.lexsort((found.frame, found.episode)))
    score = amota_of(labels, found, 3)
    for left_out in range(3):
        kept = [np.flatnonzero(side.episode != left_out) for side in (labels, found)]
        others = amota_of(labels.at(kept[0]), found.at(kept[1]), 3)
        assert score.left_out["amota"][left_out] == pytest.approx(others.amota)
        assert score.left_out["amotp_m"][left_out] == pytest.approx(others.amotp_m)
