"""Measures traffic flow over templates and seeds: ``python -m siren_ros.benchmarks.traffic_flow --seeds 0:5``.

Prints how queues discharge (L0, where nobody makes way), how drivers follow, and how civilians accelerate and brake at
each template's own level, with what traffic engineers measure on roads.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.processes.process_pool import ProcessPool, side_by_side
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.lab.benchmarks.json_figures import add_json, write_json
from siren_ros.lab.benchmarks.templates import seeds_of_option
from siren_ros.running.generation.closed_loop import closed_loop, record_of
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.scoring.evaluation.traffic_flow import (
    civilian_accelerations_mps2,
    discharge_headways,
    following_headways_s,
)
from siren_ros.scoring.judging.physics import CIVILIAN_PERCENTILES
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import TEMPLATES

ALL: Final = "all"
NOMINAL_S: Final = 90.0


@dataclass(frozen=True)
class FlowSamples:
    """Samples of one episode."""

    through_s: Floats
    cars_s: Floats
    """The part of ``through_s`` between passenger cars."""
    turning_s: Floats
    following_s: Floats
    accel_mps2: Floats


def record_at(request: EpisodeRequest, level: str = "") -> EpisodeRecord:
    """Record an episode without ROS and sensors; at L0 it lasts until the signal is green again."""
    asked = replace(request, level=level, duration_s=NOMINAL_S if level else 0.0)
    setup = set_up_episode(asked)
    return record_of(setup, list(closed_loop(setup, setup.steps)))


def measure(request: EpisodeRequest) -> FlowSamples:
    """Measure the samples of an episode."""
    own, nominal = record_at(request), record_at(request, "L0")
    queues = discharge_headways(nominal)
    through_s, turning_s = queues.headway_s[~queues.turns], queues.headway_s[queues.turns]
    cars_s = queues.headway_s[~queues.turns & ~queues.heavy]
    return FlowSamples(through_s, cars_s, turning_s, following_headways_s(own), civilian_accelerations_mps2(own))


def summary(samples: Sequence[FlowSamples]) -> dict[str, float]:
    """The figures over episodes; NaN without samples."""
    through, cars, turning, following, accel = (
        np.concatenate([getattr(episode, field.name) for episode in samples]) for field in fields(FlowSamples)
    )
    low, high = np.percentile(accel, CIVILIAN_PERCENTILES) if len(accel) else (np.nan, np.nan)
    return {
        "through_s": float(np.mean(through)) if len(through) else np.nan,
        "through_median_s": float(np.median(through)) if len(through) else np.nan,
        "through": float(len(through)),
        "cars_median_s": float(np.median(cars)) if len(cars) else np.nan,
        "cars": float(len(cars)),
        "turning_s": float(np.mean(turning)) if len(turning) else np.nan,
        "turning": float(len(turning)),
        "following_s": float(np.median(following)) if len(following) else np.nan,
        "followers": float(len(following)),
        "accel_low_mps2": float(low),
        "accel_high_mps2": float(high),
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Print a row for each template, and one for all."""
    options = _parser().parse_args(argv)
    requests = [
        EpisodeRequest(template, seed=seed, map=options.map, preset=options.preset, sensors="none")
        for template in options.templates
        for seed in options.seeds
    ]
    with ProcessPool(options.workers, preload="siren_ros.lab.benchmarks.traffic_flow") as pool:
        calls = {request: partial(pool.call, measure, request) for request in requests}
        samples = side_by_side(calls, options.workers, pool.stop)
    print(
        "     through s, mean  median  vehicles  cars  vehicles  turning s  vehicles  following s  samples"
        "  acceleration p0.5 and p99.5"
    )
    figures = {}
    for name in (*options.templates, ALL):
        row = figures[name] = summary([samples[asked] for asked in requests if name in (asked.template, ALL)])
        print(
            f"{name:<5}{row['through_s']:15.2f}{row['through_median_s']:8.2f}{row['through']:10.0f}"
            f"{row['cars_median_s']:6.2f}{row['cars']:10.0f}{row['turning_s']:11.2f}{row['turning']:10.0f}{row['following_s']:13.2f}"
            f"{row['followers']:9.0f}{row['accel_low_mps2']:10.2f}{row['accel_high_mps2']:7.2f}"
        )
    write_json(options.json, figures)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--templates", nargs="+", default=list(TEMPLATES), metavar="ID")
    parser.add_argument("--seeds", type=seeds_of_option, default=range(5), help="first:last, the last not included")
    parser.add_argument("--map", default="", help="map file; the built-in town by default")
    parser.add_argument("--preset", default="paper", help="how drivers respond")
    parser.add_argument("--workers", "--jobs", type=int, default=2, help="processes")
    add_json(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
