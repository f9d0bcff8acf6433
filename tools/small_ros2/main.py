"""The command line: which verbs there are, and what becomes of errors and Ctrl-C."""

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from typing import Final

from small_ros2.arguments import Parser
from small_ros2.errors import CommandError

EXIT_INTERRUPTED: Final = 130
"""What a shell reports for a program that Ctrl-C ended (128 + SIGINT)."""

COMMANDS: Final = ("run", "launch", "pkg", "interface", "node", "param", "topic", "bag")


def build_parser(command: str | None) -> argparse.ArgumentParser:
    """The parser for one command; without a known one, the parser that lists all of them.

    Args:
        command: First word of the command line; only its module is imported.
    """
    parser = Parser(
        prog="ros2", description="A small ros2 for this project: the verbs below, with the real one's arguments."
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=Parser)
    summaries = {
        "run": "run an executable of a package",
        "launch": "start the nodes of a launch file",
        "pkg": "list executables",
        "interface": "list and print the definitions of types",
        "node": "list nodes and what they publish, subscribe to and offer",
        "param": "list and print parameters",
        "topic": "list, describe, print and measure topics",
        "bag": "describe and play recorded bags",
    }
    for name in COMMANDS:
        sub_parser = commands.add_parser(name, help=summaries[name], description=summaries[name].capitalize() + ".")
        if name == command:
            importlib.import_module(f"small_ros2.{name}").add_arguments(sub_parser)
    return parser


def main(argv: Sequence[str]) -> int:
    """Runs one command and returns its exit code."""
    command = next((word for word in argv if not word.startswith("-")), None)
    arguments = build_parser(command).parse_args(argv)
    try:
        return int(arguments.main(arguments))
    except CommandError as error:
        sys.stderr.write(f"ros2 {arguments.command}: {error}\n")
        return error.exit_code
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader of our output (`| head`) has gone: nothing more can be said, nor flushed at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_INTERRUPTED
