"""Computes exact labels from the simulated states and the measurements of the same step.

``GroundTruth`` has 3-D boxes with LiDAR points. ``CameraTruth`` has 2-D boxes, visible fractions and truncations, from
the instance image.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely

from siren_ros.base.numerics.arrays import Flags, Floats, Matrix, Rows
from siren_ros.base.numerics.compiled import Array, compiled
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.sensing.lidar.lidar import LidarSweep
from siren_ros.sensing.meshes.mesh import VehiclePlacement, VehicleShape
from siren_ros.sensing.specification import inverse, optical_from_map
from siren_ros.simulation.world.actors import ActorClass, ActorDescription, ActorStates, rows_of_ids
from siren_ros.simulation.world.carrier import CameraIntrinsics, CameraTruth, GroundTruth

LABEL_RANGE_M: Final = 120.0
"""Actors whose centre is farther away than this, the range of the paper's LiDAR, are not labelled."""


def label_boxes(
    states: ActorStates,
    descriptions: Mapping[int, ActorDescription],
    carrier_id: int,
    map_from_lidar: Matrix,
    sweep: LidarSweep | None = None,
    range_m: float = LABEL_RANGE_M,
) -> GroundTruth:
    """Boxes of all actors but the carrier within ``range_m``, in the labels' frame, whose pose is given, ``(4, 4)``.

    ``sweep`` holds the returns of this step; without it the labels' point counts are 0.
    """
    origin = map_from_lidar[:2, 3]
    distance = np.hypot(states.x_m - origin[0], states.y_m - origin[1])
    seen = states.select((distance <= range_m) & (states.actor_id != carrier_id))
    actors = [descriptions[int(actor_id)] for actor_id in seen.actor_id]
    size = np.array([(a.length_m, a.width_m, a.height_m) for a in actors], dtype=np.float64).reshape(-1, 3)
    lidar_from_map = inverse(map_from_lidar)
    centre = np.stack((seen.x_m, seen.y_m, seen.z_m + size[:, 2] / 2.0), axis=1)
    centre = centre @ lidar_from_map[:3, :3].T + lidar_from_map[:3, 3]
    velocity = np.stack((seen.vx_mps, seen.vy_mps, np.zeros(len(seen))), axis=1) @ lidar_from_map[:3, :3].T
    heading = float(np.arctan2(map_from_lidar[1, 0], map_from_lidar[0, 0]))
    points = np.zeros(len(seen), dtype=np.uint32)
    if sweep is not None:
        rows = rows_of_ids(sweep.actor_id, seen.actor_id)
        hit = rows >= 0
        points[hit] = sweep.points_on_actor[rows[hit]]
    return GroundTruth(
        step=states.step,
        carrier_id=carrier_id,
        actor_id=seen.actor_id,
        actor_class=np.array([int(a.actor_class) for a in actors], dtype=np.uint8),
        is_emv=np.array([a.is_emv for a in actors], dtype=np.bool_),
        x_m=centre[:, 0],
        y_m=centre[:, 1],
        z_m=centre[:, 2],
        yaw_rad=wrap_angle(seen.yaw_rad - heading),
        length_m=size[:, 0],
        width_m=size[:, 1],
        height_m=size[:, 2],
        vx_mps=velocity[:, 0],
        vy_mps=velocity[:, 1],
        accel_mps2=seen.accel_mps2,
        lidar_points=points,
    )


_NEAR_M: Final = 0.1
_SMALLEST_PX: Final = 4.0
"""Vehicles whose outline is smaller than this in the picture are not labelled."""
_DIRECTIONS: Final = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])


@dataclass(frozen=True, eq=False)
class PixelBoxes:
    """Number and bounds of each actor's pixels; rows in the order of the given ids."""

    count: npt.NDArray[np.int64]
    bounds: npt.NDArray[np.int64]
    """First column, first row, last column, last row, shape ``(N, 4)``; meaningless where the count is 0."""


def extreme_points(shape: VehicleShape) -> Floats:
    """A shape's outermost points in 26 directions, which stand for its convex hull, shape ``(K, 3)``."""
    points = shape.at_rest.vertices_m.astype(np.float64)
    return points[np.unique(np.argmax(points @ _DIRECTIONS.T, axis=0))]


def pixel_boxes(instance: npt.NDArray[np.uint32], actor_id: npt.NDArray[np.uint32]) -> PixelBoxes:
    """Count and bound each actor's pixels in an instance image, shape ``(H, W)``; ids are sorted, shape ``(N,)``."""
    count = np.zeros(len(actor_id), np.int64)
    bounds = np.zeros((len(actor_id), 4), np.int64)
    bounds[:, :_LAST_COLUMN] = max(instance.shape)
    bounds[:, _LAST_COLUMN:] = -1
    _scan(instance, actor_id, count, bounds)
    return PixelBoxes(count, bounds)


_FIRST_COLUMN, _FIRST_ROW, _LAST_COLUMN, _LAST_ROW = range(4)
"""Columns of ``PixelBoxes.bounds``."""


