"""The model that ships with the project, and what is refused of others."""

import json
from pathlib import Path

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.network_file import NetworkFile, card_path
from siren_ros.evaluation.risk.references import REFERENCES
from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.evaluation.risk.scoring import score_answers
from siren_ros.evaluation.risk.sequence.sequence_model import SHIPPED, SequenceModel, load_sequence_model
from siren_ros.evaluation.risk.sequence.small_frames import HEIGHT, WIDTH
from siren_ros.evaluation.risk.video_set import VIDEO_FRAMES, VideoSet
from siren_ros.params.resources import params_dir
from siren_ros.pictures.video import write_video

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
    first, second, *_ = small_set.videos
    for number, key in enumerate((first, second)):
        shade = np.full((120, 160, 3), 90 + number, np.uint8)
        write_video(small_set.folder / small_set.videos[key].file, (shade for _ in range(VIDEO_FRAMES)))
    found = REFERENCES["sequence"](small_set)
    assert set(found) == {first, second}
    assert score_answers("sequence", small_set, found).answered == 2
    assert score_answers("sequence", small_set, {}).answered == 0
