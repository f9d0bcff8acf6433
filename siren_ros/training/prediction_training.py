"""The whole training of the trajectory predictor: data, variants, figures, files."""

import hashlib
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from siren_ros.errors import InputError
from siren_ros.evaluation.network_file import write_network
from siren_ros.evaluation.prediction.siren_model.features import FEATURES_VERSION
from siren_ros.evaluation.prediction.siren_model.network_file import load_network
from siren_ros.training.assessment import EpisodeErrors, assess, errors_json
from siren_ros.training.data_making import MadeData
from siren_ros.training.episode_plan import PlannedEpisode, Split, is_ordinary
from siren_ros.training.fit_config import FitConfig, FittedNetwork
from siren_ros.training.sample_store import SampleStore, read_store
from siren_ros.training.variants import VARIANTS

Fitter = Callable[[SampleStore, FitConfig, Callable[[str], None]], FittedNetwork]
_JUDGED: Final = (Split.VALIDATION, Split.TEST_SEEDS, Split.TEST_MAPS)
_PACKAGES: Final = ("siren_ros", "eclipse-sumo", "numpy", "onnxruntime")


@dataclass(frozen=True)
class TrainedVariant:
    """One trained network and its figures."""

    path: Path
    card: Mapping[str, Any]
    errors: Mapping[Split, tuple[EpisodeErrors, ...]]


def train_variant(
    name: str, data: MadeData, folder: Path, config: FitConfig, fitter: Fitter, told: Callable[[str], None]
) -> TrainedVariant:
    """Trains one variant, and writes ``NAME.onnx`` and its card ``NAME.json``.

    Args:
        name: One of ``VARIANTS``.
        data: Episodes of all splits.
        folder: Where the files go.
        config: Settings.
        fitter: Fits and exports a network.
        told: Called with lines on the progress.

    Raises:
        InputError: No training episode, or the folder cannot be written.
    """
    variant = VARIANTS[name]
    files = _training_files(name, data)
    if not files:
        raise InputError("episodes", name, "at least one that could be made for training")
    store = read_store([path for _, path in files], variant.ablation)
    told(f"{name} ({variant.summary}): {len(store)} samples of {len(store.episodes)} episodes")
    wall, processor = time.monotonic(), time.process_time()
    fitted = fitter(store, config, told)
    card = {
        "model": "siren",
        "variant": name,
        "summary": variant.summary,
        "ablation": variant.ablation.value,
        "features_version": FEATURES_VERSION,
        "sha256": hashlib.sha256(fitted.onnx).hexdigest(),
        "parameters": fitted.parameters,
        "made_with": {"fitting": fitted.made_with, "python": platform.python_version()}
        | {package: version(package) for package in _PACKAGES},
        "fit": asdict(config),
        "training": {
            "episodes": len(store.episodes),
            "samples": len(store),
            "wall_s": round(time.monotonic() - wall),
            "processor_s": round(time.process_time() - processor),
        },
        "data": _data_json(data),
    }
    path = folder / f"{name}.onnx"
    write_network(path, fitted.onnx, card)
    network = load_network(path)
    errors = {}
    for split in _JUDGED:
        judged = [file for planned, file in data.files if planned.split is split]
        if judged:
            errors[split] = assess(network, read_store(judged, variant.ablation))
    card = {**card, "figures": {split.value: errors_json(found) for split, found in errors.items()}}
    write_network(path, fitted.onnx, card)
    return TrainedVariant(path, card, errors)


def with_ablations(full: TrainedVariant, others: Sequence[TrainedVariant]) -> TrainedVariant:
    """The whole predictor, its card with the figures of the others."""
    compared = {
        other.card["variant"]: {
            "summary": other.card["summary"],
            "episodes": other.card["training"]["episodes"],
            **{split: figures["by_template"] for split, figures in other.card["figures"].items()},
        }
        for other in others
    }
    extended = replace(full, card={**full.card, "ablations": compared})
    write_network(full.path, full.path.read_bytes(), extended.card)
    return extended


def _training_files(name: str, data: MadeData) -> list[tuple[PlannedEpisode, Path]]:
    files = [(planned, path) for planned, path in data.files if planned.split is Split.TRAIN]
    ordinary = [(planned, path) for planned, path in files if is_ordinary(planned.request)]
    if VARIANTS[name].ordinary_only:
        return ordinary
    if VARIANTS[name].as_few_as_ordinary and ordinary:
        step = len(files) / len(ordinary)
        return [files[int(number * step)] for number in range(len(ordinary))]
    return files


def _data_json(data: MadeData) -> dict[str, Any]:
    splits = {}
    for split in Split:
        made = [planned.request for planned, _ in data.files if planned.split is split]
        left_out = [
            f"{planned.name}: {_reason(planned, why)}" for planned, why in data.missing if planned.split is split
        ]
        seeds = [request.seed for request in made]
        splits[split.value] = {
            "episodes": len(made),
            "maps": sorted({Path(request.map).name or "town" for request in made}),
            "seeds": [min(seeds), max(seeds)] if seeds else [],
            "left_out": sorted(left_out),
        }
    return splits


def _reason(planned: PlannedEpisode, reason: str) -> str:
    """Why an episode is missing, with the name of the map in place of its path."""
    path = planned.request.map
    return reason.replace(path, Path(path).name) if path else reason
