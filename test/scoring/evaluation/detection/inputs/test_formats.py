"""Labels through every format and back, and what is refused, with the first offender."""

import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from detection_boxes import truth_boxes
from evaluation.made_frames import made_frames, to_map

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.devkit_score import devkit_score
from siren_ros.scoring.evaluation.detection.frames import Frames, frames_of
from siren_ros.scoring.evaluation.detection.inputs import openpcdet_results
from siren_ros.scoring.evaluation.detection.inputs.formats import labels_as_detections, read_detections, self_test_sets
from siren_ros.scoring.evaluation.detection.inputs.kitti_results import write_kitti
from siren_ros.scoring.evaluation.detection.inputs.nuscenes_results import write_nuscenes
from siren_ros.scoring.evaluation.detection.inputs.openpcdet_results import openpcdet_entries
from siren_ros.scoring.evaluation.detection.scoring import VEHICLE_NAMES, counted_boxes


@pytest.fixture
def labelled() -> Frames:
    """Eight frames of two episodes, each with three labels; of each episode the third frame is a keyframe, too."""
    rows = [(frame, 8.0 + 6.0 * number, 2.0 * number) for frame in range(8) for number in range(3)]
    centre = np.array([to_map(frame, ahead, left, -1.0) for frame, ahead, left in rows])
    frame = np.array([frame for frame, *_ in rows])
    velocity = np.tile([[3.0, 1.0], [0.0, 0.0], [-2.0, 5.0]], (8, 1))
    truth = truth_boxes(frame, centre, velocity, np.linspace(-3.0, 3.0, len(rows)))
    parts = [truth.at(frame // 4 == number) for number in range(2)]
    return frames_of(
        [
            replace(episode, truth=replace(part, frame=part.frame % 4))
            for episode, part in zip(made_frames().episodes, parts, strict=True)
        ]
    )


def arrays_of(entries: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    """The same as the arrays of an .npz file."""
    tokens = "token" in entries[0].get("metadata", {})
    named = [entry["metadata"]["token"] if tokens else entry["frame_id"] for entry in entries]
    columns = {name: np.concatenate([entry[name] for entry in entries]) for name in ("name", "score", "boxes_lidar")}
    count = np.array([len(entry["name"]) for entry in entries])
    return {"token" if tokens else "frame_id": np.array(named), "count": count, **columns}


def test_labels_come_back_from_every_file_as_they_were(labelled: Frames, tmp_path: Path) -> None:
    """All frames in OpenPCDet's form, those with a picture in KITTI's, keyframes in nuScenes'."""
    given = labels_as_detections(labelled)
    write_nuscenes(tmp_path / "a.json", given, labelled)
    write_kitti(tmp_path / "kitti", given, labelled)
    for name, nuscenes in (("b.pkl", False), ("c.pickle", True)):
        (tmp_path / name).write_bytes(pickle.dumps(openpcdet_entries(given, labelled, nuscenes=nuscenes)))
        np.savez(tmp_path / name[0], **arrays_of(openpcdet_entries(given, labelled, nuscenes=nuscenes)))
    every, pictured, keyframes = np.ones(8, dtype=np.bool_), labelled.pictured, labelled.keyframe
    for name, frames in (
        ("a.json", keyframes),
        ("b.pkl", every),
        ("b.npz", every),
        ("c.pickle", keyframes),
        ("c.npz", keyframes),
        ("kitti", pictured),
    ):
        found = read_detections("mine", str(tmp_path / name), labelled)
        expected = given.at(frames[given.frame])
        assert (found.name, found.scored.tolist(), found.has_velocity) == ("mine", frames.tolist(), True)
        assert found.has_attributes is (name == "a.json")
        assert found.boxes.frame.tolist() == expected.frame.tolist()
        for column in ("centre_m", "size_m", "velocity_mps", "score"):
            assert getattr(found.boxes, column) == pytest.approx(getattr(expected, column), abs=1e-6), name
        assert np.exp(1j * found.boxes.yaw_rad) == pytest.approx(np.exp(1j * expected.yaw_rad))
        assert found.boxes.attribute.tolist() == expected.attribute.tolist()


def refused(labelled: Frames, path: Path, told: str) -> str:
    with pytest.raises(InputError, match=told) as caught:
        read_detections("x", str(path), labelled)
    return str(caught.value)


def changed(labelled: Frames, folder: Path, change: Callable[[dict[str, Any], list[str]], object]) -> Path:
    """A file of nuScenes' format after a change of its results, by tokens."""
    path = folder / "x.json"
    write_nuscenes(path, labels_as_detections(labelled), labelled)
    content = json.loads(path.read_text())
    change(content["results"], list(labelled.by_token))
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
    labelled: Frames, tmp_path: Path, key: str, value: object, told: str
) -> None:
    def change(results: dict[str, Any], tokens: list[str]) -> None:
        results[tokens[1]][1][key] = value
        results[tokens[2]][0][key] = value

    message = refused(labelled, changed(labelled, tmp_path, change), told)
    assert "episode0 step 10" in message
    assert "episode1" not in message


def test_frames_have_to_exist_and_to_be_there(labelled: Frames, tmp_path: Path) -> None:
    unknown = changed(labelled, tmp_path, lambda results, tokens: results.update({"f" * 32: results.pop(tokens[0])}))
    refused(labelled, unknown, "sample_token f")
    refused(labelled, changed(labelled, tmp_path, lambda results, tokens: results.pop(tokens[1])), "episode0 step 10")


def test_more_than_500_boxes_in_a_frame_are_refused(labelled: Frames, tmp_path: Path) -> None:
    path = changed(
        labelled, tmp_path, lambda results, tokens: results.update({tokens[0]: results[tokens[0]][:1] * 501})
    )
    refused(labelled, path, "episode0 step 0: 501 boxes")


class Evil:
    def __reduce__(self) -> tuple[Any, ...]:
        return (print, ("executed",))


@pytest.mark.parametrize(
    ("content", "told"),
    [([Evil()], r"builtins\.print"), ([{"name": np.array([Evil()], dtype=object)}], "values of the type 'O8'")],
)
def test_a_pickle_that_would_run_code_is_refused(
    labelled: Frames, tmp_path: Path, content: object, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.pkl"
    path.write_bytes(pickle.dumps(content))
    refused(labelled, path, told)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_every_protocol_of_pickles_is_read(labelled: Frames, tmp_path: Path, protocol: int) -> None:
    entries = openpcdet_entries(labels_as_detections(labelled), labelled, nuscenes=False)
    path = tmp_path / "x.pkl"
    path.write_bytes(pickle.dumps(entries, protocol))
    assert len(read_detections("x", str(path), labelled).boxes) == (labelled.truth.lidar_points > 0).sum()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"count": np.array([24, 1, 0, 0, 0, 0, 0, 0])}, "as many rows as count says"),
        ({"count": np.array([25, -1, 0, 0, 0, 0, 0, 0])}, "count is not a number"),
        ({"count": np.array([24])}, "count is not a number"),
        ({"count": np.array([3.5] * 8)}, "Cannot cast"),
        ({"name": np.array(["car"] * 23)}, "as many rows as count says"),
        ({"name": np.array([print] * 24, dtype=object)}, "allow_pickle"),
        ({"score": np.array(1.0)}, "unsized"),
        ({"name": np.full(24, 0x7FFFFFFF, "<u4").view("<U1")}, "name has a text of no characters"),
        ({"frame_id": np.array([f"{number:06d}" for number in (0, 1, 2, 3, 4, 5, 6, 6)])}, "twice"),
    ],
)
def test_arrays_are_checked(labelled: Frames, tmp_path: Path, change: dict[str, Any], told: str) -> None:
    given = arrays_of(openpcdet_entries(labels_as_detections(labelled), labelled, nuscenes=False))
    np.savez(tmp_path / "x.npz", **{**given, **change})
    refused(labelled, tmp_path / "x.npz", told)


