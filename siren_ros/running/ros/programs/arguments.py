"""Command line of a node's program: its help, its error messages, and quoting of texts that YAML would change.

None of it needs ROS, so that help and refusals come before rclpy starts.
"""

import json
import os
import re
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import fields
from itertools import pairwise
from pathlib import Path
from textwrap import fill
from typing import Any, Final

from siren_ros.base.params.parameter_field import allowed_text, defaults_of
from siren_ros.errors import EXIT_BAD_INPUT, EXIT_OK, InputError

_BEGIN: Final = "--ros-args"
_END: Final = "--"
_HELP: Final = frozenset({"-h", "--help"})
_FLAGS: Final = ("-p", "--param")
_SETTING: Final = re.compile(r"(?:--)?([A-Za-z_][\w-]*):?=(.*)", re.DOTALL)
_STRUCTURE: Final = re.compile(r"(?![\[{\"']).*(:(\s|$)|\s#)", re.DOTALL)
"""Matches an unquoted text that YAML reads as a mapping, or as a text with a comment."""
_WIDTH: Final = 100


def quoted(arguments: Sequence[str]) -> list[str]:
    """Quote parameters so that they reach the node as typed: ``bag:=a: b`` is a text.

    >>> quoted(["cosim", "--ros-args", "-p", "bag:=a: b", "-p", "seed:=3"])
    ['cosim', '--ros-args', '-p', 'bag:="a: b"', '-p', 'seed:=3']
    """
    return [
        f"{name}:={json.dumps(value)}" if before in _FLAGS and _STRUCTURE.match(value) else argument
        for before, argument in pairwise(("", *arguments))
        for name, _, value in [argument.partition(":=")]
    ]


def outside_ros(arguments: Iterable[str]) -> tuple[str, ...]:
    """Arguments for the program itself, which are not between ``--ros-args`` and ``--``.

    >>> outside_ros(["seed:=1", "--ros-args", "-p", "seed:=3", "--", "--help"])
    ('seed:=1', '--help')
    """
    ours: list[str] = []
    of_ros = False
    for argument in arguments:
        if of_ros:
            of_ros = argument != _END
        elif argument == _BEGIN:
            of_ros = True
        else:
            ours.append(argument)
    return tuple(ours)


def answer(words: Sequence[str], name: str, config_type: Callable[[], Any], summary: str) -> int:
    """Print the help, or an error about arguments that are not for ROS; returns the exit code.

    Args:
        words: The arguments, at least one.
        name: Name of the program.
        config_type: The dataclass of its parameters.
        summary: What the program does.
    """
    if _HELP.intersection(words):
        try:
            print(help_text(called(name), config_type, summary), flush=True)
        except BrokenPipeError:  # the program that read the output has ended, as with `| head`
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_OK
    known = {field.name for field in fields(config_type())}
    print(f"{name}: {InputError('arguments', ' '.join(words), _allowed(words, known))}", file=sys.stderr)
    return EXIT_BAD_INPUT


def called(name: str) -> str:
    """Command that starts a program: pip installs it under its own name."""
    script = Path(sys.argv[0]).name
    return script if script.startswith("siren-") else f"ros2 run siren_ros {name}"


def help_text(command: str, config_type: Callable[[], Any], summary: str) -> str:
    """Help of a program: each parameter with its default, meaning and allowed values."""
    config = config_type()
    defaults = defaults_of(type(config))
    lines = [f"usage: {command} [--ros-args [-p NAME:=VALUE]... [--params-file FILE]]", ""]
    lines += [fill(summary, _WIDTH), "", "parameters, with their defaults:"]
    for field in fields(config):
        default = defaults[field.name]
        limited = field.metadata["choices"] or field.metadata["minimum"] is not None
        accepted = f" ({allowed_text(field, type(default))})" if limited else ""
        lines.append(f"  {field.name}:={json.dumps(default)}")
        text = field.metadata["description"] + accepted
        lines.append(fill(text, _WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 6))
    return "\n".join(lines)


def _allowed(words: Sequence[str], known: set[str]) -> str:
    meant = [f"-p {shlex.quote(setting)}" for setting in _settings(words, known)]
    asked = f"; did you mean `{_BEGIN} {' '.join(meant)}`?" if meant else "; --help prints the parameters"
    return f"parameters behind {_BEGIN}, as -p NAME:=VALUE{asked}"


def _settings(words: Sequence[str], known: set[str]) -> Iterator[str]:
    for word in words:
        setting = _SETTING.fullmatch(word)
        name = setting[1].replace("-", "_") if setting else ""
        if setting and name in known:
            yield f"{name}:={setting[2]}"
