"""What ``--help`` prints: every command and option says what it does, in words that anybody understands."""

import argparse
import re
from dataclasses import fields

import pytest
from test_documents import PRIVATE_WORDS

from siren_ros.cli.command import Command
from siren_ros.cli.main import command_lines, main
from siren_ros.simulation.roads.maps.map_compiler import BUILT_IN_MAPS
from siren_ros.simulation.scenario.episode import EpisodeRequest

LINES = {line.prog: line for line in command_lines()}


@pytest.mark.parametrize("prog", LINES)
def test_every_command_and_option_says_what_it_does(prog: str) -> None:
    line = LINES[prog]
    unclear = [
        action.option_strings[0] if action.option_strings else action.dest
        for action in line.arguments()
        if action.help != argparse.SUPPRESS
        and not re.match(r"[^\W\d_(]", re.sub(r"^\(.*?\)\s*", "", action.help or ""))
    ]
    assert not unclear
    assert (line.description or "").endswith(".")


@pytest.mark.parametrize("prog", LINES)
def test_help_is_written_for_somebody_new(prog: str) -> None:
    text = LINES[prog].format_help()
    assert not PRIVATE_WORDS.findall(text)
    assert "%%" not in text


FORMER = {"--jobs": "--workers", "--time": "--time-s", "--start": "--start-s", "--playback-duration": "--duration-s"}
"""Spellings that still work, and the one that the help shows in every command."""


def known(line: Command) -> dict[str, argparse.Action]:
    """Its options, also those that the help does not show."""
    return {option: action for action in line.arguments() for option in action.option_strings}


def shown(line: Command) -> dict[str, argparse.Action]:
    return {option: action for option, action in known(line).items() if action.help != argparse.SUPPRESS}


@pytest.mark.parametrize("prog", LINES)
def test_what_is_the_same_has_one_name_in_every_command(prog: str) -> None:
    options = shown(LINES[prog])
    others = {*FORMER, "--processes", "--begin", "--duration", "--timeout", "--output"}
    assert not others & set(options)
    if "--workers" in options:
        assert options["--workers"].help == "processes (default: one for each processor)"
    if "--sensors" in options:
        assert "suite" in str(options["--sensors"].help)
    for name in {"--maps", "--map"} & set(options):
        assert all(built_in in str(options[name].help) for built_in in BUILT_IN_MAPS)


@pytest.mark.parametrize("prog", LINES)
def test_former_names_lead_to_the_same_option(prog: str) -> None:
    options = known(LINES[prog])
    for former in set(FORMER) & set(options):
        assert options[former].dest == options[FORMER[former]].dest
    assert ("--jobs" in options) == ("--workers" in options)


def test_former_names_work(siren, tmp_path) -> None:
    words = ["sense", str(tmp_path / "none"), "--out", str(tmp_path / "a.png")]
    for name in ("--time", "--time-s"):
        assert "none" in siren([*words, name, "3"], 2).err
    with pytest.raises(SystemExit):
        main(words)
    for name in ("--sensors", "--show"):
        assert "none" in siren(["view", str(tmp_path / "none"), name, "all"], 2).err
    assert "jobs" not in siren(["exam", str(tmp_path / "none"), "--jobs", "0"], 2).err


def test_the_parameter_of_a_map_names_the_built_in_ones() -> None:
    (meaning,) = [field.metadata["description"] for field in fields(EpisodeRequest) if field.name == "map"]
    assert all(name in meaning for name in BUILT_IN_MAPS)
