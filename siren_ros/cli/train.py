"""``siren train`` and ``siren calibrate``: models from data, and parameters from trajectories.

The models are those that ship with the project, from data to weights with figures.
"""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from tqdm import tqdm

from siren_ros.base.tables import Table
from siren_ros.cli.command import complain
from siren_ros.cli.generate import BUILT_IN
from siren_ros.cli.options import add_bags, add_processes, check_numbers, names_in, positive, processes_of, steps_of
from siren_ros.data.recording.bag_reader import bags_among, read_episode
from siren_ros.errors import EXIT_FAILED, EXIT_OK, InputError, write_text
from siren_ros.lab.calibration.fit import EVALUATIONS_EACH, UNDETERMINED_SHARE, Fitted, fit, residuals_over
from siren_ros.lab.calibration.problem import (
    PARAMETERS,
    Situation,
    Target,
    Trajectory,
    check_effect,
    horizons_of,
    parameters_named,
)
from siren_ros.lab.training.data_files import MadeFiles, Planned
from siren_ros.lab.training.detection.training import DetectorTraining, train_detector
from siren_ros.lab.training.prediction.samples import FULL, VARIANTS, PlanSize, make_samples, plan_bags, plan_episodes
from siren_ros.lab.training.prediction.training import (
    TrainedVariant,
    by_map,
    by_template,
    table_lines,
    train_variant,
    with_ablations,
)
from siren_ros.lab.training.risk import FilmPlanSize, make_films, plan_films, train_sequence_model
from siren_ros.lab.training.settings import ARCHITECTURES, DetectionFit, DriverFit, FilmFitConfig, FitConfig
from siren_ros.simulation.scenario.driver_parameters import DriverParameter
from siren_ros.simulation.scenario.episode import MAX_SEED

DEFAULTS = "emv.speed_mps,emv_driver.driving.comfort_accel_mps2,emv_driver.approach.headway_s"


def add_calibration(verb: argparse.ArgumentParser) -> None:
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
    verb.set_defaults(run=calibrate)


def calibrate(arguments: argparse.Namespace) -> int:
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


FITTERS: Final = {
    "prediction": "fitted_network",
    "detection": "fitted_detector",
    "risk": "fitted_film_network",
    "driver": "trained_driver",
}
"""Functions of the modules ``siren_ros.lab.training.fitting.TASK``, loaded by name because they need torch."""
_EXTRAS: Final = {"driver": "rl"}
"""Extra that a task needs, where it is another one than ``models``."""
_TOWN: Final = "town"
_SEED_COUNTS: Final = 1_000_000


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = "Trains the models that ship with the project."
    tasks = verb.add_subparsers(title="tasks", metavar="TASK", required=True)
    _add_prediction(_task(tasks, "prediction", "the trajectory predictor siren", train_prediction))
    _add_detection(_task(tasks, "detection", "the LiDAR detector pillars", train_detection))
    _add_risk(_task(tasks, "risk", "the sequence model of risk videos", train_risk))
    _add_driver(_task(tasks, "driver", "a driver that makes way", train_driver))


def _task(tasks: Any, name: str, summary: str, train: Callable[[argparse.Namespace, Any], int]) -> Any:
    """A task with the options that every training has."""
    task = tasks.add_parser(name, help=summary)
    task.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the training (default %(default)s)")
    task.set_defaults(run=run, task=name, train=train)
    return task


def run(arguments: argparse.Namespace) -> int:
    """Loads what needs torch, before any work begins, and trains.

    Raises:
        InputError: The extra with torch is not installed, or a number lies outside its limits.
    """
    check_numbers(arguments, {"seed": (0, MAX_SEED)})
    return int(arguments.train(arguments, fitter_of(arguments.task)))


def fitter_of(task: str) -> Any:
    """The function that fits and exports the network of a task; InputError where the extra is not installed."""
    try:
        return getattr(import_module(f"siren_ros.lab.training.fitting.{task}"), FITTERS[task])
    except ModuleNotFoundError as error:
        extra = _EXTRAS.get(task, "models")
        runs = f"./env --with {extra} siren train {task} …"
        raise InputError("environment", f"no {error.name}", f"the extra {extra}, as {runs} brings it") from error


def _with_bar(
    make: Callable[[Sequence[Planned], Path, int, Callable[[], None]], MadeFiles[Planned]],
    plan: Sequence[Planned],
    folder: Path,
    jobs: int,
    unit: str,
) -> MadeFiles[Planned]:
    """Makes the data with a progress bar, and prints what is missing."""
    with tqdm(total=len(plan), unit=unit, disable=not sys.stderr.isatty()) as bar:
        data = make(plan, folder, jobs, steps_of(bar))
    print(f"{folder}: {len(data.files)} of {len(plan)} {unit}s")
    for planned, reason in data.missing:
        complain(f"siren train: {planned.name}: {reason}")
    return data


_print: Final = partial(print, flush=True)


