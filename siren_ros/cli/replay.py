"""``siren replay --check``: is the recorded episode what its description gives again?"""

import argparse
from pathlib import Path
from typing import Any

from siren_ros.generation.replay_check import repeat_episode
from siren_ros.recording.bag_reader import read_episode
from siren_ros.world.errors import EXIT_FAILED, EXIT_OK


def add_to(verbs: Any) -> None:
    """Register the verb."""
    parser = verbs.add_parser(
        "replay",
        help="simulate an episode again and compare it step by step",
        description="Simulates an episode again from its own description, compares every field of every actor at every "
        "step and names the first that differs. To publish a bag on its topics: ros2 bag play.",
    )
    parser.add_argument("bag", type=Path, metavar="BAG", help="folder of the bag")
    parser.add_argument("--check", action="store_true", required=True, help="compare with the record")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Compare and say what was found."""
    return _check(arguments.bag)


def _check(bag: Path) -> int:
    record = read_episode(bag)
    difference = repeat_episode(record)
    if difference is None:
        last = record.state_hashes.get(record.steps - 1, 0)
        print(f"{bag}: the same, to the last bit, over {record.steps} steps (last state hash {last:016x})")
        return EXIT_OK
    print(f"{bag}: differs first at {difference}")
    return EXIT_FAILED
