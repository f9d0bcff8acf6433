"""``siren evaluate yield``, ``counterfactual`` and ``diversity``: yielding, levels, differences."""

import argparse
import json
from collections.abc import Collection, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from siren_ros.base.tables import text_of
from siren_ros.cli.options import add_bags, add_processes, of_each_bag, processes_of
from siren_ros.data.recording.bag_reader import bags_among, read_episode
from siren_ros.errors import EXIT_FAILED, InputError, shown_text, whole_file, write_text, writing
from siren_ros.scoring.evaluation.diversity import (
    InteractionProfile,
    diversity,
    diversity_as_json,
    diversity_tables,
    drawn_ranges,
    profile_of,
)
from siren_ros.scoring.evaluation.yielding.metrics import EPISODE_METRICS
from siren_ros.scoring.evaluation.yielding.scoring import (
    OUTCOMES,
    ScoredEpisode,
    effect_tables,
    effects,
    under_test_tables,
    yield_tables,
)


def add_yield(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.formatter_class = argparse.RawDescriptionHelpFormatter
    verb.description = (
        "Measures how traffic made way: means over the episodes of each template and level,\n"
        "with 95 % intervals over episodes, and the marks of the AV under test."
    )
    width = max(len(metric.name) for metric in EPISODE_METRICS)
    verb.epilog = "\n".join(["marks:", *(f"  {metric.name:{width}}  {metric.meaning}" for metric in EPISODE_METRICS)])
    add_bags(verb)
    verb.add_argument(
        "--out", type=Path, metavar="FILE", help="file for one row per episode and EMV: .parquet or .json"
    )
    verb.add_argument("--drivers", type=Path, metavar="FILE", help="file for one row per driver: .parquet or .json")
    add_processes(verb)
    verb.set_defaults(run=evaluate_yield)


def evaluate_yield(arguments: argparse.Namespace) -> int:
    """Scores every bag; one that cannot be read does not keep the others from being scored."""
    for file in (arguments.out, arguments.drivers):
        if file is not None and file.suffix not in {".parquet", ".json"}:
            raise InputError("out", str(file), "a file name that ends in .parquet or .json")
    episodes, worst = scored_episodes(bags_among(arguments.bags), processes_of(arguments))
    print("\n".join(text_of([*yield_tables(episodes), *under_test_tables(episodes)])))
    _write(arguments.out, [episode.row() for episode in episodes])
    _write(arguments.drivers, [row for episode in episodes for row in episode.driver_rows()])
    return worst


def scored_episodes(
    bags: Sequence[Path], jobs: int, names: Collection[str] | None = None
) -> tuple[list[ScoredEpisode], int]:
    """The scores of all bags that can be read, and the worst exit code; standard error says what is wrong with others.

    A bag has scores for each EMV. ``names`` are the metrics of the episodes, where not all are needed and no drivers.
    """
    scored, worst = of_each_bag(partial(score_bag, names=names), bags, jobs)
    episodes = [episode for of_bag in scored for episode in of_bag]
    return sorted(episodes, key=lambda one: (one.group, one.seed, one.draw, one.bag, one.emv)), worst


def score_bag(bag: Path, names: Collection[str] | None = None) -> tuple[ScoredEpisode, ...]:
    """The scores of a bag for each EMV; ``names`` as ``scored_episodes`` has them."""
    return ScoredEpisode.of_each_emv(shown_text(str(bag)), read_episode(bag), names)


def _write(file: Path | None, rows: list[dict[str, Any]]) -> None:
    if file is None:
        return
    if file.suffix == ".json":
        write_text(file, json.dumps(rows, indent=1) + "\n")
        return
    with writing(file), whole_file(file) as new:
        pq.write_table(pa.Table.from_pylist(rows), new, compression="zstd")


def add_counterfactual(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Compares levels on the same seeds: map, demand, route, drivers and draws are the same, so the difference is "
        "the effect of the level. Prints mean differences with 95 % intervals over pairs, the p-value of a "
        "permutation test, adjusted for all comparisons of an outcome (Holm), and the number of pairs in which an "
        "episode ended before its value was complete. The exit code is 1 if there is no pair."
    )
    add_bags(verb)
    verb.add_argument(
        "--outcomes",
        nargs="+",
        choices=OUTCOMES,
        default=list(OUTCOMES[:4]),
        metavar="NAME",
        help=f"outcomes among {', '.join(OUTCOMES)} (default: the first four)",
    )
    verb.add_argument("--out", type=Path, metavar="FILE", help="write the effects on all outcomes as JSON")
    add_processes(verb)
    verb.set_defaults(run=evaluate_counterfactual)


def evaluate_counterfactual(arguments: argparse.Namespace) -> int:
    """Scores every bag and compares the levels."""
    episodes, worst = scored_episodes(bags_among(arguments.bags), processes_of(arguments), OUTCOMES)
    results = effects(episodes)
    shown = [effect for effect in results if effect.metric in arguments.outcomes and effect.interval.valid]
    print("\n".join(text_of(effect_tables(shown))) or "no two episodes of one seed at different levels")
    if arguments.out is not None:
        rows = [effect.json() | {"levels": [effect.model, effect.against]} for effect in results]
        write_text(arguments.out, json.dumps({"task": "counterfactual", "differences": rows}, indent=1) + "\n")
    return worst if shown else max(worst, EXIT_FAILED)


def add_diversity(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Prints for each template, level and map which share of the parameter ranges the episodes have tried, how "
        "different the EMVs' ways and the orders of events are, and how many new transitions between events one more "
        "seed is expected to add."
    )
    add_bags(verb)
    verb.add_argument("--out", type=Path, metavar="FILE", help="write everything, with the curves, as JSON")
    add_processes(verb)
    verb.set_defaults(run=evaluate_diversity)


def evaluate_diversity(arguments: argparse.Namespace) -> int:
    """Compares all episodes of a group with each other; a bag that cannot be read does not keep the others back."""
    profiles, worst = of_each_bag(profile_bag, bags_among(arguments.bags), processes_of(arguments))
    groups = diversity(profiles, drawn_ranges(profiles))
    if groups:
        table, _ = diversity_tables(groups)
        print(*table.text(), *_NOTES, sep="\n")
    if arguments.out is not None:
        content = [diversity_as_json(group) for group in groups]
        write_text(arguments.out, json.dumps(content, indent=1, allow_nan=False) + "\n")
    return worst


def profile_bag(bag: Path) -> InteractionProfile:
    """The profile of a bag."""
    return profile_of(shown_text(str(bag)), read_episode(bag))


_NOTES = (
    "ranges tried: share of the parts (tenths) of the parameters' ranges with an episode; ways: mean distance of the",
    "EMVs at the same times, over all pairs and to the nearest episode; events: edits between orders, as a share;",
    "next adds: transitions between events that one more episode is expected to add (Good-Turing); coverage: estimated",
    "share of the next episode's transitions that has been seen.",
)
