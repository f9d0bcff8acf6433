"""Errors that cross from one process to another, those of places that cannot be written, and texts of others."""

import pickle
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.errors import (
    LONGEST_TEXT,
    BagError,
    EpisodeError,
    InputError,
    MapError,
    SirenError,
    shown_text,
    write_text,
    writing,
)


@pytest.mark.parametrize(
    "error",
    [
        InputError("template", "S9", "one of S1, S2"),
        MapError("town.xodr", "a map that can be read"),
        BagError("bags/x", "a folder that exists"),
        EpisodeError("SUMO has gone"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_of_workers_arrive_whole(error: SirenError) -> None:
    arrived = pickle.loads(pickle.dumps(error))  # noqa: S301 - made here
    assert type(arrived) is type(error)
    assert str(arrived) == str(error)
    assert arrived.exit_code == error.exit_code
    assert vars(arrived) == vars(error)


@pytest.mark.parametrize(("kind", "parameter"), [("file", "out"), ("folder", "page")])
def test_what_the_system_refuses_is_an_error_of_the_input(kind: str, parameter: str, tmp_path: Path) -> None:
    below_a_file = tmp_path / "file" / "below"
    below_a_file.parent.write_text("a file, not a folder", encoding="utf-8")
    with pytest.raises(InputError) as raised, writing(below_a_file, kind, parameter):
        below_a_file.write_text("", encoding="utf-8")
    assert (raised.value.parameter, raised.value.value) == (parameter, str(below_a_file))
    assert raised.value.allowed == f"a {kind} that can be written (Not a directory)"


@given(st.text(max_size=2 * LONGEST_TEXT))
def test_what_is_shown_is_one_printable_line_of_bounded_length(text: str) -> None:
    shown = shown_text(text)
    assert shown.isprintable()
    assert len(shown) <= 10 * LONGEST_TEXT + 40
    if text.isprintable() and len(text) <= LONGEST_TEXT:
        assert shown == text


def test_escape_codes_are_spelled_out_and_a_long_text_says_how_long_it_was() -> None:
    assert (shown_text("red \x1b[31m\nnext"), shown_text("é\ud800")) == ("red \\x1b[31m\\nnext", "é\\ud800")
    assert shown_text("x" * 100_000) == "x" * LONGEST_TEXT + "… (100000 characters)"
    assert shown_text("abcd", most=3) == "abc… (4 characters)"


def test_halves_of_characters_are_spelled_out_in_files(tmp_path: Path) -> None:
    write_text(tmp_path / "page.html", "bags/\udce9 é")
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == "bags/\\udce9 é"
