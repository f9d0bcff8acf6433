"""The table of detectors by name, how one of them runs on an episode, and the reference detector without learning.

The reference detector removes the ground, clusters points, fits boxes and tracks them.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Matrix
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.episode_source import lidar_of, open_source
from siren_ros.data.interfaces.measurements import from_point_cloud
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.boxes import FoundBoxes, attributes_of
from siren_ros.scoring.evaluation.detection.frames import EpisodeFrames
from siren_ros.scoring.evaluation.detection.pillar_detector import detect_pillars, seen_in_training
from siren_ros.scoring.evaluation.detection.tracking import Tracker
from siren_ros.simulation.scenario.episode import SeenEpisodes

_TURNS: Final = np.radians(np.arange(0.0, 90.0, 1.0))
_NEAREST_M: Final = 0.05
"""Smallest distance to the edge that the criterion distinguishes."""
_WIDEST_REAR_M: Final = 2.3
_TYPICAL_M: Final = (4.5, 1.9, 1.55)
"""Least length, width, height of a box, since a LiDAR sees only one or two sides of a vehicle."""


@dataclass(frozen=True)
class FittedBox:
    """A box in the frame of the points."""

    centre_m: Floats
    """Shape ``(3,)``."""
    size_m: Floats
    """Length, width, height."""
    yaw_rad: float
    """Heading of the longer side, within a quarter turn of x: a box does not tell front from rear."""
    seen_m: Floats
    """Length and width of the visible part."""


def fit_box(points: Floats, ground_m: float) -> FittedBox:
    """Fit the rectangle whose edges are closest to the points, and extend it to a car's size, away from the sensor.

    Source of the criterion: X. Zhang, W. Xu, C. Dong, J. Dolan, "Efficient L-shape fitting for vehicle detection using
    laser scanners", IV 2017, "closeness".

    Args:
        points: Returns of one vehicle, shape ``(N, 3)``, in a frame with the sensor at the origin.
        ground_m: Height of the ground below them.
    """
    cos, sin = np.cos(_TURNS)[:, None], np.sin(_TURNS)[:, None]
    along = cos * points[:, 0] + sin * points[:, 1]
    across = -sin * points[:, 0] + cos * points[:, 1]
    edges = [np.minimum(side.max(axis=1)[:, None] - side, side - side.min(axis=1)[:, None]) for side in (along, across)]
    best = int((1.0 / np.maximum(np.minimum(*edges), _NEAREST_M)).sum(axis=1).argmax())
    low = np.array([along[best].min(), across[best].min()])
    high = np.array([along[best].max(), across[best].max()])
    yaw, seen = float(_TURNS[best]), high - low
    # A side no longer than a car's width is taken as the front or the rear.
    along_first = (seen[0] >= seen[1]) != (seen.max() < _WIDEST_REAR_M)
    typical = np.array(_TYPICAL_M[:2]) if along_first else np.array(_TYPICAL_M[1::-1])
    grown = np.maximum(seen, typical)
    # The side that faces the sensor was seen, so the box grows on the far side.
    middle = np.where(low + high >= 0.0, low + grown / 2.0, high - grown / 2.0)
    if grown[1] > grown[0]:
        grown, seen, yaw, middle = grown[::-1], seen[::-1], yaw + np.pi / 2.0, np.array([middle[1], -middle[0]])
    height = max(float(points[:, 2].max()) - ground_m, _TYPICAL_M[2])
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    centre = np.array([*(turn @ middle), ground_m + height / 2.0])
    yaw = float(np.arctan(np.tan(yaw)))
    return FittedBox(centre, np.array([*grown, height]), yaw, seen)


_TURNING_MPS: Final = 1.0
"""Above this speed a vehicle's heading is its direction of motion."""


def directed_yaw(yaw_rad: Floats, velocity_mps: Floats) -> Floats:
    """Turn headings around where a vehicle moves against them, shape ``(N,)``."""
    forward = np.cos(yaw_rad) * velocity_mps[:, 0] + np.sin(yaw_rad) * velocity_mps[:, 1]
    return np.where(forward < -_TURNING_MPS, yaw_rad + np.pi, yaw_rad)


