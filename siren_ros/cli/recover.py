"""``siren recover BAG``: completes a bag whose writer was killed."""

import argparse
import sys
from pathlib import Path

from siren_ros.errors import EXIT_FAILED, EXIT_OK
from siren_ros.recording.recover import recover_bag


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Describe the verb, and what it takes."""
    verb.description = (
        "Writes a complete bag from all whole chunks of one that was cut off or damaged. A bag that is "
        "complete is left alone. Exit code 1 where messages of the file are lost."
    )
    verb.add_argument(
        "bag",
        type=Path,
        metavar="BAG",
        help="folder of the bag, or the name that it was to have",
    )
    verb.add_argument("--out", type=Path, metavar="FOLDER", help="new folder (default: BAG.partial next to the bag)")
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Completes the bag and says what was saved."""
    recovery = recover_bag(arguments.bag, arguments.out)
    count = f"{recovery.messages} messages, {recovery.steps} steps"
    if recovery.healthy:
        print(f"{recovery.path}: complete as it is: {count}")
        return EXIT_OK
    print(f"{recovery.path}: saved {count}")
    if recovery.restored:
        print(f"  {recovery.restored} of them from their second copies at the end of the damaged file")
    if recovery.lost_messages:
        print(f"siren recover: {recovery.lost_messages} messages are lost: {recovery.lost}", file=sys.stderr)
    elif recovery.lost and not recovery.restored:
        print(f"siren recover: the unfinished end is lost: {recovery.lost}", file=sys.stderr)
    if not recovery.described:
        print("siren recover: without its description or its map the bag is no episode any more", file=sys.stderr)
    return EXIT_FAILED if recovery.lost_messages else EXIT_OK
