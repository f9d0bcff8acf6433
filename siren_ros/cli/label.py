"""``siren label SET --time-to-collision-s 1.2``: labels derived again from what was stored, and their thresholds."""

import argparse
from collections import Counter
from dataclasses import fields
from pathlib import Path
from typing import Final

from siren_ros.errors import EXIT_OK, InputError, writing
from siren_ros.evaluation.risk.labels import TITLES, RiskClass, RiskThresholds
from siren_ros.evaluation.risk.video_set import read_set, write_set

_MEANINGS: Final = {
    "time_to_collision_s": "near-miss: a TTC below this",
    "time_to_collision_for_s": "near-miss: for so long without interruption",
    "closing_mps": "near-miss: while closing faster than this",
    "post_encroachment_s": "near-miss: a PET below this",
    "required_deceleration_mps2": "near-miss: a required deceleration above this",
    "gap_m": "near-miss: at a gap below this, for the deceleration",
}


def add_thresholds(verb: argparse.ArgumentParser) -> None:
    """One option for each threshold."""
    group = verb.add_argument_group("thresholds of the labels")
    for one in fields(RiskThresholds):
        option = f"--{one.name.replace('_', '-')}"
        group.add_argument(option, type=float, metavar="X", help=f"{_MEANINGS[one.name]} (default {one.default:g})")


def thresholds_of(arguments: argparse.Namespace, base: RiskThresholds | None = None) -> RiskThresholds:
    """The thresholds that the options give; what is not given is as in ``base``.

    Raises:
        InputError: A value that is not positive.
    """
    start = base or RiskThresholds()
    values = {}
    for one in fields(RiskThresholds):
        given = getattr(arguments, one.name)
        if given is not None and not 0.0 < given < float("inf"):
            raise InputError(one.name, given, "a positive number")
        values[one.name] = getattr(start, one.name) if given is None else given
    return RiskThresholds(**values)


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Describe the verb, and what it takes."""
    verb.description = (
        "Derives the labels of a set of risk videos again with other thresholds, prints which videos change, and with "
        "--out writes the set's files there. The videos stay where they are."
    )
    verb.add_argument("set", type=Path, metavar="SET", help="folder that `siren generate risk` made")
    verb.add_argument("--out", type=Path, metavar="DIR", help="folder for the files with the new labels")
    add_thresholds(verb)
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Derives the labels, and says what changes."""
    videos = read_set(arguments.set)
    again = videos.relabelled(thresholds_of(arguments, videos.thresholds))
    for key, video in sorted(again.videos.items()):
        before, after = videos.videos[key].label, video.label
        if before.risk is not after.risk:
            print(f"{key}: {before.risk.title} -> {after.risk.title} ({after.reason}, {after.value:.2f})")
    counts = Counter(video.label.risk for video in again.videos.values())
    print(" / ".join(str(counts[risk]) for risk in RiskClass), f"({' / '.join(TITLES)})")
    if arguments.out is not None:
        with writing(arguments.out, "folder"):
            arguments.out.mkdir(parents=True, exist_ok=True)
            write_set(again.moved(arguments.out))
    return EXIT_OK
