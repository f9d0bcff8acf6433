"""``siren plot BAG --out FILE.png``: one picture that tells the episode."""

import argparse
from pathlib import Path

from siren_ros.errors import EXIT_OK
from siren_ros.pictures.birdseye import save_episode_picture
from siren_ros.recording.bag_reader import read_episode


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Describe the verb, and what it takes."""
    verb.description = (
        "Draws the roads, all paths coloured by speed, the yielding vehicles, the events, three moments of the "
        "interaction, and who did what when, into one PNG file."
    )
    verb.add_argument("bag", type=Path, metavar="BAG", help="folder of a recorded episode")
    verb.add_argument("--out", type=Path, metavar="FILE.png", required=True, help="picture to write")
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Draws the picture."""
    print(save_episode_picture(read_episode(arguments.bag), arguments.out))
    return EXIT_OK
