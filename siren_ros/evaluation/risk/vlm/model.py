"""What the pipeline needs of a model."""

import math
from dataclasses import dataclass
from typing import Final, Protocol

from siren_ros.errors import SirenError

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
    """A reply of what a server or a file says; no more is known of its parts than that JSON can hold them.

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
        """Under which its answers are kept."""

    def answer(self, question: Question) -> Reply:
        """The model's reply, at temperature 0.

        Raises:
            ModelUnavailableError: There is none.
        """
