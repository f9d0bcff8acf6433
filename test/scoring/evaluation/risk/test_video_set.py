"""A set is read back as it was written, its labels can be derived again; frames of a video file."""

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.labels import DEFINITIONS, Moments, RiskClass
from siren_ros.scoring.evaluation.risk.video_set import (
    EVIDENCE_FILE,
    SET_FILE,
    VideoSet,
    batches,
    dense_frames,
    film_frames,
    key_frames,
    missing_files,
    read_set,
    write_set,
)
from siren_ros.scoring.pictures.video import write_video


def test_round_trip(small_set: VideoSet) -> None:
    files = [small_set.folder / name for name in (SET_FILE, EVIDENCE_FILE)]
    write_set(small_set)
    first = [path.read_bytes() for path in files]
    write_set(small_set)
    assert [path.read_bytes() for path in files] == first, "the same set is the same bytes"
    found = read_set(small_set.folder)
    assert found.thresholds == small_set.thresholds
    assert list(found.videos) == sorted(small_set.videos)
    for key, video in small_set.videos.items():
        read = found.videos[key]
        assert replace(read, evidence=video.evidence) == video
        assert read.evidence.encroachments == video.evidence.encroachments
        assert read.evidence.contacts == video.evidence.contacts
        for one in fields(Moments):
            ours, theirs = getattr(video.evidence.moments, one.name), getattr(read.evidence.moments, one.name)
            assert np.array_equal(ours, theirs), one.name


def test_labels_are_derived_again(small_set: VideoSet) -> None:
    strict = replace(small_set.thresholds, time_to_collision_s=0.8)
    found = small_set.relabelled(strict)
    labels = [video.label.risk for _, video in sorted(found.videos.items())]
    assert labels == [*[RiskClass.NORMAL] * 5, RiskClass.COLLISION]
    assert found.thresholds == strict
    again = found.relabelled(small_set.thresholds)
    assert [video.label for video in again.videos.values()] == [video.label for video in small_set.videos.values()]


def test_a_set_of_an_earlier_version_does_not_know_who_braked(small_set: VideoSet) -> None:
    """Every short TTC of it counts."""
    write_set(small_set)
    path = small_set.folder / EVIDENCE_FILE
    pq.write_table(pq.read_table(path).drop_columns(["braked_mps2"]), path)
    found = read_set(small_set.folder)
    assert all(np.isnan(video.evidence.moments.braked_mps2).all() for video in found.videos.values())
    relabelled = found.relabelled(DEFINITIONS["near_crash"]).videos.values()
    assert [video.label.risk for video in relabelled] == [video.label.risk for video in found.videos.values()]


def test_a_set_with_the_threshold_of_an_earlier_version(small_set: VideoSet) -> None:
    """Slow contacts were near-misses; its labels stay until they are derived again."""
    write_set(small_set)
    file = small_set.folder / SET_FILE
    content = json.loads(file.read_text())
    content["thresholds"]["impact_mps"] = 1.4
    content["videos"][5]["contacts"][0]["impact_mps"] = 0.5
    content["videos"][5]["label"]["risk"] = "Near-Miss"
    file.write_text(json.dumps(content))
    read = read_set(small_set.folder)
    assert read.thresholds == small_set.thresholds
    assert read.videos["S6_005"].label.risk is RiskClass.NEAR_MISS
    assert read.relabelled(read.thresholds).videos["S6_005"].label.risk is RiskClass.COLLISION


def test_videos_without_their_file(small_set: VideoSet) -> None:
    small_set.folder.joinpath("videos").mkdir()
    small_set.folder.joinpath("videos/S4_000.mp4").touch()
    assert missing_files(small_set) == ("S4_001", "S4_002", "S6_003", "S6_004", "S6_005")


@pytest.mark.parametrize("broken", [SET_FILE, EVIDENCE_FILE])
def test_what_is_no_set_is_refused(small_set: VideoSet, broken: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="siren generate risk"):
        read_set(tmp_path / "elsewhere")
    write_set(small_set)
    for content in ('{"videos": [{"id": "x"}]}', "[" * 200_000):
        small_set.folder.joinpath(broken).write_text(content)
        with pytest.raises(InputError, match="siren generate risk"):
            read_set(small_set.folder)


def test_a_set_is_told_from_another_folder(small_set: VideoSet) -> None:
    found = small_set.moved(small_set.folder / "deep" / "other")
    assert found.videos["S4_000"].file == "../../videos/S4_000.mp4"
    for key, video in found.videos.items():
        assert (found.folder / video.file).resolve() == (small_set.folder / small_set.videos[key].file).resolve()


@pytest.fixture
def film(tmp_path: Path) -> Path:
    """Three pictures, each brighter than the one before."""
    path = tmp_path / "film.mp4"
    write_video(path, (np.full((64, 64, 3), 60 * number, np.uint8) for number in range(3)))
    return path


def test_frames_come_in_their_order(film: Path) -> None:
    brightness = [frame.to_ndarray(format="gray").mean() for frame in film_frames(film, 3)]
    assert brightness == pytest.approx([0.0, 60.0, 120.0], abs=3.0)
    for count in (2, 4):
        with pytest.raises(InputError, match=f"3 frames.*{count} frames"):
            list(film_frames(film, count))


@pytest.mark.parametrize("content", [None, b"", b"no film"])
def test_what_is_no_film_is_refused(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "film.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match="an MP4 file"):
        list(film_frames(path, 1))


def test_of_a_video_of_190_frames() -> None:
    assert key_frames(190) == (0, 23, 47, 70, 94, 118, 141, 165, 189)
    assert batches(key_frames(190)) == ((0, 23, 47, 70, 94, 118, 141, 165), (189,))
    assert key_frames(9) == tuple(range(9)), "the shortest video"
    with pytest.raises(InputError, match="9 frames"):
        key_frames(8)


def test_dense_frames_contain_the_moment_of_every_label() -> None:
    """A TTC counts from four steps of 0.05 s on; a video has a frame each two steps."""
    shown = {2 * frame for frame in dense_frames(190)}
    begins = range(2 * 189 - 3)
    assert all(shown & {*range(begin, begin + 4)} for begin in begins)
    kept = {2 * frame for frame in key_frames(190)}
    assert sum(bool(kept & {*range(begin, begin + 4)}) for begin in begins) < len(begins) / 5


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("file", "../secret.txt"),
        ("file", "../secret.mp4"),
        ("file", "/etc/passwd"),
        ("file", "videos/link.mp4"),
        ("file", 3),
        ("frames", "many"),
        ("id", 7),
        ("template", None),
    ],
)
def test_a_set_names_films_of_sets_alone(small_set: VideoSet, tmp_path: Path, key: str, value: object) -> None:
    folder = tmp_path / "inner"
    (folder / "videos").mkdir(parents=True)
    write_set(replace(small_set, folder=folder))
    (tmp_path / "secret.txt").write_text("mine")
    (tmp_path / "secret.mp4").write_text("mine")
    (folder / "videos/link.mp4").symlink_to(tmp_path / "secret.mp4")
    path = folder / SET_FILE
    content = json.loads(path.read_text())
    content["videos"][0][key] = value
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match="set"):
        read_set(folder)
