"""The Intelligent Driver Model: M. Treiber, A. Hennecke, D. Helbing, Phys. Rev. E 62 (2000) 1805, eqs. 2 to 4."""

from dataclasses import dataclass

import numpy as np

from siren_ros.numerics.arrays import Floats


@dataclass(frozen=True)
class IdmConfig:
    """Parameters of the model and of its application to roads."""

    time_headway_s: float = 1.5
    standstill_gap_m: float = 2.0
    acceleration_mps2: float = 1.5
    comfortable_braking_mps2: float = 2.0
    exponent: float = 4.0
    """Exponent of the free-road term, as in the original."""
    integration_s: float = 0.1
    range_m: float = 250.0
    """Largest distance to a leader."""
    off_lane_limit_mps: float = 50.0 / 3.6
    """Speed limit of vehicles in no lane: that of an urban road."""
    least_gap_m: float = 0.1
    """Least gap that the model gets; the measured gap is negative where the bumpers overlap."""


def idm_acceleration(
    speed_mps: Floats, desired_mps: Floats, gap_m: Floats, closing_mps: Floats, config: IdmConfig
) -> Floats:
    """Acceleration of the model; all arrays of shape ``(N,)``, the gap inf on a free road.

    Args:
        speed_mps: Own speed.
        desired_mps: Speed on a free road.
        gap_m: From the own front bumper to the leader's rear bumper.
        closing_mps: Own speed minus the leader's.
        config: Parameters.
    """
    braking_term = 2.0 * np.sqrt(config.acceleration_mps2 * config.comfortable_braking_mps2)
    dynamic = speed_mps * config.time_headway_s + speed_mps * closing_mps / braking_term
    wanted_gap = config.standstill_gap_m + np.maximum(dynamic, 0.0)
    free = (speed_mps / desired_mps) ** config.exponent
    return config.acceleration_mps2 * (1.0 - free - (wanted_gap / np.maximum(gap_m, config.least_gap_m)) ** 2)


def idm_travel(
    speed_mps: Floats, desired_mps: Floats, gap_m: Floats, leader_mps: Floats, times_s: Floats, config: IdmConfig
) -> Floats:
    """Distances travelled behind leaders of constant speed, shape ``(N, T)``.

    Ballistic update: a vehicle whose speed would become negative stops within the step
    (M. Treiber, V. Kanagaraj, Physica A 419 (2015) 183, eqs. 10 and 11).

    Args:
        speed_mps: Present speeds, shape ``(N,)``.
        desired_mps: Speeds on a free road, shape ``(N,)``.
        gap_m: Present bumper gaps, inf without a leader, shape ``(N,)``.
        leader_mps: Leaders' speeds, shape ``(N,)``.
        times_s: Times of the answer, multiples of the integration step, shape ``(T,)``.
        config: Parameters.
    """
    dt = config.integration_s
    wanted = np.round(times_s / dt).astype(np.intp)
    speed, travelled = speed_mps, np.zeros(len(speed_mps))
    after = [travelled]
    for step in range(int(wanted.max())):
        gap = gap_m + leader_mps * (step * dt) - travelled
        acceleration = idm_acceleration(speed, desired_mps, gap, speed - leader_mps, config)
        stops = speed + acceleration * dt < 0.0
        to_stop = 0.5 * speed**2 / np.where(stops, -acceleration, 1.0)
        travelled = travelled + np.where(stops, to_stop, speed * dt + 0.5 * acceleration * dt**2)
        speed = np.where(stops, 0.0, speed + acceleration * dt)
        after.append(travelled)
    return np.stack(after, axis=-1)[:, wanted]
