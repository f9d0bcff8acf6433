"""One box in each format, written by hand from the format's own description, and where it lies in the map."""

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from evaluation.made_frames import GLOBAL_M, LIDAR_YAW_RAD, made_frames, to_map

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.boxes import FoundBoxes
from siren_ros.scoring.evaluation.detection.frames import Frames
from siren_ros.scoring.evaluation.detection.inputs.formats import read_detections
from siren_ros.scoring.evaluation.detection.inputs.kitti_results import write_kitti
from siren_ros.scoring.evaluation.detection.inputs.nuscenes_results import write_nuscenes
from siren_ros.scoring.evaluation.detection.inputs.openpcdet_results import openpcdet_entries
from siren_ros.scoring.evaluation.detection.inputs.stated_boxes import quaternions_of_yaw, yaws_of_quaternions

TURNED = np.array([[np.cos(LIDAR_YAW_RAD), -np.sin(LIDAR_YAW_RAD)], [np.sin(LIDAR_YAW_RAD), np.cos(LIDAR_YAW_RAD)]])


@pytest.fixture
def frames() -> Frames:
    return made_frames()


def as_angle(yaw_rad: float) -> float:
    return float(np.arctan2(np.sin(yaw_rad), np.cos(yaw_rad)))


def refused(path: Path, frames: Frames, told: str) -> None:
    with pytest.raises(InputError, match=told):
        read_detections("x", str(path), frames)


def kitti_folder(folder: Path, fifth: str = "") -> Path:
    """Files of the six pictures; the fifth one is the third frame of the second episode: its second frame has none."""
    (folder / "kitti").mkdir()
    for number in range(6):
        (folder / f"kitti/{number:06d}.txt").write_text(fifth if number == 4 else "\n")
    return folder / "kitti"


BARE = [12.0, 3.0, -1.0, 4.5, 1.9, 1.6, 0.4]
"""A box without velocity."""


def write_openpcdet(path: Path, boxes: dict[int, list[list[float]]], count: int = 8) -> Path:
    width = max(len(rows[0]) for rows in boxes.values())
    entries = [
        {
            "frame_id": f"{frame:06d}",
            "name": np.array(["Car"] * len(boxes.get(frame, ()))),
            "score": np.linspace(0.7, 0.6, len(boxes.get(frame, ()))),
            "boxes_lidar": np.array(boxes.get(frame, np.zeros((0, width)))),
        }
        for frame in range(count)
    ]
    path.write_bytes(pickle.dumps(entries))
    return path


def test_openpcdet_boxes_are_in_the_lidars_frame(frames: Frames, tmp_path: Path) -> None:
    """Frame 5 is the second one of the second episode."""
    path = write_openpcdet(
        tmp_path / "x.pkl",
        {5: [[12.0, 3.0, -1.0, 4.5, 1.9, 1.6, 0.4, 5.0, -2.0], [8.0, -6.0, -1.2, 10, 2.5, 3, -3, 0, 0]]},
    )
    found = read_detections("x", str(path), frames)
    assert found.has_velocity
    assert found.scored.all()
    assert found.boxes.frame.tolist() == [5, 5]
    assert found.boxes.centre_m == pytest.approx(np.array([to_map(5, 12.0, 3.0, -1.0), to_map(5, 8.0, -6.0, -1.2)]))
    assert found.boxes.size_m == pytest.approx(np.array([[4.5, 1.9, 1.6], [10.0, 2.5, 3.0]]))
    assert [as_angle(yaw) for yaw in found.boxes.yaw_rad] == pytest.approx([0.4 + LIDAR_YAW_RAD, -3.0 + LIDAR_YAW_RAD])
    assert found.boxes.velocity_mps == pytest.approx(np.array([TURNED @ (5.0, -2.0), (0.0, 0.0)]))
    assert found.boxes.score == pytest.approx([0.7, 0.6])
    assert found.boxes.label.tolist() == ["car", "car"]
    assert found.boxes.attribute.tolist() == [1, 2]


