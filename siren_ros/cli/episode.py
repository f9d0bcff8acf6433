"""``siren episode`` and ``siren replay``: makes one episode without ROS; plays or checks a recorded one.

A check simulates the episode again from its description.
"""

import argparse
import json
import os
import re
import sys
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path
from shlex import quote
from typing import Any, Final

from tqdm import tqdm

from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.params.parameters import check_fields
from siren_ros.cli.command import complain
from siren_ros.cli.options import add_former, steps_of
from siren_ros.data.recording.bag_reader import check_bag_files, read_episode
from siren_ros.errors import EXIT_FAILED, EXIT_OK, InputError
from siren_ros.running.generation.closed_loop import RecordedEpisode, record_episode
from siren_ros.running.generation.episode_setup import default_bag_path, plan_length, set_up_episode
from siren_ros.running.generation.replay_check import notes_on, repeat_episode
from siren_ros.simulation.scenario.episode import EpisodeEnd, EpisodeRequest
from siren_ros.simulation.scenario.paper import level_name

_OF_COSIM: Final = frozenset({"av", "av_sensors", "predictor", "detector"})
"""Fields that name programs which take part over ROS, so that this command does not have them."""
_NEXT: Final = ("info {}", "verify {}", "view {}", "replay {} --check")


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Simulates, senses and records one episode, without ROS. The bag has the bytes that cosim writes with the same "
        "choices. The exit code is 1 if the episode fails; with --strict also if its interaction did not happen or "
        "vehicles collided."
    )
    asked = EpisodeRequest()
    for field in fields(EpisodeRequest):
        default = getattr(asked, field.name)
        if field.name in _OF_COSIM:
            continue
        options: dict[str, Any] = {"default": default, "help": _help_of(field.metadata["description"], default)}
        if field.name == "template":
            verb.add_argument("template", nargs="?", metavar="TEMPLATE", **options)
            continue
        kind = level_name if field.name == "level" else type(default)
        name = f"--{field.name.replace('_', '-')}"
        verb.add_argument(name, type=kind, metavar=field.name.rpartition("_")[2].upper(), **options)
    verb.add_argument("--out", type=Path, metavar="BAG", help="folder to write (default: bags/TEMPLATE_LEVEL_seedN)")
    verb.add_argument("--overwrite", action="store_true", help="replace an earlier episode there; nothing else")
    verb.add_argument(
        "--strict", action="store_true", help="exit code 1 also if the interaction did not happen or vehicles collided"
    )
    verb.set_defaults(run=run)


def _help_of(description: str, default: object) -> str:
    text = description[0].lower() + description[1:].rstrip(".")
    return text.replace("%", "%%") + (f" (default {default})" if default else "")


def run(arguments: argparse.Namespace) -> int:
    """Makes the episode and says how it ended; exit code 1 where it failed, or with ``--strict`` lacks something."""
    asked = {field.name for field in fields(EpisodeRequest)} - _OF_COSIM
    request = EpisodeRequest(**{name: getattr(arguments, name) for name in asked})
    check_fields(request)
    bag = arguments.out or default_bag_path(request)
    with tqdm(total=plan_length(request), unit="step", desc="episode", disable=None, leave=False) as bar:
        step_on = steps_of(bar)
        recorded = record_episode(
            set_up_episode(request), bag, overwrite=arguments.overwrite, on_step=lambda _: step_on()
        )
    print(*_summary(recorded), sep="\n")
    made = recorded.outcome.end is EpisodeEnd.COMPLETE
    return EXIT_OK if made and not (arguments.strict and recorded.outcome.shortcomings) else EXIT_FAILED


def _summary(recorded: RecordedEpisode) -> list[str]:
    outcome, bag = recorded.outcome, recorded.bag
    ended = f"episode {outcome.end.value} after {outcome.steps * STEP_S:.2f} s"
    if outcome.reason:
        ended += f": {outcome.reason}"
    elif outcome.predicate_holds is not None:
        happened = "happened" if outcome.predicate_holds else "did not happen"
        ended += f"; its interaction {happened} ({outcome.measures.get('predicate', '')})"
    if bag is None:
        return [f"no bag: {ended}"]
    commands = ", ".join(f"`siren {command.format(quote(str(bag.path)))}`" for command in _NEXT)
    return [f"{bag.path} ({bag.size_bytes / 1e6:.1f} MB): {ended}", f"next: {commands}"]


_RULE: Final = re.compile(r"[A-Za-z0-9_/~]+:=[A-Za-z0-9_/~]+")


def add_replay(verb: argparse.ArgumentParser) -> None:
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
    verb.set_defaults(run=replay)


def replay(arguments: argparse.Namespace) -> int:
    """Compare and say what was found, or become the player."""
    return _check_replay(arguments.bag) if arguments.check else _play(arguments)


def _check_replay(bag: Path) -> int:
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