def test_arrays_that_unpack_to_more_than_the_memory_are_not_read(
    labelled: Frames, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(openpcdet_results, "MOST_BYTES", 10_000)
    given = arrays_of(openpcdet_entries(labels_as_detections(labelled), labelled, nuscenes=False))
    np.savez_compressed(tmp_path / "x.npz", **given, more=np.zeros(5_000))
    refused(labelled, tmp_path / "x.npz", "more than 10000")
    (tmp_path / "x.npz").write_bytes(b"PK no archive")
    refused(labelled, tmp_path / "x.npz", r"an \.npz file of detections")


def test_pickles_are_checked(labelled: Frames, tmp_path: Path) -> None:
    entries = openpcdet_entries(labels_as_detections(labelled), labelled, nuscenes=False)
    path = tmp_path / "x.pkl"

    for content, told in (
        ({}, "a list of dictionaries"),
        (entries[:-1], "episode1 step 12"),
        ([*entries, entries[0]], "twice"),
        ([{**entries[0], "frame_id": "000030"}], "frame_id 000030"),
        ([{**entries[0], "boxes_lidar": np.zeros((1, 5))}, *entries[1:]], "boxes_lidar of shape"),
    ):
        path.write_bytes(pickle.dumps(content))
        refused(labelled, path, told)
    path.write_bytes(b"\x80\x04 no pickle")
    refused(labelled, path, "a pickle of")


def test_seven_numbers_are_boxes_without_velocity(labelled: Frames, tmp_path: Path) -> None:
    entries = openpcdet_entries(labels_as_detections(labelled), labelled, nuscenes=False)
    path = tmp_path / "x.pkl"
    path.write_bytes(pickle.dumps([{**entry, "boxes_lidar": entry["boxes_lidar"][:, :7]} for entry in entries]))
    found = read_detections("x", str(path), labelled)
    assert not found.has_velocity
    assert np.isnan(found.boxes.velocity_mps).all()
    assert (found.boxes.attribute == 0).all()


def test_kitti_files_are_checked(labelled: Frames, tmp_path: Path) -> None:
    folder = tmp_path / "kitti"
    write_kitti(folder, labels_as_detections(labelled), labelled)
    text = (folder / "000003.txt").read_text()

    for name, content, told in (
        ("000099.txt", "", "000099"),
        ("000003.txt", text.splitlines()[0].rsplit(" ", 3)[0], "15 words"),
        ("000003.txt", text.replace(" ", " x", 1), "could not convert"),
        ("000003.txt", "\xe9", "a text file"),
    ):
        (folder / name).write_text(content, encoding="latin-1")
        refused(labelled, folder, told)
        (folder / "000099.txt").unlink(missing_ok=True)
    (folder / "000003.txt").unlink()
    refused(labelled, folder, "no 000003.txt")


def test_what_is_no_file_of_detections_is_refused(labelled: Frames, tmp_path: Path) -> None:
    (tmp_path / "x.txt").write_text("")
    refused(labelled, tmp_path / "x.txt", "json")
    refused(labelled, Path("missing.json"), "exists")


def test_labels_score_fully_through_every_format(frames: Frames, tmp_path: Path) -> None:
    sets = self_test_sets(frames, tmp_path)
    formats = ["nuScenes results", *["OpenPCDet results"] * 2, "KITTI results", "recorded topic"]
    assert [detected.format for detected in sets] == formats
    for detected in sets:
        score = devkit_score(*counted_boxes(frames, detected, VEHICLE_NAMES))
        assert score.labels == score.detections > 10
        assert score.mean_average_precision == pytest.approx(1.0)
        errors = dict(score.errors)
        if not detected.has_velocity:
            assert (errors.pop("AVE"), errors.pop("AAE")) == (1.0, 1.0)
        assert max(errors.values()) == pytest.approx(0.0, abs=1e-5)
