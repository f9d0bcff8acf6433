"""``siren evaluate yield BAG…``: what making way was worth, for the EMV, for every driver, for the AV under test."""

import argparse
import json
from collections.abc import Collection, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from siren_ros.cli.options import add_processes, of_each_bag, processes_of
from siren_ros.errors import InputError, whole_file, writing
from siren_ros.evaluation.yielding.metrics import EPISODE_METRICS
from siren_ros.evaluation.yielding.scoring import (
    ScoredEpisode,
    score_yielding,
    under_test_tables,
    yield_tables,
)
from siren_ros.recording.bag_reader import bags_among, read_episode
from siren_ros.tables.table import text_of


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Describe the verb, and what it takes."""
    verb.formatter_class = argparse.RawDescriptionHelpFormatter
    verb.description = (
        "Marks how traffic made way: means over the episodes of each template and level,\n"
        "with 95 % intervals over episodes, and the marks of the AV under test."
    )
    width = max(len(metric.name) for metric in EPISODE_METRICS)
    verb.epilog = "\n".join(["marks:", *(f"  {metric.name:{width}}  {metric.meaning}" for metric in EPISODE_METRICS)])
    verb.add_argument("bags", type=Path, metavar="BAG", nargs="+", help="bags, or folders with bags at any depth")
    verb.add_argument("--out", type=Path, metavar="FILE", help="one row for each episode, as Parquet (or .json)")
    verb.add_argument("--drivers", type=Path, metavar="FILE", help="one row for each driver, as Parquet (or .json)")
    add_processes(verb)
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
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
    """The scores of all bags that can be read, and the worst exit code; the others are told on standard error.

    Args:
        bags: Of the episodes.
        jobs: Processes.
        names: Metrics of the episodes, where not all are wanted and no drivers.
    """
    episodes, worst = of_each_bag(partial(score_bag, names=names), bags, jobs)
    return sorted(episodes, key=lambda episode: (episode.group, episode.seed, episode.draw, episode.bag)), worst


def score_bag(bag: Path, names: Collection[str] | None = None) -> ScoredEpisode:
    """The scores of a bag; ``names`` as ``scored_episodes`` has them."""
    record = read_episode(bag)
    return ScoredEpisode.of(str(bag), record, score_yielding(record, names=names))


def _write(file: Path | None, rows: list[dict[str, Any]]) -> None:
    if file is None:
        return
    with writing(file), whole_file(file) as new:
        if file.suffix == ".json":
            new.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        else:
            pq.write_table(pa.Table.from_pylist(rows), new, compression="zstd")
