"""Typed errors. Library code raises them; only programs turn them into a line and an exit code."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final
from uuid import uuid4

EXIT_OK: Final = 0
EXIT_FAILED: Final = 1
EXIT_BAD_INPUT: Final = 2


class SirenError(Exception):
    """The base class of all errors of the project. Programs exit with ``exit_code``."""

    exit_code = EXIT_FAILED


class InputError(SirenError):
    """Input that cannot be used; the message names the parameter, its value and what is allowed.

    >>> str(InputError("template", "S9", "one of S1, S2"))
    "template: 'S9' cannot be used; allowed: one of S1, S2"
    """

    exit_code = EXIT_BAD_INPUT

    def __init__(self, parameter: str, value: object, allowed: str) -> None:
        self.parameter = parameter
        self.value = value
        self.allowed = allowed
        super().__init__(f"{parameter}: {value!r} cannot be used; allowed: {allowed}")

    def __reduce__(self) -> tuple[Any, ...]:
        """How a process of a pool hands it over: without its message, which the constructor makes."""
        return _input_error, (type(self), self.parameter, self.value, self.allowed)


def _input_error(kind: type[InputError], parameter: str, value: object, allowed: str) -> InputError:
    """An error of a kind whose own constructor may take fewer arguments."""
    error = kind.__new__(kind)
    InputError.__init__(error, parameter, value, allowed)
    return error


LONGEST_TEXT: Final = 1000
"""Characters of a text that is shown; another program's error may be of any length."""


def shown_text(text: str, most: int = LONGEST_TEXT) -> str:
    r"""A text of another program as one line for terminals, files and pages: printable, and not endless.

    Control characters and halves of characters (lone surrogates, also those of names of files that are no UTF-8) are
    written as Python writes them, such as ``\x1b``; no escape code reaches a terminal, and every text has a UTF-8.
    """
    if text.isprintable() and len(text) <= most:
        return text
    line = "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode() for letter in text[:most]
    )
    return line if len(text) <= most else f"{line}… ({len(text)} characters)"


@contextmanager
def writing(place: object, kind: str = "file", parameter: str = "out") -> Iterator[None]:
    """Around what writes to a place that the user named: what the system refuses there is an error of that input.

    Args:
        place: The place as the message shows it, usually a path.
        kind: What is written there: a file, a folder, or either (a place).
        parameter: The option that named it.

    Raises:
        InputError: An OSError, with what the system says.
    """
    try:
        yield
    except OSError as error:
        raise InputError(parameter, str(place), f"a {kind} that can be written ({error.strerror or error})") from error


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A new file next to a file's place, which takes that place once it is whole; nothing half written has its name.

    Of a failure nothing stays, and what stood there before stays as it was. Devices and pipes are written themselves.

    Args:
        path: The file's place; its folder exists. A link leads to the file that is replaced.

    Raises:
        OSError: The new file cannot be written or moved.
    """
    target = path.resolve()
    if target.exists() and not target.is_file():
        yield target
        return
    # The suffix stays, because libraries choose the format by it.
    new = target.with_name(f".{os.getpid()}-{uuid4().hex[:8]}{target.suffix}")
    try:
        yield new
        new.replace(target)
    except BaseException:
        with suppress(OSError):
            new.unlink()
        raise


def write_text(path: Path, text: str) -> None:
    """Writes a text in UTF-8, whole or not at all; InputError where the file cannot be written.

    Halves of characters, as in names of files that are no UTF-8, are written as ``shown_text`` shows them.
    """
    with writing(path), whole_file(path) as new:
        new.write_text(text, encoding="utf-8", errors="backslashreplace")


class MapError(InputError):
    """A map that cannot be read, or that has no site of the kind a template needs."""

    def __init__(self, value: object, allowed: str) -> None:
        super().__init__("map", value, allowed)


class BagError(InputError):
    """A bag that is missing, unreadable or not an episode."""

    def __init__(self, value: object, allowed: str) -> None:
        super().__init__("bag", value, allowed)


class EpisodeError(SirenError):
    """An episode that had to end early: a participant failed, SUMO teleported, the residual grew."""
