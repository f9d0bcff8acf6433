"""The constant-velocity reference predictor."""

from dataclasses import dataclass, field

from siren_ros.evaluation.prediction.prediction_samples import SampleBatch
from siren_ros.evaluation.prediction.prediction_window import HistoryWindow, future_times_s
from siren_ros.numerics.arrays import Floats


@dataclass(frozen=True)
class ConstantVelocity:
    """Every vehicle keeps its present velocity.

    The velocity is the recorded one (columns ``vx, vy`` of ``trajectory.csv``). The difference of the last two points
    of the history would be the velocity half a grid period earlier.
    """

    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Floats:
        """One hypothesis for each sample, shape ``(N, 1, FUTURE_POINTS, 2)``."""
        path = batch.xy_m[:, None] + future_times_s()[:, None] * batch.velocity_mps[:, None]
        return path[:, None]
