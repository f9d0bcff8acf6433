"""``siren generate risk`` and ``siren label``: front-camera videos with risk labels, and labels by other thresholds."""

import argparse
from collections import Counter
from dataclasses import fields, replace
from pathlib import Path
from threading import Lock
from typing import Any, Final

from tqdm import tqdm

from siren_ros.base.tables import text_of
from siren_ros.cli.options import add_processes, check_numbers, positive
from siren_ros.errors import EXIT_FAILED, EXIT_OK, InputError, writing
from siren_ros.running.studies.risk_set.make_set import RiskSetRequest, SetObserver, make_set
from siren_ros.running.studies.risk_set.search import (
    PAPER_COUNTS,
    PAPER_PER_TEMPLATE,
    Balance,
    Counts,
    Search,
    papers_balance,
)
from siren_ros.scoring.evaluation.risk.labels import DEFINITIONS, NEW_SETS, TITLES, RiskClass, RiskThresholds
from siren_ros.scoring.evaluation.risk.report import table_of_changes
from siren_ros.scoring.evaluation.risk.video_set import read_set, write_set
from siren_ros.simulation.roads.maps.map_compiler import BUILT_IN_MAPS
from siren_ros.simulation.scenario.episode import MAX_SEED
from siren_ros.simulation.scenario.paper import TEMPLATES

_MEANINGS: Final = {
    "time_to_collision_s": "near-miss: a TTC below this",
    "time_to_collision_for_s": "near-miss: for this time without interruption",
    "closing_mps": "near-miss: a closing speed above this, together with the TTC",
    "post_encroachment_s": "near-miss: a PET below this",
    "required_deceleration_mps2": "near-miss: a required deceleration above this",
    "gap_m": "near-miss: a gap below this, together with the deceleration",
    "braked_mps2": "near-miss: together with braking of one of the two from this on",
    "needed_mps2": "near-miss: or, with the PET, braking from this on that would have been needed",
}


def add_thresholds(verb: argparse.ArgumentParser) -> None:
    """One option for each threshold."""
    group = verb.add_argument_group("thresholds of the labels")
    for limit in fields(RiskThresholds):
        option = f"--{limit.name.replace('_', '-')}"
        usual = f"of new sets {getattr(NEW_SETS, limit.name):g}"
        group.add_argument(option, type=float, metavar="X", help=f"{_MEANINGS[limit.name]} ({usual})")
    group.add_argument(
        "--near-miss",
        choices=list(DEFINITIONS),
        help="all thresholds at once: near_crash (somebody brakes hard; new sets), paper (every conflict counts)",
    )


def thresholds_of(arguments: argparse.Namespace, base: RiskThresholds = NEW_SETS) -> RiskThresholds:
    """The thresholds of the options, the others as in ``base``; InputError for a value that is not positive."""
    values = {name: getattr(arguments, name) for name in _MEANINGS if getattr(arguments, name) is not None}
    for name, value in values.items():
        if not 0.0 < value < float("inf"):
            raise InputError(name, value, "a positive number")
    if arguments.near_miss is not None:
        base = DEFINITIONS[arguments.near_miss]
    return replace(base, **values)


def add_label(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Derives the labels of a set of risk videos again with other thresholds, and prints which videos change. With "
        "--out, it writes the set's files there; the videos stay where they are."
    )
    verb.add_argument("set", type=Path, metavar="SET", help="folder that `siren generate risk` made")
    verb.add_argument("--out", type=Path, metavar="DIR", help="folder for the files with the new labels")
    verb.add_argument(
        "--table", action="store_true", help="print how the labels change with each threshold, and nothing else"
    )
    add_thresholds(verb)
    verb.set_defaults(run=label)


def label(arguments: argparse.Namespace) -> int:
    """Derives the labels, and says what changes."""
    videos = read_set(arguments.set)
    if arguments.table:
        print("\n".join(text_of((table_of_changes(videos),))))
        return EXIT_OK
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


