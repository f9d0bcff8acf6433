"""CARLA's sensors for those of a suite, and their measurements as ours."""

from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Matrix, Rows
from siren_ros.base.numerics.units import STEPS_PER_S
from siren_ros.data.interfaces.carla import classes_of, depth_of, pixels_of
from siren_ros.sensing.camera.camera import CameraFrame, developed
from siren_ros.sensing.camera.renderer import RenderedImage
from siren_ros.sensing.lidar.lidar import LIDAR_POINT_DTYPE, LidarSweep
from siren_ros.sensing.specification import CameraSpec, LidarSpec
from siren_ros.simulation.world.actors import ActorDescription, ActorStates

LIDAR: Final = "sensor.lidar.ray_cast"
RGB: Final = "sensor.camera.rgb"
DEPTH: Final = "sensor.camera.depth"
SEMANTIC: Final = "sensor.camera.semantic_segmentation"
_SKIN_M: Final = 0.1
"""Points this far outside of a box still count as on the actor: mirrors and wheels, and the noise of real sensors."""


def carla_sensors(spec: LidarSpec | CameraSpec) -> Iterator[tuple[str, Mapping[str, str]]]:
    """Blueprints and attributes of CARLA that measure what one of our sensors measures.

    A LiDAR turns once in a step, as sweeps between steps are not wanted; the number of its firings in a turn is the
    suite's. A camera that records depth or classes is several of CARLA's cameras in one place.
    """
    if isinstance(spec, LidarSpec):
        values: dict[str, float] = {
            "channels": spec.channels,
            "range": spec.range_m,
            "points_per_second": spec.columns * spec.channels * STEPS_PER_S,
            "rotation_frequency": STEPS_PER_S,
            "upper_fov": float(np.degrees(spec.upper_fov_rad)),
            "lower_fov": float(np.degrees(spec.lower_fov_rad)),
            "atmosphere_attenuation_rate": spec.atmosphere_attenuation_per_m,
            "dropoff_general_rate": spec.dropoff_general_rate,
            "dropoff_intensity_limit": spec.dropoff_intensity_limit,
            "dropoff_zero_intensity": spec.dropoff_zero_intensity,
            "noise_stddev": spec.noise_stddev_m,
        }
        yield LIDAR, {name: f"{value:.9g}" for name, value in values.items()}
        return
    size = {"image_size_x": f"{spec.width}", "image_size_y": f"{spec.height}"}
    attributes = {**size, "fov": f"{np.degrees(spec.horizontal_fov_rad):.9g}"}
    for kind, wanted in ((RGB, True), (DEPTH, spec.depth), (SEMANTIC, spec.semantic)):
        if wanted:
            yield kind, attributes


def sweep_of(
    spec: LidarSpec,
    measured: Any,
    map_from_lidar: Matrix,
    states: ActorStates,
    actors: Mapping[int, ActorDescription],
) -> LidarSweep:
    """A sweep of CARLA's as ours.

    CARLA gives the points ring by ring from the top. They are sorted as they were fired, and each belongs to the actor
    in whose box it lies. ``states`` are of all actors but the carrier; ``actors`` have the sizes of CARLA's boxes.
    """
    raw = np.frombuffer(measured.raw_data, np.float32).reshape(-1, 4)
    counts = [measured.get_point_count(channel) for channel in range(measured.channels)]
    ring = np.repeat(np.arange(len(counts) - 1, -1, -1), counts)
    share = (np.pi - np.arctan2(-raw[:, 1], raw[:, 0])) / (2.0 * np.pi) % 1.0
    column = np.minimum((share * spec.columns).round().astype(np.intp), spec.columns - 1)
    order = np.lexsort((ring, column))
    points = np.zeros(len(raw), LIDAR_POINT_DTYPE)
    points["x"], points["y"], points["z"], points["intensity"] = (raw * (1.0, -1.0, 1.0, 1.0))[order].T
    points["ring"] = ring[order]
    points["time"] = (column[order] - (spec.columns - 1)) / (spec.columns * spec.rate_hz)
    distance_m = np.hypot(states.x_m - map_from_lidar[0, 3], states.y_m - map_from_lidar[1, 3])
    near = states.select(distance_m < spec.range_m)
    here = np.stack([points[name].astype(np.float64) for name in "xyz"], axis=1)
    place = here @ map_from_lidar[:3, :3].T + map_from_lidar[:3, 3]
    count = np.zeros(len(near), np.int64)
    for row, actor_id in enumerate(near.actor_id.tolist()):
        on = _inside(place, near, row, actors[actor_id])
        points["instance"][on] = actor_id
        count[row] = len(on)
    return LidarSweep(spec.name, states.step, points, near.actor_id, count)


def _inside(place: Matrix, states: ActorStates, row: int, actor: ActorDescription) -> Rows:
    """Rows of the points in an actor's box and its skin, without the road below."""
    reach_m = np.hypot(actor.length_m, actor.width_m) / 2.0 + _SKIN_M
    x, y = place[:, 0] - states.x_m[row], place[:, 1] - states.y_m[row]
    near = np.flatnonzero((np.abs(x) < reach_m) & (np.abs(y) < reach_m))
    cos, sin = np.cos(states.yaw_rad[row]), np.sin(states.yaw_rad[row])
    ahead, left = cos * x[near] + sin * y[near], cos * y[near] - sin * x[near]
    up = place[near, 2] - states.z_m[row]
    within = (np.abs(ahead) < actor.length_m / 2.0 + _SKIN_M) & (np.abs(left) < actor.width_m / 2.0 + _SKIN_M)
    return near[within & (up > _SKIN_M) & (up < actor.height_m + _SKIN_M)]


def frame_of(spec: CameraSpec, seed: int, step: int, measured: Mapping[str, Any], encoder: Executor) -> CameraFrame:
    """Pictures of CARLA's cameras in one place, by blueprint, as one of ours, with the suite's noise and blur."""
    pixels = {kind: pixels_of(image.raw_data, image.width, image.height) for kind, image in measured.items()}
    rgba = np.zeros((spec.height, spec.width, 4), np.uint8)
    rgba[..., :3] = pixels[RGB][..., 2::-1]
    if SEMANTIC in pixels:
        rgba[..., 3] = classes_of(pixels[SEMANTIC])
    depth = depth_of(pixels[DEPTH]) if DEPTH in pixels else None
    return developed(replace(spec, anti_aliasing=False), seed, step, RenderedImage(rgba, None, depth), encoder)
