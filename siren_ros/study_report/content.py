"""What the page is made of, before it is HTML."""

from collections.abc import Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Table:
    """Cells as text; every row has as many as the head."""

    key: str
    """Identifies it on the page."""
    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    folded: bool = False
    """Whether the page shows only its caption until it is opened."""


@dataclass(frozen=True)
class Figure:
    """A picture."""

    key: str
    caption: str
    """Also what is said where the picture cannot be seen."""
    source: str
    """A data URI."""


@dataclass(frozen=True)
class Clip:
    """A short film."""

    key: str
    caption: str
    source: str
    """A data URI of an MP4."""
    poster: str
    """A data URI: what is shown before it plays."""


@dataclass(frozen=True)
class Section:
    """One part of the page."""

    key: str
    title: str
    text: tuple[str, ...] = ()
    """Paragraphs."""
    figures: tuple[Figure, ...] = ()
    clips: tuple[Clip, ...] = ()
    tables: tuple[Table, ...] = ()
    commands: tuple[str, ...] = ()
    """What makes its numbers again."""


@dataclass(frozen=True)
class Page:
    """The whole page."""

    title: str
    lead: str
    sections: Sequence[Section] = field(default_factory=tuple)