def test_openpcdets_nuscenes_frames_have_x_to_the_right(frames: Frames, tmp_path: Path) -> None:
    """A box 12 m ahead and 3 m to the left that points ahead and moves to the left."""
    (token, *_), path = frames.by_token, tmp_path / "x.pkl"
    entries = [
        {
            "metadata": {"token": one},
            "name": np.array(["car"] * (one == token)),
            "score": np.full(int(one == token), 0.5),
            "boxes_lidar": np.array([[-3.0, 12.0, -1.0, 4.5, 1.9, 1.6, np.pi / 2.0, -4.0, 0.0]] * (one == token)),
        }
        for one in frames.by_token
    ]
    path.write_bytes(pickle.dumps(entries))
    found = read_detections("x", str(path), frames)
    assert found.scored.tolist() == [True, False, True, False] * 2
    assert found.boxes.frame.tolist() == [0]
    assert found.boxes.centre_m[0] == pytest.approx(to_map(0, 12.0, 3.0, -1.0))
    assert as_angle(found.boxes.yaw_rad[0]) == pytest.approx(LIDAR_YAW_RAD)
    assert found.boxes.velocity_mps[0] == pytest.approx(TURNED @ (0.0, 4.0))


def test_nuscenes_boxes_are_in_the_global_frame(frames: Frames, tmp_path: Path) -> None:
    """Width before length; frame 6 is the second keyframe of the second episode, whose map begins farther away."""
    token = next(token for token, frame in frames.by_token.items() if frame == 6)
    box = {
        "translation": [2.0 * GLOBAL_M[0] + 40.0, 2.0 * GLOBAL_M[1] - 7.0, 0.8],
        "size": [1.9, 4.5, 1.6],
        "rotation": [np.cos(0.6), 0.0, 0.0, np.sin(0.6)],
        "velocity": [3.0, -1.0],
        "detection_name": "Car",
        "detection_score": 0.25,
        "attribute_name": "vehicle.parked",
    }
    path = tmp_path / "x.json"
    path.write_text(json.dumps({"meta": {}, "results": {one: [box] * (one == token) for one in frames.by_token}}))
    found = read_detections("x", str(path), frames)
    assert found.has_velocity
    assert found.has_attributes
    assert found.boxes.frame.tolist() == [6]
    assert found.boxes.centre_m[0] == pytest.approx([40.0, -7.0, 0.8])
    assert found.boxes.size_m[0].tolist() == [4.5, 1.9, 1.6]
    assert found.boxes.yaw_rad[0] == pytest.approx(1.2)
    assert found.boxes.velocity_mps[0].tolist() == [3.0, -1.0]
    assert (found.boxes.score[0], found.boxes.label[0], found.boxes.attribute[0]) == (0.25, "car", 3)


@pytest.mark.parametrize("velocity", [True, False])
def test_kitti_boxes_are_in_the_cameras_frame(frames: Frames, tmp_path: Path, *, velocity: bool) -> None:
    """A car 20 m ahead of the camera, 3 m to its left, whose bottom is 1.6 m below; it points 0.3 rad to the left.

    KITTI's rotation is about the axis down and 0 to the right: ahead is −π/2, and to the left of that is less.
    """
    rotation = -np.pi / 2.0 - 0.3
    line = f"Car 0 0 0 1 2 3 4 1.5 1.8 4.2 -3.0 1.6 20.0 {rotation:.9f} 0.8"
    folder = kitti_folder(tmp_path, f"{line} -2.0 6.0\n" if velocity else f"{line}\n")
    found = read_detections("x", str(folder), frames)
    assert found.has_velocity is velocity
    assert found.scored.tolist() == [True, False, True, True] * 2
    assert found.boxes.frame.tolist() == [6]
    # The camera is 1.5 m ahead of the LiDAR and 0.5 m below it; the centre is half a height above the bottom.
    assert found.boxes.centre_m[0] == pytest.approx(to_map(6, 20.0 + 1.5, 3.0, -0.5 - 1.6 + 0.75))
    assert found.boxes.size_m[0].tolist() == [4.2, 1.8, 1.5]
    assert as_angle(found.boxes.yaw_rad[0]) == pytest.approx(LIDAR_YAW_RAD + 0.3)
    if velocity:
        assert found.boxes.velocity_mps[0] == pytest.approx(TURNED @ (6.0, 2.0))
    else:
        assert np.isnan(found.boxes.velocity_mps).all()
    assert (found.boxes.score[0], found.boxes.label[0]) == (0.8, "car")


