"""Asks a model about every video of a set, several at once, reads its answers, and sums up the cost.

A question is key frames as JPEG, plain or with outlined vehicles, and a text. The words are our own; SeeUnsafe's
procedure is followed where the paper names it. Replies are kept in a cache on disk, so that nothing is asked twice and
an interrupted run goes on. An unreadable answer is counted, not guessed.
"""

import json
import math
import os
import re
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import binary_erosion

from siren_ros.base.params import plain_files
from siren_ros.base.processes.process_pool import side_by_side
from siren_ros.errors import InputError, SirenError, whole_file, writing
from siren_ros.scoring.evaluation.risk.labels import RiskClass, most_severe, risk_class
from siren_ros.scoring.evaluation.risk.scoring import UNREADABLE
from siren_ros.scoring.evaluation.risk.sequence_model import CHANGES, Control
from siren_ros.scoring.evaluation.risk.video_set import (
    RiskVideo,
    VideoSet,
    batches,
    dense_frames,
    film_frames,
    key_frames,
)

MOST_TOKENS: Final = 512
"""Default limit of an answer's length in tokens."""
MOST_REPLY_BYTES: Final = 1_000_000
"""Size limit of a whole reply. An answer of ``MOST_TOKENS`` has some 4 kB; the rest is for models that write their
reasoning and for servers that add data."""
_MOST_TOKENS_COUNTED: Final = 1_000_000_000


class ModelUnavailableError(SirenError):
    """Raised if the model gave no answer: the server refuses, is unreachable, or fails repeatedly."""


@dataclass(frozen=True)
class Question:
    """One question: texts, and JPEG pictures in the order of time."""

    system: str
    text: str
    pictures: tuple[bytes, ...]


@dataclass(frozen=True)
class Reply:
    """A model's text, the tokens that it used if known, and the time that it took."""

    text: str
    prompt_tokens: int = 0
    completion_tokens: int = 0
    seconds: float = 0.0
    """Wall time of the answer, including further attempts."""


def checked_reply(text: object, prompt_tokens: object, completion_tokens: object, seconds: object) -> Reply:
    """Make a reply from values that a server or a file states; they may be anything that JSON can hold.

    Raises:
        ValueError: The text is no text, or a number is none that can be counted with.
    """
    if not isinstance(text, str):
        raise ValueError(f"a text of the kind {type(text).__name__}")  # noqa: TRY004 - what is in a file, not a call
    if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not 0.0 <= seconds < math.inf:
        raise ValueError("a time that is no number of seconds")
    return Reply(text, _count(prompt_tokens), _count(completion_tokens), float(seconds))


