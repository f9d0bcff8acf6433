"""Matching and average precision against nuscenes-devkit on random boxes, and closed-form cases."""

import numpy as np
import pytest
from detection_boxes import found_boxes, made_boxes, random_boxes, truth_boxes

from siren_ros.evaluation.detection.devkit_score import DISTANCES_M, average_precision, devkit_score, match


@pytest.mark.parametrize("seed", range(12))
def test_the_compiled_score_is_the_devkits(seed: int) -> None:
    truth, found = random_boxes(np.random.default_rng(seed), frames=12)
    score = devkit_score(truth, found)
    matches = match(truth, found)
    for row, distance_m in enumerate(DISTANCES_M):
        hit = matches.label[row] >= 0
        (value,) = average_precision(
            hit, np.zeros(len(hit), dtype=np.intp), np.array([float(len(truth))]), np.ones((1, 1))
        )
        assert value == pytest.approx(score.average_precision[distance_m], abs=1e-12)
    assert score.mean_average_precision == pytest.approx(np.mean(list(score.average_precision.values())))


def test_weights_are_repetitions_of_episodes() -> None:
    """An episode that counts twice is an episode that is there twice."""
    truth, found = random_boxes(np.random.default_rng(3), frames=8)
    matches = match(truth, found)
    episode = (found.frame[matches.order] >= 4).astype(np.intp)
    hit = matches.label[2] >= 0
    labels = np.bincount((truth.frame >= 4).astype(np.intp), minlength=2).astype(float)
    (weighted,) = average_precision(hit, episode, labels, np.array([[1.0, 2.0]]))
    twice = np.repeat(np.arange(len(hit)), 1 + episode)
    (repeated,) = average_precision(
        hit[twice], np.zeros(len(twice), dtype=np.intp), np.array([labels @ [1.0, 2.0]]), np.ones((1, 1))
    )
    # Repeated detections have the same confidence: where hits and misses alternate, the order within is free.
    assert weighted == pytest.approx(repeated, abs=0.02)
    (only_first,) = average_precision(hit, episode, labels, np.array([[1.0, 0.0]]))
    (alone,) = average_precision(
        hit[episode == 0], np.zeros((episode == 0).sum(), dtype=np.intp), labels[:1], np.ones((1, 1))
    )
    assert only_first == pytest.approx(alone, abs=1e-12)


def test_no_label_has_no_score() -> None:
    found = average_precision(np.array([True]), np.zeros(1, dtype=np.intp), np.array([0.0]), np.ones((1, 1)))
    assert np.isnan(found).all()


def test_the_nearest_free_label_is_taken_in_the_order_of_confidence() -> None:
    truth, found = made_boxes(truth_x_m=[0.0, 1.5], found_x_m=[0.9, 1.0, 0.1], score=[0.5, 0.9, 0.7])
    matches = match(truth, found)
    assert matches.order.tolist() == [1, 2, 0]
    assert matches.label.tolist() == [[-1, 0, -1], [1, 0, -1], [1, 0, -1], [1, 0, -1]]


def test_perfect_detections_score_fully_and_have_no_errors() -> None:
    truth, found = made_boxes(truth_x_m=[0.0, 10.0, 20.0], found_x_m=[0.0, 10.0, 20.0], score=[0.9, 0.8, 0.7])
    score = devkit_score(truth, found)
    assert (score.mean_average_precision, score.nds) == (pytest.approx(1.0), pytest.approx(1.0))
    assert max(score.errors.values()) == pytest.approx(0.0, abs=1e-9)


def test_recalls_that_are_reached_exactly_count_as_in_the_devkit() -> None:
    """With 25 labels every fourth recall of the grid is reached, some only up to the last bit."""
    rng = np.random.default_rng(0)
    x_m = np.arange(25) * 10.0
    found_x_m = np.r_[x_m, x_m + 5.0]
    truth, found = made_boxes(truth_x_m=x_m, found_x_m=found_x_m, score=rng.permutation(np.linspace(0.9, 0.1, 50)))
    hit = match(truth, found).label[2] >= 0
    (value,) = average_precision(hit, np.zeros(50, dtype=np.intp), np.array([25.0]), np.ones((1, 1)))
    assert value == pytest.approx(devkit_score(truth, found).average_precision[2.0], abs=1e-12)


def test_labels_of_other_frames_are_not_taken_and_a_limit_is_no_match() -> None:
    """Frames in no order; a detection 3 and 4 m away, one exactly 2 m away, one on a label of another frame."""
    places = np.array([[10.0, 10.0, 1.0], [0.0, 0.0, 1.0], [-20.0, 5.0, 1.0]])
    still, ahead = np.zeros((3, 2)), np.zeros(3)
    truth = truth_boxes(np.array([2, 0, 1]), places, still, ahead)
    found = found_boxes(
        np.array([0, 1, 1]),
        np.array([[0.0, 2.0, 0.0], [10.0, 10.0, 1.0], [-20.0 + 2.3, 5.0 - 3.2, 9.0]]),
        still,
        ahead,
        np.array([0.3, 0.8, 0.5]),
    )
    matches = match(truth, found)
    assert matches.order.tolist() == [1, 2, 0]
    # The second is 3.94 m from the label of row 2, whatever its height; the third at 2 m is beyond 2 m.
    assert matches.label.tolist() == [[-1, -1, -1], [-1, -1, -1], [-1, -1, -1], [-1, 2, 1]]


def test_of_equal_confidences_the_later_one_comes_first() -> None:
    truth, found = made_boxes(truth_x_m=[0.0], found_x_m=[0.1, 0.2, 0.3], score=[0.5, 0.5, 0.6])
    matches = match(truth, found)
    assert matches.order.tolist() == [2, 1, 0]
    assert matches.label[1].tolist() == [0, -1, -1]


def test_average_precision_by_hand() -> None:
    """Four labels; hit, miss, hit: precision falls from 1 at recall 0.25 to 1/2 there, and rises to 2/3 at 0.5.

    From recall 0.11 to 0.24 the precision is 1. Where a recall is reached twice, the last precision counts.
    """
    hit = np.array([True, False, True])
    (value,) = average_precision(hit, np.zeros(3, dtype=np.intp), np.array([4.0]), np.ones((1, 1)))
    recall = np.arange(11, 101) / 100.0
    rising = 0.5 + (recall - 0.25) / 0.25 * (2.0 / 3.0 - 0.5)
    precision = np.where(recall < 0.25, 1.0, np.where(recall <= 0.5, rising, 0.0))
    assert value == pytest.approx(np.maximum(precision - 0.1, 0.0).mean() / 0.9)


def test_a_resample_without_labels_leaves_the_others_their_scores() -> None:
    """The second episode has no label."""
    hit, episode, labels = np.array([True, False]), np.array([0, 1]), np.array([1.0, 0.0])
    found = average_precision(hit, episode, labels, np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 0.0], [2.0, 0.0]]))
    assert np.isnan(found).tolist() == [True, False, True, False]
    assert found[[1, 3]] == pytest.approx([1.0, 1.0])
