"""``ros2 run PACKAGE EXECUTABLE [ARGUMENT...]``."""

import argparse
import importlib
import os
import sys

from small_ros2.index import built_in, executable


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the arguments; everything behind the executable's name is passed on to it untouched."""
    parser.add_argument("package", help="name of the package")
    parser.add_argument("executable", help="name of the executable")
    parser.add_argument("arguments", nargs=argparse.REMAINDER, help="passed on, for example --ros-args -p NAME:=VALUE")
    parser.set_defaults(main=run)


def run(arguments: argparse.Namespace) -> int:
    """Replaces this process by the executable, unless it is one that the small ros2 brings.

    So the executable has the terminal, gets every signal exactly once, and its exit code is that of this program.
    """
    module = built_in(arguments.package).get(arguments.executable)
    if module is not None:
        return int(importlib.import_module(module).main(arguments.arguments))
    path = executable(arguments.package, arguments.executable)
    sys.stdout.flush()
    sys.stderr.flush()
    return os.execv(path, [str(path), *arguments.arguments])  # noqa: S606  starting what the user names is the purpose