def _count(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= _MOST_TOKENS_COUNTED:
        raise ValueError("a number of tokens that is none")
    return value


class VisionLanguageModel(Protocol):
    """Protocol of a model that answers questions about pictures; several threads may ask at once."""

    @property
    def name(self) -> str:
        """Name of the model, which is its key in the cache."""

    def answer(self, question: Question) -> Reply:
        """Answer a question at temperature 0.

        Raises:
            ModelUnavailableError: There is none.
        """


_MOST_BYTES: Final = 6 * MOST_REPLY_BYTES + 1_000
"""Largest size of a file: a byte of text that is not ASCII is written with up to six bytes."""


class ReplyCache:
    """Stores one file per reply, by model, words and pictures."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def get(self, model: str, question: Question) -> Reply | None:
        """Get a stored reply; None if there is none or it is damaged."""
        try:
            with self._path(model, question).open("rb") as file:
                kept = json.loads(file.read(_MOST_BYTES))
            return checked_reply(**kept)
        except (OSError, ValueError, TypeError, RecursionError):
            return None

    def put(self, model: str, question: Question, reply: Reply) -> None:
        """Store a reply; readers see the whole file or none.

        Raises:
            InputError: The folder cannot be written.
        """
        path = self._path(model, question)
        with writing(self._folder, "folder", "cache"):
            path.parent.mkdir(parents=True, exist_ok=True)
            # The temporary name is unique, because the same question may be asked twice at the same time.
            partial = path.with_suffix(f".{os.getpid()}-{threading.get_ident()}.partial")
            partial.write_text(json.dumps(asdict(reply)) + "\n", encoding="utf-8")
            partial.replace(path)

    def _path(self, model: str, question: Question) -> Path:
        digest = sha256()
        for part in (model, question.system, question.text):
            digest.update(len(part.encode()).to_bytes(8, "big") + part.encode())
        for picture in question.pictures:
            digest.update(sha256(picture).digest())
        return self._folder / f"{digest.hexdigest()}.json"


Picture = npt.NDArray[np.uint8]
_QUALITY: Final = 90
_LEAST_PIXELS: Final = 40
_MOST_MASK_BYTES: Final = 1 << 30
"""Largest size of a video's masks in memory; nine key frames of 1280 by 720 pixels have 33 MB."""
_COLOURS: Final = ((230, 60, 40), (30, 120, 230), (20, 160, 80), (220, 150, 0), (150, 60, 200), (0, 160, 170))


def video_frames(path: Path, numbers: Sequence[int], count: int) -> list[Picture]:
    """Some frames of a video, shape ``(height, width, 3)``.

    Raises:
        InputError: No such video, not a video, or one of another length.
    """
    pictures = {
        number: np.asarray(frame.to_ndarray(format="rgb24"), dtype=np.uint8)
        for number, frame in enumerate(film_frames(path, count))
        if number in numbers
    }
    return [pictures[number] for number in numbers]


def masks_of(path: Path, numbers: Sequence[int]) -> list[npt.NDArray[np.uint32]]:
    """Masks with the actor of each pixel, for some key frames, shape ``(height, width)``.

    Raises:
        InputError: The file is missing or has none of them.
    """
    try:
        content = plain_files.read_arrays(path, _MOST_MASK_BYTES)
        return [content[f"frame_{number:03d}"] for number in numbers]
    except (OSError, ValueError, KeyError) as error:
        raise InputError("masks", str(path), f"the masks of the set ({error})") from error


def numbers_of(masks: Sequence[npt.NDArray[np.uint32]]) -> Mapping[int, int]:
    """Small numbers for the vehicles of a video, most pixels first; the smallest vehicles get none."""
    ids, counts = np.unique(np.concatenate([mask.ravel() for mask in masks]), return_counts=True)
    order = sorted((-int(count), int(actor)) for actor, count in zip(ids, counts, strict=True) if actor)
    return {actor: number for number, (count, actor) in enumerate(order, start=1) if -count >= _LEAST_PIXELS}


def outlined(picture: Picture, mask: npt.NDArray[np.uint32], numbers: Mapping[int, int]) -> Picture:
    """Draw the contour of each numbered vehicle into the picture, with its number above it."""
    drawn = picture.copy()
    labels = []
    for actor, number in numbers.items():
        inside = mask == actor
        if int(inside.sum()) < _LEAST_PIXELS:
            continue
        colour = _COLOURS[(number - 1) % len(_COLOURS)]
        drawn[inside & ~binary_erosion(inside, iterations=2)] = colour
        rows, columns = np.nonzero(inside)
        labels.append((float(columns.mean()), float(rows.min()), str(number), colour))
    image = Image.fromarray(drawn)
    canvas, font = ImageDraw.Draw(image), ImageFont.load_default(16)
    for x, y, text, colour in labels:
        box = canvas.textbbox((x, max(y, 18.0)), text, font=font, anchor="mb")
        canvas.rectangle((box[0] - 2, box[1] - 1, box[2] + 2, box[3] + 1), fill=colour)
        canvas.text((x, max(y, 18.0)), text, font=font, anchor="mb", fill="white")
    return np.asarray(image)


def as_jpeg(picture: Picture) -> bytes:
    """Encode the picture as JPEG; the same pixels give the same bytes."""
    buffer = BytesIO()
    Image.fromarray(picture).save(buffer, "JPEG", quality=_QUALITY)
    return buffer.getvalue()


SYSTEM: Final = """You judge the risk of road traffic scenes. You are shown pictures from a camera that looks forward \
from an emergency vehicle on duty. The pictures are in order of time.

Choose exactly one class for what happens between the emergency vehicle and other road users in these pictures:
- Normal: nobody comes close to a crash. Vehicles that stand aside while the emergency vehicle passes slowly are normal.
- Near-Miss: a crash is close. The ways of two vehicles meet within about a second, or one of them has to brake or \
swerve hard to avoid the other, and they do not touch.
- Collision: the emergency vehicle and another vehicle touch.

Answer with one JSON object and nothing else: \
{"class": "Normal" | "Near-Miss" | "Collision", "reason": "one sentence"}"""

_MARKED: Final = (
    " Vehicles are outlined, each with its own number; the same number is the same vehicle in all pictures."
)


def question(frames: Sequence[int], *, marked: bool) -> str:
    """Text of one question, with the pictures' frame numbers in the video; a frame is 0.1 s."""
    times = ", ".join(f"{0.1 * frame:.1f}" for frame in frames)
    several = f"{len(frames)} pictures, taken at {times} s" if len(frames) > 1 else f"One picture, taken at {times} s"
    return f"{several} of the same drive; the video has a picture every 0.1 s.{_MARKED if marked else ''} Which class?"


DEEPEST: Final = 20
"""Largest nesting of objects and lists; deeper texts are not read. The requested answer is one object."""
_BEGIN: Final = re.compile(r'\{(?=[ \t\n\r]*+["}])')
TOKEN: Final = re.compile(
    r"""[ \t\n\r]*+(?:(?P<sign>[{}\[\],:])
    |(?P<text>"[^"\\\x00-\x1f]*+(?:\\(?:["\\/bfnrt]|u[0-9a-fA-F]{4})[^"\\\x00-\x1f]*+)*+")
    |(?P<value>-?(?:0|[1-9][0-9]*+)(?:\.[0-9]++)?(?:[eE][-+]?[0-9]++)?|true|false|null|NaN|-?Infinity))""",
    re.VERBOSE,
)
"""Matches the next token of a JSON text (RFC 8259, with the three special numbers that Python writes)."""


_STATES: Final[Mapping[tuple[str, str], str]] = {
    **{(state, kind): "open" for state in ("value", "first [") for kind in "{["},
    **{(state, kind): "more" for state in ("value", "first [") for kind in ("text", "value")},
    ("key", "text"): "colon",
    ("first {", "text"): "colon",
    ("first {", "}"): "close",
    ("first [", "]"): "close",
    ("colon", ":"): "value",
    ("more {", ","): "key",
    ("more {", "}"): "close",
    ("more [", ","): "value",
    ("more [", "]"): "close",
}
"""Next state of the parser, by state and token; after a value, the enclosing container decides."""


class _TooDeepError(Exception):
    """Raised for a text that is nested too deeply."""


def class_in(text: str) -> RiskClass | None:
    """Find the class in the last JSON object of a text that has a ``class``; None if there is none or it is unknown.

    A model may think aloud or put the object into a code fence; words outside an object are not read. Takes a time
    proportional to the length of the text, and little memory, whatever the text is.
    """
    title = ""
    try:
        for part in _objects(text):
            # Integers are read as floats, because Python is slow with, and refuses, integers of many digits.
            content = json.loads(part, parse_int=float)
            if isinstance(content.get("class"), str):
                title = content["class"]
        return risk_class(title)
    except (_TooDeepError, InputError):
        return None


def _objects(text: str) -> Iterator[str]:
    """Find the JSON objects of a text that are not inside another object.

    Raises:
        _TooDeepError: One has more than ``DEEPEST`` levels.
    """
    known: dict[int, int | None] = {}
    begins = _BEGIN.search(text)
    while begins is not None:
        begin = begins.start()
        end = known[begin] if begin in known else _end_of_object(text, begin, known)
        if end is not None:
            yield text[begin:end]
        begins = _BEGIN.search(text, end or begin + 1)


def _end_of_object(text: str, begin: int, known: dict[int, int | None]) -> int | None:
    """Find the end of the JSON object that begins at a brace; None if it is not one.

    ``known`` holds the ends of objects inside others that were read before, so that no place is read again and again;
    this call adds to it.

    Raises:
        _TooDeepError: It has more than ``DEEPEST`` levels.
    """
    inside: list[tuple[str, int]] = []
    state, place = "value", begin
    while token := TOKEN.match(text, place):
        kind, place = token.group("sign") or str(token.lastgroup), token.end()
        state = _STATES.get((state, kind), "")
        if not state:
            break
        if state == "open":
            end = known.get(place - 1, place)
            if end is None:
                break
            if end == place:
                inside.append((kind, place - 1))
            state, place = (f"first {kind}" if end == place else "more"), end
            if len(inside) > DEEPEST:
                raise _TooDeepError
        elif state == "close":
            known[inside.pop()[1]] = place
            state = "more"
        if not inside:
            return place
        state += f" {inside[-1][0]}" if state == "more" else ""
    known |= dict.fromkeys(at for _, at in inside)
    return None


def final_class(predictions: Sequence[RiskClass | None]) -> RiskClass | None:
    """Class of a video from its questions' classes: the most severe readable one (paper, max-severity).

    None where none could be read.
    """
    known = [prediction for prediction in predictions if prediction is not None]
    return most_severe(known) if known else None


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

    Where ``marked``, vehicles are outlined from the simulator's own masks, which only key frames have. A control
    changes the pictures or leaves them out; with one frame, and with dense ones, there is one question.

    Raises:
        InputError: The video or its masks are missing or of another length.
    """
    dense = control is Control.DENSE
    marked, frames = marked and not dense, dense_frames(video.frames) if dense else key_frames(video.frames)
    pictures = video_frames(folder / video.file, frames, video.frames)
    if marked:
        masks = masks_of(folder / "masks" / f"{video.video_id}.npz", frames)
        numbers = numbers_of(masks)
        pictures = [outlined(*pair, numbers) for pair in zip(pictures, masks, strict=True)]
    if control is not None and control in CHANGES:
        pictures = CHANGES[control](pictures, video.video_id)
    if control is Control.ONE_FRAME:
        frames = frames[len(frames) // 2 :][:1]
        pictures = pictures[:1]
    asked = (frames,) if dense else batches(frames)
    if control is Control.TEXT_ONLY:
        return tuple(Question(SYSTEM, question(batch, marked=marked), ()) for batch in asked)
    encoded = dict(zip(frames, map(as_jpeg, pictures), strict=True))
    return tuple(
        Question(SYSTEM, question(batch, marked=marked), tuple(encoded[frame] for frame in batch)) for batch in asked
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
