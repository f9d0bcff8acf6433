"""A Kalman filter that weights two motion models by the history (IMM): constant velocity and constant acceleration.

Source: H. Blom, Y. Bar-Shalom, IEEE Trans. Automatic Control 33 (1988) 780.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses
from siren_ros.scoring.evaluation.prediction.reported_tracks import TrackNoise
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, SampleBatch, future_times_s

_STATES: Final = 6
"""State: position, velocity, acceleration, each with x and y."""
_MEASURED: Final = 4
"""Measurement: position and velocity, each with x and y."""


@dataclass(frozen=True)
class Imm:
    """Settings of the filter; the measurement errors are those of a tracker (``TrackNoise``)."""

    position_m: float = TrackNoise.position_m
    velocity_mps: float = TrackNoise.velocity_mps
    accelerations_mps2: float = 1.0
    """Unmodelled acceleration in the constant-velocity model."""
    jerk_mps3: float = 2.0
    """Unmodelled jerk in the constant-acceleration model."""
    stays: float = 0.95
    """Probability that a vehicle keeps its motion model from one point of the history to the next."""

    def transition(self, period_s: float) -> Floats:
        """Transition matrices of both models, shape ``(2, 6, 6)``; the first model sets the acceleration to zero."""
        unit = np.eye(2)
        step, half = period_s * unit, 0.5 * period_s**2 * unit
        nothing = np.zeros((2, 2))
        moving = np.block([[unit, step, nothing], [nothing, unit, nothing], [nothing, nothing, nothing]])
        gaining = np.block([[unit, step, half], [nothing, unit, step], [nothing, nothing, unit]])
        return np.stack((moving, gaining))

    def process_noise(self, period_s: float) -> Floats:
        """Process noise of both models over a period, shape ``(2, 6, 6)``: white acceleration and white jerk."""
        unit = np.eye(2)
        by_acceleration = np.concatenate((0.5 * period_s**2 * unit, period_s * unit, 0.0 * unit))
        by_jerk = np.concatenate((period_s**3 / 6.0 * unit, 0.5 * period_s**2 * unit, period_s * unit))
        return np.stack(
            (
                self.accelerations_mps2**2 * by_acceleration @ by_acceleration.T,
                self.jerk_mps3**2 * by_jerk @ by_jerk.T,
            )
        )


def filtered(imm: Imm, measured: Floats, period_s: float) -> tuple[Floats, Floats]:
    """Filter a history: final states of both models, ``(N, 2, 6)``, and the models' probabilities, ``(N, 2)``.

    ``measured`` are positions and velocities, shape ``(N, H, 4)``.
    """
    count = len(measured)
    noise = np.diag([imm.position_m**2] * 2 + [imm.velocity_mps**2] * 2)
    move, process = imm.transition(period_s), imm.process_noise(period_s)
    change = np.array([[imm.stays, 1.0 - imm.stays], [1.0 - imm.stays, imm.stays]])
    state = np.zeros((count, 2, _STATES))
    state[:, :, :_MEASURED] = measured[:, None, 0]
    spread = np.broadcast_to(np.diag([*np.diag(noise), 4.0, 4.0]), (count, 2, _STATES, _STATES)).copy()
    share = np.full((count, 2), 0.5)
    for point in range(1, measured.shape[1]):
        expected = share @ change
        mixing = change[None] * share[:, :, None] / expected[:, None]  # indices: from model i to model j
        mixed = np.einsum("nij,nis->njs", mixing, state)
        apart = state[:, :, None] - mixed[:, None]
        mixed_spread = np.einsum(
            "nij,nijst->njst", mixing, spread[:, :, None] + apart[..., :, None] * apart[..., None, :]
        )
        state = np.einsum("jst,njt->njs", move, mixed)
        spread = move @ mixed_spread @ np.swapaxes(move, -1, -2) + process
        miss = measured[:, None, point] - state[..., :_MEASURED]
        innovation = spread[..., :_MEASURED, :_MEASURED] + noise
        inverse = np.linalg.inv(innovation)
        gain = spread[..., :, :_MEASURED] @ inverse
        state = state + np.einsum("njsm,njm->njs", gain, miss)
        spread = spread - gain @ spread[..., :_MEASURED, :]
        far = np.einsum("njm,njmk,njk->nj", miss, inverse, miss)
        log_likelihood = -0.5 * (far + np.linalg.slogdet(innovation)[1])
        likelihood = np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True)) * expected
        share = likelihood / likelihood.sum(axis=1, keepdims=True)
    return state, share


@dataclass(frozen=True)
class ImmPredictor:
    """Predicts one hypothesis per motion model, with the model's probability. A braking vehicle stops."""

    imm: Imm = field(default_factory=Imm)
    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """Give the hypotheses of every sample."""
        actors, rows = batch.actors, batch.target
        origin = batch.xy_m[:, None]
        measured = np.concatenate((actors.xy_m[rows] - origin, actors.velocity_mps[rows]), axis=-1)
        state, share = filtered(self.imm, measured, float(np.diff(batch.window.times_s)[0]))
        place, velocity, acceleration = np.split(state, 3, axis=-1)
        acceleration = acceleration * np.array([0.0, 1.0])[:, None]
        along = (velocity * acceleration).sum(axis=-1)
        braking = along < 0.0
        square = np.where(braking, (acceleration**2).sum(axis=-1), 1.0)
        stop_s = np.where(braking, -along / square, np.inf)
        times = np.minimum(future_times_s(), stop_s[..., None])[..., None]
        moved = velocity[:, :, None] * times + 0.5 * acceleration[:, :, None] * times**2
        return Hypotheses.ranked(origin[:, None] + place[:, :, None] + moved, share)
