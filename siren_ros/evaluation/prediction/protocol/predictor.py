"""The protocol of trajectory predictors, and what a user may give to one."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.evaluation.prediction.protocol.samples import SampleBatch
from siren_ros.evaluation.prediction.protocol.window import HistoryWindow


class Predictor(Protocol):
    """Predicts the positions of vehicles from their past, their neighbours' past and the map."""

    @property
    def window(self) -> HistoryWindow:
        """The past that the predictor needs; a sample has this past and the common future."""

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """The hypotheses of every sample of the batch, in its order."""


@dataclass(frozen=True)
class PredictorOptions:
    """What a user gives to one predictor."""

    checkpoint: Path | None = None
    """File of trained weights."""
