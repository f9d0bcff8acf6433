"""Scores by nuScenes' rules: errors, matches, average precision; the devkit's own evaluation of an export."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_detections import found_boxes, made_boxes, random_boxes, truth_boxes

from siren_ros.cli.main import main
from siren_ros.scoring.evaluation.detection.boxes import FoundBoxes, TruthBoxes, joined
from siren_ros.scoring.evaluation.detection.frames import Frames
from siren_ros.scoring.evaluation.detection.metrics import (
    DISTANCES_M,
    ERRORS,
    DevkitScore,
    average_precision,
    devkit_score,
    match,
)
from siren_ros.scoring.evaluation.detection.result_files import labels_as_detections, write_nuscenes
from siren_ros.scoring.evaluation.scores import Scores

X_M = [0.0, 10.0, 20.0]
TURNED_RAD = 2.0


def exact() -> tuple[TruthBoxes, FoundBoxes]:
    """Three boxes, all of them found where they are; they point to 2 rad."""
    truth, found = made_boxes(X_M, X_M, [0.9, 0.8, 0.7])
    return replace(truth, yaw_rad=np.full(3, TURNED_RAD)), replace(found, yaw_rad=np.full(3, TURNED_RAD))


def assert_errors(score: DevkitScore, **expected: float) -> None:
    """All other errors are none; the score is nuScenes' sum of five times the mAP and what is left of the errors."""
    errors = {"ATE": 0.0, "ASE": 0.0, "AOE": 0.0, "AVE": 0.0, "AAE": 0.0, **expected}
    assert dict(score.errors) == pytest.approx(errors, abs=1e-6)
    left = sum(1.0 - min(1.0, value) for value in errors.values())
    assert score.nds == pytest.approx((5.0 * score.mean_average_precision + left) / 10.0)


@pytest.mark.parametrize(
    ("error", "changes", "expected"),
    [
        ("ATE", {"centre_m": np.array([0.3, -0.4, 7.0])}, 0.5),
        ("ASE", {"size_m": np.array([0.9, 0.0, 0.0])}, 1.0 - 4.5 / 5.4),
        *(("AOE", {"yaw_rad": off_rad}, abs(off_rad)) for off_rad in (0.4, -0.7, 2.9)),
        ("AVE", {"velocity_mps": np.array([0.6, -0.8])}, 1.0),
        ("AAE", {"attribute": np.uint8(1)}, 1.0),
    ],
)
def test_each_error_alone(error: str, changes: dict[str, np.ndarray], expected: float) -> None:
    """Places whatever the height; of 4.5 m by 1.9 m by 1.6 m the found ones are 0.9 m longer; they stand and move."""
    truth, found = exact()
    changed = {name: getattr(found, name) + more for name, more in changes.items()}
    assert_errors(devkit_score(truth, replace(found, **changed)), **{error: expected})


def test_each_distance_has_its_precision_and_all_their_mean() -> None:
    """0.7 m off: no match within half a metre."""
    truth, found = exact()
    score = devkit_score(truth, replace(found, centre_m=found.centre_m + np.array([0.7, 0.0, 0.0])))
    assert score.average_precision == pytest.approx({0.5: 0.0, 1.0: 1.0, 2.0: 1.0, 4.0: 1.0})
    assert score.mean_average_precision == pytest.approx(0.75)
    assert score.precision.shape == (len(DISTANCES_M), 101)
    assert score.precision[0].tolist() == [0.0] * 101
    assert score.precision[1].tolist() == [1.0] * 101
    assert (score.labels, score.detections) == (3, 3)


