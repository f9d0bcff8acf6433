"""What the network sees of each sample. Training and prediction share these arrays."""

from dataclasses import dataclass, fields, replace
from enum import StrEnum
from typing import Final

import numpy as np

from siren_ros.evaluation.prediction.samples import SampleBatch
from siren_ros.evaluation.prediction.siren_model.columns import (
    NEIGHBOURS,
    choose_neighbours,
    in_frame_of,
    lane_columns,
    neighbour_columns,
    stop_line_columns,
    target_columns,
    traffic_columns,
)
from siren_ros.evaluation.prediction.siren_model.paths import PATH_POINTS, PATHS, choose_paths
from siren_ros.numerics.arrays import Flags, Floats, Floats32, Rows

FEATURES_VERSION: Final = 1
"""Raised whenever a value changes its meaning: weights fit one version."""
_SIREN_COLUMNS: Final = ("beacon", "siren")


class Ablation(StrEnum):
    """Inputs that a network can do without."""

    NONE = "none"
    SIREN = "siren"
    """Beacon and siren of every vehicle are hidden; which vehicle is an emergency vehicle is not."""
    MAP = "map"
    """No lanes, stop lines or signals."""


@dataclass(frozen=True)
class Features:
    """Arrays of N samples in the frame of each sample: origin at its centre, x forward. All float32 or flags."""

    target: Floats32
    """Own past, shape ``(N, TARGET)``."""
    speed_mps: Floats32
    """Present speed, shape ``(N,)``."""
    neighbours: Floats32
    """Shape ``(N, NEIGHBOURS, NEIGHBOUR)``."""
    neighbour_there: Flags
    """Shape ``(N, NEIGHBOURS)``."""
    path_points_m: Floats32
    """Points of the paths, 0 where there is none; shape ``(N, PATHS, PATH_POINTS, 2)``."""
    path_spacing_m: Floats32
    """Arc length between the points of a path, shape ``(N,)``."""
    paths: Floats32
    """Shape ``(N, PATHS, PATH)``."""
    path_there: Flags
    """Shape ``(N, PATHS)``."""

    def __len__(self) -> int:
        return len(self.target)

    def select(self, rows: slice | Rows) -> "Features":
        """Some of the samples."""
        return Features(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})


@dataclass(frozen=True)
class FeatureNames:
    """Names of the columns, in their order."""

    target: tuple[str, ...]
    neighbours: tuple[str, ...]
    paths: tuple[str, ...]


def features_of(batch: SampleBatch) -> Features:
    """The arrays of all samples of a batch."""
    return features_and_names(batch)[0]


def features_and_names(batch: SampleBatch) -> tuple[Features, FeatureNames]:
    """The arrays of all samples of a batch, and the names of their columns."""
    others = choose_neighbours(batch)
    choice = choose_paths(batch.network, batch.xy_m, batch.yaw_rad, batch.speed_mps)
    points = in_frame_of(batch, choice.points() - batch.xy_m[:, None, None])
    points = np.where(choice.there[..., None, None], points, 0.0)
    target, neighbours = target_columns(batch), neighbour_columns(batch, others)
    road = {
        **lane_columns(batch.network, choice),
        **stop_line_columns(batch, choice),
        **traffic_columns(batch, others, choice, points),
    }
    road = {name: np.where(choice.there, values, 0.0) for name, values in road.items()}
    features = Features(
        target=_stacked(target),
        speed_mps=batch.speed_mps.astype(np.float32),
        neighbours=_stacked(neighbours),
        neighbour_there=others.there,
        path_points_m=points.astype(np.float32),
        path_spacing_m=choice.spacing_m.astype(np.float32),
        paths=_stacked(road),
        path_there=choice.there,
    )
    return features, FeatureNames(tuple(target), tuple(neighbours), tuple(road))


def _stacked(columns: dict[str, Floats]) -> Floats32:
    return np.stack(list(columns.values()), axis=-1, dtype=np.float32, casting="same_kind")


def without(features: Features, names: FeatureNames, ablation: Ablation) -> Features:
    """The same samples with an input hidden: its values are 0 and its flags false."""
    if ablation is Ablation.SIREN:
        shown = {
            kind: np.array([name not in _SIREN_COLUMNS for name in getattr(names, kind)], dtype=np.float32)
            for kind in ("target", "neighbours")
        }
        return replace(features, **{kind: np.asarray(getattr(features, kind) * mask) for kind, mask in shown.items()})
    if ablation is Ablation.MAP:
        return replace(
            features,
            path_points_m=np.zeros_like(features.path_points_m),
            paths=np.zeros_like(features.paths),
            path_there=np.zeros_like(features.path_there),
        )
    return features


SHAPES: Final = {"neighbours": NEIGHBOURS, "paths": PATHS, "path_points": PATH_POINTS}
"""Sizes that a network is built for."""
