"""SIREN's own predictor: paths along the road network, chosen and driven by a network trained on its episodes.

The network is an ONNX file with its card next to it.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.errors import InputError
from siren_ros.evaluation.network_file import NetworkFile, open_network
from siren_ros.evaluation.prediction.predictors import Hypotheses
from siren_ros.evaluation.prediction.samples import FUTURE_POINTS, HistoryWindow, SampleBatch
from siren_ros.evaluation.prediction.siren_model.features import (
    FEATURES_VERSION,
    Ablation,
    Features,
    features_and_names,
    without,
)
from siren_ros.numerics.arrays import Floats
from siren_ros.params.resources import params_dir

OUTPUTS: Final = ("xy_m", "probability")
_SAMPLES_AT_ONCE: Final = 2048
"""Bounds the memory of a run."""


class TrainedNetwork(NetworkFile):
    """A network of the prediction task."""

    @property
    def ablation(self) -> Ablation:
        """Input that the network was trained without."""
        return Ablation(self.card["ablation"])

    def run(self, features: Features) -> tuple[Floats, Floats]:
        """Paths in the samples' frames, ``(N, k, FUTURE_POINTS, 2)``, and probabilities, ``(N, k)``; not sorted."""
        parts = [
            self.session.run(OUTPUTS, vars(features.select(slice(start, start + _SAMPLES_AT_ONCE))))
            for start in range(0, len(features), _SAMPLES_AT_ONCE)
        ]
        if not parts:
            return np.empty((0, 1, FUTURE_POINTS, 2)), np.empty((0, 1))
        xy_m, probability = (np.concatenate(arrays).astype(np.float64) for arrays in zip(*parts, strict=True))
        return xy_m, probability


def load_network(path: Path) -> TrainedNetwork:
    """Loads a network of the prediction task.

    Raises:
        InputError: No such file, no card, weights that are not the card's, or of another version of the features.
    """
    network = open_network(path)
    card = network.card
    if card.get("features_version") != FEATURES_VERSION or card.get("ablation") not in set(Ablation):
        version = card.get("features_version")
        raise InputError("checkpoint", str(path), f"features of version {FEATURES_VERSION}, not {version}")
    return TrainedNetwork(network.session, card)


SHIPPED: Final = Path("predictors", "siren.onnx")
"""Place of the weights below the parameter files."""


@dataclass(frozen=True)
class SirenPredictor:
    """Six hypotheses with probabilities, from what an observer sees: pasts, lights, lanes, stop lines, signals.

    It knows neither routes, nor modes, nor the lane that SUMO has a vehicle in.
    """

    network: TrainedNetwork
    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """The hypotheses of every sample."""
        features, names = features_and_names(batch)
        paths, probability = self.network.run(without(features, names, self.network.ablation))
        cos, sin = (values[:, None, None] for values in (np.cos(batch.yaw_rad), np.sin(batch.yaw_rad)))
        x, y = paths[..., 0], paths[..., 1]
        moved = np.stack((cos * x - sin * y, sin * x + cos * y), axis=-1)
        return Hypotheses.ranked(batch.xy_m[:, None, None] + moved, probability)


def make(checkpoint: Path | None = None) -> SirenPredictor:
    """The constructor of the table of predictors: the weights that ship, or those of ``siren train prediction``."""
    return SirenPredictor(load_network(checkpoint or params_dir() / SHIPPED))
