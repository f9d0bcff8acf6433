"""``siren verify BAG…``: did the interaction happen, and can the record be trusted."""

import argparse
import sys
from pathlib import Path

from siren_ros.errors import EXIT_BAD_INPUT, EXIT_FAILED, EXIT_OK, SirenError
from siren_ros.judging.verdict import Part
from siren_ros.judging.verify import Verification, verify_episode
from siren_ros.recording.bag_reader import read_episode


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Describe the verb, and what it takes."""
    verb.description = (
        "Evaluates the predicate of the episode's template on the record alone, and checks continuity, "
        "ownership, residuals, message counts and stamps. Exit code 1 where anything fails."
    )
    verb.add_argument("bags", type=Path, metavar="BAG", nargs="+", help="folder of a recorded episode")
    verb.add_argument("-q", "--quiet", action="store_true", help="print one line for each bag, and what fails")
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Verifies every bag; a bag that cannot be read does not keep the others from being verified."""
    worst = EXIT_OK
    for bag in arguments.bags:
        try:
            verification = verify_episode(read_episode(bag))
        except SirenError as error:
            print(f"siren verify: {error}", file=sys.stderr)
            worst = max(worst, error.exit_code)
            continue
        print("\n".join(_report(bag, verification, quiet=arguments.quiet)))
        worst = max(worst, EXIT_OK if verification.holds else EXIT_FAILED)
    return min(worst, EXIT_BAD_INPUT)


def _report(bag: Path, verification: Verification, quiet: bool) -> list[str]:
    word = "holds" if verification.holds else "FAILS"
    lines = [f"{bag}: {word}: {verification.verdict.text}"]
    for title, parts in (("interaction", verification.verdict.parts), ("record", verification.checks)):
        shown = [part for part in parts if not (quiet and part.holds)]
        lines += [f"  {title}"] if shown and not quiet else []
        lines += [_line(part) for part in shown]
    return lines


def _line(part: Part) -> str:
    return f"    {'ok  ' if part.holds else 'FAIL'}  {part}"
