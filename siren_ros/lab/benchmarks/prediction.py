"""Measures speed of predictors: ``python -m siren_ros.benchmarks.prediction BAG… --models cv,idm --samples 100000``.

Goes through the samples of the bags, over and over until there were as many as asked for. Prints for each model the
time of its predictions, and first the time that making the samples took; reading the bags is not in it. The wall time
means something on an idle machine only; the processors' time hardly depends on what else runs.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from siren_ros.data.recording.bag_reader import bags_among, read_episode
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import EXIT_OK
from siren_ros.lab.reproduction.results import add_json, write_json
from siren_ros.scoring.evaluation.prediction.predictors import PREDICTORS, Predictor, predictors_named
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, ScoredSamples, samples_of

SAMPLES: Final = 100_000


@dataclass(frozen=True)
class Taken:
    """Wall time and processor time of a task."""

    samples: int
    wall_s: float
    processors_s: float
    """Processor time, summed over all threads."""

    def row(self, name: str) -> str:
        """One row of the table: both times as measured, and scaled to ``SAMPLES``."""
        scale = SAMPLES / max(self.samples, 1)
        times = (self.wall_s, self.processors_s, self.wall_s * scale, self.processors_s * scale)
        return f"{name:<12}{self.samples:>10}" + "".join(f"{value:>12.1f}" for value in times)


def sampling(
    records: Sequence[EpisodeRecord], window: HistoryWindow, population: Population
) -> tuple[Taken, list[ScoredSamples]]:
    """Make the samples of every record once, and measure it."""
    wall, processors = time.perf_counter(), time.process_time()
    samples = [samples_of(record, window, population) for record in records]
    taken = Taken(sum(map(len, samples)), time.perf_counter() - wall, time.process_time() - processors)
    return taken, [scored for scored in samples if len(scored)]


def predicting(predictor: Predictor, samples: Sequence[ScoredSamples], least: int) -> Taken:
    """Predict at least this number of samples, and measure it."""
    predictor.predict(samples[0].batch)  # compiles loops and starts threads, so that they are not measured
    wall, processors, done = time.perf_counter(), time.process_time(), 0
    while done < least:
        for scored in samples:
            predictor.predict(scored.batch)
            done += len(scored)
    return Taken(done, time.perf_counter() - wall, time.process_time() - processors)


def main(argv: Sequence[str] | None = None) -> int:
    """Print one row for each model."""
    parser = argparse.ArgumentParser(prog="prediction", description=__doc__)
    parser.add_argument("bags", type=Path, nargs="+", metavar="BAG", help="episodes, or folders of them")
    parser.add_argument("--models", default="cv,idm", help=f"of {', '.join(PREDICTORS)}, by commas")
    parser.add_argument("--checkpoint", action="append", default=[], metavar="NAME=PATH", help="weights of a model")
    parser.add_argument("--samples", type=int, default=SAMPLES, help="default: %(default)s")
    parser.add_argument("--population", choices=list(Population), default=Population.ALL)
    add_json(parser)
    arguments = parser.parse_args(argv)
    checkpoints = dict(pair.split("=", 1) for pair in arguments.checkpoint)
    predictors = predictors_named(arguments.models.split(","), {name: Path(path) for name, path in checkpoints.items()})
    records = [read_episode(bag) for bag in bags_among(arguments.bags)]
    samples: dict[HistoryWindow, list[ScoredSamples]] = {}
    figures: dict[str, dict[str, float]] = {}
    population = Population(arguments.population)
    heads = ("wall s", "CPU s", f"per {SAMPLES // 1000}k", "CPU")
    print(f"{'':<12}{'samples':>10}" + "".join(f"{head:>12}" for head in heads))
    for name, predictor in predictors.items():
        if predictor.window not in samples:
            taken, samples[predictor.window] = sampling(records, predictor.window, population)
            print(taken.row("samples"), flush=True)
        taken = predicting(predictor, samples[predictor.window], arguments.samples)
        print(taken.row(name), flush=True)
        figures[name] = {"processors_s_per_100000": taken.processors_s * 100_000 / taken.samples}
    write_json(arguments.json, figures)
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
