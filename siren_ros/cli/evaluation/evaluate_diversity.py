"""``siren evaluate diversity BAG…``: how different episodes are, and what more seeds would still add."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm

from siren_ros.cli.options.processes import add_processes
from siren_ros.datasets.exporting.worker_pool import worker_pool
from siren_ros.errors import EXIT_OK, InputError, SirenError
from siren_ros.evaluation.aligned_text import aligned
from siren_ros.evaluation.diversity.as_json import diversity_as_json
from siren_ros.evaluation.diversity.drawn_ranges import drawn_ranges
from siren_ros.evaluation.diversity.profile import InteractionProfile, profile_of
from siren_ros.evaluation.diversity.summary import GroupDiversity, diversity
from siren_ros.recording.bag_folders import bags_among
from siren_ros.recording.bag_reader import read_episode


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Describe the verb, and what it takes."""
    verb.description = (
        "Says for each template, level and map how much of the ranges of its parameters the episodes have tried, how "
        "far the EMVs' ways and the orders of events are apart, how new the newest kind of episode still is, and how "
        "many transitions between events one more seed is expected to add."
    )
    verb.add_argument("bags", type=Path, metavar="BAG", nargs="+", help="bags, or folders with bags at any depth")
    verb.add_argument("--out", type=Path, metavar="FILE", help="write everything, with the curves, as JSON")
    add_processes(verb)
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Compares all episodes of a group with each other; a bag that cannot be read does not keep the others back."""
    if arguments.jobs < 1:
        raise InputError("jobs", arguments.jobs, "1 or more")
    profiles, worst = _profiles(bags_among(arguments.bags), arguments.jobs)
    found = diversity(profiles, drawn_ranges(profiles))
    if found:
        print("\n".join(aligned([_HEAD, *map(_row, found)])))
        print("\n".join(_NOTES))
    if arguments.out is not None:
        try:
            content = json.dumps([diversity_as_json(one) for one in found], indent=1, allow_nan=False)
            arguments.out.write_text(content + "\n", encoding="utf-8")
        except OSError as error:
            raise InputError("out", str(arguments.out), f"a file that can be written ({error.strerror})") from error
    return worst


def profile_bag(bag: Path) -> InteractionProfile | tuple[str, int]:
    """The profile of a bag, or why it has none, with the exit code."""
    try:
        return profile_of(str(bag), read_episode(bag))
    except SirenError as error:
        return str(error), error.exit_code


def _profiles(bags: Sequence[Path], jobs: int) -> tuple[list[InteractionProfile], int]:
    worst, profiles = EXIT_OK, []
    with (
        worker_pool(min(jobs, len(bags)), lambda _: None) as pool,
        tqdm(total=len(bags), unit="episode", desc="evaluate", disable=None) as bar,
    ):
        for _, found in pool(profile_bag, [(bag,) for bag in bags]):
            bar.update(1)
            if isinstance(found, InteractionProfile):
                profiles.append(found)
            else:
                text, code = found
                print(f"siren evaluate: {text}", file=sys.stderr)
                worst = max(worst, code)
    return profiles, worst


_HEAD = [
    "",
    "episodes",
    "ranges tried",
    "ways apart",
    "nearest",
    "events apart",
    "nearest",
    "transitions",
    "next adds",
    "coverage",
]
_NOTES = (
    "ranges tried: share of the parts (tenths) of the parameters' ranges with an episode; ways: mean distance of the",
    "EMVs at the same times, over all pairs and to the nearest episode; events: edits between orders, as a share;",
    "next adds: transitions between events that one more episode is expected to add (Good-Turing); coverage: estimated",
    "share of the next episode's transitions that has been seen.",
)


def _row(one: GroupDiversity) -> list[str]:
    several = len(one.profiles) > 1
    share = one.parameter_share
    return [
        " ".join(one.group),
        str(len(one.profiles)),
        "-" if share is None else f"{share:.0%}",
        f"{one.ways.mean:.1f} m" if several else "-",
        f"{np.mean(one.ways.nearest):.1f} m" if several else "-",
        f"{one.events.mean:.2f}" if several else "-",
        f"{np.mean(one.events.nearest):.2f}" if several else "-",
        str(one.transitions.seen),
        f"{one.transitions.next_adds:.1f}" if several else "-",
        f"{one.transitions.coverage:.0%}" if several else "-",
    ]
