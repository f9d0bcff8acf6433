"""``siren evaluate diversity BAG…``: how different episodes are, and what more seeds would still add."""

import argparse
import json
from pathlib import Path

from siren_ros.cli.options import add_processes, of_each_bag, processes_of
from siren_ros.errors import whole_file, writing
from siren_ros.evaluation.diversity.coverage import drawn_ranges
from siren_ros.evaluation.diversity.profile import InteractionProfile, profile_of
from siren_ros.evaluation.diversity.summary import diversity, diversity_as_json, diversity_tables
from siren_ros.recording.bag_reader import bags_among, read_episode


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
    profiles, worst = of_each_bag(profile_bag, bags_among(arguments.bags), processes_of(arguments))
    found = diversity(profiles, drawn_ranges(profiles))
    if found:
        groups, _ = diversity_tables(found)
        print("\n".join(groups.text()))
        print("\n".join(_NOTES))
    if arguments.out is not None:
        content = json.dumps([diversity_as_json(one) for one in found], indent=1, allow_nan=False)
        with writing(arguments.out), whole_file(arguments.out) as file:
            file.write_text(content + "\n", encoding="utf-8")
    return worst


def profile_bag(bag: Path) -> InteractionProfile:
    """The profile of a bag."""
    return profile_of(str(bag), read_episode(bag))


_NOTES = (
    "ranges tried: share of the parts (tenths) of the parameters' ranges with an episode; ways: mean distance of the",
    "EMVs at the same times, over all pairs and to the nearest episode; events: edits between orders, as a share;",
    "next adds: transitions between events that one more episode is expected to add (Good-Turing); coverage: estimated",
    "share of the next episode's transitions that has been seen.",
)