def test_kitti_needs_a_front_camera(tmp_path: Path) -> None:
    refused(kitti_folder(tmp_path), made_frames(camera=False), "front camera")


def one_found() -> FoundBoxes:
    """A box of frame 6, which has a picture and is a keyframe."""
    return FoundBoxes(
        frame=np.array([6]),
        centre_m=np.array([to_map(6, 21.5, 3.0, -1.35)]),
        size_m=np.array([[4.2, 1.8, 1.5]]),
        yaw_rad=np.array([LIDAR_YAW_RAD + 0.3]),
        velocity_mps=np.array([TURNED @ (6.0, 2.0)]),
        attribute=np.array([3], dtype=np.uint8),
        score=np.array([0.8]),
        label=np.array(["car"]),
    )


def test_what_is_written_has_each_formats_numbers(frames: Frames, tmp_path: Path) -> None:
    write_kitti(tmp_path / "kitti", one_found(), frames)
    texts = [path.read_text().split() for path in sorted((tmp_path / "kitti").iterdir())]
    assert [len(words) for words in texts] == [0, 0, 0, 0, 18, 0]
    assert texts[4][0] == "Car"
    expected = [1.5, 1.8, 4.2, -3.0, 1.6, 20.0, -np.pi / 2.0 - 0.3, 0.8, -2.0, 6.0]
    assert [float(word) for word in texts[4][8:]] == pytest.approx(expected, abs=1e-8)

    write_nuscenes(tmp_path / "x.json", one_found(), frames)
    results: dict[str, list[dict[str, Any]]] = json.loads((tmp_path / "x.json").read_text())["results"]
    (box,) = (box for boxes in results.values() for box in boxes)
    assert list(results) == list(frames.by_token)
    assert frames.by_token[box["sample_token"]] == 6
    centre = to_map(6, 21.5, 3.0, -1.35)
    assert box["translation"] == pytest.approx([centre[0] + 2 * GLOBAL_M[0], centre[1] + 2 * GLOBAL_M[1], centre[2]])
    assert box["size"] == [1.8, 4.2, 1.5]
    half = 0.5 * (LIDAR_YAW_RAD + 0.3)
    assert box["rotation"] == pytest.approx([np.cos(half), 0.0, 0.0, np.sin(half)])
    assert box["attribute_name"] == "vehicle.parked"

    entries = openpcdet_entries(one_found(), frames, nuscenes=False)
    assert [len(entry["score"]) for entry in entries] == [0] * 6 + [1, 0]
    assert entries[6]["boxes_lidar"][0] == pytest.approx([21.5, 3.0, -1.35, 4.2, 1.8, 1.5, 0.3, 6.0, 2.0])
    keyframes = openpcdet_entries(one_found(), frames, nuscenes=True)
    assert [frames.by_token[entry["metadata"]["token"]] for entry in keyframes] == [0, 2, 4, 6]
    # x to the right, y ahead; a heading from x to y.
    right = keyframes[3]["boxes_lidar"][0]
    assert right == pytest.approx([-3.0, 21.5, -1.35, 4.2, 1.8, 1.5, 0.3 + np.pi / 2.0, -2.0, 6.0])


@pytest.mark.parametrize("yaw_rad", [-3.0, -1.0, 0.0, 0.5, 3.1])
def test_quaternions_of_headings(yaw_rad: float) -> None:
    (rotation,) = quaternions_of_yaw(np.array([yaw_rad]))
    assert rotation == pytest.approx([np.cos(yaw_rad / 2.0), 0.0, 0.0, np.sin(yaw_rad / 2.0)])
    # Tilted about its own length the box has the same heading.
    w, _, _, z = rotation
    cos, sin = np.cos(0.2), np.sin(0.2)
    tilted = np.array([[w * cos, w * sin, z * sin, z * cos]])
    assert yaws_of_quaternions(tilted) == pytest.approx([yaw_rad])


