"""The pipeline's view of a model: questions, replies, and a cache of replies.

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
"""Of an answer, where nobody says otherwise."""
MOST_REPLY_BYTES: Final = 1_000_000
"""Of a whole reply. An answer of ``MOST_TOKENS`` has some 4 kB; this leaves room for a model that thinks aloud and for
a server that adds much to it."""
_MOST_TOKENS_COUNTED: Final = 1_000_000_000


class ModelUnavailableError(SirenError):
    """The model gave no answer: the server refuses, cannot be reached, or fails again and again."""


@dataclass(frozen=True)
class Question:
    """One question: texts and JPEG pictures in order of time."""

    system: str
    text: str
    pictures: tuple[bytes, ...]


@dataclass(frozen=True)
class Reply:
    """A model's text, the tokens that it cost where the model says so, and how long it took."""

    text: str
    prompt_tokens: int = 0
    completion_tokens: int = 0
    seconds: float = 0.0
    """Wall time of the answer, further attempts included."""


def checked_reply(text: object, prompt_tokens: object, completion_tokens: object, seconds: object) -> Reply:
    """A reply from the parts that a server or a file states: anything that JSON can hold.

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
    """Answers questions about pictures; several threads may ask at once."""

    @property
    def name(self) -> str:
        """The key of its answers in the cache."""

    def answer(self, question: Question) -> Reply:
        """The model's reply, at temperature 0.

        Raises:
            ModelUnavailableError: There is none.
        """


_MOST_BYTES: Final = 6 * MOST_REPLY_BYTES + 1_000
"""Of a file: each byte of a text that is not ASCII takes up to six (``\\uXXXX``)."""


class ReplyCache:
    """One file for each reply, by model, words and pictures."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def get(self, model: str, question: Question) -> Reply | None:
        """The reply that is kept; None where there is none, or a damaged one."""
        try:
            with self._path(model, question).open("rb") as file:
                kept = json.loads(file.read(_MOST_BYTES))
            return checked_reply(**kept)
        except (OSError, ValueError, TypeError, RecursionError):
            return None

    def put(self, model: str, question: Question, reply: Reply) -> None:
        """Keeps a reply; readers see the whole file or none.

        Raises:
            InputError: The folder cannot be written.
        """
        path = self._path(model, question)
        with writing(self._folder, "folder", "cache"):
            path.parent.mkdir(parents=True, exist_ok=True)
            # A name of its own: the same question may be asked twice at the same time.
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
