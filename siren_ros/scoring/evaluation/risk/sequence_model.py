"""A reference that sees pictures but is no language model: a small network on every second frame of a video.

It sees grey pictures, five a second, without the sky, a fifth of the size. Controls against guessing ask it, and
language models, the same questions with less information in the pictures.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.base.params.folders import params_dir
from siren_ros.base.params.plain_files import NetworkFile, open_network
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.labels import RiskClass
from siren_ros.scoring.evaluation.risk.video_set import VideoSet, film_frames
from siren_ros.simulation.scenario.episode import (
    EpisodeIdentity,
    EpisodeRequest,
    SeenEpisodes,
    Split,
    counted_standings,
)

SmallFrames = npt.NDArray[np.uint8]
"""A film in grey values, shape ``(T, HEIGHT, WIDTH)``."""

EVERY: Final = 2
"""Every second frame of a 10 Hz video is used."""
WIDTH: Final = 160
HEIGHT: Final = 60
_VIEW: Final = (800, 600)
"""Width and height of the paper's front camera, for which the rows below are given."""
_ROWS: Final = (200, 500)
"""Rows that are used: from above the horizon at 300 to where the road is 1.7 m ahead of the camera."""
_GREY: Final = np.array([0.299, 0.587, 0.114], dtype=np.float32)
"""Weights of red, green and blue in grey (luma of ITU-R BT.601, as in H.264)."""


def reduced(rgb: npt.NDArray[np.uint8]) -> SmallFrames:
    """Reduce one picture of the front camera, ``(height, width, 3)``, to ``(HEIGHT, WIDTH)``.

    Raises:
        InputError: A picture whose size is no multiple of the small one in the camera's proportions.
    """
    return _reduced_grey(rgb.astype(np.float32) @ _GREY)


def read_small_frames(path: Path, frames: int) -> SmallFrames:
    """Read every second frame of an MP4 file, which must have the given number of frames, and reduce them.

    Raises:
        InputError: No such video, not a video, one of another length, or of a size that cannot be reduced.
    """
    return np.stack(
        [
            _reduced_grey(frame.to_ndarray(format="gray").astype(np.float32))
            for number, frame in enumerate(film_frames(path, frames))
            if number % EVERY == 0
        ]
    )


