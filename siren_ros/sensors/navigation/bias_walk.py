"""Biases that wander: a random walk per axis, a function of seed, sensor and step alone."""

import numpy as np

from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.units import STEP_S
from siren_ros.sensors.suite.noise import sensor_generator


class BiasWalk:
    """Sum of one normal increment per step from step 1 on, each drawn from its own stream; zero at step 0."""

    def __init__(self, seed: int, sensor: str, per_sqrt_s: Floats) -> None:
        """Start the walk.

        Args:
            seed: Of the noise.
            sensor: Name of the sensor.
            per_sqrt_s: Standard deviation of each axis after one second, shape ``(K,)``; it grows with √t.
        """
        self._seed = seed
        self._stream = f"{sensor} bias"
        self._stddev = np.asarray(per_sqrt_s, dtype=np.float64) * np.sqrt(STEP_S)
        self._step = 0
        self._bias = np.zeros(len(self._stddev))

    def at(self, step: int) -> Floats:
        """The bias at a step, shape ``(K,)``; steps can be asked for in any order."""
        if step < self._step:
            self._step, self._bias = 0, np.zeros(len(self._stddev))
        if np.any(self._stddev):
            for passed in range(self._step + 1, step + 1):
                draw = sensor_generator(self._seed, self._stream, passed).standard_normal(len(self._stddev))
                self._bias = self._bias + draw * self._stddev
        self._step = step
        return self._bias.copy()
