"""One step of the filter written out, gates, gaps, and who is whom."""

import numpy as np
import pytest

from siren_ros.evaluation.detection.detectors.tracker import Tracker, directed_yaw

STEP_S = 0.05


def at(*places: tuple[float, float]) -> np.ndarray:
    return np.array(places, dtype=float).reshape(-1, 2)


def test_the_first_three_sweeps_by_hand() -> None:
    """Gains 0.5 and 0.15: 1 m in 0.1 s, then 1 m more."""
    tracker = Tracker()
    velocity, sweeps = tracker.follow(0, at((0.0, 0.0)), STEP_S)
    assert (velocity.tolist(), sweeps.tolist()) == ([[0.0, 0.0]], [1])
    velocity, sweeps = tracker.follow(2, at((1.0, -1.0)), STEP_S)
    assert velocity == pytest.approx(np.array([[1.5, -1.5]]))
    assert tracker.place_m == pytest.approx(np.array([[0.5, -0.5]]))
    velocity, sweeps = tracker.follow(4, at((2.0, -2.0)), STEP_S)
    # Expected at 0.5 + 1.5 × 0.1 = 0.65 m, seen at 2 m: 1.35 m away.
    assert velocity == pytest.approx(np.array([[1.5 + 0.15 * 1.35 / 0.1, -1.5 - 0.15 * 1.35 / 0.1]]))
    assert tracker.place_m == pytest.approx(np.array([[0.65 + 0.675, -0.65 - 0.675]]))
    assert sweeps.tolist() == [3]


@pytest.mark.parametrize(("away_m", "same"), [(2.4, True), (2.6, False)])
def test_a_box_beyond_the_gate_is_another_vehicle(away_m: float, *, same: bool) -> None:
    tracker = Tracker()
    tracker.follow(0, at((0.0, 0.0)), STEP_S)
    _, sweeps = tracker.follow(2, at((0.0, away_m)), STEP_S)
    assert sweeps.tolist() == [2 if same else 1]
    assert len(tracker.place_m) == (1 if same else 2)


@pytest.mark.parametrize(("missed", "known"), [(20, True), (22, False)])
def test_a_track_is_kept_for_a_second(missed: int, *, known: bool) -> None:
    tracker = Tracker()
    tracker.follow(0, at((0.0, 0.0)), STEP_S)
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


def test_the_same_instant_moves_nobody() -> None:
    tracker = Tracker()
    tracker.follow(0, at((0.0, 0.0)), STEP_S)
    velocity, sweeps = tracker.follow(0, at((1.0, 0.0)), STEP_S)
    assert (velocity.tolist(), sweeps.tolist()) == ([[0.0, 0.0]], [2])
    assert tracker.place_m.tolist() == [[0.0, 0.0]]


@pytest.mark.parametrize("turn", [0.0, 1.2, -2.5])
@pytest.mark.parametrize(("speed_mps", "turned"), [(1.5, False), (-0.9, False), (-1.1, True)])
def test_a_heading_is_turned_round_from_walking_pace_on(turn: float, speed_mps: float, *, turned: bool) -> None:
    velocity = speed_mps * np.array([[np.cos(turn), np.sin(turn)]])
    assert directed_yaw(np.array([turn]), velocity) == pytest.approx([turn + np.pi if turned else turn])
