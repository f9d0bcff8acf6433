"""Output of results: intervals, the only table type, and the parts of HTML pages.

A task makes its tables once. The terminal, the files and the pages show the same tables, with the same digits:

* A number has the digits of its column; a whole number has commas between the thousands. Numbers that name something,
  such as seeds, are given as text.
* An interval stands behind its value: ``2.28 [2.10, 2.43]``. ``[–]`` says that there is none, and a note below the
  tables says why.
* Values that belong together share a cell: ``1.44/3.73``.
* A text is printable: what another program wrote cannot change a terminal.
* A dash stands where there is no value. An empty cell is one in which nothing can stand.

Pages are made of jinja2 templates, styles and scripts in ``params/pages``.
"""

import base64
import csv
import hashlib
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any, Final, Self

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from scipy.special import ndtri

from siren_ros.base.params.folders import params_dir
from siren_ros.errors import shown_text

NONE: Final = "–"
"""Text for a missing value."""
CONFIDENCE: Final = 0.95
BLOCKS_MIN: Final = 5
"""Smallest number of blocks for an interval. With fewer it is too wide, and too often wrong for skewed values."""


@dataclass(frozen=True)
class Measure:
    """A measured value of an episode. If nothing could be measured, ``value`` is 0 and ``lack`` gives the reason."""

    value: float
    lack: str = ""
    at_least: bool = False
    """Whether the value is only a lower bound, because the episode ended first."""

    @property
    def valid(self) -> bool:
        """Whether there is a value."""
        return not self.lack

    @property
    def text(self) -> str:
        """Text for a table: the value, with ``at least`` before a lower bound, or the reason why there is none."""
        return f"{'at least ' * self.at_least}{self.value:.2f}" if self.valid else f"{NONE} ({self.lack})"

    @classmethod
    def lacking(cls, reason: str) -> Self:
        """A measure without a value."""
        return cls(0.0, reason)


@dataclass(frozen=True)
class Interval:
    """An estimate from some blocks. If it is not ``bounded``, ``low`` and ``high`` are meaningless."""

    value: float
    low: float
    high: float
    blocks: int
    """Number of independent blocks (episodes) of the estimate."""
    scatter_known: bool = True
    """Whether the blocks show their scatter: not if a stratum has only one, or if all are equal."""

    @property
    def valid(self) -> bool:
        """Whether there is a value."""
        return self.blocks > 0

    @property
    def bounded(self) -> bool:
        """Whether the bounds are meaningful."""
        return self.blocks >= BLOCKS_MIN and self.scatter_known

    def __format__(self, spec: str) -> str:
        """``2.28 [2.10, 2.43]``; ``2.28 [–]`` without bounds; a dash without a value."""
        return f"{self.value:{_spec_for(spec, self.value)}} {Bounds(self):{spec}}" if self.valid else NONE

    def scaled(self, factor: float) -> "Interval":
        """The interval in another unit, such as percent; the factor is positive."""
        return Interval(factor * self.value, factor * self.low, factor * self.high, self.blocks, self.scatter_known)

    def json(self) -> dict[str, Any]:
        """JSON types as in all files of scores; null for a missing value or bound."""
        return {
            "value": self.value if self.valid else None,
            "low": self.low if self.bounded else None,
            "high": self.high if self.bounded else None,
            "episodes": self.blocks,
        }


@dataclass(frozen=True)
class Bounds:
    """The bounds of an interval without its value."""

    interval: Interval

    def __format__(self, spec: str) -> str:
        """``[2.10, 2.43]``; ``[–]`` for a value without bounds; a dash without a value."""
        if not self.interval.bounded:
            return f"[{NONE}]" if self.interval.valid else NONE
        low, high = (f"{end:{_spec_for(spec, end)}}" for end in (self.interval.low, self.interval.high))
        return f"[{low}, {high}]"


_HUGE: Final = 1e12


def _spec_for(spec: str, value: float) -> str:
    """The format of a number; huge ones, which only errors of a program give, have few digits and an exponent."""
    return ".3g" if abs(value) >= _HUGE and spec.endswith("f") else spec


NOTHING: Final = Interval(0.0, 0.0, 0.0, 0)
"""The interval without any block."""


def interval_of_json(content: Mapping[str, Any] | None) -> Interval:
    """Inverse of ``Interval.json``; ``NOTHING`` for null. It also reads files without the number of episodes."""
    if content is None or content.get("value") is None:
        return NOTHING
    value, low, high = content["value"], content.get("low"), content.get("high")
    if low is None or high is None:
        return Interval(value, value, value, int(content.get("episodes", 1)), scatter_known=False)
    return Interval(value, low, high, int(content.get("episodes", BLOCKS_MIN)))


