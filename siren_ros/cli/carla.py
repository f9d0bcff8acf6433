"""``siren carla play`` and ``siren carla check``: an episode in a CARLA server, and a look at the server itself."""

import argparse
import json
from pathlib import Path

from tqdm import tqdm

from siren_ros.cli.command import Command, complain
from siren_ros.cli.options import steps_of
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import EXIT_FAILED, EXIT_OK, InputError, write_text
from siren_ros.running.carla.check import examine, lines_of
from siren_ros.running.carla.play import play
from siren_ros.running.carla.session import CALL_S, DEFAULT_PORT
from siren_ros.simulation.scenario.episode import EpisodeEnd


def add_arguments(verb: Command) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Uses a running CARLA server, which draws and senses what SIREN decides. The exit code is 1 if the episode "
        "fails or the server differs from what is expected, 2 if there is no such server, version or map."
    )
    tasks = verb.add_subparsers(title="tasks", metavar="TASK", required=True)
    tasks.add_parser("play", help="play a bag in the server and record what it senses", add="carla.add_play")
    tasks.add_parser("check", help="examine the server: version, map, blueprints, sensors", add="carla.add_check")


def _add_server(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--host", default="localhost", help="machine of the server (default localhost)")
    verb.add_argument(
        "--port", type=int, default=DEFAULT_PORT, metavar="N", help=f"port of the server (default {DEFAULT_PORT})"
    )
    verb.add_argument(
        "--timeout-s", type=float, default=CALL_S, metavar="S", help=f"deadline of each call (default {CALL_S:g})"
    )


def _address(arguments: argparse.Namespace) -> str:
    if not 0.0 < arguments.timeout_s <= 3600.0:
        raise InputError("--timeout-s", arguments.timeout_s, "seconds above 0, at most 3600")
    return f"{arguments.host}:{arguments.port}"


def add_play(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Plays a recorded episode in a CARLA server and writes a bag like it, with the measurements of CARLA's LiDARs "
        "and cameras in place of ours. Labels keep their poses and get the sizes of CARLA's vehicles."
    )
    verb.add_argument("bag", type=Path, metavar="BAG", help="folder of a recorded episode")
    verb.add_argument("--out", type=Path, metavar="BAG", help="folder to write (default: BAG_carla)")
    verb.add_argument("--overwrite", action="store_true", help="replace an earlier episode there; nothing else")
    verb.add_argument("--load-map", action="store_true", help="let the server build the episode's map from OpenDRIVE")
    _add_server(verb)
    verb.set_defaults(run=run_play)


def run_play(arguments: argparse.Namespace) -> int:
    """Plays the bag and says how it ended."""
    bag: Path = arguments.bag
    out = arguments.out or bag.with_name(f"{bag.resolve().name}_carla")
    with tqdm(unit="step", desc="play", disable=None, leave=False) as bar:
        step_on = steps_of(bar)
        how = {"load": arguments.load_map, "overwrite": arguments.overwrite, "timeout_s": arguments.timeout_s}
        recorded = play(bag, out, _address(arguments), **how, on_step=lambda _: step_on())
    outcome = recorded.outcome
    place = "no bag" if recorded.bag is None else f"{recorded.bag.path} ({recorded.bag.size_bytes / 1e6:.1f} MB)"
    print(f"{place}: {outcome.end.value} after {outcome.steps} steps" + f": {outcome.reason}" * bool(outcome.reason))
    return EXIT_OK if outcome.end is EpisodeEnd.COMPLETE else EXIT_FAILED


def add_check(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Examines a CARLA server: versions, map, blueprints of each class with their boxes, poses and lights as the "
        "server says they are, a frame of each sensor. A report of a fault should contain what it prints."
    )
    verb.add_argument("--bag", type=Path, metavar="BAG", help="compare the map with this episode's (default: its own)")
    verb.add_argument("--sensors", default="front", metavar="SUITE", help="suite to try (default front)")
    verb.add_argument("--json", type=Path, metavar="FILE", help="also write everything that was found as JSON")
    _add_server(verb)
    verb.set_defaults(run=run_check)


def run_check(arguments: argparse.Namespace) -> int:
    """Examines the server; exit code 1 where something is wrong."""
    record = None if arguments.bag is None else read_episode(arguments.bag)
    found = examine(_address(arguments), arguments.sensors, record, arguments.timeout_s)
    if arguments.json is not None:
        write_text(arguments.json, json.dumps(found, indent=1, sort_keys=True) + "\n")
    for line in lines_of(found):
        (complain if line.startswith("WRONG") else print)(line)
    return EXIT_FAILED if found["verdict"] else EXIT_OK
