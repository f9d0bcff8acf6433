"""Joint errors: how far the prediction of a whole frame is from the true motion of all its vehicles.

Argoverse 2 calls a set of one path for each vehicle a *world* (``av2``: ``compute_world_fde``, ``compute_world_ade``):
its error is the mean over the vehicles. The models here predict each vehicle by itself, so world k has every vehicle's
k-th most probable path; a vehicle with fewer paths keeps its last one.
"""

from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses
from siren_ros.scoring.evaluation.prediction.samples import ScoredSamples

WORLDS: Final = 6
"""Number of worlds in Argoverse 2's multi-world metrics."""


def world_min_ade_6(hypotheses: Hypotheses, samples: ScoredSamples) -> Floats:
    """Error of the best of six worlds: mean distance over a frame's vehicles and over time, in metres."""
    return _of_frames(_distances(hypotheses, samples).mean(axis=-1), samples)


def world_min_fde_6(hypotheses: Hypotheses, samples: ScoredSamples) -> Floats:
    """Error of the best of six worlds: mean distance over a frame's vehicles at the horizon, in metres."""
    return _of_frames(_distances(hypotheses, samples)[..., -1], samples)


def _distances(hypotheses: Hypotheses, samples: ScoredSamples) -> Floats:
    miss = hypotheses.xy_m[:, :WORLDS] - samples.future_xy_m[:, None]
    return np.asarray(np.hypot(miss[..., 0], miss[..., 1]))


def _of_frames(errors: Floats, samples: ScoredSamples) -> Floats:
    """Put the error of the best world at the first sample of each frame and NaN at the others: a frame counts once.

    Errors have the shape ``(N, k)``, the answer ``(N,)``.
    """
    frame = samples.batch.actors.frame[samples.batch.target]
    values = np.full(len(errors), np.nan)
    if len(errors):
        first, count = np.unique(frame, return_index=True, return_counts=True)[1:]
        values[first] = (np.add.reduceat(errors, first, axis=0) / count[:, None]).min(axis=1)
    return values
