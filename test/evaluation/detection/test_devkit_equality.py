"""nuscenes-devkit's own evaluation of the exported dataset gives the same score."""

import json
from pathlib import Path

import numpy as np
import pytest
from nuscenes import NuScenes
from nuscenes.eval.common.config import config_factory
from nuscenes.eval.detection.evaluate import DetectionEval

from siren_ros.cli.main import main
from siren_ros.evaluation.detection.boxes import FoundBoxes
from siren_ros.evaluation.detection.frames import Frames
from siren_ros.evaluation.detection.inputs.formats import labels_as_detections
from siren_ros.evaluation.detection.inputs.nuscenes_results import write_nuscenes


def _with_errors(found: FoundBoxes, rng: np.random.Generator) -> FoundBoxes:
    """Detections that are somewhat wrong in everything, with false alarms, and some vehicles missed."""
    kept = found.at(rng.random(len(found)) < 0.85)
    alarms = found.at(rng.random(len(found)) < 0.2)
    rows = [*range(len(kept)), *range(len(alarms))]
    both = {
        name: np.concatenate((getattr(kept, name), getattr(alarms, name))) for name in FoundBoxes.__dataclass_fields__
    }
    count = len(rows)
    both["centre_m"] = both["centre_m"] + rng.normal(0.0, 0.6, size=(count, 3))
    both["centre_m"][len(kept) :, :2] += rng.normal(0.0, 8.0, size=(len(alarms), 2))
    both["size_m"] = both["size_m"] * rng.uniform(0.8, 1.2, size=(count, 3))
    both["yaw_rad"] = both["yaw_rad"] + rng.normal(0.0, 0.3, size=count)
    both["velocity_mps"] = both["velocity_mps"] + rng.normal(0.0, 1.0, size=(count, 2))
    both["attribute"] = rng.integers(1, 4, size=count).astype(np.uint8)
    both["score"] = rng.uniform(0.05, 1.0, size=count)
    return FoundBoxes(**both)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_the_devkits_evaluation_of_the_export_gives_the_same(
    frames: Frames, sensed_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results = tmp_path / "results.json"
    write_nuscenes(results, _with_errors(labels_as_detections(frames), np.random.default_rng(5)), frames)
    dataset, out = tmp_path / "dataset", tmp_path / "out"
    options = ("--vehicle-category", "vehicle.car", "--split", "val")
    assert main(["export", "nuscenes", str(sensed_bag), "--out", str(dataset), *options]) == 0
    nusc = NuScenes("v1.0-siren", str(dataset), verbose=False)
    config = config_factory("detection_cvpr_2019")
    official = DetectionEval(nusc, config, str(results), "siren_val", str(tmp_path / "official"), verbose=False)
    metrics, _ = official.evaluate()
    told = metrics.serialize()
    errors = list(told["label_tp_errors"]["car"].values())
    nds = (5.0 * told["mean_dist_aps"]["car"] + sum(1.0 - min(1.0, error) for error in errors)) / 10.0

    assert main(["evaluate", "detection", str(sensed_bag), "--detections", f"noisy={results}", "--out", str(out)]) == 0
    assert "noisy" in capsys.readouterr().out
    ours = json.loads((out / "scores.json").read_text())["noisy"]["templates"]["S2"]
    assert 0.1 < ours["mAP"]["value"] < 0.9
    assert ours["mAP"]["value"] == pytest.approx(told["mean_dist_aps"]["car"], abs=1e-6)
    assert ours["NDS"] == pytest.approx(nds, abs=1e-6)
    named = {"ATE": "trans_err", "ASE": "scale_err", "AOE": "orient_err", "AVE": "vel_err", "AAE": "attr_err"}
    for short, name in named.items():
        assert ours["errors"][short] == pytest.approx(told["label_tp_errors"]["car"][name], abs=1e-6)
    assert {"by_template.csv", "by_template.tex", "curves_noisy.png", "birdseye_noisy_S2.png"} <= {
        path.name for path in out.iterdir()
    }
