"""AMOTA and AMOTP of tracks by hand, intervals from episodes, and the same by the devkit's evaluation of the export."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from evaluation.detection.test_hota import joined, table

from siren_ros.cli.main import main
from siren_ros.scoring.evaluation.detection.devkit_tracking import DevkitTracking, devkit_tracking
from siren_ros.scoring.evaluation.detection.frames import Frames
from siren_ros.scoring.evaluation.detection.hota import TrackTable
from siren_ros.scoring.evaluation.detection.inputs.formats import labels_as_detections
from siren_ros.scoring.evaluation.detection.inputs.nuscenes_results import write_nuscenes

pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::FutureWarning"),
]
FRAMES = 8


def vehicle(episode: int, x_m: float, track: int, away_m: float = 0.0) -> TrackTable:
    first = FRAMES * episode
    return table(*((frame, x_m + away_m, track) for frame in range(first, first + FRAMES)), episode=episode)


def scored(labels: TrackTable, found: TrackTable, episodes: int = 1) -> DevkitTracking:
    frames = [list(range(FRAMES * one, FRAMES * (one + 1))) for one in range(episodes)]
    return devkit_tracking(labels, found, frames)


def test_the_labels_themselves_are_perfect() -> None:
    labels = joined(vehicle(0, 0.0, 1), vehicle(0, 20.0, 2))
    score = scored(labels, labels)
    assert (score.labels, score.amota, score.amotp_m, score.mota, score.switches) == (2, 1.0, 0.0, 1.0, 0.0)
    assert score.confidence == 0.5


def test_half_a_metre_away_is_a_precision_of_half_a_metre() -> None:
    score = scored(vehicle(0, 0.0, 1), vehicle(0, 0.0, 1, away_m=0.5))
    assert (score.amota, score.amotp_m) == pytest.approx((1.0, 0.5))


def test_nothing_found_is_the_worst_of_all() -> None:
    score = scored(vehicle(0, 0.0, 1), vehicle(0, 50.0, 1))
    assert (score.amota, score.amotp_m) == (0.0, 2.0)
    assert np.isnan(score.confidence)


def test_a_change_of_the_number_counts() -> None:
    whole = vehicle(0, 0.0, 1)
    changed = replace(whole, track=np.repeat([1, 2], FRAMES // 2))
    score = scored(whole, changed)
    assert score.switches == 1.0
    assert score.mota == pytest.approx(1.0 - 1.0 / FRAMES)


def test_without_an_episode_the_score_is_that_of_the_others() -> None:
    """All confidences are equal, so that the thresholds do not depend on the episodes: an exact comparison."""
    labels = joined(*(vehicle(one, 10.0 * place, 10 * one + place) for one in range(3) for place in range(3)))
    found = joined(
        *(vehicle(one, 10.0 * place, 10 * one + place, away_m=0.3 * one) for one in range(3) for place in range(3)),
        *(vehicle(one, 60.0 + 5.0 * place, 100 + 10 * one + place) for one in range(3) for place in range(one)),
    )
    found = found.at(np.lexsort((found.frame, found.episode)))
    score = scored(labels, found, 3)
    for left_out in range(3):
        kept = [np.flatnonzero(side.episode != left_out) for side in (labels, found)]
        others = scored(labels.at(kept[0]), found.at(kept[1]), 3)
        assert score.left_out["amota"][left_out] == pytest.approx(others.amota)
        assert score.left_out["amotp_m"][left_out] == pytest.approx(others.amotp_m)


def test_the_devkits_evaluation_of_the_export_gives_the_same(frames: Frames, sensed_bag: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    boxes = labels_as_detections(frames)
    boxes = boxes.at(np.flatnonzero(rng.random(len(boxes)) < 0.8))
    boxes.centre_m[:, :2] += rng.normal(0.0, 0.3, size=(len(boxes), 2))
    results, dataset, out = tmp_path / "results.json", tmp_path / "dataset", tmp_path / "out"
    write_nuscenes(results, boxes, frames)
    assert main(["evaluate", "detection", str(sensed_bag), "--detections", f"noisy={results}", "--tracking",
                 "--out", str(out)]) == 0  # fmt: skip
    ours = json.loads((out / "scores.json").read_text())["noisy"]["tracking"]["vehicle"]
    options = ("--vehicle-category", "vehicle.car", "--split", "val")
    assert main(["export", "nuscenes", str(sensed_bag), "--out", str(dataset), *options]) == 0
    from nuscenes.eval.common.config import config_factory
    from nuscenes.eval.tracking.evaluate import TrackingEval

    official = TrackingEval(
        config_factory("tracking_nips_2019"), str(out / "tracks_noisy.json"), "siren_val",
        str(tmp_path / "official"), "v1.0-siren", str(dataset), verbose=False,
    )  # fmt: skip
    metrics, _ = official.evaluate()
    assert 0.0 < ours["AMOTA"]["value"] < 1.0
    assert ours["AMOTA"]["value"] == pytest.approx(metrics.compute_metric("amota", "car"), abs=1e-6)
    assert ours["AMOTP"]["value"] == pytest.approx(metrics.compute_metric("amotp", "car"), abs=1e-6)
    assert ours["MOTA"] == pytest.approx(metrics.compute_metric("mota", "car"), abs=1e-6)
    assert ours["switches"] == metrics.compute_metric("ids", "car")
    assert (out / "tracking.csv").read_text().startswith("detector,figure,vehicle")
