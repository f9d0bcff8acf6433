"""``siren train prediction``: the project's own predictor, from episodes to weights with figures."""

import argparse
import sys
from pathlib import Path
from typing import Final

from tqdm import tqdm

from siren_ros.cli.options import add_processes, check_numbers, processes_of, steps_of
from siren_ros.cli.train.torch_part import torch_part
from siren_ros.errors import EXIT_FAILED, EXIT_OK
from siren_ros.scenario.episode import MAX_SEED
from siren_ros.training.data_files import MadeFiles
from siren_ros.training.prediction.plan import FULL, VARIANTS, PlannedEpisode, PlanSize, plan_episodes
from siren_ros.training.prediction.samples import make_samples
from siren_ros.training.prediction.training import (
    Fitter,
    TrainedVariant,
    by_map,
    by_template,
    table_lines,
    train_variant,
    with_ablations,
)
from siren_ros.training.settings import FitConfig

_FITTER: Final = ("siren_ros.training.fitting.prediction", "fitted_network")
"""Loaded by name, because it needs torch."""
_TOWN: Final = "town"


def add_arguments(task: argparse.ArgumentParser) -> None:
    """Describe the task, and what it takes."""
    task.description = (
        "Runs episodes without sensors, trains the trajectory predictor on them, judges it on other seeds and on "
        "maps that it was not trained on, and writes DIR/full.onnx with its card DIR/full.json. Needs torch: "
        "./env --with models siren train prediction. Exit code 1 where an episode failed for another reason than "
        "that a map has no site for its template."
    )
    task.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of weights and cards")
    task.add_argument(
        "--cache", type=Path, metavar="DIR", help="folder of the samples, which a second run takes (default OUT/cache)"
    )
    task.add_argument(
        "--maps", nargs="+", default=[_TOWN], metavar="FILE", help="maps to train on, town for the built-in (default)"
    )
    task.add_argument("--held-out-maps", nargs="+", default=[], metavar="FILE", help="maps that only judge")
    size, config = PlanSize(), FitConfig()
    for name, default in (("train", size.train), ("validation", size.validation), ("test", size.test)):
        task.add_argument(
            f"--{name}-seeds",
            type=int,
            default=default,
            metavar="N",
            help=f"seeds of each template and map for {name} (default {default})",
        )
    add_processes(task)
    task.add_argument(
        "--seed", type=int, default=config.seed, metavar="N", help="of the training (default %(default)s)"
    )
    task.add_argument(
        "--epochs", type=int, default=config.epochs, metavar="N", help="passes over the samples (default %(default)s)"
    )
    task.add_argument("--device", default=config.device, metavar="NAME", help="cpu (default) or cuda")
    task.add_argument(
        "--variants",
        nargs="+",
        default=[FULL],
        choices=list(VARIANTS),
        help=f"what to train: {', '.join(f'{name} ({one.summary})' for name, one in VARIANTS.items())}",
    )
    task.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Makes the data, trains every variant, prints its figures."""
    seeds = (0, 1_000_000)
    check_numbers(
        arguments,
        {"train_seeds": (1, seeds[1]), "validation_seeds": seeds, "test_seeds": seeds, "epochs": (1, 1e9)}
        | {"seed": (0, MAX_SEED)},
    )
    fitter = _fitter()
    size = PlanSize(arguments.train_seeds, arguments.validation_seeds, arguments.test_seeds)
    plan = plan_episodes(_map_files(arguments.maps), _map_files(arguments.held_out_maps), size)
    data = _made(plan, arguments.cache or arguments.out / "cache", processes_of(arguments))
    config = FitConfig(seed=arguments.seed, epochs=arguments.epochs, device=arguments.device)
    trained = {}
    for name in dict.fromkeys(arguments.variants):
        trained[name] = train_variant(name, data, arguments.out, config, fitter, _tell)
        print("\n".join(_figures(name, trained[name])), flush=True)
    if FULL in trained and len(trained) > 1:
        with_ablations(trained[FULL], [other for name, other in trained.items() if name != FULL])
    return EXIT_FAILED if any(not reason.startswith("map:") for _, reason in data.missing) else EXIT_OK


def _fitter() -> Fitter:
    fitter: Fitter = torch_part("prediction", *_FITTER)
    return fitter


def _map_files(names: list[str]) -> list[str]:
    return ["" if name == _TOWN else name for name in names]


def _made(plan: tuple[PlannedEpisode, ...], folder: Path, jobs: int) -> MadeFiles[PlannedEpisode]:
    with tqdm(total=len(plan), unit="episode", disable=not sys.stderr.isatty()) as bar:
        data = make_samples(plan, folder, jobs, steps_of(bar))
    print(f"{folder}: {len(data.files)} of {len(plan)} episodes")
    for planned, reason in data.missing:
        print(f"siren train: {planned.name}: {reason}", file=sys.stderr)
    return data


def _tell(line: str) -> None:
    print(line, flush=True)


def _figures(name: str, trained: TrainedVariant) -> list[str]:
    lines = [f"{trained.path} ({trained.card['parameters']} parameters, sha256 {trained.card['sha256'][:16]})"]
    for split, errors in trained.errors.items():
        for what, table in (("template", by_template(errors)), ("map", by_map(errors))):
            lines += ["", f"{name}, {split.value.replace('_', ' ')}, by {what}: ADE in metres, region"]
            lines += table_lines(table)
    return [*lines, ""]
