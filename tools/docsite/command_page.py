"""The page of the command ``siren``: what ``--help`` prints, verb by verb."""

from functools import partial
from typing import Any, Final

from siren_ros.cli.main import command_lines

_INTRODUCTION: Final = """# The command `siren`

Inside the environment: `./env siren …`. Exit codes: 0 all is well; 1 a check or an episode failed; 2 the input cannot
be used. One line then names the input and what is allowed.
"""
_WIDTH: Final = 90


def command_page() -> str:
    """The page as Markdown, with a heading for each command."""
    parts = [_INTRODUCTION]
    for line in command_lines():
        kind: Any = line.formatter_class
        line.formatter_class = partial(kind, width=_WIDTH)
        parts.append(f"## `{line.prog}`\n\n```text\n{line.format_help().strip()}\n```\n")
    return "\n".join(parts)