_RANGE_M: Final = 55.0
_OWN_M: Final = 3.5
"""Returns nearer than this come from the vehicle with the LiDAR."""
_GROUND_M: Final = 0.25
_LEAST_TOP_M: Final = 0.9
_HIGHEST_M: Final = 3.9
"""Vehicles end between these heights. Hedges are lower; poles, trees and walls are higher."""
_MOST_CLEARANCE_M: Final = 0.9
_PLANE_M: Final = 0.1
_PLANE_POINTS: Final = 4000
_PLANE_DRAWS: Final = 100
_LEAST_AREA_M2: Final = 1.0
_STEEPEST: Final = 0.2
_NEIGHBOUR_M: Final = 0.7
_LEAST_POINTS: Final = 5
_LONGEST_M: Final = 13.0
_WIDEST_M: Final = 3.2
_SMALLEST_M: Final = 1.0
_MOVING_MPS: Final = 3.0
_FULL_TRACK: Final = 5
_LENGTH_M: Final = 2.5
_WIDTH_M: Final = 1.2
"""Least visible extents of a cluster that looks like a vehicle."""
_FULL_POINTS: Final = 60.0


def detect_classical(episode: EpisodeFrames) -> FoundBoxes:
    """Detect vehicles in all labelled sweeps of an episode, in the ``map`` frame.

    Raises:
        InputError: Open3D is not installed.
        BagError: The bag is damaged.
    """
    open3d = _open3d()
    frame_of_step = episode.frame_of_step
    tracker, rows = Tracker(), [np.zeros((0, 11))]
    with open_source(Path(episode.bag)) as source:
        topic = lidar_of(source).topic
        for step, held in source.messages_by_step({topic}):
            if step in frame_of_step:
                frame = frame_of_step[step]
                boxes = boxes_of_sweep(open3d, from_point_cloud(held[topic].read()))
                rows.append(boxes_in_map(frame, step, boxes, episode.map_from_lidar[frame], tracker))
    table = np.vstack(rows)
    velocity = table[:, 8:10]
    return FoundBoxes(
        frame=table[:, 0].astype(np.intp),
        centre_m=table[:, 1:4],
        size_m=table[:, 4:7],
        yaw_rad=table[:, 7],
        velocity_mps=velocity,
        attribute=attributes_of(velocity),
        score=table[:, 10],
        label=np.full(len(table), "car"),
    )


def _open3d() -> Any:
    try:
        return import_module("open3d")
    except ModuleNotFoundError as error:
        command = "`./env --with classical siren evaluate detection …`"
        raise InputError("detectors", "classical", f"{command}, which installs open3d") from error


def boxes_of_sweep(open3d: Any, points: npt.NDArray[np.void]) -> list[tuple[FittedBox, int]]:
    """Boxes of one sweep (fields x, y, z) in the LiDAR's frame, each with the number of its returns."""
    places = np.stack([points[name].astype(np.float64) for name in ("x", "y", "z")], axis=-1)
    flat = np.hypot(places[:, 0], places[:, 1])
    places = places[(flat > _OWN_M) & (flat < _RANGE_M)]
    if len(places) < _LEAST_POINTS:
        return []
    ground = ground_heights(places)
    above = places[:, 2] - ground
    stands = above > _GROUND_M
    standing, above, heights = places[stands], above[stands], ground[stands]
    if len(standing) < _LEAST_POINTS:
        return []
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(standing))
    cluster = np.asarray(cloud.cluster_dbscan(_NEIGHBOUR_M, _LEAST_POINTS))
    boxes = []
    for number in range(int(cluster.max(initial=-1)) + 1):
        inside = cluster == number
        if not (_LEAST_TOP_M < above[inside].max() < _HIGHEST_M and above[inside].min() < _MOST_CLEARANCE_M):
            continue
        box = fit_box(standing[inside], float(heights[inside].mean()))
        if box.size_m[0] <= _LONGEST_M and box.size_m[1] <= _WIDEST_M and box.seen_m.max() >= _SMALLEST_M:
            boxes.append((box, int(inside.sum())))
    return boxes


