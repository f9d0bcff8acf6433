"""Options that several commands share: numbers, names, processes, bars, and one measurement on many bags."""

import argparse
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from tqdm import tqdm

from siren_ros.base.params.signatures import fault_of_signature
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.cli.command import complain
from siren_ros.errors import EXIT_OK, InputError, SirenError, shown_text

Item = TypeVar("Item")
Measured = TypeVar("Measured")


def of_each_bag(
    measure: Callable[[Item], Measured], bags: Sequence[Item], jobs: int, verb: str = "evaluate"
) -> tuple[list[Measured], int]:
    """The results of the bags that can be read, and the worst exit code; standard error says what is wrong.

    ``measure`` is a function of a module, because other processes call it; it takes a bag, or what stands for one.
    ``verb`` is the command that speaks.
    """
    with (
        ProcessPool(min(jobs, len(bags))) as pool,
        tqdm(total=len(bags), unit="episode", desc=verb, disable=None) as bar,
    ):
        measured = pool.map(_tried, [(measure, bag) for bag in bags], steps_of(bar))
    errors = [result for result in measured if isinstance(result, SirenError)]
    for error in errors:
        complain(f"siren {verb}: {error}")
    worst = max((error.exit_code for error in errors), default=EXIT_OK)
    return [result for result in measured if not isinstance(result, SirenError)], worst


def _tried(measure: Callable[[Item], Measured], bag: Item) -> Measured | SirenError:
    try:
        return measure(bag)
    except SirenError as error:
        return error


def names_in(text: str) -> tuple[str, ...]:
    """Names separated by commas, without the spaces around them; empty ones do not count. Tables can show them."""
    return tuple(shown_text(name.strip()) for name in text.split(",") if name.strip())


def check_numbers(arguments: argparse.Namespace, limits: Mapping[str, tuple[float, float]]) -> None:
    """Checks options against the least and the largest number that they may have; those that are not given are fine.

    Raises:
        InputError: A number outside its limits, or none at all (nan).
    """
    for name, (least, most) in limits.items():
        value = getattr(arguments, name)
        if value is not None and not least <= value <= most:
            kind = "an integer" if isinstance(value, int) else "a number"
            raise InputError(name, value, f"{kind} from {least:.12g} to {most:.12g}")


def steps_of(bar: "tqdm[Any]") -> Callable[..., None]:
    """A function that moves a bar on each time it is called, by one or by what it is given."""

    def step(width: float = 1) -> None:
        bar.update(width)

    return step


def add_processes(line: "argparse.ArgumentParser | argparse._ArgumentGroup", kind: Callable[[str], int] = int) -> None:
    """Adds ``--workers`` to a command, with the processors that this process may use as its default."""
    line.add_argument(
        "--workers",
        type=kind,
        default=len(os.sched_getaffinity(0)),
        metavar="N",
        help="processes (default: one for each processor)",
    )
    add_former(line, "--jobs", "workers", type=kind)


def add_former(
    line: "argparse.ArgumentParser | argparse._ArgumentGroup", option: str, name: str, **options: Any
) -> None:
    """Lets an option be called by a spelling that it had before, which the help does not show."""
    line.add_argument(option, dest=name, default=argparse.SUPPRESS, help=argparse.SUPPRESS, **options)


def processes_of(arguments: argparse.Namespace) -> int:
    """The number of ``--workers``; InputError where there is no process to work with."""
    workers = int(arguments.workers)
    if workers < 1:
        raise InputError("workers", workers, "1 or more")
    return workers


def positive(text: str) -> int:
    """Reads a positive whole number; argparse prints the error."""
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 on")
    return value


def named_path(text: str) -> tuple[str, Path]:
    """The type of an argument ``NAME=PATH``, with a name that tables and files can show; argparse prints the error."""
    name, _, path = text.partition("=")
    if not (name and path):
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=PATH")
    return shown_text(name), Path(path)


def add_named_paths(line: argparse.ArgumentParser, option: str, metavar: str, meaning: str) -> None:
    """Adds an option such as ``NAME=PATH`` that may be given several times."""
    meaning = f"{meaning}; may be given several times"
    line.add_argument(option, type=named_path, action="append", default=[], metavar=metavar, help=meaning)


def add_bags(line: argparse.ArgumentParser) -> None:
    """Adds the argument for ``bags_among``."""
    line.add_argument("bags", type=Path, metavar="BAG", nargs="+", help="bags, or folders with bags at any depth")


def add_signing(verb: argparse.ArgumentParser) -> None:
    """Adds ``--sign``."""
    verb.add_argument("--sign", type=Path, metavar="KEY.pem", help="sign it with a private key of Ed25519")


def add_public_key(verb: argparse.ArgumentParser) -> None:
    """Adds ``--public-key``."""
    verb.add_argument("--public-key", type=Path, metavar="KEY.pem", help="also check the signature of this key's owner")


def faults_of_signature(arguments: argparse.Namespace, file: Path) -> tuple[str, ...]:
    """Why a file is not signed by the owner of ``--public-key``; nothing without the option."""
    fault = "" if arguments.public_key is None else fault_of_signature(file, arguments.public_key)
    return (fault,) if fault else ()