@pytest.mark.parametrize("seed", range(4))
def test_the_compiled_score_is_the_devkits(seed: int) -> None:
    truth, found = random_boxes(np.random.default_rng(seed), frames=12)
    score = devkit_score(truth, found)
    matches = match(truth, found)
    for row, distance_m in enumerate(DISTANCES_M):
        value = ap_of(matches.label[row] >= 0, float(len(truth)))
        assert value == pytest.approx(score.average_precision[distance_m], abs=1e-12)
    assert score.mean_average_precision == pytest.approx(np.mean(list(score.average_precision.values())))
    # With 25 labels every fourth recall of the grid is reached exactly, some only up to the last bit.
    x_m = np.arange(25) * 10.0
    ranks = np.random.default_rng(seed).permutation(np.linspace(0.9, 0.1, 50))
    truth, found = made_boxes(truth_x_m=x_m, found_x_m=np.r_[x_m, x_m + 5.0], score=ranks)
    hit = match(truth, found).label[2] >= 0
    assert ap_of(hit, 25.0) == pytest.approx(devkit_score(truth, found).average_precision[2.0], abs=1e-12)


def test_weights_are_repetitions_of_episodes() -> None:
    """An episode that counts twice is an episode that is there twice."""
    truth, found = random_boxes(np.random.default_rng(3), frames=8)
    matches = match(truth, found)
    episode = (found.frame[matches.order] >= 4).astype(np.intp)
    hit = matches.label[2] >= 0
    labels = np.bincount((truth.frame >= 4).astype(np.intp), minlength=2).astype(float)
    (weighted,) = average_precision(hit, episode, labels, np.array([[1.0, 2.0]]))
    twice = np.repeat(np.arange(len(hit)), 1 + episode)
    repeated = ap_of(hit[twice], labels @ [1.0, 2.0])
    # Repeated detections have the same confidence: where hits and misses alternate, the order within is free.
    assert weighted == pytest.approx(repeated, abs=0.02)
    (only_first,) = average_precision(hit, episode, labels, np.array([[1.0, 0.0]]))
    assert only_first == pytest.approx(ap_of(hit[episode == 0], labels[0]), abs=1e-12)


def ap_of(hit: np.ndarray, labels: float) -> float:
    """Average precision of one episode."""
    (value,) = average_precision(hit, np.zeros(len(hit), dtype=np.intp), np.array([labels]), np.ones((1, 1)))
    return float(value)


def test_the_nearest_free_label_is_taken_in_the_order_of_confidence() -> None:
    truth, found = made_boxes(truth_x_m=[0.0, 1.5], found_x_m=[0.9, 1.0, 0.1], score=[0.5, 0.9, 0.7])
    matches = match(truth, found)
    assert matches.order.tolist() == [1, 2, 0]
    assert matches.label.tolist() == [[-1, 0, -1], [1, 0, -1], [1, 0, -1], [1, 0, -1]]
    equal = match(*made_boxes(truth_x_m=[0.0], found_x_m=[0.1, 0.2, 0.3], score=[0.5, 0.5, 0.6]))
    assert (equal.order.tolist(), equal.label[1].tolist()) == ([2, 1, 0], [0, -1, -1]), "of equal ones the later first"


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


def test_average_precision_by_hand() -> None:
    """Four labels; hit, miss, hit: precision falls from 1 at recall 0.25 to 1/2 there, and rises to 2/3 at 0.5.

    From recall 0.11 to 0.24 the precision is 1. Where a recall is reached twice, the last precision counts.
    """
    recall = np.arange(11, 101) / 100.0
    rising = 0.5 + (recall - 0.25) / 0.25 * (2.0 / 3.0 - 0.5)
    precision = np.where(recall < 0.25, 1.0, np.where(recall <= 0.5, rising, 0.0))
    value = ap_of(np.array([True, False, True]), 4.0)
    assert value == pytest.approx(np.maximum(precision - 0.1, 0.0).mean() / 0.9)


def test_a_resample_without_labels_leaves_the_others_their_scores() -> None:
    """The second episode has no label."""
    hit, episode, labels = np.array([True, False]), np.array([0, 1]), np.array([1.0, 0.0])
    found = average_precision(hit, episode, labels, np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 0.0], [2.0, 0.0]]))
    assert np.isnan(found).tolist() == [True, False, True, False]
    assert found[[1, 3]] == pytest.approx([1.0, 1.0])
    assert np.isnan(ap_of(np.array([True]), 0.0))


