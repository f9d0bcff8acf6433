"""The vehicles that a sample has ahead of it and behind it on each of its paths."""

from typing import Final

import numpy as np

from siren_ros.evaluation.prediction.protocol.samples import SampleBatch
from siren_ros.evaluation.prediction.siren_model.actor_features import (
    SPEED_SCALE_MPS,
    NeighbourChoice,
    in_frame_of,
)
from siren_ros.evaluation.prediction.siren_model.path_choice import PathChoice
from siren_ros.numerics.arrays import Floats, Rows

_CHUNK: Final = 4096
"""Pairs of a path and a vehicle whose distances are held in memory at once."""
_FAR_M: Final = 100.0
_SIDE_MARGIN_M: Final = 0.3
"""Lateral gap below which a vehicle counts as in the way."""
_OVERLAP_M: Final = 5.0
"""Least gap that is told apart; it is negative where the two overlap lengthwise."""
_LEADERS: Final = ("leader", "second")
_NAMES: Final = tuple(f"{prefix}_{what}" for prefix in _LEADERS for what in ("gap", "there", "speed", "is_emv"))


def traffic_columns(
    batch: SampleBatch, others: NeighbourChoice, choice: PathChoice, points_m: Floats
) -> dict[str, Floats]:
    """The first two vehicles whose footprints reach into the strip along each path; each of shape ``(N, PATHS)``.

    Args:
        batch: The samples.
        others: The neighbours that a sample is shown.
        choice: Its paths.
        points_m: Points of the paths in the samples' frames, shape ``(N, PATHS, PATH_POINTS, 2)``.
    """
    actors, own = batch.actors, batch.target
    row, path, slot = np.nonzero(choice.there[:, :, None] & others.there[:, None])
    other = others.actor[row, slot]
    place = in_frame_of(batch, actors.xy_m[others.actor, -1] - batch.xy_m[:, None])[row, slot]
    along, aside = _on_paths(points_m, choice.spacing_m, row, path, place)
    strip = 0.5 * (actors.width_m[own[row]] + actors.width_m[other]) + _SIDE_MARGIN_M
    ahead = np.flatnonzero((aside < strip) & (along > 0.0))
    row, path, other = row[ahead], path[ahead], other[ahead]
    gap = along[ahead] - 0.5 * (actors.length_m[own[row]] + actors.length_m[other])
    key = row * points_m.shape[1] + path
    order = np.lexsort((gap, key))
    row, path, other, gap, key = row[order], path[order], other[order], gap[order], key[order]
    place_in_line = np.arange(len(key)) - np.searchsorted(key, key)
    velocity = actors.velocity_mps[:, -1]
    speed = np.hypot(velocity[:, 0], velocity[:, 1]) / SPEED_SCALE_MPS
    columns = {name: np.zeros(points_m.shape[:2]) for name in _NAMES}
    for number, prefix in enumerate(_LEADERS):
        columns[f"{prefix}_gap"][:] = 1.0
        found = np.flatnonzero(place_in_line == number)
        at = row[found], path[found]
        columns[f"{prefix}_gap"][at] = np.clip(gap[found], -_OVERLAP_M, _FAR_M) / _FAR_M
        columns[f"{prefix}_there"][at] = 1.0
        columns[f"{prefix}_speed"][at] = speed[other[found]]
        columns[f"{prefix}_is_emv"][at] = actors.is_emv[other[found]]
    return columns


def _on_paths(points_m: Floats, spacing_m: Floats, row: Rows, path: Rows, place_m: Floats) -> tuple[Floats, Floats]:
    """Arc length along paths and distance from them of one place for each pair of sample and path.

    A place behind the path has a negative arc length.
    """
    along, aside = np.empty(len(row)), np.empty(len(row))
    for first in range(0, len(row), _CHUNK):
        part = slice(first, first + _CHUNK)
        x, y = points_m[row[part], path[part]].transpose(2, 0, 1)
        step_x, step_y = np.diff(x, axis=1), np.diff(y, axis=1)
        apart_x, apart_y = place_m[part, :1] - x[:, :-1], place_m[part, 1:] - y[:, :-1]
        square = np.maximum(step_x * step_x + step_y * step_y, 1e-9)
        fraction = (apart_x * step_x + apart_y * step_y) / square
        # The first piece is extended backwards, so that places behind the path have a negative arc length.
        low = np.where(np.arange(fraction.shape[1]) == 0, -np.inf, 0.0)
        fraction = np.clip(fraction, low, 1.0)
        miss_x, miss_y = apart_x - fraction * step_x, apart_y - fraction * step_y
        distance = miss_x * miss_x + miss_y * miss_y
        best = distance.argmin(axis=1)
        rows = np.arange(len(best))
        along[part] = (best + fraction[rows, best]) * spacing_m[row[part]]
        aside[part] = np.sqrt(distance[rows, best])
    return along, aside