def _add_prediction(task: argparse.ArgumentParser) -> None:
    task.description = (
        "Simulates episodes without sensors, trains the trajectory predictor on them, evaluates it on other seeds and "
        "on maps that the training did not see, and writes DIR/full.onnx with its card DIR/full.json. After Ctrl-C, "
        "the same command goes on from its checkpoint. It needs torch: "
        "./env --with models siren train prediction. The exit code is 1 if an episode failed, unless the map has no "
        "site for its template."
    )
    task.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for weights and cards")
    task.add_argument(
        "--cache", type=Path, metavar="DIR", help="folder of the samples, kept for later runs (default OUT/cache)"
    )
    task.add_argument(
        "--maps",
        nargs="+",
        default=[_TOWN],
        metavar="FILE",
        help=f"maps to train on: files, {BUILT_IN} (default town)",
    )
    task.add_argument(
        "--bags",
        type=Path,
        nargs="+",
        default=[],
        metavar="BAG",
        help="recorded episodes, or folders with bags, in place of simulated ones; params/splits.yaml says which train",
    )
    task.add_argument("--held-out-maps", nargs="+", default=[], metavar="FILE", help="maps for evaluation only")
    config = FitConfig()
    for name, default in asdict(PlanSize()).items():
        meaning = f"seeds of each template and map for {name} (default {default})"
        task.add_argument(f"--{name}-seeds", type=int, default=default, metavar="N", help=meaning)
    add_processes(task)
    task.add_argument(
        "--epochs", type=int, default=config.epochs, metavar="N", help="passes over the samples (default %(default)s)"
    )
    task.add_argument(
        "--architecture",
        choices=ARCHITECTURES,
        default=config.architecture,
        help="network: SIREN's own along the roads, or a baseline without a map (default %(default)s)",
    )
    task.add_argument("--device", default=config.device, metavar="NAME", help="cpu (default) or cuda")
    meaning = f"variants to train: {', '.join(f'{name} ({variant.summary})' for name, variant in VARIANTS.items())}"
    task.add_argument("--variants", nargs="+", default=[FULL], choices=list(VARIANTS), help=meaning)


def train_prediction(arguments: argparse.Namespace, fitter: Any) -> int:
    """Makes the data, trains every variant, prints its figures."""
    limits = {"validation_seeds": (0, _SEED_COUNTS), "test_seeds": (0, _SEED_COUNTS), "epochs": (1, 1e9)}
    check_numbers(arguments, {"train_seeds": (1, _SEED_COUNTS), **limits})
    size = PlanSize(arguments.train_seeds, arguments.validation_seeds, arguments.test_seeds)
    maps, held_out = (
        ["" if name == _TOWN else name for name in names] for names in (arguments.maps, arguments.held_out_maps)
    )
    cache = arguments.cache or arguments.out / "cache"
    plan = plan_bags(bags_among(arguments.bags)) if arguments.bags else plan_episodes(maps, held_out, size)
    data = _with_bar(make_samples, plan, cache, processes_of(arguments), "episode")
    config = FitConfig(
        seed=arguments.seed,
        epochs=arguments.epochs,
        device=arguments.device,
        architecture=arguments.architecture,
    )
    trained: dict[str, TrainedVariant] = {}
    for name in dict.fromkeys(arguments.variants):
        trained[name] = train_variant(name, data, arguments.out, config, fitter, _print)
        _print(*_figures(name, trained[name]), sep="\n")
    if FULL in trained and len(trained) > 1:
        with_ablations(trained[FULL], [other for name, other in trained.items() if name != FULL])
    return EXIT_FAILED if any(not reason.startswith("map:") for _, reason in data.missing) else EXIT_OK


def _figures(name: str, trained: TrainedVariant) -> list[str]:
    lines = [f"{trained.path} ({trained.card['parameters']} parameters, sha256 {trained.card['sha256'][:16]})"]
    for split, errors in trained.errors.items():
        for what, table in (("template", by_template(errors)), ("map", by_map(errors))):
            lines += ["", f"{name}, {split.value.replace('_', ' ')}, by {what}: ADE in metres, region"]
            lines += table_lines(table)
    return [*lines, ""]


def _add_detection(task: argparse.ArgumentParser) -> None:
    task.description = (
        "Trains the pillar detector on recorded sweeps, evaluates it on other bags, and writes FILE.onnx with its "
        "card FILE.json. The same command continues an interrupted training from its checkpoint. It needs torch: "
        "./env --with models siren train detection."
    )
    config = DetectionFit()
    task.add_argument(
        "bags",
        type=Path,
        nargs="+",
        metavar="BAG",
        help="bags with a LiDAR, folders with such bags, or frames of the cache (.npz)",
    )
    task.add_argument(
        "--out", type=Path, required=True, metavar="FILE.onnx", help="file for the detector; its card lies next to it"
    )
    task.add_argument("--held-out", type=Path, nargs="+", default=[], metavar="BAG", help="bags only for evaluation")
    meaning = "folder of frames and checkpoint (default: FILE_training next to FILE)"
    task.add_argument("--cache", type=Path, metavar="DIR", help=meaning)
    task.add_argument(
        "--steps", type=int, default=config.steps, metavar="N", help="steps of the optimiser (default %(default)s)"
    )
    task.add_argument("--minutes", type=float, metavar="M", help="stop at the first checkpoint after M minutes")
    task.add_argument("--threads", type=int, default=1, metavar="N", help="number of threads (default %(default)s)")
    task.add_argument("--device", default=config.device, help="cpu (default) or cuda")


