"""The residual of an episode: the distance between SUMO's and the simulated pose of actors that SUMO owns."""

from dataclasses import dataclass

import numpy as np

from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.world.actors import Owner


@dataclass(frozen=True)
class ResidualSummary:
    """Over all actors and steps; zeros where SUMO owns no actor."""

    median_m: float
    p99_m: float
    max_m: float


def summarise_residuals(record: EpisodeRecord) -> ResidualSummary:
    """Median, 99th percentile and largest value of an episode's residuals."""
    rows = record.rows
    residual_m = rows.residual_m[rows.owner == Owner.SUMO]
    if not len(residual_m):
        return ResidualSummary(0.0, 0.0, 0.0)
    median_m, p99_m = np.percentile(residual_m, (50, 99))
    return ResidualSummary(float(median_m), float(p99_m), float(residual_m.max()))
