"""The complete training of the trajectory predictor: data, variants, comparison with reference models, files."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Floats32, random_stream
from siren_ros.base.params.plain_files import write_network
from siren_ros.errors import InputError
from siren_ros.lab.training.data_files import MadeFiles
from siren_ros.lab.training.prediction.samples import (
    VARIANTS,
    WORST_TRACKER,
    EpisodeKey,
    PlannedEpisode,
    SampleStore,
    is_ordinary,
    read_store,
    without_lamps,
)
from siren_ros.lab.training.settings import ARCHITECTURES, FitConfig, FittedNetwork
from siren_ros.scoring.evaluation.prediction.reported_tracks import TrackNoise
from siren_ros.scoring.evaluation.prediction.siren_model.siren_predictor import (
    FEATURES_VERSION,
    TrainedNetwork,
    load_network,
)
from siren_ros.simulation.scenario.episode import Split

MEAN: Final = "mean"
UNLIT_SHARE: Final = 0.1
"""Share of training samples without brake lamps and indicators, because many trackers report none."""
_MODEL_ERRORS: Final = ("siren", "siren_min6", "siren_fde")


@dataclass(frozen=True)
class EpisodeErrors:
    """Mean errors over the samples of one episode, in metres."""

    episode: EpisodeKey
    samples: int
    errors_m: Mapping[str, float]
    """ADE of ``cv``, ``idm`` and ``siren`` (most probable hypothesis), and ``siren_min6``, ``siren_fde``."""


def assess(network: TrainedNetwork, store: SampleStore) -> tuple[EpisodeErrors, ...]:
    """Errors of each episode in a split."""
    xy_m, probability = network.run(store.batch(slice(None)))
    miss = xy_m - store.truth_m[:, None]
    distance = np.hypot(miss[..., 0], miss[..., 1])
    ade = distance.mean(axis=-1)
    likeliest, rows = probability.argmax(axis=1), np.arange(len(store))
    of_model = (ade[rows, likeliest], ade.min(axis=1), distance[rows, likeliest, -1])
    columns: dict[str, Floats | Floats32] = {**dict(zip(_MODEL_ERRORS, of_model, strict=True)), **store.reference_ade_m}
    episodes = []
    for number, key in enumerate(store.episodes):
        rows = np.flatnonzero(store.episode == number)
        means = {name: float(values[rows].mean()) for name, values in columns.items()}
        episodes.append(EpisodeErrors(key, len(rows), means))
    return tuple(episodes)


def by_template(errors: Sequence[EpisodeErrors]) -> dict[str, dict[str, float]]:
    """Means over the samples of each template; ``MEAN`` is the mean over templates, as in the evaluation."""
    table = {}
    for name in sorted({each.episode.template for each in errors}):
        episodes = [each for each in errors if each.episode.template == name]
        means = _mean([each.errors_m for each in episodes], [each.samples for each in episodes])
        table[name] = {"episodes": float(len(episodes)), **means}
    if not table:
        return {}
    mean = _mean(list(table.values()), [1] * len(table))
    return {**table, MEAN: {**mean, "episodes": float(len(errors))}}


def by_map(errors: Sequence[EpisodeErrors]) -> dict[str, dict[str, float]]:
    """Mean over the templates, for each map."""
    names = sorted({each.episode.map_name for each in errors})
    return {name: by_template([each for each in errors if each.episode.map_name == name])[MEAN] for name in names}


def _mean(rows: Sequence[Mapping[str, float]], weights: Sequence[int]) -> dict[str, float]:
    return {name: float(np.average([row[name] for row in rows], weights=weights)) for name in rows[0]}


def table_lines(table: Mapping[str, Mapping[str, float]]) -> list[str]:
    """The table as text: ADE of the models, minADE of six, and their ratios to constant velocity."""
    lines = [f"{'':<14}{'episodes':>9}{'cv':>8}{'idm':>8}{'siren':>8}{'':>7}{'minADE6':>9}{'':>7}"]
    for name, row in table.items():
        gains = [f"{row[name] / row['cv'] - 1.0:+.0%}" for name in _MODEL_ERRORS[:2]]
        lines.append(
            f"{name:<14}{row['episodes']:>9.0f}{row['cv']:8.2f}{row['idm']:8.2f}{row['siren']:8.2f}{gains[0]:>7}"
            f"{row['siren_min6']:9.2f}{gains[1]:>7}"
        )
    return lines


def errors_json(errors: Sequence[EpisodeErrors]) -> dict[str, Any]:
    """All errors as JSON types, rounded to millimetres."""
    return {
        "samples": sum(each.samples for each in errors),
        "by_template": _rounded(by_template(errors)),
        "by_map": _rounded(by_map(errors)),
    }


def _rounded(table: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    return {name: {key: round(value, 3) for key, value in row.items()} for name, row in table.items()}


Fitter = Callable[[SampleStore, FitConfig, Path, Callable[[str], None]], FittedNetwork]
_JUDGED: Final[tuple[Split, ...]] = tuple(split for split in Split if split is not Split.TRAIN)


@dataclass(frozen=True)
class TrainedVariant:
    """One trained network with its errors."""

    path: Path
    card: Mapping[str, Any]
    errors: Mapping[Split, tuple[EpisodeErrors, ...]]


def train_variant(
    name: str,
    data: MadeFiles[PlannedEpisode],
    folder: Path,
    config: FitConfig,
    fitter: Fitter,
    report: Callable[[str], None],
) -> TrainedVariant:
    """Train a variant on all splits, and write ``NAME.onnx`` with its card ``NAME.json``.

    ``report`` is called with lines on the progress.

    Raises:
        InputError: No training episode, or the folder cannot be written.
    """
    variant = VARIANTS[name]
    training_files = _training_files(name, data)
    if not training_files:
        raise InputError("episodes", name, "at least one that could be made for training")
    store = read_store([path for _, path in training_files], variant.ablation)
    store = without_lamps(store, random_stream(config.seed, "training/lamps").random(len(store)) < UNLIT_SHARE)
    report(f"{name} ({variant.summary}): {len(store)} samples of {len(store.episodes)} episodes")
    path, wall = folder / f"{name}.onnx", time.monotonic()
    fitted = fitter(store, config, path.with_suffix(".checkpoint.pt"), report)
    card = fitted.card(
        config,
        model="siren" if config.architecture == ARCHITECTURES[0] else config.architecture,
        variant=name,
        summary=variant.summary,
        ablation=variant.ablation.value,
        features_version=FEATURES_VERSION,
    )
    card["training"] = {
        "episodes": len(store.episodes),
        "samples": len(store),
        "noise": asdict(TrackNoise()),
        "noisy_share": 0.5,
        "noise_times": [0.0, WORST_TRACKER],
        "unlit_share": UNLIT_SHARE,
        "wall_s": round(time.monotonic() - wall),
        "processor_s": round(fitted.processor_s),
    }
    card["data"] = _data_json(data)
    card["data"][Split.TRAIN.value]["contents"] = sorted({episode.content for episode in store.episodes} - {""})
    write_network(path, fitted.onnx, card)
    network = load_network(path)
    judged = {split: [file for planned, file in data.files if planned.split is split] for split in _JUDGED}
    errors = {split: assess(network, read_store(files, variant.ablation)) for split, files in judged.items() if files}
    card = {**card, "figures": {split.value: errors_json(episodes) for split, episodes in errors.items()}}
    write_network(path, fitted.onnx, card)
    return TrainedVariant(path, card, errors)


def with_ablations(full: TrainedVariant, others: Sequence[TrainedVariant]) -> TrainedVariant:
    """The main predictor with the errors of the other variants in its card."""
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


def _training_files(name: str, data: MadeFiles[PlannedEpisode]) -> list[tuple[PlannedEpisode, Path]]:
    files = [(planned, path) for planned, path in data.files if planned.split is Split.TRAIN]
    ordinary = [(planned, path) for planned, path in files if is_ordinary(planned.request)]
    if VARIANTS[name].ordinary_only:
        return ordinary
    if VARIANTS[name].as_few_as_ordinary and ordinary:
        step = len(files) / len(ordinary)
        return [files[int(number * step)] for number in range(len(ordinary))]
    return files


def _data_json(data: MadeFiles[PlannedEpisode]) -> dict[str, Any]:
    splits = {}
    for split in Split:
        planned_episodes = [planned for planned, _ in data.files if planned.split is split]
        requests = [planned.request for planned in planned_episodes]
        left_out = []
        for planned, reason in data.missing:
            if planned.split is split:
                path = planned.request.map or "town"  # the card contains the map's name, not its path
                left_out.append(f"{planned.name}: {reason.replace(path, Path(path).name)}")
        seeds = [request.seed for request in requests]
        splits[split.value] = {
            "episodes": len(requests),
            "maps": sorted({Path(request.map).name or "town" for request in requests}),
            "seeds": [min(seeds), max(seeds)] if seeds else [],
            "keys": sorted({planned.identity.text for planned in planned_episodes}),
            "left_out": sorted(left_out),
        }
    return splits
