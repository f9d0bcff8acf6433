"""The sample's own past and that of its neighbours, in the sample's frame: origin at its centre, x forward."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.evaluation.prediction.protocol.samples import SampleBatch
from siren_ros.numerics.arrays import Flags, Floats, Rows
from siren_ros.numerics.geometry import wrap_angle
from siren_ros.world.actors import Lights

NEIGHBOURS: Final = 12
_RANGE_M: Final = 80.0
POSITION_SCALE_M: Final = 20.0
SPEED_SCALE_MPS: Final = 10.0
_PAST: Final = (-6, -11, -16)
"""Points of a neighbour's past that are shown: 1, 2 and 3 s ago."""
_SHOWN_LIGHTS: Final = {
    "brake": Lights.BRAKE,
    "indicates_left": Lights.INDICATOR_LEFT,
    "indicates_right": Lights.INDICATOR_RIGHT,
    "beacon": Lights.BEACON,
    "siren": Lights.SIREN,
}


@dataclass(frozen=True)
class NeighbourChoice:
    """Up to ``NEIGHBOURS`` other vehicles of each of N samples: emergency vehicles first, then by distance."""

    actor: Rows
    """Rows of ``SampleBatch.actors``, 0 where there is none; shape ``(N, NEIGHBOURS)``."""
    there: Flags
    """Shape ``(N, NEIGHBOURS)``."""


def choose_neighbours(batch: SampleBatch) -> NeighbourChoice:
    """The vehicles that a sample is shown, within 80 m."""
    sample, other = batch.neighbours()
    xy, is_emv = batch.actors.xy_m[:, -1], batch.actors.is_emv
    distance = np.hypot(*(xy[other] - batch.xy_m[sample]).T)
    near = np.flatnonzero(distance <= _RANGE_M)
    sample, other, distance = sample[near], other[near], distance[near]
    order = np.lexsort((distance, ~is_emv[other], sample))
    sample, other = sample[order], other[order]
    place = np.arange(len(sample)) - np.searchsorted(sample, sample)
    few = place < NEIGHBOURS
    actor, there = np.zeros((len(batch), NEIGHBOURS), dtype=np.intp), np.zeros((len(batch), NEIGHBOURS), dtype=np.bool_)
    actor[sample[few], place[few]], there[sample[few], place[few]] = other[few], True
    return NeighbourChoice(actor, there)


def in_frame_of(batch: SampleBatch, vectors: Floats) -> Floats:
    """Vectors of the frame ``map`` in each sample's frame; shape ``(N, …, 2)``."""
    shape = (len(batch), *(1,) * (vectors.ndim - 2))
    cos, sin = np.cos(batch.yaw_rad).reshape(shape), np.sin(batch.yaw_rad).reshape(shape)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack((cos * x + sin * y, cos * y - sin * x), axis=-1)


def target_columns(batch: SampleBatch) -> dict[str, Floats]:
    """Own past, size, lights and the nearest emergency vehicle; each of shape ``(N,)``."""
    actors, rows = batch.actors, batch.target
    past = in_frame_of(batch, actors.xy_m[rows] - batch.xy_m[:, None]) / POSITION_SCALE_M
    velocity = in_frame_of(batch, actors.velocity_mps[rows]) / SPEED_SCALE_MPS
    turned = np.asarray(wrap_angle(actors.yaw_rad[rows] - batch.yaw_rad[:, None]))
    points = past.shape[1]
    return {
        **{f"x{point - points}": past[:, point, 0] for point in range(points - 1)},
        **{f"y{point - points}": past[:, point, 1] for point in range(points - 1)},
        **{f"vx{point - points}": velocity[:, point, 0] for point in range(points)},
        **{f"vy{point - points}": velocity[:, point, 1] for point in range(points)},
        **{f"turned{point - points}": turned[:, point] for point in range(0, points - 1, 2)},
        **_gains(velocity),
        **_body_columns(batch, rows),
    }


def neighbour_columns(batch: SampleBatch, choice: NeighbourChoice) -> dict[str, Floats]:
    """Neighbours as the sample sees them, 0 where there is none; each of shape ``(N, NEIGHBOURS)``."""
    actors, rows = batch.actors, choice.actor
    points = actors.xy_m.shape[1]
    shown = np.array([points - 1, *(points + point for point in _PAST)])
    seen = actors.observed[rows][..., shown]
    place = in_frame_of(batch, actors.xy_m[rows][:, :, shown] - batch.xy_m[:, None, None]) / POSITION_SCALE_M
    moved = np.where(seen[..., None], place - place[:, :, :1], 0.0)
    velocity = in_frame_of(batch, actors.velocity_mps[rows][:, :, shown]) / SPEED_SCALE_MPS
    gained = np.where(seen[..., None], velocity[:, :, :1] - velocity, 0.0)
    turned = actors.yaw_rad[rows, -1] - batch.yaw_rad[:, None]
    columns = {
        "x": place[:, :, 0, 0],
        "y": place[:, :, 0, 1],
        "distance": np.hypot(place[:, :, 0, 0], place[:, :, 0, 1]),
        "cos": np.cos(turned),
        "sin": np.sin(turned),
        "vx": velocity[:, :, 0, 0],
        "vy": velocity[:, :, 0, 1],
        "closing_x": velocity[:, :, 0, 0] - _speed(batch)[:, None],
        **{f"moved_x{at}": moved[:, :, number, 0] for number, at in enumerate(_PAST, 1)},
        **{f"moved_y{at}": moved[:, :, number, 1] for number, at in enumerate(_PAST, 1)},
        **{f"gained_x{at}": gained[:, :, number, 0] for number, at in enumerate(_PAST, 1)},
        **{f"seen{at}": seen[:, :, number].astype(np.float64) for number, at in enumerate(_PAST, 1)},
        **_body_columns(batch, rows),
    }
    return {name: np.where(choice.there, values, 0.0) for name, values in columns.items()}


def _speed(batch: SampleBatch) -> Floats:
    return np.hypot(batch.velocity_mps[:, 0], batch.velocity_mps[:, 1]) / SPEED_SCALE_MPS


def _gains(velocity: Floats) -> dict[str, Floats]:
    """Change of the velocity over the last 0.2, 0.6 and 1.4 s, per second."""
    return {
        f"{axis}_gained_in{steps}": (velocity[:, -1, number] - velocity[:, -1 - steps, number]) / (0.2 * steps)
        for steps in (1, 3, 7)
        for number, axis in enumerate("xy")
    }


def _body_columns(batch: SampleBatch, rows: Rows) -> dict[str, Floats]:
    actors = batch.actors
    lights = actors.lights[rows]
    return {
        "length": actors.length_m[rows] / 10.0,
        "width": actors.width_m[rows] / 2.0,
        "is_emv": actors.is_emv[rows].astype(np.float64),
        **{name: ((lights & light) != 0).astype(np.float64) for name, light in _SHOWN_LIGHTS.items()},
    }