def train_detection(arguments: argparse.Namespace, fitter: Any) -> int:
    """Makes the frames, trains, prints the figures."""
    check_numbers(arguments, {"steps": (1, 1e9), "threads": (1, 10_000), "minutes": (0.0, 1e9)})
    out: Path = arguments.out
    if out.suffix != ".onnx":
        raise InputError("out", str(out), "a file that ends in .onnx")
    training = DetectorTraining(
        bags=tuple(arguments.bags),
        held_out=tuple(arguments.held_out),
        out=out,
        cache=arguments.cache or out.with_name(f"{out.stem}_training"),
        config=DetectionFit(seed=arguments.seed, steps=arguments.steps, device=arguments.device),
        threads=arguments.threads,
        minutes=arguments.minutes,
    )
    card = train_detector(training, fitter, _print)
    if card is None:
        _print("stopped; the same command continues from here")
        return EXIT_OK
    _print(f"{out} ({card['parameters']} parameters, sha256 {card['sha256'][:16]})")
    for split, figures in card["figures"].items():
        values = ", ".join(f"{name} {value:.3f}" for name, value in figures["mAP"].items())
        _print(f"{split.replace('_', ' ')}: {figures['episodes']} episodes, mAP {values}")
    return EXIT_OK


def _add_risk(task: argparse.ArgumentParser) -> None:
    task.description = (
        "Simulates episodes, draws small films of the front camera, trains the network that judges their risk, and "
        "writes DIR/sequence.onnx with its card DIR/sequence.json. With the same cache, it uses the films that exist. "
        "It needs torch: ./env --with models siren train risk. The exit code is 1 if a film could not be made."
    )
    task.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the weights and the card")
    task.add_argument("--cache", type=Path, metavar="DIR", help="folder of the films (default OUT/cache)")
    size, config = FilmPlanSize(), FilmFitConfig()
    for option, name, default, what in (
        ("--train", "train_films", size.train, "films of each template"),
        ("--validation", "validation", size.validation, "validation films of each template"),
        ("--epochs", "epochs", config.epochs, "passes over the films"),
    ):
        meaning = f"{what} (default %(default)s)"
        task.add_argument(option, dest=name, type=positive, default=default, metavar="N", help=meaning)
    add_processes(task, kind=positive)


def train_risk(arguments: argparse.Namespace, fitter: Any) -> int:
    """Makes the films, trains, says how it does on the validation films."""
    plan = plan_films(FilmPlanSize(arguments.train_films, arguments.validation))
    films = _with_bar(make_films, plan, arguments.cache or arguments.out / "cache", arguments.workers, "film")
    config = FilmFitConfig(seed=arguments.seed, epochs=arguments.epochs)
    path = arguments.out / "sequence.onnx"
    model = train_sequence_model(films, path, config, fitter, _print)
    figures = model.network.card["validation"]
    print(f"{path} ({model.network.card['parameters']} parameters)")
    print(f"validation: accuracy {figures['accuracy']:.1%}, macro F1 {figures['macro_f1']:.1%}, {figures['confusion']}")
    return EXIT_FAILED if films.missing else EXIT_OK


def _add_driver(task: argparse.ArgumentParser) -> None:
    task.description = (
        "Trains a driver in the environment siren/Yield-v0: several drivers drive each episode, rules and the one that "
        "learns, and it imitates the best drive. It writes DIR/driver.onnx with its card DIR/driver.json, which "
        "`siren exam --driver DIR/driver.onnx` examines. It needs torch and Gymnasium: "
        "./env --with rl siren train driver."
    )
    config = DriverFit()
    task.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the weights and the card")
    task.add_argument(
        "--episodes",
        type=positive,
        nargs="+",
        default=[*config.episodes],
        metavar="N",
        help=f"number of episodes of each round (default {' '.join(map(str, config.episodes))})",
    )
    task.add_argument(
        "--templates",
        nargs="+",
        default=[*config.templates],
        metavar="ID",
        help=f"templates of the episodes (default {' '.join(config.templates)})",
    )
    add_processes(task)


def train_driver(arguments: argparse.Namespace, trainer: Any) -> int:
    """Trains the driver."""
    config = DriverFit(seed=arguments.seed, episodes=tuple(arguments.episodes), templates=tuple(arguments.templates))
    path = arguments.out / "driver.onnx"
    card = trainer(path, config, processes_of(arguments), _print)
    print(f"{path} ({card['parameters']} parameters, sha256 {card['sha256'][:16]}, {card['minutes']:.0f} min)")
    return EXIT_OK
