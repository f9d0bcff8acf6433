"""Detections of other programs in each format, by hand and of labels, and what is refused, with the first offender."""

import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from datasets.made_bag import LIDAR_M, BagSpec, place_of, truth_of, write_made_bag, yaw_of
from known_outputs import assert_known
from made_detections import busy_episodes, made_frames, to_map, truth_boxes
from rosbags.typesys.store import Typestore

from siren_ros.data.episode_source import Need, in_dataset_order, survey_bag
from siren_ros.data.interfaces.topics import BOXES, GROUND_TRUTH
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection import openpcdet_results
from siren_ros.scoring.evaluation.detection.boxes import quaternions_of_yaw, yaws_of_quaternions
from siren_ros.scoring.evaluation.detection.frames import Frames, frames_of, read_frames
from siren_ros.scoring.evaluation.detection.openpcdet_results import openpcdet_entries
from siren_ros.scoring.evaluation.detection.result_files import (
    labels_as_detections,
    read_detections,
    read_topic,
    write_kitti,
    write_nuscenes,
    write_nuscenes_tracks,
)


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
    scored = {"a.json": keyframes, "b.pkl": every, "b.npz": every, "c.pickle": keyframes, "c.npz": keyframes}
    for name, frames in {**scored, "kitti": pictured}.items():
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


def test_frames_are_checked(labelled: Frames, tmp_path: Path) -> None:
    """Frames exist, are there, and have at most 500 boxes; files are of a known kind."""
    changes: tuple[tuple[Callable[[dict[str, Any], list[str]], object], str], ...] = (
        (lambda results, tokens: results.update({"f" * 32: results.pop(tokens[0])}), "sample_token f"),
        (lambda results, tokens: results.pop(tokens[1]), "episode0 step 10"),
        (lambda results, tokens: results.update({tokens[0]: results[tokens[0]][:1] * 501}), "step 0: 501 boxes"),
    )
    for change, told in changes:
        refused(labelled, changed(labelled, tmp_path, change), told)
    (tmp_path / "x.txt").write_text("")
    refused(labelled, tmp_path / "x.txt", "json")
    refused(labelled, Path("missing.json"), "exists")


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


def test_frames_of_openpcdet_are_checked(labelled: Frames, tmp_path: Path) -> None:
    entries = openpcdet_entries(labels_as_detections(labelled), labelled, nuscenes=False)
    thin = entries[6]["boxes_lidar"].copy()
    thin[1:, 4] = -1.9
    for content, told in (
        (entries[:-1], "nothing for episode1 step 12"),
        ([*entries[:3], *entries[4:]], "nothing for episode0 step 12"),
        ([*entries, entries[5]], "episode1 step 2 twice"),
        ([{**entries[0], "frame_id": "000030"}], "frame_id 000030"),
        ([*entries, {**entries[0], "frame_id": "000008"}], "000008.*frames 000000 to 000007 of the given bags"),
        ([*entries[:6], {**entries[6], "boxes_lidar": thin}, entries[7]], "episode1 step 10, box 1: size .*-1.9"),
    ):
        np.savez(tmp_path / "x.npz", **arrays_of(content))
        refused(labelled, tmp_path / "x.npz", told)
    path = tmp_path / "x.pkl"
    broken = [{**entries[0], "boxes_lidar": np.zeros((1, 5))}, *entries[1:]]
    for raw, told in ((pickle.dumps(broken), "boxes_lidar of shape"), (b"\x80\x04 no pickle", "a pickle of")):
        path.write_bytes(raw)
        refused(labelled, path, told)


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
    line = "Car 0 0 0 1 2 3 4 1.5 1.8 4.2 -3.0 1.6 20.0 0.0 0.8"
    for number, (first, second) in enumerate(((" -2.0 6.0", ""), ("", " -2.0 6.0"))):
        (folder / "000003.txt").write_text(f"{line}{first}\n{line}{second}\n")
        refused(labelled, folder, rf"box {1 - number}: velocity \[nan, nan\]")
    (folder / "000003.txt").write_text(text)
    refused(made_frames(camera=False), folder, "front camera")


@pytest.fixture
def turned_frames() -> Frames:
    return made_frames()


BARE = [12.0, 3.0, -1.0, 4.5, 1.9, 1.6, 0.4]
"""A box without velocity."""