def share_interval(part: int, whole: int, confidence: float = CONFIDENCE) -> Interval:
    """Wilson's interval of a share of independent blocks; it has a width even at 0 and 1.

    Source: E. Wilson, J. Am. Stat. Assoc. 22 (1927) 209.
    """
    if not whole:
        return NOTHING
    square = float(ndtri(0.5 * (1.0 + confidence))) ** 2
    middle = (part + 0.5 * square) / (whole + square)
    half = math.sqrt(square * (part * (whole - part) / whole + 0.25 * square)) / (whole + square)
    return Interval(part / whole, max(middle - half, 0.0), min(middle + half, 1.0), whole)


def mean_of_intervals(parts: Sequence[Interval], blocks: int) -> Interval:
    """Mean of independent estimates, given their total number of blocks; estimates that are not valid do not count.

    Source: G. Zou, A. Donner, Statist. Med. 27 (2008) 1693: the distances to the bounds add up as squares.
    """
    known = [part for part in parts if part.valid]
    if not known:
        return NOTHING
    value = math.fsum(part.value for part in known) / len(known)
    below = math.hypot(*(part.value - part.low for part in known)) / len(known)
    above = math.hypot(*(part.high - part.value for part in known)) / len(known)
    return Interval(value, value - below, value + above, blocks)


UNBOUNDED_NOTE: Final = (
    f"[{NONE}] is no interval: it takes {BLOCKS_MIN} episodes, 2 of each template, and values that are not all the same"
)
_LONG: Final = 28
"""A page may break lines in cells with more letters than this."""
_WIDE: Final = ' class="long"'
_LATEX: Final = str.maketrans(
    {
        **{special: f"\\{special}" for special in "_%&#${}"},
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "–": "--",
        "−": "$-$",
        "²": r"\textsuperscript{2}",
    }
)


Value = str | int | float | Interval | Bounds | None
Cell = Value | tuple[Value, ...]
Row = tuple[Cell, ...]


@dataclass(frozen=True)
class Table:
    """A table; every row has as many cells as the head."""

    key: str
    """Name of the table's file, and its id on a page."""
    caption: str
    head: tuple[str, ...]
    rows: tuple[Row, ...]
    spec: str = ".2f"
    """Python's format specification for numbers, such as ``.3f``, ``+.2f`` or ``.0%``."""
    specs: Mapping[str, str] = field(default_factory=dict)
    """Format specifications of single columns, by their titles."""
    reference: tuple[Row, ...] = ()
    """Rows to compare with, such as the paper's; a rule separates them."""
    folded: bool = False
    """Whether a page shows only the caption until the reader opens the table."""

    def __post_init__(self) -> None:
        """Make titles printable, because they may contain names from other programs."""
        object.__setattr__(self, "caption", shown_text(self.caption))
        object.__setattr__(self, "head", tuple(map(shown_text, self.head)))

    def cells(self) -> list[tuple[str, ...]]:
        """All rows below the head as texts."""
        specs = [self.specs.get(title, self.spec) for title in self.head]
        return [
            tuple(shown(cell, spec) for cell, spec in zip(row, specs, strict=True))
            for row in (*self.rows, *self.reference)
        ]

    @property
    def has_unbounded(self) -> bool:
        """Whether a value has no interval, so that ``UNBOUNDED_NOTE`` is needed."""
        cells = (cell if isinstance(cell, tuple) else (cell,) for row in self.rows for cell in row)
        values = (value.interval if isinstance(value, Bounds) else value for cell in cells for value in cell)
        return any(isinstance(value, Interval) and value.valid and not value.bounded for value in values)

    def text(self) -> list[str]:
        """Lines for a terminal: the caption, if any, then columns two spaces apart."""
        rows = [self.head, *self.cells()]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(f"{cell:<{size}}" for cell, size in zip(row, widths, strict=True)).rstrip() for row in rows]
        return [self.caption, *lines] if self.caption else lines

    def csv(self) -> str:
        """The cells as CSV, with the head."""
        return csv_text(self.head, self.cells())

    def json(self) -> dict[str, Any]:
        """The values as JSON types: null for missing ones, intervals as in ``Interval.json``."""
        rows = {"rows": self.rows, "reference": self.reference}
        return {
            "key": self.key,
            "caption": self.caption,
            "head": list(self.head),
            **{name: [[_json(cell) for cell in row] for row in some] for name, some in rows.items()},
        }

    def latex(self) -> str:
        """LaTeX's ``tabular`` with the rules of ``booktabs``; the caption is a comment."""
        cells = (self.head, *self.cells())
        head, *rows = [" & ".join(cell.translate(_LATEX) for cell in row) + r" \\" for row in cells]
        below = rows[len(self.rows) :]
        lines = [
            f"% {self.caption}",
            rf"\begin{{tabular}}{{l{'c' * (len(self.head) - 1)}}}",
            r"\toprule",
            head,
            r"\midrule",
            *rows[: len(self.rows)],
            *([r"\midrule", *below] if below else []),
            r"\bottomrule",
            r"\end{tabular}",
        ]
        return "\n".join(lines) + "\n"

    def html(self, prefix: str = "") -> str:
        """An HTML ``table`` whose ``id`` is the prefix and the key; the first cell of a row is its head."""
        lines = [f'<table id="{escape(prefix + self.key)}">', f"<caption>{escape(self.caption)}</caption>"]
        titles = "".join(f'<th scope="col">{escape(title)}</th>' for title in self.head)
        lines += [f"<thead><tr>{titles}</tr></thead>", "<tbody>"]
        for first, *others in self.cells():
            cells = (f"<td{_WIDE if len(cell) > _LONG else ''}>{escape(cell)}</td>" for cell in others)
            lines.append(f'<tr><th scope="row">{escape(first)}</th>{"".join(cells)}</tr>')
        return "\n".join([*lines, "</tbody>", "</table>"])


