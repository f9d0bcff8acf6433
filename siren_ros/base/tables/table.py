"""The only table type: its cells hold values, and its methods write them as text, CSV, JSON, LaTeX and HTML.

A task makes its tables once. The terminal, the files and the pages show the same tables, with the same digits:

* A number has the digits of its column; a whole number has commas between the thousands. Numbers that name something,
  such as seeds, are given as text.
* An interval stands behind its value: ``2.28 [2.10, 2.43]``. ``[–]`` says that there is none, and a note below the
  tables says why.
* Values that belong together share a cell: ``1.44/3.73``.
* A text is printable: what another program wrote cannot change a terminal.
* A dash stands where there is no value. An empty cell is one in which nothing can stand.
"""

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any, Final

from siren_ros.base.tables.interval import BLOCKS_MIN, NONE, Bounds, Interval
from siren_ros.errors import shown_text

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