def _reduced_grey(grey: npt.NDArray[np.float32]) -> SmallFrames:
    height, width = grey.shape
    if width % WIDTH or width * _VIEW[1] != height * _VIEW[0]:
        raise InputError("video", f"{width} x {height} pixels", "a multiple of 160 x 120")
    first, last = (row * height // _VIEW[1] for row in _ROWS)
    block = width // WIDTH
    parts = grey[first:last].reshape(HEIGHT, block, WIDTH, block)
    return np.rint(parts.mean(axis=(1, 3))).astype(np.uint8)


def stacked(films: Sequence[SmallFrames]) -> SmallFrames:
    """Join films of equal length to one array, shape ``(N, T, HEIGHT, WIDTH)``."""
    return np.stack(list(films))


SHIPPED: Final = Path("risk", "sequence.onnx")
"""Place of the shipped weights below the parameter files."""
INPUT: Final = "frames"
OUTPUT: Final = "probability"
_DECIDES: Final = ("seed", "map", "values")
"""Fields of a request that decide its episode's split, besides the template."""
FRAMES_VERSION: Final = 1
"""Version of the network's input; weights of other versions are refused."""


@dataclass(frozen=True)
class SequenceModel:
    """Estimates the probability that a film shows at least a near-miss, and that it shows a collision."""

    network: NetworkFile

    def probabilities(self, frames: SmallFrames) -> tuple[float, float]:
        """Probabilities for one film, ``(T, HEIGHT, WIDTH)``: at least a near-miss, and a collision."""
        (shares,) = self.network.session.run([OUTPUT], {INPUT: frames[None]})
        return float(shares[0, 0]), float(shares[0, 1])

    def answer(self, frames: SmallFrames) -> RiskClass:
        """Class of one film: collision is tested first, each against a probability of one half."""
        near, hit = self.probabilities(frames)
        if hit > 0.5:
            return RiskClass.COLLISION
        return RiskClass.NEAR_MISS if near > 0.5 else RiskClass.NORMAL

    def standings(self, videos: VideoSet) -> dict[Split, int]:
        """Number of a set's episodes by their relation to the training; empty if the card lists no episodes."""
        seen = SeenEpisodes.of_card(self.network.card)
        if seen is None:
            return {}
        episodes = {
            EpisodeIdentity.of_request(
                EpisodeRequest(**{name: video.request[name] for name in _DECIDES}), video.template
            )
            for video in videos.videos.values()
        }
        return counted_standings([seen.split_of(episode) for episode in episodes])

    def answers(
        self, videos: VideoSet, progress: Callable[[str], None] = lambda _: None
    ) -> dict[str, RiskClass | None]:
        """Answers to all videos of a set; ``progress`` is called with each video's id.

        Raises:
            InputError: A video is missing or of another length.
        """
        answers: dict[str, RiskClass | None] = {}
        for key, video in sorted(videos.videos.items()):
            answers[key] = self.answer(read_small_frames(videos.folder / video.file, video.frames))
            progress(key)
        return answers


def load_sequence_model(path: Path | None = None) -> SequenceModel:
    """Load the shipped model, or one of ``siren train risk``.

    Raises:
        InputError: No such file, or not a network of this task.
    """
    file = path or params_dir() / SHIPPED
    network = open_network(file)
    if (version := network.card.get("frames_version")) != FRAMES_VERSION:
        allowed = f"a sequence model for frames of version {FRAMES_VERSION}, not {version}"
        raise InputError("checkpoint", str(file), allowed)
    return SequenceModel(network)


Picture = npt.NDArray[np.uint8]
_BLANK_GREY: Final = 128


class Control(StrEnum):
    """Kind of control: what is removed from the pictures, or added."""

    BLANK = "blank"
    """Grey pictures; only the question remains."""
    SHUFFLED = "shuffled"
    """Pictures in random order; their content without motion remains."""
    ONE_FRAME = "one_frame"
    """The model gets only the picture in the middle."""
    TEXT_ONLY = "text_only"
    """The model gets no pictures, only the text of the question."""
    DENSE = "dense"
    """For models that take videos: one question with a plain picture every 0.2 s."""


def _blank(pictures: Sequence[Picture], _: str) -> list[Picture]:
    return [np.full_like(picture, _BLANK_GREY) for picture in pictures]


def _shuffled(pictures: Sequence[Picture], key: str) -> list[Picture]:
    order = random_stream(0, f"risk/shuffled/{key}").permutation(len(pictures))
    return [pictures[number] for number in order]


def _one_frame(pictures: Sequence[Picture], _: str) -> list[Picture]:
    return [pictures[len(pictures) // 2]] * len(pictures)


CHANGES: Final[Mapping[Control, Callable[[Sequence[Picture], str], list[Picture]]]] = {
    Control.BLANK: _blank,
    Control.SHUFFLED: _shuffled,
    Control.ONE_FRAME: _one_frame,
}
"""Function that changes a video's pictures, by control. Its text is the video's id, which decides the random order."""


def sequence_answers(
    videos: VideoSet, model: SequenceModel, controls: Collection[Control]
) -> dict[Control, dict[str, RiskClass | None]]:
    """Answers of the sequence model to changed films of a set; the number of pictures stays the same.

    A film is read once for all controls.

    Raises:
        InputError: A video is missing or of another length.
        KeyError: A control without pictures, which the model cannot answer.
    """
    changes = {control: CHANGES[control] for control in controls}
    answers: dict[Control, dict[str, RiskClass | None]] = {control: {} for control in changes}
    for key, video in sorted(videos.videos.items()) if changes else ():
        frames: SmallFrames = read_small_frames(videos.folder / video.file, video.frames)
        for control, change in changes.items():
            answers[control][key] = model.answer(np.stack(change(list(frames), key)))
    return answers
