"""``siren episode``: one episode with its bag, without ROS."""

import argparse
from dataclasses import fields
from pathlib import Path
from shlex import quote
from typing import Any, Final

from tqdm import tqdm

from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.params.parameter_field import check_fields
from siren_ros.cli.options import steps_of
from siren_ros.errors import EXIT_FAILED, EXIT_OK
from siren_ros.running.generation.episode_setup import default_bag_path, plan_length, set_up_episode
from siren_ros.running.generation.recorded_episode import RecordedEpisode, record_episode
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
