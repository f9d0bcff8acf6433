"""Films as the sequence model sees them."""

import json
from pathlib import Path

import numpy as np
import pytest

from siren_ros.base.params.folders import params_dir
from siren_ros.base.params.plain_files import NetworkFile, card_path
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.labels import RiskClass
from siren_ros.scoring.evaluation.risk.scoring import REFERENCES, score_answers
from siren_ros.scoring.evaluation.risk.sequence_model import (
    HEIGHT,
    SHIPPED,
    WIDTH,
    SequenceModel,
    load_sequence_model,
    read_small_frames,
    reduced,
)
from siren_ros.scoring.evaluation.risk.video_set import VIDEO_FRAMES, VideoSet
from siren_ros.scoring.pictures.video import write_video
from siren_ros.simulation.scenario.episode import Split


@pytest.mark.parametrize("factor", [1, 2, 5])
def test_sky_and_bonnet_are_cut_and_blocks_averaged(factor: int) -> None:
    picture = np.zeros((120 * factor, 160 * factor, 3), np.uint8)
    picture[: 40 * factor] = 255
    picture[40 * factor, :factor] = 100
    picture[100 * factor :] = 255
    small = reduced(picture)
    assert small.shape == (HEIGHT, WIDTH)
    assert small[0, 0] == round(100 / factor)
    assert small.sum() == small[0, 0]
    picture = np.zeros((120, 160, 3), np.uint8)
    picture[..., 1] = 200
    assert (reduced(picture) == round(0.587 * 200)).all(), "grey is luma"


def test_each_second_frame_of_a_video_is_read_as_it_was_drawn(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    coarse = random.integers(30, 220, (12, 12, 16, 3), dtype=np.uint8)
    drawn = coarse.repeat(20, axis=1).repeat(20, axis=2)
    write_video(tmp_path / "a.mp4", drawn)
    small = read_small_frames(tmp_path / "a.mp4", 12)
    assert small.shape == (6, HEIGHT, WIDTH)
    wanted = np.stack([reduced(picture) for picture in drawn[::2]])
    assert np.abs(small.astype(float) - wanted).mean() < 3.0


def test_what_is_no_film_of_the_front_camera_is_refused(tmp_path: Path) -> None:
    write_video(tmp_path / "a.mp4", np.zeros((4, 120, 160, 3), np.uint8))
    with pytest.raises(InputError, match="5 frames"):
        read_small_frames(tmp_path / "a.mp4", 5)
    write_video(tmp_path / "wide.mp4", np.zeros((4, 96, 160, 3), np.uint8))
    with pytest.raises(InputError, match="160 x 96"):
        read_small_frames(tmp_path / "wide.mp4", 4)
    with pytest.raises(InputError, match="MP4"):
        read_small_frames(tmp_path / "none.mp4", 4)


FILM = np.full((95, HEIGHT, WIDTH), 100, np.uint8)


class Session:
    """Answers what it is told to."""

    def __init__(self, near: float, hit: float) -> None:
        self.answer = np.array([[near, hit]], dtype=np.float32)

    def run(self, _names: list[str], _inputs: object) -> list[np.ndarray]:
        return [self.answer]


@pytest.mark.parametrize(
    ("near", "hit", "risk"),
    [
        (0.4, 0.4, RiskClass.NORMAL),
        (0.6, 0.4, RiskClass.NEAR_MISS),
        (0.6, 0.6, RiskClass.COLLISION),
        (0.4, 0.6, RiskClass.COLLISION),
    ],
)
def test_the_more_severe_class_comes_first(near: float, hit: float, risk: RiskClass) -> None:
    assert SequenceModel(NetworkFile(Session(near, hit), {})).answer(FILM) is risk


def test_the_shipped_model_runs_and_answers_the_same_again() -> None:
    model = load_sequence_model()
    first = model.probabilities(FILM)
    assert all(0.0 < value < 1.0 for value in first)
    assert model.probabilities(FILM) == first
    assert model.network.card["films"]["train"]["seed"] != model.network.card["films"]["validation"]["seed"] != 0


def test_weights_of_other_frames_are_refused(tmp_path: Path) -> None:
    shipped, path = params_dir() / SHIPPED, tmp_path / "sequence.onnx"
    path.write_bytes(shipped.read_bytes())
    card = json.loads(card_path(shipped).read_text())
    card_path(path).write_text(json.dumps({**card, "frames_version": 0}))
    with pytest.raises(InputError, match="frames of version 1, not 0"):
        load_sequence_model(path)
    card_path(path).write_text(json.dumps({**card, "sha256": "0"}))
    with pytest.raises(InputError, match="another hash"):
        load_sequence_model(path)


def test_videos_without_their_file_have_no_answer(small_set: VideoSet) -> None:
    first = next(iter(small_set.videos))
    shade = np.full((120, 160, 3), 90, np.uint8)
    write_video(small_set.folder / small_set.videos[first].file, (shade for _ in range(VIDEO_FRAMES)))
    found = REFERENCES["sequence"](small_set)
    assert set(found) == {first}
    assert score_answers("sequence", small_set, found).answered == 1


def test_episodes_of_a_set_that_were_trained_on_are_counted(small_set: VideoSet) -> None:
    templates = {video.template: video.request["seed"] for video in small_set.videos.values()}
    template, seed = next(iter(templates.items()))
    card = {"data": {"train": {"keys": [f"town {template} {seed}", f"town {template} 999"]}}}
    counts = SequenceModel(NetworkFile(Session(0.0, 0.0), card)).standings(small_set)
    assert counts[Split.TRAIN] == 1
    assert sum(counts.values()) == len(small_set.videos)
    assert SequenceModel(NetworkFile(Session(0.0, 0.0), {})).standings(small_set) == {}
