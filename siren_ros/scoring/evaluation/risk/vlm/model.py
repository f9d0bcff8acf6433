"""Types of the pipeline: questions, replies, the model's protocol, and a cache of replies.

The cache lies on disk, so that nothing is asked twice and an interrupted run goes on.
"""

import json
import math
import os
import threading
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Final, Protocol

from siren_ros.errors import SirenError, writing

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