def _with_errors(found: FoundBoxes, rng: np.random.Generator) -> FoundBoxes:
    """Detections that are somewhat wrong in everything, with false alarms, and some vehicles missed."""
    kept = found.at(rng.random(len(found)) < 0.85)
    alarms = found.at(rng.random(len(found)) < 0.2)
    both = joined([kept, alarms])
    count = len(both)
    both.centre_m[:] += rng.normal(0.0, 0.6, size=(count, 3))
    both.centre_m[len(kept) :, :2] += rng.normal(0.0, 8.0, size=(len(alarms), 2))
    both.size_m[:] *= rng.uniform(0.8, 1.2, size=(count, 3))
    both.yaw_rad[:] += rng.normal(0.0, 0.3, size=count)
    both.velocity_mps[:] += rng.normal(0.0, 1.0, size=(count, 2))
    attribute = rng.integers(1, 4, size=count).astype(np.uint8)
    return replace(both, attribute=attribute, score=rng.uniform(0.05, 1.0, size=count))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.filterwarnings("ignore::FutureWarning")
def test_the_devkits_evaluation_of_the_export_gives_the_same(
    frames: Frames, sensed_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results = tmp_path / "results.json"
    write_nuscenes(results, _with_errors(labels_as_detections(frames), np.random.default_rng(5)), frames)
    dataset, out = tmp_path / "dataset", tmp_path / "out"
    options = ("--vehicle-category", "vehicle.car", "--split", "val")
    assert main(["export", "nuscenes", str(sensed_bag), "--out", str(dataset), *options]) == 0
    from nuscenes import NuScenes
    from nuscenes.eval.common.config import config_factory
    from nuscenes.eval.detection.evaluate import DetectionEval
    from nuscenes.eval.tracking.evaluate import TrackingEval

    nusc = NuScenes("v1.0-siren", str(dataset), verbose=False)
    config = config_factory("detection_cvpr_2019")
    official = DetectionEval(nusc, config, str(results), "siren_val", str(tmp_path / "official"), verbose=False)
    metrics, _ = official.evaluate()
    told = metrics.serialize()
    errors = list(told["label_tp_errors"]["car"].values())
    nds = (5.0 * told["mean_dist_aps"]["car"] + sum(1.0 - min(1.0, error) for error in errors)) / 10.0

    words = "--detections", f"noisy={results}", "--tracking", "--out", str(out)
    assert main(["evaluate", "detection", str(sensed_bag), *words]) == 0
    assert "noisy" in capsys.readouterr().out
    scores = Scores.of_json(json.loads((out / "scores.json").read_text()))
    ours = {metric: scores.value("noisy", "template", "S2", metric) for metric in ("mAP", "NDS", *ERRORS)}
    assert 0.1 < ours["mAP"] < 0.9
    assert ours["mAP"] == pytest.approx(told["mean_dist_aps"]["car"], abs=1e-6)
    assert ours["NDS"] == pytest.approx(nds, abs=1e-6)
    named = {"ATE": "trans_err", "ASE": "scale_err", "AOE": "orient_err", "AVE": "vel_err", "AAE": "attr_err"}
    for short, name in named.items():
        assert ours[short] == pytest.approx(told["label_tp_errors"]["car"][name], abs=1e-6)
    folders = str(out / "tracks_noisy.json"), "siren_val", str(tmp_path / "official"), "v1.0-siren", str(dataset)
    tracked, _ = TrackingEval(config_factory("tracking_nips_2019"), *folders, verbose=False).evaluate()
    for name in ("AMOTA", "AMOTP", "MOTA"):
        told = tracked.compute_metric(name.lower(), "car")
        assert scores.value("noisy", "tracking", "vehicle", name) == pytest.approx(told, abs=1e-6), name
    assert 0.0 < tracked.compute_metric("amota", "car") < 1.0
    assert scores.value("noisy", "tracking", "vehicle", "switches") == tracked.compute_metric("ids", "car")
    assert (out / "tracking.csv").read_text().startswith("detector,figure,vehicle")
    assert {"by_template.csv", "by_template.tex", "curves_noisy.png", "birdseye_noisy_S2.png"} <= {
        path.name for path in out.iterdir()
    }
