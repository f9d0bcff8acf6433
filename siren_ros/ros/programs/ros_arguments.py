"""What stands after ``--ros-args``: texts that ROS's YAML would take for something else, and errors in one line."""

import json
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Final

from rclpy._rclpy_pybind11 import UnknownROSArgsError

from siren_ros.errors import InputError

_FLAGS: Final = ("-p", "--param")
_STRUCTURE: Final = re.compile(r"(?![\[{\"']).*(:(\s|$)|\s#)", re.DOTALL)
"""A text without quotes that YAML takes for a mapping, or for a text with a comment behind it."""
_PLACE: Final = re.compile(r", at /.*")
_UNREADABLE: Final = "Couldn't parse"


def quoted(arguments: Sequence[str]) -> list[str]:
    """Arguments whose parameters reach the node as they were typed: ``bag:=a: b`` is a text.

    >>> quoted(["cosim", "--ros-args", "-p", "bag:=a: b", "-p", "seed:=3"])
    ['cosim', '--ros-args', '-p', 'bag:="a: b"', '-p', 'seed:=3']
    """
    return [
        f"{name}:={json.dumps(value)}" if before in _FLAGS and _STRUCTURE.match(value) else argument
        for before, argument in pairwise(("", *arguments))
        for name, _, value in [argument.partition(":=")]
    ]


@contextmanager
def reading_arguments() -> Iterator[None]:
    """Around ``rclpy.init``, which reads the arguments.

    Raises:
        InputError: Arguments that ROS cannot read.
    """
    try:
        yield
    except UnicodeEncodeError as error:
        raise InputError("arguments", str(error.object), "text in UTF-8") from error
    except UnknownROSArgsError as error:
        raise InputError("arguments", str(error), "arguments that ROS knows, after --ros-args") from error
    except RuntimeError as error:  # rclpy's RCLError, for whatever goes wrong
        _, found, reason = _PLACE.sub("", str(error)).partition(_UNREADABLE)
        if not found:
            raise
        raise InputError("arguments", reason.strip(), "what ROS can read, such as -p NAME:=VALUE") from error