def write_openpcdet(path: Path, boxes: dict[int, list[list[float]]]) -> Path:
    width = max(len(rows[0]) for rows in boxes.values())
    entries = [
        {
            "frame_id": f"{frame:06d}",
            "name": np.array(["Car"] * len(boxes.get(frame, ()))),
            "score": np.linspace(0.7, 0.6, len(boxes.get(frame, ()))),
            "boxes_lidar": np.array(boxes.get(frame, np.zeros((0, width)))),
        }
        for frame in range(8)
    ]
    path.write_bytes(pickle.dumps(entries))
    return path


def test_what_other_programs_write(labelled: Frames, tmp_path: Path) -> None:
    """KITTI's files have no velocities, its names are capital; an attribute that nuScenes does not know is none."""
    write_kitti(tmp_path / "kitti", labels_as_detections(labelled), labelled)
    for file in (tmp_path / "kitti").iterdir():
        lines = [line.rsplit(" ", 2)[0] for line in file.read_text().splitlines()]
        file.write_text("".join(f"{line[0].upper()}{line[1:]}\n" for line in lines))
    found = read_detections("x", str(tmp_path / "kitti"), labelled)
    assert (found.has_velocity, set(found.boxes.label.tolist())) == (False, {"car"})
    assert np.isnan(found.boxes.velocity_mps).all()

    def change(results: dict[str, Any], tokens: list[str]) -> None:
        results[tokens[1]][1] |= {"attribute_name": "vehicle.flying", "detection_name": "Car"}

    found = read_detections("x", str(changed(labelled, tmp_path, change)), labelled)
    assert np.flatnonzero(found.boxes.attribute == 0).tolist() == [4]
    assert set(found.boxes.label.tolist()) == {"car"}


@pytest.mark.parametrize("yaw_rad", [-3.0, -1.0, 0.0, 0.5, 3.1])
def test_quaternions_of_headings(yaw_rad: float) -> None:
    (rotation,) = quaternions_of_yaw(np.array([yaw_rad]))
    assert rotation == pytest.approx([np.cos(yaw_rad / 2.0), 0.0, 0.0, np.sin(yaw_rad / 2.0)])
    # Tilted about its own length the box has the same heading.
    w, _, _, z = rotation
    cos, sin = np.cos(0.2), np.sin(0.2)
    tilted = np.array([[w * cos, w * sin, z * sin, z * cos]])
    assert yaws_of_quaternions(tilted) == pytest.approx([yaw_rad])


def test_boxes_may_lack_the_velocity_only_where_the_format_has_none(turned_frames: Frames, tmp_path: Path) -> None:
    found = read_detections("x", str(write_openpcdet(tmp_path / "x.pkl", {0: [BARE]})), turned_frames)
    assert not found.has_velocity
    assert np.isnan(found.boxes.velocity_mps).all()
    assert found.boxes.attribute.tolist() == [0]
    more = [*BARE, float("nan"), 0.0]
    refused(turned_frames, write_openpcdet(tmp_path / "x.pkl", {0: [more]}), "velocity")


@pytest.mark.parametrize(("nothing", "found_in"), [(np.zeros((0, 9)), ()), ([], ()), (np.zeros(0), (2, 7))])
def test_frames_in_which_nothing_was_found(
    turned_frames: Frames, tmp_path: Path, nothing: object, found_in: tuple[int, ...]
) -> None:
    """Whatever the shape of no box is."""
    full = {"name": np.array(["Car"]), "score": np.array([0.5]), "boxes_lidar": np.array([[*BARE, 5.0, -2.0]])}
    path = tmp_path / "x.pkl"
    empty = {"name": np.zeros(0, dtype=np.str_), "score": np.zeros(0), "boxes_lidar": nothing}
    entries = [{**(full if frame in found_in else empty), "frame_id": str(frame)} for frame in range(8)]
    path.write_bytes(pickle.dumps(entries))
    found = read_detections("x", str(path), turned_frames)
    assert found.boxes.frame.tolist() == list(found_in)
    assert found.scored.all()


SWEEPS = (8, 4)
"""Of two episodes: at every second step from 4 on."""


def frames_with(folder: Path, store: Typestore, boxes_frame: str) -> Frames:
    made = [BagSpec(steps=4 + 2 * count, seed=seed, boxes_frame=boxes_frame) for seed, count in enumerate(SWEEPS)]
    bags = [write_made_bag(folder / f"seed{episode.seed}", store, episode) for episode in made]
    surveys = [survey_bag(bag, "detection", (Need.LIDAR,), folder) for bag in bags]
    return frames_of([read_frames(*one) for one in in_dataset_order(surveys)])


