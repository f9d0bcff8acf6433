"""Predictors that continue the present motion: constant acceleration, constant turn rate, along the lane.

Acceleration and turn rate are slopes over the last second of the history: a tracker measures neither.
Along the lane a vehicle keeps its offset from the centre line and goes straight on at junctions; one in no lane goes
straight ahead.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.data.record.vehicle_location import locate
from siren_ros.scoring.evaluation.prediction.baselines import drive_along, paths_from
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, SampleBatch, future_times_s
from siren_ros.simulation.roads.road_network import NO_LANE

_SLOPE_POINTS: Final = 6
"""Number of history points (1 s) for a slope."""
_SUBSTEPS: Final = 20
"""Integration steps per 0.2 s of the prediction."""


def slope(values: Floats, times_s: Floats) -> Floats:
    """Slope per second over the last second of a history, by least squares; values ``(N, H)``, result ``(N,)``."""
    times = times_s[-_SLOPE_POINTS:] - times_s[-_SLOPE_POINTS:].mean()
    return np.asarray(values[:, -_SLOPE_POINTS:] @ times / (times @ times))


def acceleration_of(batch: SampleBatch) -> Floats:
    """Acceleration of the samples over the last second, in m/s², shape ``(N,)``."""
    speed = np.hypot(*np.moveaxis(batch.actors.velocity_mps[batch.target], -1, 0))
    return slope(speed, batch.window.times_s)


def turn_rate_of(batch: SampleBatch) -> Floats:
    """Turn rate of the samples over the last second, in rad/s, shape ``(N,)``."""
    return slope(np.unwrap(batch.actors.yaw_rad[batch.target], axis=1), batch.window.times_s)


def fine_times_s() -> Floats:
    """Midpoints of the integration steps, shape ``(T · substeps,)``."""
    step = future_times_s()[0] / _SUBSTEPS
    return (np.arange(len(future_times_s()) * _SUBSTEPS) + 0.5) * step


def integrated(rates: Floats) -> Floats:
    """Integrate rates at ``fine_times_s`` up to each predicted time; ``(N, T · substeps, …)`` gives ``(N, T, …)``."""
    step = future_times_s()[0] / _SUBSTEPS
    return np.asarray(np.cumsum(rates, axis=1)[:, _SUBSTEPS - 1 :: _SUBSTEPS] * step)


def speeds_of(speed_mps: Floats, gained_mps: Floats) -> Floats:
    """Speeds at ``fine_times_s``, at least 0: present speed plus its gain, which must be monotonic.

    Shapes ``(N,)`` and ``(N, T · substeps)``.
    """
    return np.asarray(np.maximum(speed_mps[:, None] + gained_mps, 0.0))


@dataclass(frozen=True)
class TurnRate:
    """Constant acceleration along the heading, and constant turn rate (CTRA) or none (CA).

    Source: R. Schubert, E. Richter, G. Wanielik, Int. Conf. Information Fusion 2008. A vehicle that brakes stops.
    """

    turns: bool
    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """Give one hypothesis per sample."""
        times = fine_times_s()
        speed = speeds_of(batch.speed_mps, acceleration_of(batch)[:, None] * times)
        course = np.where(batch.speed_mps > 0.0, np.arctan2(*batch.velocity_mps.T[::-1]), batch.yaw_rad)
        rate = turn_rate_of(batch) if self.turns else np.zeros(len(batch))
        heading = course[:, None] + rate[:, None] * times
        velocity = speed[..., None] * np.stack((np.cos(heading), np.sin(heading)), axis=-1)
        return Hypotheses.certain(batch.xy_m[:, None] + integrated(velocity))


def make_ca() -> TurnRate:
    """Constant acceleration along the present course."""
    return TurnRate(turns=False)


def make_ctra() -> TurnRate:
    """Constant turn rate and acceleration."""
    return TurnRate(turns=True)


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
