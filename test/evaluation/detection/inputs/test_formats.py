"""Labels through every format and back, and what is refused, with the first offender."""

import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.detection.inputs.formats import read_detections
from siren_ros.evaluation.detection.inputs.kitti_results import write_kitti
from siren_ros.evaluation.detection.inputs.nuscenes_results import write_nuscenes
from siren_ros.evaluation.detection.inputs.openpcdet_results import openpcdet_entries
from siren_ros.evaluation.detection.metrics.devkit_score import devkit_score
from siren_ros.evaluation.detection.protocol.frames import Frames
from siren_ros.evaluation.detection.scoring import VEHICLE_NAMES, counted_boxes
from siren_ros.evaluation.detection.self_test import labels_as_detections, self_test_sets


def test_labels_score_fully_through_every_format(frames: Frames, tmp_path: Path) -> None:
    sets = self_test_sets(frames, tmp_path)
    assert [one.format for one in sets] == [
        "nuScenes results",
        "OpenPCDet results",
        "OpenPCDet results",
        "KITTI results",
        "recorded topic",
    ]
    for one in sets:
        score = devkit_score(*counted_boxes(frames, one, VEHICLE_NAMES))
        assert score.labels == score.detections > 10
        assert score.mean_average_precision == pytest.approx(1.0)
        errors = dict(score.errors)
        if not one.has_velocity:
            assert (errors.pop("AVE"), errors.pop("AAE")) == (1.0, 1.0)
        assert max(errors.values()) == pytest.approx(0.0, abs=1e-5)


def _nuscenes(frames: Frames, path: Path, change: Callable[[dict[str, Any], list[str]], None]) -> Path:
    write_nuscenes(path, labels_as_detections(frames), frames)
    content = json.loads(path.read_text())
    change(content["results"], list(frames.by_token))
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("translation", [1.0, float("nan"), 0.0], "centre"),
        ("translation", [1.0, 0.0], "translation"),
        ("size", [1.9, -4.0, 1.5], "size"),
        ("size", [1.9, 0.0, 1.5], "size"),
        ("rotation", [1.0, 0.0, 0.0, 0.5], "rotation"),
        ("detection_score", 1.2, "score"),
        ("detection_score", -0.1, "score"),
        ("detection_score", float("nan"), "score"),
        ("velocity", [float("nan"), 0.0], "velocity"),
        ("detection_name", None, "detection_name"),
    ],
)
def test_a_box_that_means_nothing_is_refused(
    frames: Frames, tmp_path: Path, key: str, value: object, told: str
) -> None:
    def change(results: dict[str, Any], tokens: list[str]) -> None:
        results[tokens[2]][1][key] = value
        results[tokens[3]][0][key] = value

    with pytest.raises(InputError, match=told) as refused:
        read_detections("x", str(_nuscenes(frames, tmp_path / "x.json", change)), frames)
    assert "step 20" in str(refused.value)
    assert "step 30" not in str(refused.value)


def test_frames_have_to_exist_and_to_be_there(frames: Frames, tmp_path: Path) -> None:
    def unknown(results: dict[str, Any], tokens: list[str]) -> None:
        results["f" * 32] = results.pop(tokens[0])

    def missing(results: dict[str, Any], tokens: list[str]) -> None:
        del results[tokens[1]]

    for change, told in ((unknown, "sample_token f"), (missing, "step 10")):
        with pytest.raises(InputError, match=told):
            read_detections("x", str(_nuscenes(frames, tmp_path / "x.json", change)), frames)


def test_more_than_500_boxes_in_a_frame_are_refused(frames: Frames, tmp_path: Path) -> None:
    def change(results: dict[str, Any], tokens: list[str]) -> None:
        results[tokens[0]] = results[tokens[0]][:1] * 501

    with pytest.raises(InputError, match="step 0: 501 boxes"):
        read_detections("x", str(_nuscenes(frames, tmp_path / "x.json", change)), frames)


class Evil:
    def __reduce__(self) -> tuple[Any, ...]:
        return (print, ("executed",))


@pytest.mark.parametrize("content", [[Evil()], [{"name": np.array([Evil()], dtype=object)}]])
def test_a_pickle_that_would_run_code_is_refused(
    frames: Frames, tmp_path: Path, content: object, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.pkl"
    path.write_bytes(pickle.dumps(content))
    with pytest.raises(InputError, match=r"builtins\.print"):
        read_detections("x", str(path), frames)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_every_protocol_of_pickles_is_read(frames: Frames, tmp_path: Path, protocol: int) -> None:
    entries = openpcdet_entries(labels_as_detections(frames), frames, nuscenes=False)
    path = tmp_path / "x.pkl"
    path.write_bytes(pickle.dumps(entries, protocol))
    assert len(read_detections("x", str(path), frames).boxes) == (frames.truth.lidar_points > 0).sum()


def test_pickles_are_checked(frames: Frames, tmp_path: Path) -> None:
    entries = openpcdet_entries(labels_as_detections(frames), frames, nuscenes=False)
    path = tmp_path / "x.pkl"

    def refused(content: object, told: str) -> None:
        path.write_bytes(pickle.dumps(content))
        with pytest.raises(InputError, match=told):
            read_detections("x", str(path), frames)

    refused({}, "a list of dictionaries")
    refused(entries[:-1], "step 38")
    refused([*entries, entries[0]], "twice")
    refused([{**entries[0], "frame_id": "000030"}], "frame_id 000030")
    refused([{**entries[0], "boxes_lidar": np.zeros((1, 5))}, *entries[1:]], "boxes_lidar of shape")
    path.write_bytes(b"\x80\x04 no pickle")
    with pytest.raises(InputError, match="a pickle of"):
        read_detections("x", str(path), frames)


def test_seven_numbers_are_boxes_without_velocity(frames: Frames, tmp_path: Path) -> None:
    entries = openpcdet_entries(labels_as_detections(frames), frames, nuscenes=False)
    path = tmp_path / "x.pkl"
    path.write_bytes(pickle.dumps([{**entry, "boxes_lidar": entry["boxes_lidar"][:, :7]} for entry in entries]))
    found = read_detections("x", str(path), frames)
    assert not found.has_velocity
    assert np.isnan(found.boxes.velocity_mps).all()
    assert (found.boxes.attribute == 0).all()


def test_kitti_files_are_checked(frames: Frames, tmp_path: Path) -> None:
    folder = tmp_path / "kitti"
    write_kitti(folder, labels_as_detections(frames), frames)
    text = (folder / "000003.txt").read_text()

    def refused(name: str, content: str | None, told: str) -> None:
        before = (folder / name).read_text() if (folder / name).exists() else None
        if content is None:
            (folder / name).unlink()
        else:
            (folder / name).write_text(content)
        with pytest.raises(InputError, match=told):
            read_detections("x", str(folder), frames)
        if before is None:
            (folder / name).unlink()
        else:
            (folder / name).write_text(before)

    refused("000003.txt", None, "no 000003.txt")
    refused("000099.txt", "", "000099")
    refused("000003.txt", text.splitlines()[0].rsplit(" ", 3)[0], "15 words")
    refused("000003.txt", text.replace(" ", " x", 1), "could not convert")


def test_what_is_no_file_of_detections_is_refused(frames: Frames, tmp_path: Path) -> None:
    (tmp_path / "x.txt").write_text("")
    for source, told in ((str(tmp_path / "x.txt"), "json"), ("missing.json", "exists"), ("topic:/nothing", "boxes")):
        with pytest.raises(InputError, match=told):
            read_detections("x", source, frames)
