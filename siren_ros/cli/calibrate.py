"""``siren calibrate BAG… --parameters NAMES``: the EMV's parameters that drive most like given trajectories."""

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from tqdm import tqdm

from siren_ros.base.tables.table import Table
from siren_ros.cli.options import add_bags, add_processes, check_numbers, names_in, processes_of, steps_of
from siren_ros.data.recording.bag_reader import bags_among, read_episode
from siren_ros.errors import EXIT_OK, InputError, write_text
from siren_ros.lab.calibration.fit import EVALUATIONS_EACH, UNDETERMINED_SHARE, Fitted, fit
from siren_ros.lab.calibration.parameters import PARAMETERS, check_effect, parameters_named
from siren_ros.lab.calibration.searches import residuals_over
from siren_ros.lab.calibration.targets import Situation, Target, Trajectory, horizons_of
from siren_ros.simulation.scenario.driver_parameters import DriverParameter
from siren_ros.simulation.scenario.episode import MAX_SEED

DEFAULTS = "emv.speed_mps,emv_driver.driving.comfort_accel_mps2,emv_driver.approach.headway_s"


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Simulates the situations of bags with other parameters of the EMV until it drives most like the EMV of the "
        "bags or like a given trajectory (least squares and CMA-ES). The error is the root "
        "mean square of the distance between both EMVs at the same times. The spread of a value is how far it can "
        f"move, while the others follow, until the error grows by a tenth. Parameters: {', '.join(PARAMETERS)}."
    )
    add_bags(verb)
    verb.add_argument(
        "--parameters", default=DEFAULTS, metavar="NAMES", help="parameters, by commas (default %(default)s)"
    )
    verb.add_argument(
        "--trajectory",
        type=Path,
        metavar="FILE.csv",
        help="trajectory in place of the bag's EMV (needs one bag): time_s, x_m, y_m in the map's frame",
    )
    verb.add_argument(
        "--evaluations",
        type=int,
        default=0,
        metavar="N",
        help=f"largest number of tries (default: {EVALUATIONS_EACH} for each parameter)",
    )
    verb.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the search (default 0)")
    verb.add_argument("--out", type=Path, metavar="FILE.json", help="write the values to this file")
    add_processes(verb)
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fits the parameters and prints them."""
    jobs = processes_of(arguments)
    check_numbers(arguments, {"evaluations": (0, 10_000_000), "seed": (0, MAX_SEED)})
    parameters = parameters_named(names_in(arguments.parameters))
    targets = _targets(arguments)
    check_effect(parameters, sorted({target.situation.request.level for target in targets}))
    evaluations = arguments.evaluations or EVALUATIONS_EACH * len(parameters)
    with (
        tqdm(total=evaluations * len(targets), unit="episode", desc="calibrate", disable=None) as bar,
        residuals_over(targets, jobs, steps_of(bar)) as residuals,
    ):
        fitted = fit(parameters, residuals, evaluations, arguments.seed, horizons=horizons_of(targets))
    print("\n".join(fitted_lines(parameters, fitted)))
    if arguments.out is not None:
        content = asdict(fitted)
        content["least_error_m"] = content.pop("history_m")
        content |= {"targets": [target.name for target in targets], "seed": arguments.seed}
        write_text(arguments.out, json.dumps(content, indent=1) + "\n")
    return EXIT_OK


def fitted_lines(parameters: tuple[DriverParameter, ...], fitted: Fitted) -> list[str]:
    """The values and how sure they are, for a terminal."""
    rows = tuple(
        (
            each.name,
            fitted.values[each.name],
            fitted.spread[each.name],
            f"{each.minimum:g} to {each.maximum:g}",
            each.meaning,
        )
        for each in parameters
    )
    table = Table("fit", "", ("parameter", "value", "spread", "range", "meaning"), rows, spec=".3f")
    distances = f"{fitted.error_m:.3f} m, {fitted.start_error_m:.3f} m in the middle of the ranges"
    lines = [*table.text(), f"distance to the trajectories {distances}; {fitted.evaluations} tries"]
    if fitted.undetermined:
        limit = f"spread above {UNDETERMINED_SHARE:.0%} of the range"
        lines.append(f"not determined by these trajectories: {', '.join(fitted.undetermined)} ({limit})")
    if not fitted.agreed:
        lines.append("no second round came to the same error; more --evaluations may find a smaller one")
    return lines


def _targets(arguments: argparse.Namespace) -> list[Target]:
    bags = bags_among(arguments.bags)
    if arguments.trajectory is not None and len(bags) != 1:
        raise InputError("trajectory", f"with {len(bags)} bags", "one bag, which gives the situation")
    given = None if arguments.trajectory is None else Trajectory.read(arguments.trajectory)
    targets = []
    for bag in bags:
        record = read_episode(bag)
        targets.append(Target(bag.name, Situation.of_record(record), given or Trajectory.of_record(record)))
    return targets
