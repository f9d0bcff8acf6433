"""The tracker that gives detected vehicles their velocities."""

import numpy as np
import pytest

from siren_ros.evaluation.detection.detectors.tracker import Tracker

STEP_S = 0.05


def at(*places: tuple[float, float]) -> np.ndarray:
    return np.array(places, dtype=float).reshape(-1, 2)


@pytest.fixture
def tracker() -> Tracker:
    """Of one vehicle at the origin at step 0."""
    tracker = Tracker()
    velocity, sweeps = tracker.follow(0, at((0.0, 0.0)), STEP_S)
    assert (velocity.tolist(), sweeps.tolist()) == ([[0.0, 0.0]], [1])
    return tracker


def test_the_first_three_sweeps_by_hand(tracker: Tracker) -> None:
    """Gains 0.5 and 0.15: 1 m in 0.1 s, then 1 m more."""
    velocity, sweeps = tracker.follow(2, at((1.0, -1.0)), STEP_S)
    assert velocity == pytest.approx(np.array([[1.5, -1.5]]))
    assert tracker.place_m == pytest.approx(np.array([[0.5, -0.5]]))
    velocity, sweeps = tracker.follow(4, at((2.0, -2.0)), STEP_S)
    # Expected at 0.5 + 1.5 × 0.1 = 0.65 m, seen at 2 m: 1.35 m away.
    assert velocity == pytest.approx(np.array([[1.5 + 0.15 * 1.35 / 0.1, -1.5 - 0.15 * 1.35 / 0.1]]))
    assert tracker.place_m == pytest.approx(np.array([[0.65 + 0.675, -0.65 - 0.675]]))
    assert sweeps.tolist() == [3]


@pytest.mark.parametrize(("away_m", "same"), [(2.4, True), (2.6, False)])
def test_a_box_beyond_the_gate_is_another_vehicle(tracker: Tracker, away_m: float, *, same: bool) -> None:
    _, sweeps = tracker.follow(2, at((0.0, away_m)), STEP_S)
    assert sweeps.tolist() == [2 if same else 1]
    assert len(tracker.place_m) == (1 if same else 2)


@pytest.mark.parametrize(("missed", "known"), [(20, True), (22, False)])
def test_a_track_is_kept_for_a_second(tracker: Tracker, missed: int, *, known: bool) -> None:
    for step in range(2, missed, 2):
        tracker.follow(step, at(), STEP_S)
    _, sweeps = tracker.follow(missed, at((0.0, 0.0)), STEP_S)
    assert sweeps.tolist() == [2 if known else 1]


def test_answers_are_in_the_order_of_the_boxes() -> None:
    """Two known vehicles and a new one between them, given in another order."""
    tracker = Tracker()
    tracker.follow(0, at((0.0, 0.0), (20.0, 0.0)), STEP_S)
    tracker.follow(2, at((0.0, 0.0), (20.0, 0.0)), STEP_S)
    velocity, sweeps = tracker.follow(4, at((20.0, 1.0), (10.0, 0.0), (-1.0, 0.0)), STEP_S)
    assert sweeps.tolist() == [3, 1, 3]
    assert velocity == pytest.approx(np.array([[0.0, 1.5], [0.0, 0.0], [-1.5, 0.0]]))


def test_the_nearest_pairs_are_the_same_vehicles() -> None:
    """Both boxes are within the gate of both tracks: the sum of the ways decides."""
    tracker = Tracker()
    tracker.follow(0, at((0.0, 0.0), (2.0, 0.0)), STEP_S)
    velocity, _ = tracker.follow(2, at((1.9, 0.0), (0.2, 0.0)), STEP_S)
    assert velocity[:, 0] == pytest.approx([-0.15, 0.3])


def test_the_same_instant_moves_nobody(tracker: Tracker) -> None:
    velocity, sweeps = tracker.follow(0, at((1.0, 0.0)), STEP_S)
    assert (velocity.tolist(), sweeps.tolist()) == ([[0.0, 0.0]], [2])
    assert tracker.place_m.tolist() == [[0.0, 0.0]]


def test_a_track_begins_with_what_its_detector_states() -> None:
    """At 10 m/s it is where it was expected, and keeps its velocity; a track that began standing has 1.5 m/s."""
    given, bare = Tracker(), Tracker()
    stated = np.array([[10.0, 0.0]])
    assert given.follow(0, at((0.0, 0.0)), STEP_S, stated)[0].tolist() == stated.tolist()
    bare.follow(0, at((0.0, 0.0)), STEP_S)
    assert given.follow(2, at((1.0, 0.0)), STEP_S, np.zeros((1, 2)))[0] == pytest.approx(stated)
    assert bare.follow(2, at((1.0, 0.0)), STEP_S)[0] == pytest.approx(np.array([[1.5, 0.0]]))


def test_tracks_find_the_velocity() -> None:
    tracker = Tracker()
    for step in range(0, 80, 2):
        places = np.array([[8.0 * step * 0.05, 0.0], [30.0, 10.0 - 3.0 * step * 0.05]])
        velocity, sweeps = tracker.follow(step, places[:: 1 if step % 4 else -1], 0.05)
    assert sweeps.tolist() == [40, 40]
    assert np.sort(velocity, axis=0) == pytest.approx(np.array([[0.0, -3.0], [8.0, 0.0]]), abs=0.1)


def test_vehicles_that_leave_are_forgotten(tracker: Tracker) -> None:
    _, sweeps = tracker.follow(40, np.array([[0.0, 0.0]]), 0.05)
    assert sweeps.tolist() == [1]
    velocity, sweeps = tracker.follow(42, np.zeros((0, 2)), 0.05)
    assert (velocity.shape, sweeps.shape) == ((0, 2), (0,))
