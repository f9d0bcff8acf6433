"""The option that says how many processes a command works with: the same for every command."""

import argparse
import os
from collections.abc import Callable

from siren_ros.errors import InputError


def add_processes(
    line: "argparse.ArgumentParser | argparse._ArgumentGroup", option: str = "--jobs", kind: Callable[[str], int] = int
) -> None:
    """Adds the option to a command, with the processors that this process may use as its default."""
    line.add_argument(
        option,
        type=kind,
        default=len(os.sched_getaffinity(0)),
        metavar="N",
        help="processes (default: one for each processor)",
    )


def processes_of(arguments: argparse.Namespace) -> int:
    """What ``--jobs`` says.

    Raises:
        InputError: No process to work with.
    """
    jobs = int(arguments.jobs)
    if jobs < 1:
        raise InputError("jobs", jobs, "1 or more")
    return jobs
