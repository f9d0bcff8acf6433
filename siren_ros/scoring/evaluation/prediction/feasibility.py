"""Checks whether a vehicle could drive a predicted path: acceleration within grip, bends within the turning circle."""

from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses
from siren_ros.scoring.evaluation.prediction.samples import FRAME_PERIOD_S, FUTURE_STRIDE_FRAMES, ScoredSamples

ACCELERATION_MAX_MPS2: Final = 0.9 * 9.81
"""Largest total acceleration: tyres on dry asphalt carry 0.8 to 0.9 g (J. Y. Wong, Theory of Ground Vehicles, ch.
1)."""
RADIUS_MIN_M: Final = 6.4
"""Smallest radius of the centre's path: design passenger car (AASHTO, Green Book 2018, table 2-2)."""
_TURNING_MIN_MPS: Final = 1.0
"""Bends are checked only above this speed; below it the direction of a segment is not certain enough."""
_POINT_S: Final = FRAME_PERIOD_S * FUTURE_STRIDE_FRAMES


def infeasible(hypotheses: Hypotheses, samples: ScoredSamples) -> Floats:
    """1 where the most probable path exceeds a limit of acceleration or curvature, else 0; shape ``(N,)``.

    The path begins with the vehicle's recorded velocity.
    """
    batch = samples.batch
    places = np.concatenate((batch.xy_m[:, None], hypotheses.xy_m[:, 0]), axis=1)
    velocity = np.diff(places, axis=1) / _POINT_S
    # The velocity of a segment belongs to its middle, so the first change takes half a period.
    gained = np.diff(np.concatenate((batch.velocity_mps[:, None], velocity), axis=1), axis=1)
    gained[:, 0] *= 2.0
    acceleration = np.hypot(gained[..., 0], gained[..., 1]) / _POINT_S
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    turned = np.abs(wrap_angle(np.diff(np.arctan2(velocity[..., 1], velocity[..., 0]), axis=1)))
    way = 0.5 * (speed[:, 1:] + speed[:, :-1]) * _POINT_S
    moves = np.minimum(speed[:, 1:], speed[:, :-1]) > _TURNING_MIN_MPS
    bent = moves & (turned * RADIUS_MIN_M > way)
    return ((acceleration > ACCELERATION_MAX_MPS2).any(axis=1) | bent.any(axis=1)).astype(np.float64)