@compiled
def _scan(instance: Array, actor_id: Array, count: Array, bounds: Array) -> None:
    """Scan the image once; a run of equal pixels needs one search."""
    for v in range(instance.shape[0]):
        last, row = np.uint32(0), -1
        for u in range(instance.shape[1]):
            value = instance[v, u]
            if value != last:
                last, row = value, -1
                if value != 0:
                    place = np.searchsorted(actor_id, value)
                    if place < actor_id.shape[0] and actor_id[place] == value:
                        row = place
            if row >= 0:
                count[row] += 1
                bounds[row, _FIRST_COLUMN] = min(bounds[row, _FIRST_COLUMN], u)
                bounds[row, _FIRST_ROW] = min(bounds[row, _FIRST_ROW], v)
                bounds[row, _LAST_COLUMN] = max(bounds[row, _LAST_COLUMN], u)
                bounds[row, _LAST_ROW] = max(bounds[row, _LAST_ROW], v)


class ImageLabeller:
    """Labels the vehicles in a picture."""

    def __init__(self, shapes: Mapping[ActorClass, VehicleShape]) -> None:
        """Find each shape's outermost points once."""
        self._extremes = {int(kind): extreme_points(shape) for kind, shape in shapes.items()}

    def label(
        self,
        step: int,
        camera: CameraIntrinsics,
        map_from_camera: Matrix,
        placement: VehiclePlacement,
        instance: npt.NDArray[np.uint32],
        is_emv: Flags,
    ) -> CameraTruth:
        """The vehicles within range whose outline reaches into the picture.

        The visible fraction is the number of pixels over the area of the convex outline within the picture, at most 1:
        a vehicle that nothing hides shows 0.9 and more, since vehicles are nearly convex. The pose is that of the
        camera's body frame, ``(4, 4)``; ``instance`` holds actor ids, ``(H, W)``; ``is_emv`` has a row per placed
        vehicle.
        """
        near = placement.distance_m(map_from_camera[0, 3], map_from_camera[1, 3]) <= LABEL_RANGE_M
        rows = np.flatnonzero(near)
        whole, inside = self._outlines(camera, optical_from_map(map_from_camera), placement, rows)
        seen = inside >= _SMALLEST_PX
        rows, whole, inside = rows[seen], whole[seen], inside[seen]
        boxes = pixel_boxes(instance, np.ascontiguousarray(placement.actor_id[rows]))
        shown = (boxes.count > 0)[:, None]
        bounds = np.where(shown, boxes.bounds + np.array([-0.5, -0.5, 0.5, 0.5]), 0.0)
        return CameraTruth(
            step=step,
            actor_id=placement.actor_id[rows],
            actor_class=placement.actor_class[rows],
            is_emv=is_emv[rows],
            u_min_px=bounds[:, 0],
            v_min_px=bounds[:, 1],
            u_max_px=bounds[:, 2],
            v_max_px=bounds[:, 3],
            visible_px=boxes.count.astype(np.uint32),
            visible_fraction=np.minimum(boxes.count / inside, 1.0),
            truncation=np.clip(1.0 - inside / whole, 0.0, 1.0),
        )

    def _outlines(
        self, camera: CameraIntrinsics, optical_from_map_: Matrix, placement: VehiclePlacement, rows: Rows
    ) -> tuple[Floats, Floats]:
        """Area of each vehicle's convex outline, and of the part within the picture, in pixels, shape ``(R,)``."""
        points, owner = [np.empty((0, 2))], [np.empty(0, np.intp)]
        for number, row in enumerate(rows):
            local = self._extremes[int(placement.actor_class[row])] * placement.scale[row]
            cos, sin = np.cos(placement.yaw_rad[row]), np.sin(placement.yaw_rad[row])
            x = placement.x_m[row] + cos * local[:, 0] - sin * local[:, 1]
            y = placement.y_m[row] + sin * local[:, 0] + cos * local[:, 1]
            in_map = np.stack((x, y, placement.z_m[row] + local[:, 2], np.ones(len(local))), axis=1)
            front = _in_front(in_map @ optical_from_map_[:3].T)
            if len(front) > 2:
                uv, _ = camera.project(front)
                points.append(uv)
                owner.append(np.full(len(uv), number))
        hulls = np.full(len(rows), shapely.Polygon(), dtype=object)
        joined, owners = np.concatenate(points), np.concatenate(owner)
        if len(owners):
            known = np.unique(owners)
            compact = np.searchsorted(known, owners)
            hulls[known] = shapely.convex_hull(shapely.multipoints(shapely.points(joined), indices=compact))
        picture = shapely.box(-0.5, -0.5, camera.width - 0.5, camera.height - 0.5)
        whole = shapely.area(hulls)
        return np.maximum(whole, 1e-9), shapely.area(shapely.intersection(hulls, picture))


def _in_front(optical: Floats) -> Floats:
    """Clip a convex body at the near plane: its points in front of the camera, and where its lines cross the plane."""
    ahead = optical[:, 2] > _NEAR_M
    if np.all(ahead) or not np.any(ahead):
        return optical[ahead]
    before, behind = optical[ahead][:, None], optical[~ahead][None]
    share = (before[..., 2:] - _NEAR_M) / (before[..., 2:] - behind[..., 2:])
    crossing = before + share * (behind - before)
    return np.concatenate((optical[ahead], crossing.reshape(-1, 3)))
