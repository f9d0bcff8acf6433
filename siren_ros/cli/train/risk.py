"""``siren train risk``: the risk task's sequence model, from films to weights."""

import argparse
import sys
from pathlib import Path
from typing import Final

from tqdm import tqdm

from siren_ros.cli.options import add_processes, check_numbers, positive, steps_of
from siren_ros.cli.train.torch_part import torch_part
from siren_ros.errors import EXIT_FAILED, EXIT_OK
from siren_ros.scenario.episode import MAX_SEED
from siren_ros.training.data_files import MadeFiles
from siren_ros.training.risk.batches import FilmFitConfig
from siren_ros.training.risk.plan import FilmPlanSize, PlannedFilm, plan_films
from siren_ros.training.risk.samples import make_films
from siren_ros.training.risk.training import Fitter, train_sequence_model

_FITTER: Final = ("siren_ros.training.fitting.risk", "fitted_film_network")
"""Loaded by name, because it needs torch."""


def add_arguments(task: argparse.ArgumentParser) -> None:
    """Describe the task, and what it takes."""
    task.description = (
        "Simulates episodes, draws small films of the front camera, trains the network that judges their risk, and "
        "writes DIR/sequence.onnx with its card DIR/sequence.json. Called again with the same cache, it takes the "
        "films that are there. Needs torch: ./env --with models siren train risk. Exit code 1 where a film could not "
        "be made."
    )
    task.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the weights and the card")
    task.add_argument("--cache", type=Path, metavar="DIR", help="folder of the films (default OUT/cache)")
    size, config = FilmPlanSize(), FilmFitConfig()
    task.add_argument(
        "--train", type=positive, default=size.train, metavar="N", help="films of each template (default %(default)s)"
    )
    task.add_argument(
        "--validation", type=positive, default=size.validation, metavar="N", help="likewise (default %(default)s)"
    )
    add_processes(task, kind=positive)
    task.add_argument("--seed", type=int, default=config.seed, metavar="N", help="of the fitting (default %(default)s)")
    task.add_argument(
        "--epochs",
        type=positive,
        default=config.epochs,
        metavar="N",
        help="passes over the films (default %(default)s)",
    )
    task.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Makes the films, trains, says how it does on the validation films."""
    check_numbers(arguments, {"seed": (0, MAX_SEED)})
    fitter = _fitter()
    plan = plan_films(FilmPlanSize(arguments.train, arguments.validation))
    films = _made(plan, arguments.cache or arguments.out / "cache", arguments.jobs)
    config = FilmFitConfig(seed=arguments.seed, epochs=arguments.epochs)
    path = arguments.out / "sequence.onnx"
    model = train_sequence_model(films, path, config, fitter, _tell)
    figures = model.network.card["validation"]
    print(f"{path} ({model.network.card['parameters']} parameters)")
    print(f"validation: accuracy {figures['accuracy']:.1%}, macro F1 {figures['macro_f1']:.1%}, {figures['confusion']}")
    return EXIT_FAILED if films.missing else EXIT_OK


def _fitter() -> Fitter:
    fitter: Fitter = torch_part("risk", *_FITTER)
    return fitter


def _made(plan: tuple[PlannedFilm, ...], folder: Path, jobs: int) -> MadeFiles[PlannedFilm]:
    with tqdm(total=len(plan), unit="film", disable=not sys.stderr.isatty()) as bar:
        films = make_films(plan, folder, jobs, steps_of(bar))
    print(f"{folder}: {len(films.files)} of {len(plan)} films")
    for planned, reason in films.missing:
        print(f"siren train: {planned.name}: {reason}", file=sys.stderr)
    return films


def _tell(line: str) -> None:
    print(line, flush=True)
