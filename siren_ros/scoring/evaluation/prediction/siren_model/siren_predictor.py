"""SIREN's own predictor: a network chooses among paths along the road network and predicts the motion along them.

The network is an ONNX file with its card next to it. Training and prediction share the arrays that it sees.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Floats32, Rows
from siren_ros.base.params.folders import params_dir
from siren_ros.base.params.plain_files import NetworkFile, open_network
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses
from siren_ros.scoring.evaluation.prediction.samples import FUTURE_POINTS, HistoryWindow, SampleBatch
from siren_ros.scoring.evaluation.prediction.siren_model.columns import (
    NEIGHBOURS,
    choose_neighbours,
    in_frame_of,
    lane_columns,
    neighbour_columns,
    stop_line_columns,
    target_columns,
    traffic_columns,
)
from siren_ros.scoring.evaluation.prediction.siren_model.paths import PATH_POINTS, PATHS, choose_paths
from siren_ros.simulation.roads.road_network import MIRROR
from siren_ros.simulation.scenario.episode import SeenEpisodes

FEATURES_VERSION: Final = 1
"""Version of the features. It is raised when the meaning of a value changes; weights fit one version."""
SHAPES: Final = {"neighbours": NEIGHBOURS, "paths": PATHS, "path_points": PATH_POINTS}
"""Array sizes for which a network is built."""
_SIREN_COLUMNS: Final = ("beacon", "siren")
LAMP_COLUMNS: Final = ("brake", "indicates_left", "indicates_right")


class Ablation(StrEnum):
    """Inputs that a network can be trained without."""

    NONE = "none"
    SIREN = "siren"
    """Hides beacon and siren of all vehicles, but not which vehicle is an emergency vehicle."""
    MAP = "map"
    """Hides lanes, stop lines and signals."""


@dataclass(frozen=True)
class Features:
    """Input arrays of N samples, in the frame of each sample: origin at its centre, x forward. float32 or flags."""

    target: Floats32
    """Columns of the sample itself, shape ``(N, TARGET)``."""
    speed_mps: Floats32
    """Present speed, shape ``(N,)``."""
    neighbours: Floats32
    """Columns of the neighbours, shape ``(N, NEIGHBOURS, NEIGHBOUR)``."""
    neighbour_there: Flags
    """Whether a neighbour exists, shape ``(N, NEIGHBOURS)``."""
    path_points_m: Floats32
    """Points of the paths, 0 for empty places; shape ``(N, PATHS, PATH_POINTS, 2)``."""
    path_spacing_m: Floats32
    """Arc length between the points of a path, shape ``(N,)``."""
    paths: Floats32
    """Columns of the paths, shape ``(N, PATHS, PATH)``."""
    path_there: Flags
    """Whether a path exists, shape ``(N, PATHS)``."""

    def __len__(self) -> int:
        return len(self.target)

    def select(self, rows: slice | Rows) -> "Features":
        """Select some of the samples."""
        return Features(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})


@dataclass(frozen=True)
class FeatureNames:
    """Names of the columns, in their order."""

    target: tuple[str, ...]
    neighbours: tuple[str, ...]
    paths: tuple[str, ...]


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


def without_columns(
    features: Features, names: FeatureNames, hidden: Sequence[str], rows: Flags | slice = slice(None)
) -> Features:
    """Copy of the samples with some columns set to 0, at all rows or some of them."""
    for kind in ("target", "neighbours"):
        values = getattr(features, kind).copy()
        for column in map(getattr(names, kind).index, hidden):
            values[rows, ..., column] = 0.0
        features = replace(features, **{kind: values})
    return features


def without(features: Features, names: FeatureNames, ablation: Ablation) -> Features:
    """Copy of the samples with an input hidden: values 0, flags false."""
    if ablation is Ablation.SIREN:
        return without_columns(features, names, _SIREN_COLUMNS)
    if ablation is Ablation.MAP:
        return replace(
            features,
            path_points_m=np.zeros_like(features.path_points_m),
            paths=np.zeros_like(features.paths),
            path_there=np.zeros_like(features.path_there),
        )
    return features


OUTPUTS: Final = ("xy_m", "probability")
_SAMPLES_AT_ONCE: Final = 2048
"""Number of samples per run of the network; it bounds the memory."""


class TrainedNetwork(NetworkFile):
    """A network for prediction."""

    @property
    def ablation(self) -> Ablation:
        """The input without which the network was trained."""
        return Ablation(self.card["ablation"])

    @property
    def seen(self) -> SeenEpisodes | None:
        """Episodes of the network's training."""
        return SeenEpisodes.of_card(self.card)

    def run(self, features: Features) -> tuple[Floats, Floats]:
        """Paths in the samples' frames, ``(N, k, FUTURE_POINTS, 2)``, with probabilities, ``(N, k)``.

        The network runs once. Its hypotheses are not sorted.
        """
        used = [given.name for given in self.session.get_inputs()]  # a network without a map has no inputs for it

        def inputs(start: int) -> dict[str, Any]:
            part = features.select(slice(start, start + _SAMPLES_AT_ONCE))
            return {name: getattr(part, name) for name in used}

        parts = [self.session.run(OUTPUTS, inputs(start)) for start in range(0, len(features), _SAMPLES_AT_ONCE)]
        if not parts:
            return np.empty((0, 1, FUTURE_POINTS, 2)), np.empty((0, 1))
        xy_m, probability = (np.concatenate(arrays).astype(np.float64) for arrays in zip(*parts, strict=True))
        return xy_m, probability


def load_network(path: Path) -> TrainedNetwork:
    """Load a network for prediction.

    Raises:
        InputError: No such file, no card, weights that are not the card's, or of another version of the features.
    """
    network = open_network(path)
    card, version = network.card, network.card.get("features_version")
    if version != FEATURES_VERSION or card.get("ablation") not in set(Ablation):
        raise InputError("checkpoint", str(path), f"features of version {FEATURES_VERSION}, not {version}")
    return TrainedNetwork(network.session, card)


SHIPPED: Final = Path("predictors", "siren.onnx")
"""Place of the shipped weights below the parameter files."""


@dataclass(frozen=True)
class SirenPredictor:
    """Predicts six hypotheses with probabilities from observable data: history, lights, lanes, stop lines, signals.

    It knows neither routes, nor modes, nor the lane that SUMO has a vehicle in.
    """

    network: TrainedNetwork
    window: HistoryWindow = field(default_factory=HistoryWindow)

    @property
    def seen(self) -> SeenEpisodes | None:
        """Episodes of the network's training."""
        return self.network.seen

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """Give the hypotheses of every sample."""
        seen = batch.right_hand
        features, names = features_and_names(seen)
        paths, probability = self.network.run(without(features, names, self.network.ablation))
        cos, sin = (values[:, None, None] for values in (np.cos(seen.yaw_rad), np.sin(seen.yaw_rad)))
        x, y = paths[..., 0], paths[..., 1]
        xy_m = seen.xy_m[:, None, None] + np.stack((cos * x - sin * y, sin * x + cos * y), axis=-1)
        return Hypotheses.ranked(xy_m * MIRROR if batch.network.left_hand else xy_m, probability)


def make(checkpoint: Path | None = None) -> SirenPredictor:
    """Make the predictor with the shipped weights, or with those of ``siren train prediction``."""
    return SirenPredictor(load_network(checkpoint or params_dir() / SHIPPED))
