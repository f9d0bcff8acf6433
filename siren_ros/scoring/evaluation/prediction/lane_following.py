"""Predictors that follow the lane with constant speed, constant acceleration, or decaying acceleration.

A vehicle keeps its offset from the centre line and goes straight on at junctions; one in no lane goes straight ahead.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from siren_ros.data.record.vehicle_location import locate
from siren_ros.scoring.evaluation.prediction.baselines import drive_along, paths_from
from siren_ros.scoring.evaluation.prediction.kinematic import acceleration_of, fine_times_s, integrated, speeds_of
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, SampleBatch
from siren_ros.simulation.roads.road_network import NO_LANE

DECAY_S: Final = 1.0
"""Time constant: an acceleration falls to 1/e in this time."""
_REACH_M: Final = 250.0


@dataclass(frozen=True)
class LaneFollowing:
    """Follows the lane with the acceleration a₀ of the last second, a(t) = a₀ exp(−t / decay), until a stop."""

    decay_s: float
    """Time constant of the decay; 0 gives constant speed, infinity constant acceleration."""
    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """Give one hypothesis per sample."""
        times = fine_times_s()
        gain_s = times if np.isinf(self.decay_s) else 0.0 * times
        if 0.0 < self.decay_s < np.inf:
            gain_s = self.decay_s * (1.0 - np.exp(-times / self.decay_s))
        travelled = integrated(speeds_of(batch.speed_mps, acceleration_of(batch)[:, None] * gain_s))
        actors = batch.actors
        places = locate(batch.network, actors.xy_m[:, -1], actors.yaw_rad[:, -1], actors.sumo_lane)
        lane = places.lane[batch.target]
        paths = paths_from(batch.network, np.unique(lane[lane != NO_LANE]), _REACH_M)
        return Hypotheses.certain(drive_along(batch, places, paths, travelled))


def make_cv_lane() -> LaneFollowing:
    """Constant speed along the lane."""
    return LaneFollowing(0.0)


def make_ca_lane() -> LaneFollowing:
    """Constant acceleration along the lane."""
    return LaneFollowing(np.inf)


def make_decay_lane() -> LaneFollowing:
    """Decaying acceleration along the lane, with a time constant of one second."""
    return LaneFollowing(DECAY_S)
