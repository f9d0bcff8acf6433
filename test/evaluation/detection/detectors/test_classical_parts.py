"""The ground's plane, clusters that are taken for vehicles, and boxes in the map with their confidence."""

from contextlib import nullcontext
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from evaluation.made_frames import LIDAR_YAW_RAD, map_from_lidar, to_map

from siren_ros.evaluation.detection.detectors import classical
from siren_ros.evaluation.detection.detectors.box_fitting import FittedBox
from siren_ros.evaluation.detection.detectors.classical import _in_map, boxes_of_sweep, ground_heights
from siren_ros.evaluation.detection.detectors.tracker import Tracker


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.05, -0.03), (-0.1, 0.08)])
def test_the_ground_is_the_plane_of_most_points(slope: tuple[float, float]) -> None:
    """A third of the points stand on it, up to 3 m high."""
    rng = np.random.default_rng(1)
    flat = rng.uniform(-40.0, 40.0, size=(900, 2))
    ground = flat @ slope - 1.8
    above = np.where(np.arange(900) % 3 == 0, rng.uniform(0.3, 3.0, 900), rng.uniform(-0.02, 0.02, 900))
    found = ground_heights(np.column_stack((flat, ground + above)))
    assert found == pytest.approx(ground, abs=0.1)


def test_a_wall_is_no_ground() -> None:
    """Most points lie on an upright plane; the ground is steeper than any road where it were that."""
    rng = np.random.default_rng(2)
    wall = np.column_stack((20.0 + rng.normal(0.0, 0.001, 600), rng.uniform(-20, 20, 600), rng.uniform(-1.8, 6, 600)))
    road = np.column_stack((rng.uniform(-30, 20, (300, 2)), np.full(300, -1.8)))
    found = ground_heights(np.concatenate((wall, road)))
    assert found[600:] == pytest.approx(np.full(300, -1.8), abs=0.1)


