"""Labels of 3-D boxes: ``GroundTruth`` from the simulated states and the sweep of the same step."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from siren_ros.numerics.arrays import Matrix
from siren_ros.numerics.geometry import wrap_angle
from siren_ros.sensors.lidar.lidar import LidarSweep
from siren_ros.sensors.suite.mount import inverse
from siren_ros.world.actors import ActorDescription, ActorStates, rows_of_ids
from siren_ros.world.carrier import GroundTruth

LABEL_RANGE_M: Final = 120.0
"""Actors whose centre is further away than the paper's LiDAR reaches are not labelled."""


def label_boxes(
    states: ActorStates,
    descriptions: Mapping[int, ActorDescription],
    carrier_id: int,
    map_from_lidar: Matrix,
    sweep: LidarSweep | None = None,
    range_m: float = LABEL_RANGE_M,
) -> GroundTruth:
    """Boxes of all actors but the carrier within ``range_m`` of the sensor, in the sensor's frame.

    Args:
        states: Actors at this step.
        descriptions: What the actors are, by id.
        carrier_id: The vehicle with the sensors.
        map_from_lidar: Pose of the frame of the labels, shape ``(4, 4)``.
        sweep: Returns of this step; without one the labels' point counts are 0.
        range_m: Horizontal distance of the box's centre.
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
