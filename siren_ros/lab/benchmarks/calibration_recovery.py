"""Tests whether calibration finds known parameters: ``python -m siren_ros.benchmarks.calibration_recovery``.

An EMV drives with drawn parameters; its trajectory, with noise as of a tracker, is all that the search gets.
"""

import argparse
import os
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.tables import Table
from siren_ros.errors import EXIT_FAILED, EXIT_OK
from siren_ros.lab.calibration.fit import EVALUATIONS_EACH, Fitted, fit, residuals_over
from siren_ros.lab.calibration.problem import (
    Situation,
    Target,
    Trajectory,
    check_effect,
    driven,
    horizons_of,
    parameters_named,
)
from siren_ros.lab.reproduction.results import add_json, write_json
from siren_ros.running.generation.episode_setup import plan_length
from siren_ros.simulation.scenario.driver_parameters import DriverParameter
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import EmergencyLevel, level_name

TOLERANCE: Final = 0.05
"""Share of a parameter's range within which a found value counts as recovered."""
_PARAMETERS: Final = "emv.speed_mps,emv_driver.driving.comfort_accel_mps2,emv_driver.lines.speed_mps"
_PARAMETERS_L0: Final = "sumo.speed_factor,sumo.tau_s"
_INNER: Final = (0.15, 0.85)
"""True values are drawn from this part of each range."""


def main(argv: Sequence[str] | None = None) -> int:
    """Print true values, fitted values and differences; exit code 1 if a difference exceeds the tolerance."""
    line = argparse.ArgumentParser(description=__doc__)
    line.add_argument("--templates", nargs="+", default=["S2", "S3", "S4", "S6"], metavar="ID")
    line.add_argument("--level", type=level_name, default="L1")
    line.add_argument(
        "--seeds", type=int, nargs="+", default=[0], help="of each template's situations; all are fitted together"
    )
    line.add_argument("--parameters", default="", help=f"by default {_PARAMETERS}, at L0 {_PARAMETERS_L0}")
    line.add_argument("--truth-seed", type=int, default=1, help="of the true values")
    line.add_argument("--noise-m", type=float, default=0.1, help="standard deviation of each place")
    line.add_argument("--evaluations", type=int, default=0, help=f"0: {EVALUATIONS_EACH} for each parameter")
    line.add_argument("--duration-s", type=float, default=18.0, help="0: the template's own")
    line.add_argument("--workers", "--jobs", type=int, default=len(os.sched_getaffinity(0)))
    line.add_argument(
        "--tolerance", type=float, default=TOLERANCE, help="share of a range that a value may be off (%(default)s)"
    )
    add_json(line)
    asked = line.parse_args(argv)
    usual = _PARAMETERS_L0 if asked.level == EmergencyLevel.L0.name else _PARAMETERS
    parameters = parameters_named((asked.parameters or usual).split(","))
    check_effect(parameters, [asked.level])
    truth = drawn_truth(parameters, asked.truth_seed)
    requests = [
        EpisodeRequest(template, asked.level, seed, sensors="none", duration_s=asked.duration_s)
        for template in asked.templates
        for seed in asked.seeds
    ]
    targets = [target_with(request, truth, asked.noise_m) for request in requests]

    def report(tries: int, horizon_s: float, error_m: float) -> None:
        print(f"{tries}: {error_m:.3f} m over {horizon_s:g} s", flush=True)

    began = time.perf_counter()
    with residuals_over(targets, asked.workers) as residuals:
        evaluations = asked.evaluations or EVALUATIONS_EACH * len(parameters)
        fitted = fit(parameters, residuals, evaluations, report=report, horizons=horizons_of(targets))
    table = recovery_table(parameters, truth, fitted)
    print("\n".join(table.text()))
    rows: list[dict[str, Any]] = [{"name": row[0], "off": row[3], "spread": row[4]} for row in table.rows]
    worst = max(row["off"] for row in rows)
    print(
        f"{fitted.evaluations} tries of {len(targets)} episodes in {time.perf_counter() - began:.0f} s, "
        f"{'two rounds agree' if fitted.agreed else 'the tries were spent'}; "
        f"distance {fitted.error_m:.3f} m with {asked.noise_m:g} m of noise on each axis, {fitted.start_error_m:.2f} m "
        f"at the start; worst parameter off by {worst:.1%} of its range (allowed {asked.tolerance:.0%})"
    )
    if fitted.undetermined:
        print(f"not determined by these trajectories: {', '.join(fitted.undetermined)}")
    write_json(asked.json, {"parameters": rows, "error_m": fitted.error_m, "tries": fitted.evaluations})
    return EXIT_OK if worst <= asked.tolerance else EXIT_FAILED


def recovery_table(parameters: Sequence[DriverParameter], truth: Mapping[str, float], fitted: Fitted) -> Table:
    """Table of true and fitted values; differences and spreads are shares of the range."""
    rows = []
    for each in parameters:
        reach, value = each.maximum - each.minimum, fitted.values[each.name]
        off = abs(value - truth[each.name]) / reach
        rows.append((each.name, truth[each.name], value, off, fitted.spread[each.name] / reach))
    head = ("parameter", "truth", "found", "off, of the range", "spread, of the range")
    return Table("recovery", "", head, tuple(rows), spec=".3f", specs=dict.fromkeys(head[3:], ".1%"))


def drawn_truth(parameters: Sequence[DriverParameter], seed: int) -> dict[str, float]:
    """Draw true values uniformly from the inner part of each range."""
    rng = random_stream(seed, "calibration/truth")
    return {each.name: each.at(float(rng.uniform(*_INNER))) for each in parameters}


def target_with(request: EpisodeRequest, truth: Mapping[str, float], noise_m: float) -> Target:
    """Trajectory of an EMV with the true values, with a tracker's noise."""
    situation = Situation(request)
    way = driven(situation, truth, plan_length(request) * STEP_S)
    noise = random_stream(request.seed, f"calibration/noise/{request.template}").normal(0.0, noise_m, way.xy_m.shape)
    seen = Trajectory(way.time_s, np.asarray(way.xy_m + noise))
    return Target(f"{request.template}_seed{request.seed}", situation, seen)


if __name__ == "__main__":
    sys.exit(main())
