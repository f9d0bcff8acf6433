"""``siren sense BAG --time S --sensors SUITE --look LOOK --out FILE``: what sensors see at an instant."""

import argparse
from pathlib import Path

from siren_ros.errors import EXIT_OK
from siren_ros.pictures.sensor_views import observe_at, save_sheet
from siren_ros.recording.bag_reader import read_episode
from siren_ros.sensors.look import load_look, look_of
from siren_ros.sensors.suite import load_suite


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Describe the verb, and what it takes."""
    verb.description = (
        "Draws the pictures of all cameras of a suite and its point clouds, by height and by instance, into one "
        "file. Suite and look may be others than the episode's own, and the bag may be one without sensors."
    )
    verb.add_argument("bag", type=Path, metavar="BAG", help="folder of a recorded episode")
    verb.add_argument("--time", type=float, metavar="S", required=True, help="simulated time")
    verb.add_argument("--sensors", metavar="SUITE", default="full", help="name or file of a suite (default: full)")
    verb.add_argument("--look", metavar="LOOK", help="name or file of a look; the episode's own without it")
    verb.add_argument("--actor", type=int, metavar="ID", help="who carries the sensors; the first EMV without it")
    verb.add_argument("--out", type=Path, metavar="FILE", required=True, help="PNG or JPEG file to write")
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Draws the pictures."""
    record = read_episode(arguments.bag)
    episode = record.description
    look = load_look(arguments.look) if arguments.look else load_look(look_of(episode), episode.files)
    seen = observe_at(record, arguments.time, load_suite(arguments.sensors), look, arguments.actor)
    print(save_sheet(seen, arguments.out))
    return EXIT_OK