def ground_heights(places: Floats) -> Floats:
    """Ground height at each point, from the plane through most of the points (RANSAC), shape ``(N,)``.

    Open3D's own search shares its draws between threads, and then no two runs are alike.
    """
    rng = np.random.default_rng(0)
    searched = places[:: max(len(places) // _PLANE_POINTS, 1)]
    level = np.column_stack((searched[:, :2], np.ones(len(searched))))
    best, most = np.array([0.0, 0.0, float(np.median(searched[:, 2]))]), 0
    for rows in rng.integers(len(searched), size=(_PLANE_DRAWS, 3)):
        if abs(np.linalg.det(level[rows])) < _LEAST_AREA_M2:
            continue
        plane = np.linalg.solve(level[rows], searched[rows, 2])
        on_it = int((abs(level @ plane - searched[:, 2]) < _PLANE_M).sum())
        if on_it > most and abs(plane[:2]).max() < _STEEPEST:
            best, most = plane, on_it
    return places[:, :2] @ best[:2] + best[2]


def boxes_in_map(
    frame: int, step: int, boxes: list[tuple[FittedBox, int]], map_from_lidar: Matrix, tracker: Tracker
) -> Floats:
    """Place the boxes of a sweep in the map, follow them from sweep to sweep and score them.

    Args:
        frame: Number of the frame, which the table repeats.
        step: Step of the sweep; the tracker gets those of an episode in order.
        boxes: Boxes in the LiDAR's frame, each with the number of its returns.
        map_from_lidar: Transform of shape ``(4, 4)``.
        tracker: Knows the boxes of the sweeps before; it gives velocities, and with them the boxes' fronts.

    Returns:
        Frame, centre, size, yaw, velocity (two columns) and score of each box, shape ``(N, 11)``; metres, radians, m/s.
    """
    centre = np.array([box.centre_m for box, _ in boxes]).reshape(-1, 3) @ map_from_lidar[:3, :3].T
    centre += map_from_lidar[:3, 3]
    turn = np.arctan2(map_from_lidar[1, 0], map_from_lidar[0, 0])
    velocity, sweeps, _ = tracker.follow(step, centre[:, :2], STEP_S)
    yaw = directed_yaw(np.array([box.yaw_rad for box, _ in boxes]) + turn, velocity)
    size = np.array([box.size_m for box, _ in boxes]).reshape(-1, 3)
    points = np.array([count for _, count in boxes], dtype=np.float64)
    # The score is high for boxes that move, were tracked for long, are as wide as a vehicle and have many returns.
    seen = np.array([box.seen_m for box, _ in boxes]).reshape(-1, 2)
    shares = (
        np.minimum(np.hypot(velocity[:, 0], velocity[:, 1]) / _MOVING_MPS, 1.0),
        np.minimum(sweeps / _FULL_TRACK, 1.0),
        ((seen[:, 0] > _LENGTH_M) & (seen[:, 1] > _WIDTH_M)).astype(np.float64),
        np.minimum(points / _FULL_POINTS, 1.0),
    )
    score = np.mean(shares, axis=0)
    return np.column_stack((np.full(len(boxes), frame), centre, size, yaw, velocity, score))


Detect = Callable[[EpisodeFrames, Path | None], FoundBoxes]
"""Detects vehicles in all labelled sweeps of an episode. The path gives other weights than the detector's own."""


def _classical(episode: EpisodeFrames, weights: Path | None) -> FoundBoxes:
    if weights is not None:
        raise InputError("checkpoint", f"classical={weights}", "a detector that has weights: pillars")
    return detect_classical(episode)


DETECTORS: Final[Mapping[str, Detect]] = MappingProxyType(
    {
        "classical": _classical,
        "pillars": detect_pillars,
    }
)

SEEN: Final[Mapping[str, Callable[[Path | None], SeenEpisodes | None]]] = MappingProxyType(
    {"pillars": seen_in_training}
)
"""For learned detectors: gives the episodes in their training, from their weights."""


def run_detector(name: str, episode: EpisodeFrames, weights: Path | None) -> tuple[FoundBoxes, float]:
    """Run one of ``DETECTORS``; returns its boxes and its processor time in seconds, including the reading of sweeps.

    Raises:
        InputError: The detector cannot run here, or not with these weights.
        BagError: The bag is damaged.
    """
    start = time.process_time()
    boxes = DETECTORS[name](episode, weights)
    return boxes, time.process_time() - start