def sweep_of(*parts: np.ndarray) -> Any:
    places = np.concatenate(parts).astype(np.float32)
    points = np.zeros(len(places), dtype=[("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
    points["x"], points["y"], points["z"] = places.T
    return points


def block(x_m: float, y_m: float, length_m: float, width_m: float, low_m: float, high_m: float) -> np.ndarray:
    """Points every 30 cm on the sides of a block above the ground at −1.8 m."""
    along = np.arange(-length_m / 2, length_m / 2 + 0.01, 0.3)
    across = np.arange(-width_m / 2, width_m / 2 + 0.01, 0.3)
    heights = np.arange(low_m, high_m + 0.01, 0.3) - 1.8
    sides = [(x, s * width_m / 2) for x in along for s in (-1, 1)] + [
        (s * length_m / 2, y) for y in across for s in (-1, 1)
    ]
    return np.array([(x_m + x, y_m + y, z) for x, y in sides for z in heights])


GROUND = np.array([(x, y, -1.8) for x in np.arange(-30.0, 30.0, 1.5) for y in np.arange(-30.0, 30.0, 1.5)])


@pytest.mark.parametrize(
    ("thing", "found"),
    [
        (block(15.0, 5.0, 4.5, 1.8, 0.3, 1.5), True),
        (block(15.0, 5.0, 4.5, 1.8, 0.3, 0.7), False),  # a hedge
        (block(15.0, 5.0, 4.5, 1.8, 0.3, 4.5), False),  # a house
        (block(15.0, 5.0, 4.5, 1.8, 1.2, 1.8), False),  # a branch
        (block(15.0, 5.0, 15.0, 1.8, 0.3, 1.5), False),  # a wall
        (block(15.0, 5.0, 6.0, 5.0, 0.3, 1.5), False),  # a shed
        (block(15.0, 5.0, 0.3, 0.3, 0.3, 1.5), False),  # a post
        (block(2.0, 1.0, 1.2, 1.2, 0.3, 1.5), False),  # the own vehicle
        (block(50.0, 40.0, 4.5, 1.8, 0.3, 1.5), False),  # out of range
    ],
)
def test_what_is_as_large_as_a_vehicle_and_stands_on_the_ground(thing: np.ndarray, *, found: bool) -> None:
    open3d = pytest.importorskip("open3d")
    boxes = boxes_of_sweep(open3d, sweep_of(GROUND, thing))
    assert len(boxes) == int(found)
    if found:
        ((box, count),) = boxes
        assert count == len(thing)
        assert box.centre_m == pytest.approx([15.0, 5.0, -1.8 + 1.55 / 2.0], abs=0.1)


def test_nothing_is_found_among_nothing() -> None:
    open3d = import_module("open3d")
    assert boxes_of_sweep(open3d, sweep_of(np.zeros((0, 3)))) == []
    assert boxes_of_sweep(open3d, sweep_of(GROUND)) == []


def fitted(x_m: float, y_m: float, seen: tuple[float, float] = (4.0, 1.5)) -> FittedBox:
    return FittedBox(np.array([x_m, y_m, -1.0]), np.array([4.5, 1.9, 1.6]), 0.3, np.array(seen))


def test_boxes_are_placed_in_the_map() -> None:
    (row,) = _in_map(5, 10, [(fitted(12.0, 3.0), 30)], map_from_lidar(5), Tracker())
    assert row[0] == 5
    assert row[1:4] == pytest.approx(to_map(5, 12.0, 3.0, -1.0))
    assert row[4:7].tolist() == [4.5, 1.9, 1.6]
    assert row[7] == pytest.approx(0.3 + LIDAR_YAW_RAD)
    assert row[8:10].tolist() == [0.0, 0.0]
    # Stands; seen once of five times; as large as a vehicle; 30 of 60 returns.
    assert row[10] == pytest.approx((0.0 + 0.2 + 1.0 + 0.5) / 4.0)
    assert _in_map(5, 10, [], map_from_lidar(5), Tracker()).shape == (0, 11)


def test_confidence_grows_with_motion_time_size_and_returns() -> None:
    """In the map the vehicle moves along x by 1 m in 0.1 s: the LiDAR moves with it, a metre per frame."""
    tracker = Tracker()
    for frame in range(5):
        rows = _in_map(frame, 2 * frame, [(fitted(12.0, 3.0, (2.0, 1.5)), 90)], map_from_lidar(frame), tracker)
    (row,) = rows
    speed = float(np.hypot(row[8], row[9]))
    assert row[8] > 3.0
    assert abs(row[9]) < 1e-6
    assert speed == pytest.approx(row[8])
    # Moves; seen five times; too short to look like a vehicle; enough returns.
    assert row[10] == pytest.approx((1.0 + 1.0 + 0.0 + 1.0) / 4.0)


def test_the_front_is_where_the_vehicle_moves() -> None:
    tracker, turned = Tracker(), map_from_lidar(0)
    for frame in range(8):
        place = turned.copy()
        place[0, 3] -= frame
        (row,) = _in_map(frame, 2 * frame, [(fitted(12.0, 3.0), 90)], place, tracker)
    # It moves against x; the box points to 0.3 rad + 60°, so that its other end is the front.
    assert np.cos(row[7]) < 0.0
    assert row[7] == pytest.approx(0.3 + LIDAR_YAW_RAD + np.pi)


@pytest.mark.parametrize(
    ("x_m", "y_m", "found"),
    [
        (15.0, 0.0, True),
        (0.0, 15.0, True),
        (-15.0, 0.0, True),
        (58.0, 0.0, False),
        (0.0, -58.0, False),
        (1.0, 0.5, False),
    ],
)
def test_range_and_the_own_vehicle_are_measured_along_both_axes(x_m: float, y_m: float, found: bool) -> None:
    open3d = pytest.importorskip("open3d")
    boxes = boxes_of_sweep(open3d, sweep_of(GROUND, block(x_m, y_m, 1.5, 1.5, 0.3, 1.5)))
    assert len(boxes) == int(found)


def test_what_is_no_vehicle_keeps_no_other_from_being_found() -> None:
    """Three clusters in any order: a hedge, a car, a wall."""
    open3d = pytest.importorskip("open3d")
    car, hedge = block(15.0, 5.0, 4.5, 1.8, 0.3, 1.5), block(-15.0, 5.0, 4.5, 1.8, 0.3, 0.7)
    wall = block(0.0, -15.0, 15.0, 1.8, 0.3, 1.5)
    for parts in ((car, hedge, wall), (hedge, wall, car), (wall, car, hedge)):
        ((box, _),) = boxes_of_sweep(open3d, sweep_of(GROUND, *parts))
        assert box.centre_m[:2] == pytest.approx([15.0, 5.0], abs=0.1)


def test_boxes_of_labelled_sweeps_come_with_their_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sweeps at steps 4, 6, 8 and 10, of which 4, 8 and 10 are labelled: the second has no box, the third two."""
    boxes = {4: [(fitted(12.0, 3.0), 30)], 6: [(fitted(1.0, 1.0), 9)], 8: [], 10: [(fitted(5.0, 0.0), 60)] * 2}
    messages = [(step, {"/lidar": SimpleNamespace(read=lambda step=step: step)}) for step in boxes]
    source = SimpleNamespace(messages_by_step=lambda wanted: messages if wanted == {"/lidar"} else [])
    replaced: dict[str, Any] = {
        "_open3d": lambda: None,
        "open_source": lambda _: nullcontext(source),
        "lidar_of": lambda _: SimpleNamespace(topic="/lidar"),
        "from_point_cloud": lambda step: step,
        "boxes_of_sweep": lambda _, step: boxes[step],
    }
    for name, value in replaced.items():
        monkeypatch.setattr(classical, name, value)
    poses = np.array([map_from_lidar(frame) for frame in range(3)])
    episode: Any = SimpleNamespace(step=np.array([4, 8, 10]), bag="bag", map_from_lidar=poses)
    found = classical.detect_classical(episode)
    assert found.frame.tolist() == [0, 2, 2]
    assert found.centre_m[0] == pytest.approx(to_map(0, 12.0, 3.0, -1.0))
    assert found.centre_m[1] == pytest.approx(to_map(2, 5.0, 0.0, -1.0))
    assert found.size_m.tolist() == [[4.5, 1.9, 1.6]] * 3
    assert found.yaw_rad == pytest.approx(np.full(3, 0.3 + LIDAR_YAW_RAD))
    assert found.velocity_mps.tolist() == [[0.0, 0.0]] * 3
    assert found.attribute.tolist() == [2] * 3, "they stand"
    assert found.label.tolist() == ["car"] * 3
    assert found.score[1] > found.score[0], "it has more returns"
