"""SIREN's own predictor: paths along the road network, chosen and driven by a network trained on its episodes."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.evaluation.prediction.protocol.predictor import PredictorOptions
from siren_ros.evaluation.prediction.protocol.samples import SampleBatch
from siren_ros.evaluation.prediction.protocol.window import HistoryWindow
from siren_ros.evaluation.prediction.siren_model.features import features_and_names, without
from siren_ros.evaluation.prediction.siren_model.network_file import TrainedNetwork, load_network
from siren_ros.params.resources import params_dir

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
        own, probability = self.network.run(without(features, names, self.network.ablation))
        cos, sin = (values[:, None, None] for values in (np.cos(batch.yaw_rad), np.sin(batch.yaw_rad)))
        x, y = own[..., 0], own[..., 1]
        moved = np.stack((cos * x - sin * y, sin * x + cos * y), axis=-1)
        return Hypotheses.ranked(batch.xy_m[:, None, None] + moved, probability)


def make(options: PredictorOptions) -> SirenPredictor:
    """The constructor of the table of predictors: the weights that ship, or those of ``siren train prediction``."""
    return SirenPredictor(load_network(options.checkpoint or params_dir() / SHIPPED))
