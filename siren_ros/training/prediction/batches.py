"""All samples of a split in memory: compact, and in batches of single precision."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from siren_ros.evaluation.prediction.siren_model.siren_predictor import Ablation, FeatureNames, Features, without
from siren_ros.numerics.arrays import Floats32, Rows
from siren_ros.training.prediction.samples import read_features


@dataclass(frozen=True)
class EpisodeKey:
    """Which episode samples are of."""

    template: str
    level: str
    seed: int
    map_name: str


@dataclass(frozen=True)
class SampleStore:
    """Samples of several episodes."""

    features: Features
    """Of half precision, which halves the memory; speed and spacing are single."""
    truth_m: Floats32
    episode: npt.NDArray[np.int32]
    """Position in ``episodes`` of each sample."""
    episodes: tuple[EpisodeKey, ...]
    names: FeatureNames
    reference_ade_m: Mapping[str, Floats32]
    """Of the reference models, shape ``(N,)``; empty for episodes that are trained on."""

    def __len__(self) -> int:
        return len(self.truth_m)

    def batch(self, rows: Rows | slice) -> Features:
        """Some samples in single precision."""
        part = self.features.select(rows)
        arrays: dict[str, Any] = {field.name: _as(getattr(part, field.name), np.float32) for field in fields(Features)}
        return Features(**arrays)


def read_store(paths: Sequence[Path], ablation: Ablation = Ablation.NONE) -> SampleStore:
    """Reads episodes in their order; those without a sample are left out.

    Args:
        paths: Files of ``write_features``, at least one with a sample.
        ablation: Input that is hidden.
    """
    episodes = [read_features(path) for path in paths]
    filled = [episode for episode in episodes if len(episode)]
    names = filled[0].names
    columns: dict[str, Any] = {}
    for field in fields(Features):
        kind = np.float32 if field.name in {"speed_mps", "path_spacing_m"} else np.float16
        parts = [_as(getattr(without(each.features, names, ablation), field.name), kind) for each in filled]
        columns[field.name] = np.concatenate(parts)
    references = set.intersection(*(set(episode.reference_ade_m) for episode in filled))
    return SampleStore(
        features=Features(**columns),
        truth_m=np.concatenate([episode.truth_m for episode in filled]),
        episode=np.repeat(np.arange(len(filled), dtype=np.int32), [len(episode) for episode in filled]),
        episodes=tuple(EpisodeKey(each.template, each.level, each.seed, each.map_name) for each in filled),
        names=names,
        reference_ade_m={
            name: np.concatenate([episode.reference_ade_m[name] for episode in filled]) for name in sorted(references)
        },
    )


def _as(values: npt.NDArray[Any], kind: type[np.floating[Any]]) -> npt.NDArray[Any]:
    return values if values.dtype == np.bool_ else values.astype(kind)
