"""Figures in documents: marks such as ``{{ town.S1.holds }}`` and ``{{ prediction.S1.cv.ade_m:.2f }}``."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from siren_ros.errors import InputError, write_text
from siren_ros.reproduction.results import PartResult

_MARK: Final = re.compile(r"\{\{ *([\w-]+)\.([^\s:{}]+?)(?::([^\s{}]+))? *\}\}")
_BLOCK: Final = re.compile(r"(<!-- results: (\S+) -->\n).*?(<!-- end of results -->)", re.DOTALL)
_LITERAL: Final = re.compile(r"(?<![\w.,/-])\d+\.\d+(?![\w.]|\d)")
_LEAST_DIGITS: Final = 3
"""Numbers with fewer digits are equal by chance too often."""


def filled(text: str, results: Mapping[str, PartResult], document: str) -> str:
    """A document with the figures in place of the marks.

    Raises:
        InputError: A mark names no figure, or its format does not fit; with the document and the line.
    """

    def figure(mark: re.Match[str]) -> str:
        part, name, form = mark.groups()
        where = f"{document}:{text.count(chr(10), 0, mark.start()) + 1}"
        if part not in results or name not in results[part].figures:
            raise InputError(where, mark.group(0), "a figure of docs/results.json")
        try:
            return format(results[part].figures[name], form or "")
        except ValueError as error:
            raise InputError(where, mark.group(0), f"a format that fits; {error}") from error

    return _MARK.sub(figure, text)


def marks_in(text: str) -> Iterator[tuple[str, str, str | None]]:
    """The marks of a document: part, name, format."""
    for mark in _MARK.finditer(text):
        yield mark.group(1), mark.group(2), mark.group(3)


def write_blocks(document: Path, results: Mapping[str, PartResult]) -> bool:
    """Fills the blocks of a document that is read outside the site; returns whether it changed.

    A block stands between ``<!-- results: FILE -->`` and ``<!-- end of results -->``. FILE, relative to the document,
    holds its text with marks.
    """
    text = document.read_text(encoding="utf-8")

    def block(match: re.Match[str]) -> str:
        begin, source, end = match.groups()
        return begin + filled((document.parent / source).read_text(encoding="utf-8"), results, source) + end

    written = _BLOCK.sub(block, text)
    if written != text:
        write_text(document, written)
    return written != text


def unmarked_figures(text: str, marked: Mapping[str, str]) -> list[str]:
    """``LINE: NUMBER, write MARK`` for the numbers of a document that are written by hand although they are measured.

    They have at least three digits and a decimal point. ``text`` has no blocks of code. ``marked`` has the figures as
    documents show them, with the mark of each.
    """
    return [
        f"{number}: {literal}, write {marked[literal]}"
        for number, line in enumerate(text.splitlines(), 1)
        for literal in _LITERAL.findall(line)
        if len(literal) > _LEAST_DIGITS and literal in marked
    ]
