"""Measures how fast predictors are scored: ``python -m siren_ros.benchmarks.evaluation BAG… --models cv,idm``.

Takes the bags again and again until they give as many samples as are asked for. Prints the time of each model in one
process with the episodes in memory, and the time of the whole command, reading included, in several. The processors'
time hardly depends on what else runs; the wall time means something on an idle machine only.
"""

import argparse
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from siren_ros.data.recording.bag_reader import bags_among, read_episode
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import EXIT_BAD_INPUT, EXIT_OK
from siren_ros.scoring.evaluation.prediction.predictors import predictors_named
from siren_ros.scoring.evaluation.prediction.reports.score_table import differences, score_table
from siren_ros.scoring.evaluation.prediction.samples import Population
from siren_ros.scoring.evaluation.prediction.scoring import ScoringJob, score_bags, score_episode


def scoring_time_s(
    records: Sequence[EpisodeRecord], models: Sequence[str], checkpoints: dict[str, Path], population: Population
) -> tuple[float, int]:
    """Processor time of some models on all records in this process, and the number of samples."""
    predictors = predictors_named(models, checkpoints)
    score_episode("warm", records[0], predictors, population)
    start = time.process_time()
    samples = sum(score_episode("timed", record, predictors, population).samples for record in records)
    return time.process_time() - start, samples


def processors_s() -> float:
    """Processor time of this process and of its finished children so far."""
    return sum(os.times()[:4])


def main(argv: Sequence[str] | None = None) -> int:
    """Print a line for each model and one for the whole command."""
    parser = argparse.ArgumentParser(prog="evaluation", description=__doc__)
    parser.add_argument("bags", type=Path, nargs="+", metavar="BAG", help="episodes, or folders of them")
    parser.add_argument("--models", default="cv,idm", help="by commas (default %(default)s)")
    parser.add_argument("--checkpoint", action="append", default=[], metavar="NAME=PATH", help="weights of a model")
    parser.add_argument("--population", choices=list(Population), default=Population.REGION)
    parser.add_argument("--samples", type=int, default=100_000, help="default %(default)s")
    parser.add_argument("--workers", "--jobs", type=int, default=2, help="processes (default %(default)s)")
    arguments = parser.parse_args(argv)
    models, population = tuple(arguments.models.split(",")), Population(arguments.population)
    pairs = (text.split("=", 1) for text in arguments.checkpoint)
    checkpoints = {name: Path(path) for name, path in pairs}
    bags = bags_among(arguments.bags)
    start = time.process_time()
    records = [read_episode(bag) for bag in bags]
    print(f"read {len(bags)} bags: {(time.process_time() - start) / len(bags):.2f} s of a processor each")
    counted = 0
    for model in models:
        weights = {name: path for name, path in checkpoints.items() if name == model}
        taken_s, counted = scoring_time_s(records, [model], weights, population)
        if not counted:
            print("the bags give no samples")
            return EXIT_BAD_INPUT
        print(f"{model}: {taken_s / counted * 1e5:.2f} s of a processor for 100,000 samples, all metrics")
    many = bags * -(-arguments.samples // counted)
    start, used_s = time.perf_counter(), processors_s()
    job = ScoringJob(models, tuple(checkpoints.items()), population=population, processes=arguments.workers)
    scores = [result.scores for result in score_bags(job, many) if result.scores is not None]
    scored_s, used_s = time.perf_counter() - start, processors_s() - used_s
    table = score_table(scores)
    differences(table)
    report_s = time.perf_counter() - start - scored_s
    samples = sum(score.samples for score in scores)
    print(
        f"{samples} samples of {len(many)} bags with {', '.join(models)}: {scored_s:.1f} s in "
        f"{arguments.workers} processes, reading included ({used_s:.1f} s of processors); "
        f"intervals and differences {report_s:.1f} s"
    )
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
