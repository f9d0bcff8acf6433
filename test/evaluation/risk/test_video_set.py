"""A set is read back as it was written, and its labels can be derived again."""

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.labels import Moments, RiskClass
from siren_ros.evaluation.risk.video_set import EVIDENCE_FILE, SET_FILE, VideoSet, missing_files, read_set, write_set


def test_round_trip(small_set: VideoSet) -> None:
    write_set(small_set)
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


def test_the_same_set_is_the_same_bytes(small_set: VideoSet) -> None:
    write_set(small_set)
    first = [small_set.folder.joinpath(name).read_bytes() for name in (SET_FILE, EVIDENCE_FILE)]
    write_set(small_set)
    assert [small_set.folder.joinpath(name).read_bytes() for name in (SET_FILE, EVIDENCE_FILE)] == first


def test_labels_are_derived_again(small_set: VideoSet) -> None:
    strict = replace(small_set.thresholds, time_to_collision_s=0.8)
    found = small_set.relabelled(strict)
    labels = [video.label.risk for _, video in sorted(found.videos.items())]
    assert labels == [*[RiskClass.NORMAL] * 5, RiskClass.COLLISION]
    assert found.thresholds == strict
    again = found.relabelled(small_set.thresholds)
    assert [video.label for video in again.videos.values()] == [video.label for video in small_set.videos.values()]


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
    small_set.folder.joinpath(broken).write_text('{"videos": [{"id": "x"}]}')
    with pytest.raises(InputError, match="siren generate risk"):
        read_set(small_set.folder)


def test_a_set_is_told_from_another_folder(small_set: VideoSet) -> None:
    found = small_set.moved(small_set.folder / "deep" / "other")
    assert found.folder == small_set.folder / "deep" / "other"
    assert found.videos["S4_000"].file == "../../videos/S4_000.mp4"
    for key, video in found.videos.items():
        assert (found.folder / video.file).resolve() == (small_set.folder / small_set.videos[key].file).resolve()
