"""Building blocks of the study's page (sections, tables, pictures, films, commands), and the page as HTML."""

import base64
import io
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import Any, Final

import matplotlib as mpl
from matplotlib.figure import Figure
from PIL import Image

from siren_ros.base.params.page_files import page_part, page_template
from siren_ros.base.tables.table import Table
from siren_ros.scoring.pictures.video import Coding, Frame, write_video


@dataclass(frozen=True)
class Picture:
    """A picture."""

    key: str
    caption: str
    """Caption, also for readers who cannot see the picture."""
    source: str
    """The picture as a data URI."""


@dataclass(frozen=True)
class Clip:
    """A short film."""

    key: str
    caption: str
    source: str
    """The film as a data URI of an MP4."""
    poster: str
    """The poster as a data URI; it is shown before the film plays."""


@dataclass(frozen=True)
class Link:
    """A link to a moment of an episode."""

    text: str
    address: str
    """Address relative to the page; empty if the episode has no page."""
    command: str = ""
    """Command that shows the moment if there is no page."""


@dataclass(frozen=True)
class Section:
    """One part of the page."""

    key: str
    title: str
    text: tuple[str, ...] = ()
    """Paragraphs of text."""
    figures: tuple[Picture, ...] = ()
    clips: tuple[Clip, ...] = ()
    tables: tuple[Table, ...] = ()
    links: tuple[Link, ...] = ()
    commands: tuple[str, ...] = ()
    """Commands that compute the section's numbers again."""


@dataclass(frozen=True)
class Page:
    """The whole page."""

    title: str
    lead: str
    sections: Sequence[Section] = ()


_PAGE: Final = "study"


def html_of(page: Page) -> str:
    """The complete page in one file, with its styles."""
    return page_template(_PAGE, keep_trailing_newline=True).render(page=page, css=page_part(_PAGE, "page.css"))


_JPEG_QUALITY: Final = 82


def data_uri(kind: str, content: bytes) -> str:
    """Content of a file as a data URI."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def figure_uri(figure: Figure) -> str:
    """A chart as SVG: the same figure gives the same bytes, and it needs no font of the reader's."""
    out = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "siren", "svg.fonttype": "path"}):
        figure.savefig(out, format="svg", metadata={"Date": None})
    return data_uri("image/svg+xml", out.getvalue())


def picture_uri(pixels: Image.Image) -> str:
    """A picture as JPEG in a data URI."""
    out = io.BytesIO()
    pixels.convert("RGB").save(out, "JPEG", quality=_JPEG_QUALITY, optimize=True)
    return data_uri("image/jpeg", out.getvalue())


def drawn_uri(figure: Figure, width_px: int) -> str:
    """A figure with very many lines, such as a map, as JPEG with a given width."""
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=width_px / figure.get_figwidth())
    return picture_uri(Image.open(out))


def film_uri(frames: Iterable[Frame], coding: Coding) -> str:
    """Frames as H.264 in MP4, as a data URI."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        write_video(path, frames, coding)
        return data_uri("video/mp4", path.read_bytes())


def generate_command(asked: Mapping[str, Any], folder: Path) -> str:
    """The ``siren generate`` command that makes a study, from its ``study.json``."""
    return " ".join(["./env siren generate", *_matrix(asked), *_draws(asked.get("draws")), f"--out {quoted(folder)}"])


def command(verb: str, folder: Path, *more: str) -> str:
    """A ``siren`` command for the study's folder."""
    return " ".join(["./env siren", verb, quoted(folder), *more])


def quoted(path: Path) -> str:
    """A path quoted for a shell."""
    return quote(str(path))


def _matrix(asked: Mapping[str, Any]) -> Iterator[str]:
    for name in ("templates", "levels", "seeds", "maps", "sites", "preset", "sensors", "look"):
        if value := asked.get(name):
            yield f"--{name} {' '.join(quote(str(word)) for word in ([value] if isinstance(value, str) else value))}"
    if asked.get("duration_s"):
        yield f"--duration-s {asked['duration_s']:g}"
    if asked.get("risk_videos"):
        yield f"--risk-videos {asked['risk_videos']}"


def _draws(asked: Mapping[str, Any] | None) -> Iterator[str]:
    if not asked:
        return
    if asked.get("values"):
        words = (f"{path}={','.join(map(str, values))}" for path, values in asked["values"].items())
        yield f"--grid {' '.join(map(quote, words))}"
        return
    yield f"--{'random' if asked['method'] == 'random' else 'lhs'} {asked['samples']}"
    if asked.get("ranges"):
        yield f"--range {' '.join(quote(f'{path}={low:g}:{high:g}') for path, (low, high) in asked['ranges'].items())}"
    yield f"--draw-seed {asked['seed']}"
