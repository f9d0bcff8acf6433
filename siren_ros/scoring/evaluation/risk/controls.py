"""Controls against guessing: the same questions with less information in the pictures."""

from collections.abc import Callable, Collection, Mapping, Sequence
from enum import StrEnum
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.scoring.evaluation.risk.labels import RiskClass
from siren_ros.scoring.evaluation.risk.sequence_model import SequenceModel, SmallFrames, read_small_frames
from siren_ros.scoring.evaluation.risk.video_set import VideoSet

Picture = npt.NDArray[np.uint8]
_GREY: Final = 128


class Control(StrEnum):
    """Kind of control: what is removed from the pictures."""

    BLANK = "blank"
    """Grey pictures; only the question remains."""
    SHUFFLED = "shuffled"
    """Pictures in random order; their content without motion remains."""
    ONE_FRAME = "one_frame"
    """The model gets only the picture in the middle."""
    TEXT_ONLY = "text_only"
    """The model gets no pictures, only the text of the question."""


def _blank(pictures: Sequence[Picture], _: str) -> list[Picture]:
    return [np.full_like(picture, _GREY) for picture in pictures]


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
