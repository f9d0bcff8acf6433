"""Free space around a vehicle: distance of its footprint from others at poses that it may take."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Columns, Floats, Ids, Points
from siren_ros.base.numerics.braking import needed_brake_mps2, speed_before_mps
from siren_ros.base.numerics.compiled import COS, SIN, X, Y, box_gap_m, compiled, wrapped_rad
from siren_ros.simulation.behaviour.driving.step_view import Body, Surroundings
from siren_ros.simulation.behaviour.paths.curve import curve_place
from siren_ros.simulation.behaviour.paths.tracked_path import TrackedPath
from siren_ros.simulation.world.actors import NO_ACTOR

# These are no parameters: compiled loops contain these resolutions and tolerances as constants.
_PATH_STEP_M: Final = 0.25
_OFFSET_KEPT_M: Final = 2.0
"""Distance for which an offset from the path stays; in bends as tight as the steering allows it may even grow."""
_OFFSET_LENGTH_M: Final = 4.0
"""Distance over which path tracking then corrects most of it."""
_LEAST_WAY_M: Final = 0.2
_RESERVE_M: Final = 1.0
"""Distance kept to an impassable place by braking in any case."""
_TOUCH_M: Final = 0.03
"""Bodies nearer than this count as touching."""
_TOLERANCE_M: Final = 0.01
"""Amount by which a vehicle inside the clearance may still come nearer: the noise of tracking."""
_HALF_LENGTH, _HALF_WIDTH = 4, 5
"""Rows of boxes after those of a pose."""


@dataclass(frozen=True, eq=False)
class Obstacles(Columns):
    """Oriented boxes of actors, each array of shape ``(M,)``; frame ``map``."""

    actor_id: Ids
    x_m: Floats
    y_m: Floats
    cos: Floats
    sin: Floats
    half_length_m: Floats
    half_width_m: Floats

    @classmethod
    def swept(cls, seen: Surroundings, rows: npt.NDArray[np.intp], time_s: Floats) -> "Obstacles":
        """Footprints of vehicles, extended ahead by the distance that each drives in its ``time_s``."""
        half_sweep = 0.5 * time_s * seen.speed_mps[rows]
        cos, sin = seen.cos[rows], seen.sin[rows]
        x_m, y_m = seen.x_m[rows] + cos * half_sweep, seen.y_m[rows] + sin * half_sweep
        half_length_m = seen.half_length_m[rows] + half_sweep
        return cls(seen.actor_id[rows], x_m, y_m, cos, sin, half_length_m, seen.half_width_m[rows])


def separations_m(x_m: Floats, y_m: Floats, yaw_rad: Floats, body: Body, obstacles: Obstacles) -> Floats:
    """Largest gap along a separating axis between a body at some poses and each obstacle.

    It is a lower bound of the distance, and negative where the boxes overlap (separating axis theorem). The result has
    the shape to which the poses of the body's centre broadcast, with an axis for the obstacles added.
    """
    x, y, yaw = np.broadcast_arrays(x_m, y_m, yaw_rad)
    poses = np.array((x.ravel(), y.ravel(), np.cos(yaw).ravel(), np.sin(yaw).ravel()))
    return _gaps_m(poses, body, obstacles).reshape(*x.shape, len(obstacles))


def _gaps_m(poses: Floats, body: Body, obstacles: Obstacles) -> Floats:
    """``separations_m`` for poses as x, y, cosine and sine, shape ``(4, P)``; the result has shape ``(P, M)``."""
    boxes = np.array(
        (obstacles.x_m, obstacles.y_m, obstacles.cos, obstacles.sin, obstacles.half_length_m, obstacles.half_width_m)
    )
    gap = np.empty((poses.shape[1], boxes.shape[1]))
    _separate(poses, boxes, body.half_length_m, body.half_width_m, gap)
    return gap


@compiled
def _separate(poses: Floats, boxes: Floats, half_length: float, half_width: float, gap: Floats) -> None:
    """Compute the gap of a body in each pose (x, y, cosine, sine; ``(4, P)``) from each box ``(6, M)``."""
    for n in range(poses.shape[1]):
        pose = poses[X, n], poses[Y, n], poses[COS, n], poses[SIN, n]
        for m in range(boxes.shape[1]):
            box = boxes[X, m], boxes[Y, m], boxes[COS, m], boxes[SIN, m]
            gap[n, m] = box_gap_m(pose, box, half_length, half_width, boxes[_HALF_LENGTH, m], boxes[_HALF_WIDTH, m])


def clearances_m(
    x_m: Floats, y_m: Floats, yaw_rad: Floats, body: Body, obstacles: Obstacles, present_m: Floats
) -> Floats:
    """Smallest distance of a body from all obstacles, at poses as for ``separations_m``; infinite without obstacles.

    ``present_m`` is the distance from each obstacle at present, shape ``(M,)``: an obstacle does not count at poses
    that are no nearer to it.
    """
    gap = separations_m(x_m, y_m, yaw_rad, body, obstacles)
    gap = np.where(gap >= present_m - _TOLERANCE_M, np.inf, gap)
    return np.asarray(gap.min(axis=-1, initial=np.inf), dtype=np.float64)


class SpeedLimit(NamedTuple):
    """Limit of speed, required braking, and the actor that causes them."""

    speed_mps: float = math.inf
    brake_mps2: float = 0.0
    """Least required deceleration."""
    blocker_id: int = NO_ACTOR
    """Actor that blocks the way."""
    free_m: float = math.inf
    """Distance to that actor."""


@dataclass(frozen=True, eq=False)
class FreeWay:
    """Distances of a body from obstacles along a path."""

    way_m: Floats
    """Distances driven from the body's present place, shape ``(K,)``."""
    gap_m: Floats
    """Distance from each obstacle at each place, shape ``(K, M)``."""
    credit_m: Floats
    """Distance that each obstacle will have moved before it can stand, shape ``(M,)``."""
    actor_id: Ids
    """Ids of the obstacles."""

    @classmethod
    def along(
        cls,
        path: TrackedPath,
        pose: tuple[float, float, float],
        centre_ahead_m: float,
        reach_m: float,
        body: Body,
        obstacles: Obstacles,
        credit_m: Floats,
    ) -> "FreeWay":
        """Compute the distances for a body on a path of its centre.

        Args:
            path: Path of the body's centre.
            pose: Arc length and offset (left positive) of the body on the path, and its yaw. Both errors fade.
            centre_ahead_m: Distance from the rear axle to the body's centre. In bends the body is not along its path.
            reach_m: How far to look.
            body: Size of the body.
            obstacles: Vehicles that may be in the way.
            credit_m: Way that each obstacle will have gone before it can stand, shape ``(M,)``.
        """
        progress, left, yaw = pose
        end = min(progress + reach_m, path.length_m)
        way = _PATH_STEP_M * np.arange(max(math.ceil((end - progress) / _PATH_STEP_M), 0) + 1)
        poses, curve = np.empty((4, len(way))), path.curve
        line = curve.points, curve.heading_rad, curve.curvature_1pm, curve.spacing_m
        poses_ahead(*line, progress, left, yaw, centre_ahead_m, way, poses)
        return cls(way, _gaps_m(poses, body, obstacles), credit_m, obstacles.actor_id)

    def until_m(self, clearance_m: float) -> float:
        """Distance that the body drives before it is nearer than a clearance to an obstacle.

        Infinite if it never is.
        """
        return float(self._first_m(np.full(len(self.credit_m), clearance_m)).min(initial=np.inf))

    @property
    def free_m(self) -> float:
        """Distance until the body touches an obstacle, or comes nearer to one that it already touches."""
        return float(self._stopping_m(_TOUCH_M).min(initial=np.inf))

    def _stopping_m(self, clearance_m: float) -> Floats:
        """Distance to each obstacle that is too near; there is no tolerance at contact, or small steps would add up."""
        present = self.gap_m[0]
        nearer = np.maximum(present - _TOLERANCE_M, np.minimum(present, _TOUCH_M))
        return self._first_m(np.minimum(clearance_m, nearer))

    def _first_m(self, clearance_m: Floats) -> Floats:
        """Distance to the first place nearer to each obstacle than its clearance ``(M,)``; infinite without one."""
        first = np.empty(len(self.credit_m))
        _first_nearer(self.way_m, self.gap_m, clearance_m, first)
        return first + self.credit_m

    def limit(
        self,
        speed_mps: float,
        squeezes: tuple[tuple[float, float], ...],
        stop_short_m: float,
        brake_mps2: float,
        clearance_m: float = _TOUCH_M,
    ) -> SpeedLimit:
        """Speed from which the body can slow down for tight places and stop before impassable ones.

        The needed deceleration is that of a stop before contact. Places that are only too tight are braked for gently,
        with ``brake_mps2``; nearer to contact than ``stop_short_m`` the body brakes so until it stands.
        ``squeezes`` are margins, the wider first, and the speeds that they allow. A place with less than
        ``clearance_m`` is impassable; the body stops ``stop_short_m`` before it.
        """
        narrow = [(self.until_m(wide), tight) for (wide, _), (_, tight) in pairwise(squeezes)]
        stopping = self._stopping_m(clearance_m)
        free = float(stopping.min(initial=np.inf))
        narrow.append((free - stop_short_m, 0.0))
        limit = math.inf
        for way, slow in narrow:
            if way < math.inf:
                limit = min(limit, speed_before_mps(slow * slow, brake_mps2, max(way, 0.0)))
        if free == math.inf:
            return SpeedLimit(limit)
        contact = self.free_m
        brake = needed_brake_mps2(speed_mps**2, max(contact - min(stop_short_m, _RESERVE_M), _LEAST_WAY_M))
        blocker = int(self.actor_id[np.argmin(stopping)])
        must = brake > brake_mps2 or contact <= stop_short_m
        return SpeedLimit(limit, max(brake, brake_mps2) if must else 0.0, blocker, free)


