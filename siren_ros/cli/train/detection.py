"""``siren train detection BAG… --out FILE.onnx``: the detector ``pillars``, from bags to weights with figures."""

import argparse
from pathlib import Path
from typing import Final

from siren_ros.cli.options import check_numbers
from siren_ros.cli.train.torch_part import torch_part
from siren_ros.errors import EXIT_OK, InputError
from siren_ros.scenario.episode import MAX_SEED
from siren_ros.training.detection.training import DetectorTraining, Fitter, train_detector
from siren_ros.training.settings import DetectionFit

_FITTER: Final = ("siren_ros.training.fitting.detection", "fitted_detector")
"""Loaded by name, because it needs torch."""


def add_arguments(task: argparse.ArgumentParser) -> None:
    """Describe the task, and what it takes."""
    task.description = (
        "Trains the pillar detector on recorded sweeps, judges it on other bags, and writes FILE.onnx with its card "
        "FILE.json. A training that was stopped goes on from its checkpoint when the command is given again. Needs "
        "torch: ./env --with models siren train detection."
    )
    config = DetectionFit()
    task.add_argument(
        "bags",
        type=Path,
        nargs="+",
        metavar="BAG",
        help="folder of a recorded episode with a LiDAR, folder of such folders, or frames of the cache (.npz)",
    )
    task.add_argument(
        "--out", type=Path, required=True, metavar="FILE.onnx", help="the detector; its card is next to it"
    )
    task.add_argument(
        "--held-out", type=Path, nargs="+", default=[], metavar="BAG", help="bags that only judge: other seeds or maps"
    )
    task.add_argument(
        "--cache",
        type=Path,
        metavar="DIR",
        help="folder of frames and checkpoint (default: FILE_training next to FILE)",
    )
    task.add_argument(
        "--steps", type=int, default=config.steps, metavar="N", help="of the optimiser (default %(default)s)"
    )
    task.add_argument("--seed", type=int, default=config.seed, help="of the training (default %(default)s)")
    task.add_argument("--minutes", type=float, metavar="M", help="stop after M minutes, at the next checkpoint")
    task.add_argument("--threads", type=int, default=1, metavar="N", help="of the processor (default %(default)s)")
    task.add_argument("--device", default=config.device, help="cpu (default) or cuda")
    task.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Makes the frames, trains, prints the figures."""
    check_numbers(arguments, {"steps": (1, 1e9), "threads": (1, 10_000), "seed": (0, MAX_SEED), "minutes": (0.0, 1e9)})
    fitter = _fitter()
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
    card = train_detector(training, fitter, _tell)
    if card is None:
        _tell("stopped; the same command goes on from here")
        return EXIT_OK
    _tell(f"{out} ({card['parameters']} parameters, sha256 {card['sha256'][:16]})")
    for split, figures in card["figures"].items():
        values = ", ".join(f"{name} {value:.3f}" for name, value in figures["mAP"].items())
        _tell(f"{split.replace('_', ' ')}: {figures['episodes']} episodes, mAP {values}")
    return EXIT_OK


def _fitter() -> Fitter:
    fitter: Fitter = torch_part("detection", *_FITTER)
    return fitter


def _tell(line: str) -> None:
    print(line, flush=True)
