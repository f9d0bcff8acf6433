"""The tracker by hand: gains, gate, order, numbers of tracks."""

import numpy as np
import pytest

from siren_ros.scoring.evaluation.detection.tracker import Tracker

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


def test_the_first_three_sweeps_by_hand(tracker: Tracker) -> None:
    """1 m in 0.1 s, then 2 m more: gains 1 and 1, then 5/6 and 1/2."""
    velocity, sweeps, _ = tracker.follow(2, at((1.0, -1.0)), STEP_S)
    assert velocity == pytest.approx(np.array([[10.0, -10.0]]))
    assert tracker.place_m == pytest.approx(np.array([[1.0, -1.0]]))
    velocity, sweeps, _ = tracker.follow(4, at((3.0, -3.0)), STEP_S)
    # Expected at 1 + 10 × 0.1 = 2 m, seen at 3 m.
    assert velocity == pytest.approx(np.array([[15.0, -15.0]]))
    assert tracker.place_m == pytest.approx(np.array([[2.0 + 5.0 / 6.0, -2.0 - 5.0 / 6.0]]))
    assert sweeps.tolist() == [3]


@pytest.mark.parametrize("seed", range(5))
def test_a_short_track_is_the_straight_line_through_its_boxes(seed: int) -> None:
    places = 0.3 * np.random.default_rng(seed).normal(size=(5, 2)) + np.arange(5)[:, None] * [0.8, -0.4]
    tracker, times_s = Tracker(), 0.1 * np.arange(5)
    for number, place in enumerate(places):
        velocity, *_ = tracker.follow(2 * number, place[None], STEP_S)
    slope, start = np.polyfit(times_s, places, 1)
    assert velocity[0] == pytest.approx(slope)
    assert tracker.place_m[0] == pytest.approx(start + slope * times_s[-1])


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


def test_answers_are_in_the_order_of_the_boxes() -> None:
    """Two known vehicles and a new one between them, given in another order."""
    tracker = Tracker()
    tracker.follow(0, at((0.0, 0.0), (20.0, 0.0)), STEP_S)
    tracker.follow(2, at((0.0, 0.0), (20.0, 0.0)), STEP_S)
    velocity, sweeps, _ = tracker.follow(4, at((20.0, 1.0), (10.0, 0.0), (-1.0, 0.0)), STEP_S)
    assert sweeps.tolist() == [3, 1, 3]
    assert velocity == pytest.approx(np.array([[0.0, 5.0], [0.0, 0.0], [-5.0, 0.0]]))


def test_the_nearest_pairs_are_the_same_vehicles() -> None:
    """Both boxes are within the gate of both tracks: the sum of the ways decides."""
    tracker = Tracker()
    tracker.follow(0, at((0.0, 0.0), (2.0, 0.0)), STEP_S)
    velocity, *_ = tracker.follow(2, at((1.9, 0.0), (0.2, 0.0)), STEP_S)
    assert velocity[:, 0] == pytest.approx([-1.0, 2.0])


def test_the_same_instant_moves_nobody(tracker: Tracker) -> None:
    velocity, sweeps, _ = tracker.follow(0, at((1.0, 0.0)), STEP_S)
    assert (velocity.tolist(), sweeps.tolist()) == ([[0.0, 0.0]], [2])
    assert tracker.place_m.tolist() == [[0.0, 0.0]]


def test_tracks_find_the_velocity() -> None:
    tracker = Tracker()
    for step in range(0, 80, 2):
        places = np.array([[8.0 * step * 0.05, 0.0], [30.0, 10.0 - 3.0 * step * 0.05]])
        velocity, sweeps, _ = tracker.follow(step, places[:: 1 if step % 4 else -1], 0.05)
    assert sweeps.tolist() == [40, 40]
    assert np.sort(velocity, axis=0) == pytest.approx(np.array([[0.0, -3.0], [8.0, 0.0]]), abs=0.1)


def test_vehicles_that_leave_are_forgotten(tracker: Tracker) -> None:
    _, sweeps, _ = tracker.follow(40, np.array([[0.0, 0.0]]), 0.05)
    assert sweeps.tolist() == [1]
    velocity, sweeps, _ = tracker.follow(42, np.zeros((0, 2)), 0.05)
    assert (velocity.shape, sweeps.shape) == ((0, 2), (0,))
