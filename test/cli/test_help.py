"""What ``--help`` prints: every command and option says what it does, in words that anybody understands."""

import argparse
import re

import pytest
from test_documents import PRIVATE_WORDS

from siren_ros.cli.main import command_lines

LINES = {line.prog: line for line in command_lines()}


@pytest.mark.parametrize("prog", LINES)
def test_every_command_and_option_says_what_it_does(prog: str) -> None:
    line = LINES[prog]
    unclear = [
        action.option_strings[0] if action.option_strings else action.dest
        for action in line._actions
        if not isinstance(action, argparse._SubParsersAction)
        and not re.match(r"[^\W\d_(]", re.sub(r"^\(.*?\)\s*", "", action.help or ""))
    ]
    assert not unclear
    assert (line.description or "").endswith(".")


@pytest.mark.parametrize("prog", LINES)
def test_help_is_written_for_somebody_new(prog: str) -> None:
    text = LINES[prog].format_help()
    assert not PRIVATE_WORDS.findall(text)
    assert "%%" not in text


@pytest.mark.parametrize("prog", LINES)
def test_numbers_of_processes_are_named_alike(prog: str) -> None:
    helps = {action.help for action in LINES[prog]._actions if action.dest in {"jobs", "workers"}}
    assert helps <= {"processes (default: one for each processor)"}
