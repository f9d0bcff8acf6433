"""The constant-velocity reference predictor."""

from dataclasses import dataclass, field

from siren_ros.evaluation.prediction.predictors import Hypotheses, PredictorOptions
from siren_ros.evaluation.prediction.samples import HistoryWindow, SampleBatch, future_times_s


@dataclass(frozen=True)
class ConstantVelocity:
    """Every vehicle keeps its present velocity.

    The velocity is the recorded one (columns ``vx, vy`` of ``trajectory.csv``). The difference of the last two points
    of the history would be the velocity half a grid period earlier.
    """

    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """One hypothesis for each sample."""
        return Hypotheses.certain(batch.xy_m[:, None] + future_times_s()[:, None] * batch.velocity_mps[:, None])


def make(options: PredictorOptions) -> ConstantVelocity:
    """The constructor of the table of predictors."""
    del options
    return ConstantVelocity()
