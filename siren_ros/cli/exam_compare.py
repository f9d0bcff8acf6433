"""``siren exam compare A B``: two drivers by their certificates, episode by episode."""

import argparse
from pathlib import Path

from siren_ros.base.tables.table import text_of
from siren_ros.errors import EXIT_OK
from siren_ros.reports.exam.comparison import compared, read_certificate


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Compares two certificates of the same rulebook in the episodes that both have a result for: the share of "
        "episodes with a violation, clause by clause, and what the drivers do to others, with 95 % intervals of the "
        "differences."
    )
    for name, meaning in (("first", "certificate.json of a driver"), ("second", "that of another one")):
        verb.add_argument(name, type=Path, metavar=name.upper(), help=meaning)
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Prints the table."""
    print("\n".join(text_of([compared(read_certificate(arguments.first), read_certificate(arguments.second))])))
    return EXIT_OK
