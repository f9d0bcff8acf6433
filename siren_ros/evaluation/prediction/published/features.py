"""What CSP, STDAN and BAT get of each vehicle: feet and seconds, 16 points of the past first, in single precision."""

from dataclasses import dataclass

import numpy as np

from siren_ros.datasets.ngsim.conventions import FOOT_M, vehicle_class
from siren_ros.datasets.ngsim.road_frame import road_places
from siren_ros.evaluation.prediction.published.ngsim_view import NgsimView
from siren_ros.numerics.arrays import Floats, Floats32, Rows
from siren_ros.world.actors import ActorClass

_CLASSES = np.array([vehicle_class(one) for one in ActorClass], dtype=np.float64)


@dataclass(frozen=True)
class Features:
    """Features of F values by point and vehicle."""

    own: Floats32
    """Of the samples' targets, shape ``(16, B, F)``."""
    neighbours: Floats32
    """Of their neighbours, shape ``(16, P, F)``."""


def csp_features(view: NgsimView) -> Features:
    """Position: x and y."""
    return Features(*(_time_first(positions) for positions in positions_ft(view)))


def stdan_features(view: NgsimView) -> Features:
    """Position, class, speed, acceleration."""
    pairs = zip(positions_ft(view), _class_and_motion(view), strict=True)
    return Features(*(_time_first(positions, motion) for positions, motion in pairs))


def bat_features(view: NgsimView) -> Features:
    """Polar position, displacement along x and y since the point before, class, speed, acceleration, lane."""
    pairs = zip(positions_ft(view), _class_and_motion(view), _lane_numbers(view), strict=True)
    return Features(
        *(
            _time_first(polar(positions), np.diff(positions, axis=1, prepend=positions[:, :1]), motion, lanes)
            for positions, motion, lanes in pairs
        )
    )


def positions_ft(view: NgsimView) -> tuple[Floats, Floats]:
    """Past positions of targets ``(B, 16, 2)`` and of neighbours ``(P, 16, 2)``: feet to the right and ahead."""
    return (
        view.right_ahead_m(view.target, np.arange(len(view))) / FOOT_M,
        view.right_ahead_m(view.neighbour, view.sample) / FOOT_M,
    )


def polar(xy: Floats) -> Floats:
    """Distance, and angle from +x towards +y; shape ``(…, 2)``."""
    return np.stack((np.hypot(xy[..., 0], xy[..., 1]), np.arctan2(xy[..., 1], xy[..., 0])), axis=-1)


def from_polar(polar_xy: Floats) -> Floats:
    """The opposite of ``polar``."""
    r, phi = polar_xy[..., 0], polar_xy[..., 1]
    return np.stack((r * np.cos(phi), r * np.sin(phi)), axis=-1)


def _class_and_motion(view: NgsimView) -> tuple[Floats, Floats]:
    """NGSIM's class, speed and acceleration, shapes ``(B, 16, 3)`` and ``(P, 16, 3)``."""
    actors = view.actors

    def of(rows: Rows) -> Floats:
        speed = np.hypot(actors.velocity_mps[rows, :, 0], actors.velocity_mps[rows, :, 1]) / FOOT_M
        kind = np.broadcast_to(_CLASSES[actors.actor_class[rows], None], speed.shape)
        return np.stack((kind, speed, actors.accel_mps2[rows] / FOOT_M), axis=-1)

    return of(view.target), of(view.neighbour)


def _lane_numbers(view: NgsimView) -> tuple[Floats, Floats]:
    """Numbers of the lanes of all points, shapes ``(B, 16, 1)`` and ``(P, 16, 1)``; 0 off the lanes."""
    actors = view.actors
    rows = np.unique(np.concatenate((view.target, view.neighbour)))
    # The pasts of one vehicle overlap from frame to frame: each of its poses is placed once.
    poses = np.column_stack(
        (actors.xy_m[rows].reshape(-1, 2), actors.yaw_rad[rows].ravel(), actors.past_sumo_lane[rows].ravel())
    )
    different, same = np.unique(poses, axis=0, return_inverse=True)
    road = road_places(view.network, different[:, :2], different[:, 2], different[:, 3].astype(np.int32))
    numbers = road.lane_number[same].reshape(len(rows), -1, 1).astype(np.float64)
    return numbers[np.searchsorted(rows, view.target)], numbers[np.searchsorted(rows, view.neighbour)]


def _time_first(*columns: Floats) -> Floats32:
    return np.ascontiguousarray(np.concatenate(columns, axis=-1).swapaxes(0, 1), dtype=np.float32)
