"""``siren label SET --time-to-collision-s 1.2``: labels derived again from what was stored."""

import argparse
from collections import Counter
from pathlib import Path

from siren_ros.cli.generation.risk_thresholds import add_thresholds, thresholds_of
from siren_ros.errors import EXIT_OK, writing
from siren_ros.evaluation.risk.risk_class import TITLES, RiskClass
from siren_ros.evaluation.risk.video_set import read_set, write_set


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
