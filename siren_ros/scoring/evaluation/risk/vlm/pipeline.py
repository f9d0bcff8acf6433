"""Asks a model about every video of a set, several at once, and sums up the cost."""

import json
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from siren_ros.base.processes.process_pool import side_by_side
from siren_ros.errors import whole_file
from siren_ros.scoring.evaluation.risk.controls import CHANGES, Control
from siren_ros.scoring.evaluation.risk.labels import RiskClass
from siren_ros.scoring.evaluation.risk.scoring import UNREADABLE
from siren_ros.scoring.evaluation.risk.video_set import RiskVideo, VideoSet, batches, key_frames
from siren_ros.scoring.evaluation.risk.vlm import question
from siren_ros.scoring.evaluation.risk.vlm.model import Question, Reply, ReplyCache, VisionLanguageModel
from siren_ros.scoring.evaluation.risk.vlm.reading import class_in, final_class


@dataclass(frozen=True)
class VideoAnswer:
    """A model's answer to one video."""

    video_id: str
    predictions: tuple[RiskClass | None, ...]
    """Prediction of each question; None if it could not be read."""
    replies: tuple[Reply, ...]
    cached: int
    """Number of replies that came from the cache."""

    @property
    def final(self) -> RiskClass | None:
        """Final class, by the max-severity rule."""
        return final_class(self.predictions)


def questions_about(
    folder: Path, video: RiskVideo, *, marked: bool, control: Control | None = None
) -> tuple[Question, ...]:
    """Make the questions about a video of a set: one with eight key frames, one with the last.

    Where ``marked``, vehicles are outlined from the simulator's own masks. A control changes the pictures or
    leaves them out; with one frame there is one question.

    Raises:
        InputError: The video or its masks are missing or of another length.
    """
    frames = key_frames(video.frames)
    pictures = question.video_frames(folder / video.file, frames, video.frames)
    if marked:
        masks = question.masks_of(folder / "masks" / f"{video.video_id}.npz", frames)
        numbers = question.numbers_of(masks)
        pictures = [question.outlined(*pair, numbers) for pair in zip(pictures, masks, strict=True)]
    if control is not None and control in CHANGES:
        pictures = CHANGES[control](pictures, video.video_id)
    if control is Control.ONE_FRAME:
        frames = frames[len(frames) // 2 :][:1]
        pictures = pictures[:1]
    if control is Control.TEXT_ONLY:
        return tuple(
            Question(question.SYSTEM, question.question(batch, marked=marked), ()) for batch in batches(frames)
        )
    encoded = dict(zip(frames, map(question.as_jpeg, pictures), strict=True))
    return tuple(
        Question(question.SYSTEM, question.question(batch, marked=marked), tuple(encoded[frame] for frame in batch))
        for batch in batches(frames)
    )


def ask_about(
    folder: Path,
    video: RiskVideo,
    model: VisionLanguageModel,
    cache: ReplyCache,
    *,
    marked: bool,
    control: Control | None = None,
) -> VideoAnswer:
    """Ask a model about one video; replies go through the cache.

    Raises:
        ModelUnavailableError: A question got no reply. Replies before it are kept.
    """
    replies, cached = [], 0
    for asked in questions_about(folder, video, marked=marked, control=control):
        reply = cache.get(model.name, asked)
        cached += reply is not None
        if reply is None:
            reply = model.answer(asked)
            cache.put(model.name, asked, reply)
        replies.append(reply)
    return VideoAnswer(video.video_id, tuple(class_in(reply.text) for reply in replies), tuple(replies), cached)


def ask_about_all(
    videos: VideoSet,
    model: VisionLanguageModel,
    cache: ReplyCache,
    *,
    marked: bool,
    concurrency: int,
    control: Control | None = None,
    progress: Callable[[VideoAnswer], None] = lambda _: None,
) -> dict[str, VideoAnswer]:
    """Ask a model about all videos of a set.

    Raises:
        InputError: A video or its masks cannot be used.
        ModelUnavailableError: A question got no reply; the replies that came are kept in the cache.
    """

    def ask(video: RiskVideo) -> VideoAnswer:
        answer = ask_about(videos.folder, video, model, cache, marked=marked, control=control)
        progress(answer)
        return answer

    return side_by_side({key: partial(ask, video) for key, video in sorted(videos.videos.items())}, concurrency)


def write_answers(path: Path, answers: dict[str, VideoAnswer]) -> None:
    """Write the final class of each video as a file for ``--predictions``."""
    finals = {key: answer.final for key, answer in sorted(answers.items())}
    titles = {key: UNREADABLE if final is None else final.title for key, final in finals.items()}
    with whole_file(path) as file:
        file.write_text(json.dumps(titles, indent=1) + "\n", encoding="utf-8")


def account(name: str, answers: Collection[VideoAnswer], prices: tuple[float, float] | None) -> list[str]:
    """Summary for a terminal; prices are per million tokens of questions and of answers, None prints no cost."""
    replies = [reply for answer in answers for reply in answer.replies]
    unreadable = sum(prediction is None for answer in answers for prediction in answer.predictions)
    cached = sum(answer.cached for answer in answers)
    tokens = sum(reply.prompt_tokens for reply in replies), sum(reply.completion_tokens for reply in replies)
    line = f"{name}: {len(replies)} questions, {cached} of them answered before, {unreadable} answers unreadable"
    line += f"; {tokens[0]} tokens in, {tokens[1]} out"
    if prices is not None:
        line += f", cost {(tokens[0] * prices[0] + tokens[1] * prices[1]) / 1e6:.2f}"
    timed = [reply.seconds for reply in replies if reply.seconds > 0.0]
    if timed:
        middle, late = np.percentile(timed, (50.0, 95.0))
        line += f"; {middle:.2f} s for an answer (median), {late:.2f} s at the 95th percentile"
    return [line]
