"""What the pipeline needs of a model."""

from dataclasses import dataclass
from typing import Final, Protocol

from siren_ros.errors import SirenError

MOST_TOKENS: Final = 512
"""Of an answer, where nobody says otherwise."""


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