def test_the_first_box_that_means_nothing_is_named(frames: Frames, tmp_path: Path) -> None:
    good, long = [*BARE, 5.0, -2.0], [12.0, 3.0, -1.0, 4.5, -1.9, 1.6, 0.4, 5.0, -2.0]
    path = write_openpcdet(tmp_path / "x.pkl", {5: [good, good], 6: [good, long, long]})
    refused(path, frames, r"episode1 step 10, box 1: size \[4.5, -1.9, 1.6\]")


def test_boxes_may_lack_the_velocity_only_where_the_format_has_none(frames: Frames, tmp_path: Path) -> None:
    path = write_openpcdet(tmp_path / "x.pkl", {0: [BARE]})
    assert not read_detections("x", str(path), frames).has_velocity
    path = write_openpcdet(tmp_path / "y.pkl", {0: [[*BARE, float("nan"), 0.0]]})
    refused(path, frames, "velocity")
    path = write_openpcdet(tmp_path / "z.pkl", {0: [[*BARE, 1.0]]})
    refused(path, frames, r"shape \(1, 8\)")


def test_a_file_in_which_nothing_was_found(frames: Frames, tmp_path: Path) -> None:
    """Whatever the shape of no box is."""
    path = tmp_path / "x.pkl"
    for nothing in (np.zeros((0, 7)), np.zeros((0, 9)), np.zeros(0), []):
        entry = {"name": np.zeros(0, dtype=np.str_), "score": np.zeros(0), "boxes_lidar": nothing}
        path.write_bytes(pickle.dumps([{**entry, "frame_id": f"{frame:06d}"} for frame in range(8)]))
        found = read_detections("x", str(path), frames)
        assert len(found.boxes) == 0
        assert found.scored.all()


def test_some_frames_may_have_no_box(frames: Frames, tmp_path: Path) -> None:
    path = tmp_path / "x.pkl"
    empty = {"name": np.zeros(0, dtype=np.str_), "score": np.zeros(0), "boxes_lidar": np.zeros(0)}
    full = {"name": np.array(["Car"]), "score": np.array([0.5]), "boxes_lidar": np.array([[*BARE, 5.0, -2.0]])}
    entries = [{**(full if frame in (2, 7) else empty), "frame_id": str(frame)} for frame in range(8)]
    path.write_bytes(pickle.dumps(entries))
    assert read_detections("x", str(path), frames).boxes.frame.tolist() == [2, 7]


def test_a_frame_that_comes_twice_or_not_at_all_is_named(frames: Frames, tmp_path: Path) -> None:
    path = write_openpcdet(tmp_path / "x.pkl", {0: [BARE]})
    entries = pickle.loads(path.read_bytes())  # noqa: S301 - written above
    path.write_bytes(pickle.dumps([*entries, entries[5]]))
    refused(path, frames, "episode1 step 2 twice")
    path.write_bytes(pickle.dumps([*entries[:3], *entries[4:]]))
    refused(path, frames, "nothing for episode0 step 12")


def test_a_frame_behind_the_last_one_is_refused(frames: Frames, tmp_path: Path) -> None:
    path = write_openpcdet(tmp_path / "x.pkl", {0: [BARE]}, 9)
    refused(path, frames, r"frame_id 000008.*frames 000000 to 000007 of the given bags")


@pytest.mark.parametrize(("first", "second", "named"), [(" -2.0 6.0", "", 1), ("", " -2.0 6.0", 0)])
def test_where_a_line_of_kitti_has_a_velocity_all_need_one(
    frames: Frames, tmp_path: Path, first: str, second: str, named: int
) -> None:
    line = "Car 0 0 0 1 2 3 4 1.5 1.8 4.2 -3.0 1.6 20.0 0.0 0.8"
    folder = kitti_folder(tmp_path, f"{line}{first}\n{line}{second}\n")
    refused(folder, frames, rf"box {named}: velocity \[nan, nan\]")