_PAPER = ",".join(map(str, PAPER_COUNTS))


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Makes a set of front-camera videos of 190 frames at 10 Hz with the labels Normal, Near-Miss and Collision. "
        "The command searches scenario parameters until the classes have the given balance. Collisions are not "
        "scripted: they happen when drivers react late or do not look out. The default has the paper's counts: 15 "
        "videos of each template, together 74 normal, 25 near-misses and 6 collisions. The same command continues an "
        "interrupted set. The exit code is 1 if a class was not found often enough."
    )
    verb.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the set, new or interrupted")
    verb.add_argument(
        "--templates",
        nargs="+",
        metavar="ID",
        choices=TEMPLATES,
        default=list(TEMPLATES),
        help="S1 to S7 (default: all)",
    )
    verb.add_argument(
        "--per-template", type=positive, metavar="N", help=f"videos of each template (default {PAPER_PER_TEMPLATE})"
    )
    verb.add_argument(
        "--balance", type=_counts, metavar="N,N,N", help=f"{', '.join(TITLES)} in the whole set (default {_PAPER})"
    )
    verb.add_argument(
        "--within-templates",
        action="store_true",
        help="each template has the same balance, so that the template tells nothing about the class; a template that "
        "cannot find a class has fewer videos of the others, too",
    )
    verb.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the search (default 0)")
    verb.add_argument(
        "--map", default="", metavar="FILE", help="map file, or {}, {} or {} (default: the town)".format(*BUILT_IN_MAPS)
    )
    verb.add_argument(
        "--budget", type=positive, default=90, metavar="N", help="most candidates of each template (default 90)"
    )
    add_processes(verb, kind=positive)
    verb.add_argument("--retries", type=int, default=2, metavar="N", help="tries after a crash (default %(default)s)")
    add_thresholds(verb)
    verb.set_defaults(run=run)


def _counts(text: str) -> Counts:
    parts = text.split(",")
    if len(parts) != len(TITLES) or not all(part.strip().isdigit() for part in parts):
        raise argparse.ArgumentTypeError(f"{text!r} is not three counts such as {_PAPER}")
    normal, near_miss, collision = (int(part) for part in parts)
    return normal, near_miss, collision


def run(arguments: argparse.Namespace) -> int:
    """Makes the set and prints its classes."""
    check_numbers(arguments, {"seed": (0, MAX_SEED), "retries": (0, 1000)})
    request = RiskSetRequest(
        templates=tuple(dict.fromkeys(arguments.templates)),
        balance=balance_of(arguments),
        seed=arguments.seed,
        map_file=arguments.map,
        budget=arguments.budget,
        retries=arguments.retries,
        thresholds=thresholds_of(arguments),
    )
    return EXIT_OK if make_and_print(request, arguments.out, arguments.workers) else EXIT_FAILED


def make_and_print(request: RiskSetRequest, out: Path, workers: int) -> bool:
    """Makes a set with progress bars, prints its classes, and says whether it has the balance that was asked for."""
    with (
        tqdm(unit="candidate", desc="search", disable=None) as tried,
        tqdm(total=request.balance.videos, unit="video", desc="draw", disable=None) as drawn,
    ):
        videos, searches = make_set(request, out, workers, _Bars(tried, drawn))
    risks = [(video.template, video.label.risk) for video in videos.videos.values()]
    for name, search in searches.items():
        counts, found = (
            " / ".join(str(risks.count((name, risk))) for risk in RiskClass),
            " / ".join(map(str, search.found)),
        )
        print(f"{name}: {counts} of {found} found in {len(search.trials)} candidates")
    totals = tuple(sum(risk is each for _, each in risks) for risk in RiskClass)
    print(f"{out}: {sum(totals)} videos, {' / '.join(map(str, totals))} ({' / '.join(TITLES)})")
    return totals == request.balance.total


def balance_of(arguments: argparse.Namespace) -> Balance:
    """The balance of the options; without one the paper's, scaled to the number of videos."""
    count = len(set(arguments.templates))
    if arguments.balance is not None:
        per_template = arguments.per_template or max(1, sum(arguments.balance) // count)
        return Balance(arguments.balance, per_template, within=arguments.within_templates)
    return papers_balance(count, arguments.per_template or PAPER_PER_TEMPLATE, within=arguments.within_templates)


class _Bars(SetObserver):
    """Two progress bars: candidates and videos."""

    def __init__(self, tried: "tqdm[Any]", drawn: "tqdm[Any]") -> None:
        self._lock, self._tried, self._videos = Lock(), tried, drawn

    def tried(self, template: str, search: Search) -> None:
        with self._lock:
            self._tried.set_postfix({template: "/".join(map(str, search.found))}, refresh=False)
            self._tried.update(1)

    def drawn(self, video_id: str, videos: int) -> None:
        with self._lock:
            self._videos.total = videos
            self._videos.set_postfix_str(video_id, refresh=False)
            self._videos.update(1)