def placed(step: int, local_m: np.ndarray) -> np.ndarray:
    """A place of the vehicle's frame in the map's."""
    cos, sin = np.cos(yaw_of(step)), np.sin(yaw_of(step))
    turned = [local_m[0] * cos - local_m[1] * sin, local_m[0] * sin + local_m[1] * cos, local_m[2]]
    return np.array(turned) + place_of(step)


@pytest.mark.parametrize("frame_id", ["lidar", "base_link", "map"])
def test_boxes_are_moved_into_the_map(tmp_path: Path, typestore: Typestore, frame_id: str) -> None:
    frames = frames_with(tmp_path, typestore, frame_id)
    found = read_topic("mine", BOXES.name, frames)
    assert (found.name, found.has_velocity, len(frames)) == ("mine", False, sum(SWEEPS))
    boxes = found.boxes
    assert boxes.frame.tolist() == np.repeat(np.arange(sum(SWEEPS)), 2).tolist()
    assert boxes.score.tolist() == [1.0] * 2 * sum(SWEEPS)
    steps = [4 + 2 * number for count in SWEEPS for number in range(count)]
    for row in range(len(boxes)):
        step = steps[int(boxes.frame[row])]
        truth, which = truth_of(step), row % 2
        numbers = np.array([truth.x_m[which], truth.y_m[which], truth.z_m[which]])
        local = numbers + LIDAR_M if frame_id == "lidar" else numbers
        expected = numbers if frame_id == "map" else placed(step, local)
        assert boxes.centre_m[row] == pytest.approx(expected)
        assert boxes.size_m[row] == pytest.approx([truth.length_m[which], truth.width_m[which], truth.height_m[which]])
        turned = truth.yaw_rad[which] + (0.0 if frame_id == "map" else yaw_of(step))
        assert np.exp(1j * boxes.yaw_rad[row]) == pytest.approx(np.exp(1j * turned))


def test_another_frame_or_topic_is_refused(tmp_path: Path, typestore: Typestore) -> None:
    frames = frames_with(tmp_path, typestore, "odom")
    with pytest.raises(InputError, match=r"step 4\b.*'odom'.*lidar, base_link or map"):
        read_topic("mine", BOXES.name, frames)
    for topic in ("/nothing", GROUND_TRUTH.name):
        with pytest.raises(InputError, match=f"{topic} in .*{BOXES.name}"):
            read_topic("mine", topic, frames)
    with pytest.raises(InputError, match=f"/nothing in .*{BOXES.name}"):
        read_detections("mine", "topic:/nothing", frames)


def test_files_of_busy_episodes(tmp_path: Path) -> None:
    """Every seventeenth detection as each format has it; an episode that begins behind another one."""
    frames, boxes = busy_episodes("S1 S2", 9)
    some = boxes.at(np.arange(len(boxes)) % 17 == 4)
    write_kitti(tmp_path / "kitti", some, frames)
    write_nuscenes(tmp_path / "boxes.json", some, frames)
    write_nuscenes_tracks(tmp_path / "tracks.json", some, np.arange(len(some)) % 3, frames)
    keys = {token: str(frame) for token, frame in frames.by_token.items()}
    kitti = [path for path in sorted((tmp_path / "kitti").iterdir()) if path.stat().st_size]
    told: dict[str, object] = {"kitti": {path.name: _numbers_in(path) for path in kitti}}
    for name in ("boxes", "tracks"):
        content = json.loads((tmp_path / f"{name}.json").read_text())
        rows = {keys[token]: [_values(row, keys) for row in found] for token, found in content["results"].items()}
        told[name] = {"meta": content["meta"], **{key: found for key, found in rows.items() if found}}
    for nuscenes in (False, True):
        entries = [entry for entry in openpcdet_entries(some, frames, nuscenes=nuscenes) if len(entry["score"])]
        columns = [(entry["frame_id"], entry["name"], entry["boxes_lidar"]) for entry in entries]
        told[f"openpcdet {nuscenes}"] = columns
    labels = labels_as_detections(frames)
    told["labels"] = [len(labels), labels.score[::40], labels.label[::40]]
    assert_known(Path(__file__).parent / "known" / "result_files.json", told, digits=6, decimals=5)


def _numbers_in(path: Path) -> list[str | float]:
    return [float(word) if word[-1].isdigit() else word for word in path.read_text().split()]


def _values(row: dict[str, Any], keys: dict[str, str]) -> list[Any]:
    told = (value if isinstance(value, list) else [keys.get(value, value)] for value in row.values())
    return [item for items in told for item in items]
