"""``siren replay``: plays a recorded episode on its topics, or checks that its description gives it again."""

import argparse
import json
import os
import re
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from siren_ros.cli.command import complain
from siren_ros.cli.options import add_former
from siren_ros.data.recording.bag_reader import check_bag_files, read_episode
from siren_ros.errors import EXIT_FAILED, EXIT_OK, InputError
from siren_ros.running.generation.replay_check import notes_on, repeat_episode

_RULE: Final = re.compile(r"[A-Za-z0-9_/~]+:=[A-Za-z0-9_/~]+")


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Publishes an episode on the topics of the live run, with its clock. With --check, it simulates the episode "
        "again from the map and the files in its bag, without sensors, compares the result with the record, and names "
        "the first difference."
    )
    verb.add_argument("bag", type=Path, metavar="BAG", help="folder of the bag")
    verb.add_argument("--check", action="store_true", help="simulate again and compare instead of playing")
    verb.add_argument(
        "--rate", type=float, default=1.0, metavar="R", help="simulated seconds per wall second (default 1)"
    )
    verb.add_argument("--start-s", type=float, default=0.0, metavar="S", help="simulated time of the begin (default 0)")
    verb.add_argument("--loop", action="store_true", help="begin again at the end")
    verb.add_argument("--paused", action="store_true", help="wait for the service /rosbag2_player/resume first")
    verb.add_argument(
        "--duration-s",
        type=float,
        default=0.0,
        metavar="S",
        help="simulated time (default: all)",
    )
    add_former(verb, "--start", "start_s", type=float)
    add_former(verb, "--playback-duration", "duration_s", type=float)
    verb.add_argument(
        "--topics", nargs="+", default=[], metavar="TOPIC", help="only these topics and the clock (default: all)"
    )
    verb.add_argument(
        "--remap", "-m", nargs="+", default=[], metavar="OLD:=NEW", help="publish topics under other names"
    )
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Compare and say what was found, or become the player."""
    return _check(arguments.bag) if arguments.check else _play(arguments)


def _check(bag: Path) -> int:
    record = read_episode(bag)
    difference = repeat_episode(record)
    if difference is None:
        last = max((state.step for state in record.states), default=0)
        over = f"over {record.steps} steps (last state hash {record.state_hashes.get(last, 0):016x})"
        print(f"{bag}: the same, to the last bit, {over}")
    else:
        print(f"{bag}: differs first at {difference}")
    if record.lost_steps:
        closed = record.steps + record.lost_steps
        complain(f"siren replay: {bag} is not complete: it holds {record.steps} of {closed} steps")
    for note in notes_on(record):
        print(f"  {note}")
    return EXIT_OK if difference is None and not record.lost_steps else EXIT_FAILED


def _play(arguments: argparse.Namespace) -> int:
    check_bag_files(arguments.bag)
    if find_spec("rclpy") is None:
        raise InputError("replay", str(arguments.bag), "a ROS 2 environment; --check needs none")
    values = {
        "bag": str(arguments.bag.absolute()),
        "rate": arguments.rate,
        "start_s": arguments.start_s,
        "loop": arguments.loop,
        "paused": arguments.paused,
    }
    if arguments.duration_s:
        values["playback_duration_s"] = arguments.duration_s
    if arguments.topics:
        values["topics"] = arguments.topics
    flags = [part for name, value in values.items() for part in ("-p", f"{name}:={json.dumps(value)}")]
    for rule in arguments.remap:
        if not _RULE.fullmatch(rule):
            raise InputError("--remap", rule, "a rule OLD:=NEW with names of topics")
        flags += ["-r", rule]
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-m", "siren_nodes.player", "--ros-args", *flags])  # noqa: S606 - our own
