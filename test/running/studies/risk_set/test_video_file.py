"""A video of a made episode: its masks, what its note says, and when it is made again."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from siren_ros.base.params.plain_files import sha256_of_file
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import EpisodeError
from siren_ros.running.studies.risk_set import candidate as render
from siren_ros.running.studies.risk_set.candidate import (
    SEEN_PIXELS,
    UNSEEN,
    Candidate,
    Rejected,
    Rendered,
    VideoPlace,
    is_seen,
    made_before,
    make_video,
    remove_others,
    try_candidate,
)
from siren_ros.scoring.evaluation.risk.labels import Evidence, Moments, Reason, RiskClass, RiskLabel, RiskThresholds
from siren_ros.scoring.evaluation.risk.vlm.pipeline import video_frames
from siren_ros.simulation.scenario.episode import EpisodeRequest

FRAMES = 9
"""So short that every frame is a key frame."""
FIRST_STEP, LABEL_STEP = 20, 27
AHEAD = 2
THRESHOLDS = RiskThresholds()
FILES = ("video", "masks", "note")


def candidate_of(label: RiskLabel) -> Candidate:
    none = np.zeros(0)
    moments = Moments(none.astype(np.int64), none.astype(np.uint32), none, none, none, none, none)
    return Candidate(EpisodeRequest(template="S2"), FIRST_STEP, label, Evidence(moments, (), ()))


NEAR_MISS = candidate_of(RiskLabel(RiskClass.NEAR_MISS, Reason.TIME_TO_COLLISION, AHEAD, LABEL_STEP, 1.2))
NORMAL = candidate_of(RiskLabel(RiskClass.NORMAL))


@pytest.fixture(autouse=True)
def record(record_of: Callable[..., EpisodeRecord], monkeypatch: pytest.MonkeyPatch) -> EpisodeRecord:
    """What the candidate's simulation gives: an EMV that comes closer to the car ahead of it."""
    episode = record_of(duration_s=3.0)
    monkeypatch.setattr(render, "VIDEO_FRAMES", FRAMES)
    monkeypatch.setattr(render, "simulated_or_rejected", lambda _: episode)
    monkeypatch.setattr(render, "assessed", lambda *_: NEAR_MISS)
    return episode


def contents(place: VideoPlace) -> list[bytes]:
    return [getattr(place, name).read_bytes() for name in FILES]


def test_made_again_it_has_the_same_bytes_and_shows_what_the_note_says(tmp_path: Path) -> None:
    place = VideoPlace(tmp_path, "S2_001")
    assert try_candidate(NEAR_MISS.request, THRESHOLDS, place, frozenset({RiskClass.NEAR_MISS})) is NEAR_MISS
    first = contents(place)
    with np.load(place.masks) as masks:
        assert sorted(masks) == [f"frame_{number:03d}" for number in range(FRAMES)]
        pixels = [int(np.count_nonzero(masks[name] == AHEAD)) for name in sorted(masks)]
        assert {mask.shape for mask in masks.values()} == {(600, 800)}
    assert SEEN_PIXELS < pixels[0] < pixels[3] < pixels[4], "the EMV comes closer"
    shown = made_before(place, NEAR_MISS)
    assert shown == Rendered(FRAMES, pixels[3]), "the step of the label lies between the frames 3 and 4"
    start, end = video_frames(place.video, (0, FRAMES - 1), FRAMES)
    assert np.abs(start.astype(int) - end).max() > 50
    assert make_video(place, NEAR_MISS, THRESHOLDS) == shown
    assert contents(place) == first


@pytest.mark.parametrize("damaged", FILES)
def test_it_is_made_again_where_a_file_is_not_whole_or_the_candidate_is_another(tmp_path: Path, damaged: str) -> None:
    place = VideoPlace(tmp_path, "S2_001")
    note = render.outcome_as_json(NEAR_MISS)
    assert made_before(place, NEAR_MISS) is None
    for path in (place.video, place.masks, place.note):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"some bytes")
    digests = {"video": sha256_of_file(place.video), "masks": sha256_of_file(place.masks)}
    assert digests["video"] == digests["masks"]
    place.note.write_text(json.dumps({"frames": 190, "most_pixels": 77, "sha256": digests, "candidate": note}))
    assert made_before(place, NEAR_MISS) == Rendered(190, 77)
    assert made_before(place, replace(NEAR_MISS, first_step=22)) is None
    path = getattr(place, damaged)
    path.write_bytes(path.read_bytes()[:-1])
    assert made_before(place, NEAR_MISS) is None


def test_an_episode_that_is_another_one_now_is_not_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = VideoPlace(tmp_path, "S2_001")
    for again in (NORMAL, Rejected(NEAR_MISS.request, "SUMO failed")):
        monkeypatch.setattr(render, "assessed", lambda *_, again=again: again)
        with pytest.raises(EpisodeError, match="S2_001: simulated again"):
            make_video(place, NEAR_MISS, THRESHOLDS)
    monkeypatch.setattr(render, "simulated_or_rejected", lambda _: Rejected(NEAR_MISS.request, "SUMO failed"))
    with pytest.raises(EpisodeError, match="S2_001: simulated again"):
        make_video(place, NEAR_MISS, THRESHOLDS)
    assert not any(tmp_path.rglob("*"))


def test_a_class_that_lacks_nothing_is_not_drawn(tmp_path: Path) -> None:
    place = VideoPlace(tmp_path, "S2_001")
    assert try_candidate(NEAR_MISS.request, THRESHOLDS, place, frozenset({RiskClass.COLLISION})) is NEAR_MISS
    assert not any(tmp_path.rglob("*"))


@pytest.mark.parametrize(
    ("candidate", "pixels", "seen"), [(NEAR_MISS, 60, True), (NEAR_MISS, 59, False), (NORMAL, 0, True)]
)
def test_who_decides_the_label_has_to_be_seen(candidate, pixels, seen, tmp_path, monkeypatch) -> None:
    """From 60 pixels on; a normal video has nobody who decides."""
    assert is_seen(candidate, Rendered(FRAMES, pixels)) is seen
    monkeypatch.setattr(render, "assessed", lambda *_: candidate)
    monkeypatch.setattr(render, "render_candidate", lambda *_: Rendered(FRAMES, pixels))
    monkeypatch.setattr(render, "sha256_of_file", lambda _: "")
    outcome = try_candidate(
        candidate.request, THRESHOLDS, VideoPlace(tmp_path, "S2_001"), frozenset({candidate.label.risk})
    )
    assert outcome == (candidate if seen else Rejected(candidate.request, UNSEEN))


def test_files_of_videos_that_are_not_of_the_set_are_removed(tmp_path: Path) -> None:
    places = [VideoPlace(tmp_path, name) for name in ("S2_001", "S2_002")]
    for place in places:
        for name in FILES:
            path = getattr(place, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(place.video_id)
    for name in ("videos/.17-2b84.mp4", "masks/.17-2b84.npz"):
        (tmp_path / name).write_text("half of it")
    remove_others(tmp_path, {"S2_002"})
    kept = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
    assert kept == {"videos/S2_002.mp4", "masks/S2_002.npz", "search/videos/S2_002.json"}
