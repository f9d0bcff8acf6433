"""How a fitted network does on episodes that it was not trained on: next to the reference models."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from siren_ros.evaluation.prediction.siren_model.network_file import TrainedNetwork
from siren_ros.numerics.arrays import Floats, Floats32
from siren_ros.training.sample_store import EpisodeKey, SampleStore

MEAN: Final = "mean"
_OWN: Final = ("siren", "siren_min6", "siren_fde")


@dataclass(frozen=True)
class EpisodeErrors:
    """Mean errors over the samples of one episode, in metres."""

    episode: EpisodeKey
    samples: int
    errors_m: Mapping[str, float]
    """ADE of ``cv``, ``idm`` and ``siren`` (most probable hypothesis); ``siren_min6`` and ``siren_fde``."""


def assess(network: TrainedNetwork, store: SampleStore) -> tuple[EpisodeErrors, ...]:
    """Errors of each episode of a split."""
    columns: dict[str, Floats | Floats32] = {**_own_errors(network, store), **store.reference_ade_m}
    found = []
    for number, key in enumerate(store.episodes):
        rows = np.flatnonzero(store.episode == number)
        means = {name: float(values[rows].mean()) for name, values in columns.items()}
        found.append(EpisodeErrors(key, len(rows), means))
    return tuple(found)


def _own_errors(network: TrainedNetwork, store: SampleStore) -> dict[str, Floats]:
    xy_m, probability = network.run(store.batch(slice(None)))
    miss = xy_m - store.truth_m[:, None]
    distance = np.hypot(miss[..., 0], miss[..., 1])
    ade = distance.mean(axis=-1)
    likeliest = probability.argmax(axis=1)
    rows = np.arange(len(store))
    return dict(zip(_OWN, (ade[rows, likeliest], ade.min(axis=1), distance[rows, likeliest, -1]), strict=True))


def by_template(errors: Sequence[EpisodeErrors]) -> dict[str, dict[str, float]]:
    """Means over the samples of each template, and under ``MEAN`` over the templates, as the evaluation does."""
    names = sorted({each.episode.template for each in errors})
    table = {}
    for name in names:
        own = [each for each in errors if each.episode.template == name]
        means = _mean([each.errors_m for each in own], [each.samples for each in own])
        table[name] = {"episodes": float(len(own)), **means}
    if not table:
        return {}
    mean = _mean(list(table.values()), [1] * len(table))
    return {**table, MEAN: {**mean, "episodes": float(len(errors))}}


def by_map(errors: Sequence[EpisodeErrors]) -> dict[str, dict[str, float]]:
    """Of each map, the mean over its templates."""
    names = sorted({each.episode.map_name for each in errors})
    return {name: by_template([each for each in errors if each.episode.map_name == name])[MEAN] for name in names}


def _mean(rows: Sequence[Mapping[str, float]], weights: Sequence[int]) -> dict[str, float]:
    return {name: float(np.average([row[name] for row in rows], weights=weights)) for name in rows[0]}


def table_lines(table: Mapping[str, Mapping[str, float]]) -> list[str]:
    """The table as text: ADE of the models, minADE of six, and how both compare with constant velocity."""
    lines = [f"{'':<14}{'episodes':>9}{'cv':>8}{'idm':>8}{'siren':>8}{'':>7}{'minADE6':>9}{'':>7}"]
    for name, row in table.items():
        gains = [f"{row[own] / row['cv'] - 1.0:+.0%}" for own in _OWN[:2]]
        lines.append(
            f"{name:<14}{row['episodes']:>9.0f}{row['cv']:8.2f}{row['idm']:8.2f}{row['siren']:8.2f}{gains[0]:>7}"
            f"{row['siren_min6']:9.2f}{gains[1]:>7}"
        )
    return lines


def errors_json(errors: Sequence[EpisodeErrors]) -> dict[str, Any]:
    """Everything as JSON types, rounded to millimetres."""
    return {
        "samples": sum(each.samples for each in errors),
        "by_template": _rounded(by_template(errors)),
        "by_map": _rounded(by_map(errors)),
    }


def _rounded(table: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    return {name: {key: round(value, 3) for key, value in row.items()} for name, row in table.items()}