def text_of(tables: Sequence[Table]) -> list[str]:
    """Lines for a terminal: tables separated by empty lines, with a note if an interval is missing."""
    lines = [line for table in tables for line in ("", *table.text())]
    return lines[1:] + [UNBOUNDED_NOTE] * any(table.has_unbounded for table in tables)


def csv_text(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """CSV with a head, also for data that are not a ``Table``; None is an empty cell."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows((head, *rows))
    return text.getvalue()


def shown(cell: Cell, spec: str = ".2f") -> str:
    """A cell as text; ``spec`` is Python's format specification of numbers."""
    if isinstance(cell, tuple):
        first, *others = cell
        separated = (f"{' ' if isinstance(value, Bounds) else '/'}{shown(value, spec)}" for value in others)
        return shown(first, spec) + "".join(separated)
    if cell is None or (isinstance(cell, float) and math.isnan(cell)):
        return NONE
    if isinstance(cell, str):
        return shown_text(cell)
    if isinstance(cell, float):
        return f"{cell:{_spec_for(spec, cell)}}"
    return f"{cell:,}" if isinstance(cell, int) else f"{cell:{spec}}"


def counted(number: int, noun: str) -> str:
    """A number with its noun: ``1 episode``, ``2 episodes``."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def _json(cell: Cell) -> Any:
    if isinstance(cell, tuple):
        return [_json(value) for value in cell]
    if isinstance(cell, Interval):
        return cell.json() if cell.valid else None
    if isinstance(cell, Bounds):
        return [cell.interval.low, cell.interval.high] if cell.interval.bounded else None
    if isinstance(cell, str):
        return shown_text(cell)
    return None if isinstance(cell, float) and math.isnan(cell) else cell


def render_page(page: str, /, **values: object) -> str:
    """One HTML file that needs no network: a page's template, with the common styles, its own, and its script.

    ``params/pages`` has a folder for each page, and the frame that all of them fill. Values are escaped; a missing
    value is an error. A template also has the hashes of its styles and script (``style_hash``,
    ``script_hash``), so that its security policy can allow these alone.
    """
    pages = params_dir() / "pages"
    style, script = (
        Markup("".join(path.read_text(encoding="utf-8") for path in paths if path.is_file()))  # noqa: S704 - our own files
        for paths in ((pages / "base.css", pages / page / "page.css"), (pages / page / "page.js",))
    )
    environment = Environment(
        loader=FileSystemLoader((pages / page, pages)),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
        finalize=_written,
    )
    hashes = {"style_hash": _policy_hash(style), "script_hash": _policy_hash(script)}
    return environment.get_template("page.html").render(style=style, script=script, **hashes, **values)


def _policy_hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _written(value: object) -> object:
    """A text without control characters, which names from other programs and files may contain."""
    return shown_text(value, len(value)) if type(value) is str else value