@compiled
def poses_ahead(
    points: Points, heading_rad: Floats, curvature_1pm: Floats, spacing_m: float, progress_m: float, left_m: float,
    yaw_rad: float, centre_ahead_m: float, way_m: Floats, poses: Floats,
) -> None:  # fmt: skip
    """Compute x, y, cosine and sine of a body after each distance ``(K,)``; offset and yaw error decrease to zero.

    The rear axle follows the body's centre as a trailer does: behind a bend the body turns into the course of its
    centre over the way between both.
    """
    yaw, turned, before = 0.0, 0.0, 0.0
    for k in range(way_m.shape[0]):
        x, y, heading, curvature = curve_place(points, heading_rad, curvature_1pm, spacing_m, progress_m + way_m[k])
        if k == 0:
            yaw = heading - np.arctan(centre_ahead_m * curvature)
            turned = wrapped_rad(yaw_rad - yaw)
        yaw += wrapped_rad(heading - yaw) * (1.0 - np.exp(-(way_m[k] - before) / max(centre_ahead_m, _PATH_STEP_M)))
        before = way_m[k]
        fading = np.exp(-max(way_m[k] - _OFFSET_KEPT_M, 0.0) / _OFFSET_LENGTH_M)
        poses[X, k] = x - left_m * fading * np.sin(heading)
        poses[Y, k] = y + left_m * fading * np.cos(heading)
        poses[COS, k], poses[SIN, k] = np.cos(yaw + turned * fading), np.sin(yaw + turned * fading)


@compiled
def _first_nearer(way_m: Floats, gap_m: Floats, clearance_m: Floats, first_m: Floats) -> None:
    """Find for each clearance ``(M,)`` the first distance ``(K,)`` at which the gap ``(K, M)`` is smaller."""
    for m in range(gap_m.shape[1]):
        first_m[m] = np.inf
        for k in range(gap_m.shape[0]):
            if gap_m[k, m] < clearance_m[m]:
                first_m[m] = way_m[k]
                break
