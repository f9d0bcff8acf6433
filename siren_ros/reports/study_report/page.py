"""Building blocks of the study's page (sections, tables, pictures, films, commands), and the page as HTML.

Pages of episodes lie in a folder next to it, for the moments that it links to.
"""

import base64
import io
import os
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import Any, Final
from urllib.parse import quote as url_quote

import matplotlib as mpl
from matplotlib.figure import Figure
from PIL import Image

from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.base.tables import Table, render_page
from siren_ros.errors import SirenError, write_text, writing
from siren_ros.reports.episode_page.build import page_of_bag
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


def html_of(page: Page) -> str:
    """The complete page in one file, with its styles."""
    return render_page("study", page=page)


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


class EpisodePages:
    """Gives addresses of moments and collects the pages that they need; ``write`` writes these pages."""

    def __init__(self, folder: Path, most: int, bags: Collection[Path]) -> None:
        """Prepare pages for at most ``most`` episodes, only of bags that a page can show."""
        self.folder = folder
        self._most = most
        self._bags = bags
        self._asked: dict[Path, Path] = {}

    def address(self, bag: Path, time_s: float, actor_id: int | None = None) -> str:
        """Address of a moment relative to the report; empty if the episode has no page."""
        if bag not in self._asked:
            if bag not in self._bags or len(self._asked) >= self._most:
                return ""
            self._asked[bag] = self.folder / f"{bag.name}.html"
        actor = "" if actor_id is None else f"&v={actor_id}"
        names = (url_quote(os.fsencode(path.name)) for path in (self.folder, self._asked[bag]))  # of any bytes
        return f"{'/'.join(names)}#t={time_s:g}{actor}"

    def write(self, jobs: int) -> tuple[int, int, tuple[str, ...]]:
        """Write the pages in parallel processes; returns their number, total size, and reasons of missing pages."""
        if not self._asked:
            return 0, 0, ()
        with writing(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
        with ProcessPool(min(jobs, len(self._asked))) as pool:
            results = pool.map(write_page, list(self._asked.items()))
        sizes = [result for result in results if isinstance(result, int)]
        return len(sizes), sum(sizes), tuple(result for result in results if isinstance(result, str))


def write_page(bag: Path, file: Path) -> int | str:
    """Write the page of a bag; returns its size in bytes, or why it cannot be made."""
    try:
        content = page_of_bag(bag)
        write_text(file, content)
    except SirenError as error:
        return f"{bag.name}: {error}"
    return len(content.encode())
