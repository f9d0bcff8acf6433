"""``siren evaluate yield BAG…``: what making way was worth, for the EMV, for every driver, for the AV under test."""

import argparse
import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from siren_ros.cli.options import add_processes, of_each_bag, processes_of
from siren_ros.errors import InputError, whole_file, writing
from siren_ros.evaluation.statistics.interval import Interval, lack_of_bounds
from siren_ros.evaluation.yielding.metrics import DRIVER_METRICS, EPISODE_METRICS
from siren_ros.evaluation.yielding.scoring import DriverMarks, ScoredEpisode, group_means, score_yielding
from siren_ros.recording.bag_reader import bags_among, read_episode


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
    if episodes:
        print("\n".join((*_table(group_means(episodes)), *_under_test(episodes))))
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


def _table(means: Mapping[tuple[str, str, str], Mapping[str, Interval]]) -> Iterator[str]:
    """The metrics as rows, the groups as columns."""
    heads = [f"{template} {level}" for template, level, _ in means]
    maps = {name for _, _, name in means}
    if len(maps) > 1:
        heads = [f"{head} {name}" for head, (_, _, name) in zip(heads, means, strict=True)]
    width = max(len(metric.name) for metric in EPISODE_METRICS)
    columns = [[_cell(found[metric.name]) for metric in EPISODE_METRICS] for found in means.values()]
    widths = [max(len(head), *map(len, column)) for head, column in zip(heads, columns, strict=True)]
    yield " " * width + "".join(f"  {head:>{size}}" for head, size in zip(heads, widths, strict=True))
    for row, metric in enumerate(EPISODE_METRICS):
        cells = (f"  {column[row]:>{size}}" for column, size in zip(columns, widths, strict=True))
        yield f"{metric.name:<{width}}" + "".join(cells)
    yield from lack_of_bounds(found[metric.name] for found in means.values() for metric in EPISODE_METRICS)


def _cell(mean: Interval) -> str:
    if not mean.valid:
        return "-"
    return f"{mean.value:.2f} [{mean.low:.2f}, {mean.high:.2f}]" if mean.bounded else f"{mean.value:.2f} [-]"


def _under_test(episodes: Sequence[ScoredEpisode]) -> Iterator[str]:
    for episode in episodes:
        for driver in episode.scores.drivers:
            if driver.under_test:
                yield f"{episode.bag}: the AV under test (actor {driver.actor_id}), from {driver.began_s:.2f} s on"
                yield from _marks(driver)


def _marks(driver: DriverMarks) -> Iterator[str]:
    for metric in DRIVER_METRICS:
        mark = driver.marks[metric.name]
        value = f"{'at least ' if mark.at_least else ''}{mark.value:.2f}" if mark.valid else f"- ({mark.lack})"
        yield f"  {metric.name:<16} {value:<14} {metric.meaning}"
