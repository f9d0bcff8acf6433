"""Random numbers of sensors: a stream of its own for every sensor and step."""

import zlib

import numpy as np


def sensor_generator(seed: int, sensor: str, step: int) -> np.random.Generator:
    """Generator that depends on (seed, sensor, step) alone, so that results do not depend on order or history."""
    name = zlib.crc32(sensor.encode())
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence((seed, name, step))))
