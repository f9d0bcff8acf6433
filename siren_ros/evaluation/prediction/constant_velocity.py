"""The constant-velocity reference: everybody goes on as at the present."""

from dataclasses import dataclass, field

from siren_ros.evaluation.prediction.prediction_samples import SampleBatch
from siren_ros.evaluation.prediction.prediction_window import HistoryWindow, future_times_s
from siren_ros.numerics.arrays import Floats


@dataclass(frozen=True)
class ConstantVelocity:
    """Straight on with the velocity that the record gives for the present.

    The difference of the last two points of the history would be the velocity of half a grid period ago: the record
    has the present one (as ``trajectory.csv`` has, columns ``vx, vy``).
    """

    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Floats:
        """One hypothesis for each sample, shape ``(N, 1, FUTURE_POINTS, 2)``."""
        path = batch.xy_m[:, None] + future_times_s()[:, None] * batch.velocity_mps[:, None]
        return path[:, None]
