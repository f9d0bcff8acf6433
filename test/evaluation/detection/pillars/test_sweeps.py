"""What stands still stays in place over the sweeps of a vehicle that drives and turns."""

import numpy as np
import pytest

from siren_ros.evaluation.detection.pillars.sweeps import SweepMemory
from siren_ros.numerics.arrays import Matrix

POST_M = np.array([20.0, 7.0, 1.0])


def _pose(x_m: float, y_m: float, yaw_rad: float) -> Matrix:
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[cos, -sin, 0, x_m], [sin, cos, 0, y_m], [0, 0, 1.0, 1.9], [0, 0, 0, 1.0]])


def _sweep(places_m: np.ndarray) -> np.ndarray:
    points = np.zeros(len(places_m), dtype=[(name, "<f4") for name in ("x", "y", "z", "intensity")])
    points["x"], points["y"], points["z"] = places_m.T
    return points


def _seen(pose: Matrix) -> np.ndarray:
    return (np.linalg.inv(pose) @ [*POST_M, 1.0])[None, :3]


def test_the_motion_of_the_vehicle_is_taken_out() -> None:
    memory = SweepMemory(3)
    poses = [_pose(1.0 * step, 0.1 * step, 0.05 * step) for step in range(5)]
    for step, pose in enumerate(poses):
        memory.add(step, _sweep(_seen(pose)), pose)
    points = memory.points()
    assert points[:, :3] == pytest.approx(np.repeat(_seen(poses[-1]), 3, axis=0), abs=1e-5)
    assert points[:, 4] == pytest.approx([0.0, 0.05, 0.1])


def test_returns_of_the_own_vehicle_are_left_out() -> None:
    memory = SweepMemory(2)
    memory.add(0, _sweep(np.array([[3.0, 1.0, 0.0], [3.0, 2.0, 0.0], [-4.0, -1.2, 0.5]])), np.eye(4))
    assert memory.points()[:, :2].tolist() == [[3.0, 2.0]]


def test_a_step_back_begins_anew() -> None:
    memory = SweepMemory(3)
    for step in (7, 8, 3):
        memory.add(step, _sweep(np.array([[10.0, float(step), 0.0]])), np.eye(4))
    assert memory.points()[:, 1].tolist() == [3.0]
