"""Measured figures and generated tables in the documents, each with a comment that says where it comes from.

A figure stands before its source, ``1.99<!--=town.S1.ade_m:.2f-->``. In a table the header can hold the source of a
whole column, ``ADE<!--={town.*.ade_m:.2f} m-->``: the star stands for the first word of a row's first cell, or for what
that cell says, ``mean<!--*=all-->``. A cell with a comment of its own is not the column's. A generated table stands
between ``<!-- table of NAME -->`` and ``<!-- end of table -->``.
"""

import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Final

from siren_ros.errors import InputError, write_text
from siren_ros.lab.reproduction.results import PartResult

Lookup = Callable[[str], str]
"""Gives the text of a figure from its source, or a table as Markdown from its name."""

_FIGURE: Final = re.compile(r"(?:[+-]?\d[\d.,]*(?:/\d+|%)?|–)?<!--=([^{}>\s]+)-->")
_TABLE: Final = re.compile(r"(<!-- table of (\w+) -->\n).*?(<!-- end of table -->)", re.DOTALL)
_ROWS: Final = re.compile(r"^((\|.*<!--=[^>\n]*\{.*\|)\n\|[-|: ]+\|\n)((?:\|.*\|\n)+)", re.MULTILINE)
_BAR: Final = re.compile(r"(?<!\\)\|")
_SPACED_BAR: Final = re.compile(r" *(?<!\\)\| *")
_COMMENT: Final = re.compile(r"<!--.*?-->", re.DOTALL)
_COLUMN: Final = re.compile(r"<!--=([^>]*\{[^>]*)-->")
_NAME: Final = re.compile(r"\{([^}\s]+)\}")
_STAR: Final = re.compile(r"<!--\*=(\S*)-->")
_WORD: Final = re.compile(r"[\w-]+")
_LITERAL: Final = re.compile(r"(?<![\w.,/-])\d+\.\d+(?![\w.]|\d)")
_LEAST_DIGITS: Final = 3
"""Numbers with fewer digits are equal by chance too often."""


def documents_of(repository: Path) -> list[Path]:
    """The documents of the repository, sorted."""
    return sorted([*repository.glob("*.md"), *(repository / "docs").rglob("*.md")])


def figure_of(results: Mapping[str, PartResult], document: str, source: str) -> str:
    """The text of a figure that a document asks for by part, name and format, such as ``town.S1.ade_m:.2f``.

    Raises:
        InputError: There is no such figure, or its format does not fit; with the document.
    """
    path, _, form = source.partition(":")
    part, _, name = path.partition(".")
    if part not in results or name not in results[part].figures:
        raise InputError(document, source, "a figure of docs/results.json")
    try:
        return format(results[part].figures[name], form)
    except ValueError as error:
        raise InputError(document, source, f"a format that fits; {error}") from error


def written(text: str, figure: Lookup, table: Lookup) -> str:
    """A document with the figures and tables that its comments ask for.

    Args:
        text: The document.
        figure: Where figures come from.
        table: Where tables come from.
    """
    with_tables = _TABLE.sub(lambda found: f"{found[1]}\n{_close(table(found[2]))}\n\n{found[3]}", text)
    with_columns = _ROWS.sub(lambda found: f"{found[1]}{_rows(found[2], found[3], figure)}", with_tables)
    return _FIGURE.sub(lambda found: f"{figure(found[1])}<!--={found[1]}-->", with_columns)


def _close(table: str) -> str:
    """A table without spaces around its bars, as documents write tables."""
    return _SPACED_BAR.sub("|", table)


def _cells(row: str) -> list[str]:
    return _BAR.split(row)[1:-1]


def _rows(head: str, rows: str, figure: Lookup) -> str:
    """The rows of a table, with the columns that have their source in the header."""
    columns = [_COLUMN.search(cell) for cell in _cells(head)]
    lines = []
    for row in rows.splitlines():
        cells = _cells(row)
        said, word = _STAR.search(cells[0]), _WORD.search(cells[0])
        star = said[1] if said else word[0] if word else ""
        whole = [_cell(star, cell, column, figure) for cell, column in zip(cells, columns, strict=True)]
        lines.append("|".join(["", *whole, "\n"]))
    return "".join(lines)


def _cell(star: str, cell: str, column: re.Match[str] | None, figure: Lookup) -> str:
    if column is None or "<!--" in cell:
        return cell
    own = column[1].replace(".*", f".{star}" if star else "")
    return _NAME.sub(lambda found: figure(found[1]), own)


def rewrite(
    document: Path, repository: Path, results: Mapping[str, PartResult], tables: Mapping[str, Callable[[], str]]
) -> bool:
    """Writes figures and tables into a document; returns whether it changed.

    Raises:
        InputError: It asks for a figure or a table that does not exist.
    """
    name = document.relative_to(repository).as_posix()

    def table(asked: str) -> str:
        if asked not in tables:
            raise InputError(name, asked, f"one of {', '.join(tables)}")
        return tables[asked]()

    text = document.read_text(encoding="utf-8")
    whole = written(text, partial(figure_of, results, name), table)
    if whole != text:
        write_text(document, whole)
    return whole != text


def sources_in(text: str) -> list[str]:
    """The sources of all figures of a document, those of its columns row by row."""
    sources: list[str] = []

    def note(source: str) -> str:
        sources.append(source)
        return ""

    written(text, note, lambda _: "")
    return sources


def figures_by_hand(text: str, sources: Mapping[str, str]) -> list[str]:
    """``NUMBER: write NUMBER with its source`` for the numbers of a document that are measured and have no source.

    They have at least three digits and a decimal point. ``text`` has no blocks of code. ``sources`` has the figures as
    documents show them, with the source of each.
    """
    others = _COMMENT.sub("", written(text, lambda _: "", lambda _: ""))
    return [
        f"{literal}: write {literal}<!--={sources[literal]}-->"
        for literal in _LITERAL.findall(others)
        if len(literal) > _LEAST_DIGITS and literal in sources
    ]
