"""The reference detector without learning, and its parts."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_outputs import assert_known
from made_detections import LIDAR_YAW_RAD, map_from_lidar, to_map

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.boxes import FoundSet
from siren_ros.scoring.evaluation.detection.detectors import (
    FittedBox,
    boxes_in_map,
    boxes_of_sweep,
    directed_yaw,
    fit_box,
    ground_heights,
    run_detector,
)
from siren_ros.scoring.evaluation.detection.frames import Frames
from siren_ros.scoring.evaluation.detection.metrics import devkit_score
from siren_ros.scoring.evaluation.detection.scoring import VEHICLE_NAMES, counted_boxes
from siren_ros.scoring.evaluation.detection.tracking import Tracker

GROUND_M = -1.8


def rotated(yaw_rad: float) -> np.ndarray:
    return np.array([[np.cos(yaw_rad), -np.sin(yaw_rad)], [np.sin(yaw_rad), np.cos(yaw_rad)]])


def sides(centre: tuple[float, float], yaw: float, length_m: float, width_m: float, top_m: float = 1.5) -> np.ndarray:
    """Points every 5 cm on the sides of a box that face the origin."""
    along, across = rotated(yaw).T
    middle = np.array(centre)
    points = []
    for axis, half, other, other_half in (
        (along, length_m / 2, across, width_m / 2),
        (across, width_m / 2, along, length_m / 2),
    ):
        facing = -np.sign(middle @ axis)
        steps = np.arange(-other_half, other_half + 1e-9, 0.05)
        points.extend(middle + facing * half * axis + step * other for step in steps)
    flat = np.array(points)
    return np.concatenate([np.column_stack((flat, np.full(len(flat), GROUND_M + z))) for z in (0.4, top_m)])


@pytest.mark.parametrize("centre", [(12.0, 5.0), (12.0, -5.0), (-12.0, 5.0), (-10.0, -8.0), (3.0, 14.0)])
@pytest.mark.parametrize("degrees", [0.0, 20.0, -35.0, 60.0, -89.0, 90.0, 150.0])
def test_a_car_is_where_it_is_and_as_long_as_it_is(centre: tuple[float, float], degrees: float) -> None:
    """5 m by 2 m, larger than a typical car, so that nothing is added."""
    yaw = np.radians(degrees)
    box = fit_box(sides(centre, yaw, 5.0, 2.0), GROUND_M)
    assert box.centre_m == pytest.approx([*centre, GROUND_M + 1.55 / 2.0], abs=0.06)
    assert box.size_m == pytest.approx([5.0, 2.0, 1.55], abs=0.06)
    assert box.seen_m == pytest.approx([5.0, 2.0], abs=0.06)
    assert np.cos(2.0 * (box.yaw_rad - yaw)) == pytest.approx(1.0, abs=0.01)
    assert abs(box.yaw_rad) <= np.pi / 2.0 + 1e-9


@pytest.mark.parametrize("turn", [0.0, 90.0, 180.0, 270.0])
def test_a_rear_alone_is_grown_away_from_the_sensor(turn: float) -> None:
    """1.8 m wide, 10 m ahead: a car of 4.5 m by 1.9 m stands behind it, and 3 m are its height."""
    angle = np.radians(turn)
    rear = np.stack((np.full(37, 10.0), np.arange(-0.9, 0.901, 0.05)), axis=-1)
    rotation = rotated(angle)
    flat = rear @ rotation.T
    points = np.concatenate([np.column_stack((flat, np.full(len(flat), GROUND_M + z))) for z in (0.4, 3.0)])
    box = fit_box(points, GROUND_M)
    assert box.centre_m[:2] @ rotation == pytest.approx([10.0 + 2.25, 0.0], abs=0.06)
    assert box.size_m == pytest.approx([4.5, 1.9, 3.0], abs=0.06)
    assert box.seen_m == pytest.approx([0.0, 1.8], abs=0.06)
    assert np.cos(2.0 * (box.yaw_rad - angle)) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("turn", [0.0, 90.0, 180.0])
@pytest.mark.parametrize(
    ("right_m", "left_m", "middle_m"),
    [(-1.2, 1.8, 1.05), (-1.8, 1.2, -1.05), (-1.4, 1.6, 0.85), (-11.0, -8.0, -10.25)],
)
def test_a_side_alone_is_the_length_and_grows_at_its_longer_part(
    turn: float, right_m: float, left_m: float, middle_m: float
) -> None:
    """3 m of a side: longer than a car is wide; of 4.5 m what is missing lies where more of it was seen, or farther."""
    angle = np.radians(turn)
    side = np.stack((np.full(61, 4.0), np.linspace(right_m, left_m, 61)), axis=-1)
    rotation = rotated(angle)
    box = fit_box(np.column_stack((side @ rotation.T, np.full(61, GROUND_M + 1.0))), GROUND_M)
    assert box.centre_m[:2] @ rotation == pytest.approx([4.0 + 0.95, middle_m], abs=0.03)
    assert box.size_m == pytest.approx([4.5, 1.9, 1.55], abs=0.06)


@pytest.mark.parametrize("turn", [0.0, 1.2, -2.5])
@pytest.mark.parametrize(("speed_mps", "turned"), [(1.5, False), (-0.9, False), (-1.1, True)])
def test_a_heading_is_turned_round_from_walking_pace_on(turn: float, speed_mps: float, *, turned: bool) -> None:
    velocity = speed_mps * np.array([[np.cos(turn), np.sin(turn)]])
    assert directed_yaw(np.array([turn]), velocity) == pytest.approx([turn + np.pi if turned else turn])


@pytest.mark.parametrize("slope", [(0.0, 0.0), (-0.1, 0.08)])
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
        (block(58.0, 0.0, 1.5, 1.5, 0.3, 1.5), False),
        (block(0.0, -58.0, 1.5, 1.5, 0.3, 1.5), False),
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


def fitted(x_m: float, y_m: float, seen: tuple[float, float] = (4.0, 1.5)) -> FittedBox:
    return FittedBox(np.array([x_m, y_m, -1.0]), np.array([4.5, 1.9, 1.6]), 0.3, np.array(seen))


def test_boxes_are_placed_in_the_map() -> None:
    (row,) = boxes_in_map(5, 10, [(fitted(12.0, 3.0), 30)], map_from_lidar(5), Tracker())
    assert row[0] == 5
    assert row[1:4] == pytest.approx(to_map(5, 12.0, 3.0, -1.0))
    assert row[4:7].tolist() == [4.5, 1.9, 1.6]
    assert row[7] == pytest.approx(0.3 + LIDAR_YAW_RAD)
    assert row[8:10].tolist() == [0.0, 0.0]
    # Stands; seen once of five times; as large as a vehicle; 30 of 60 returns.
    assert row[10] == pytest.approx((0.0 + 0.2 + 1.0 + 0.5) / 4.0)
    assert boxes_in_map(5, 10, [], map_from_lidar(5), Tracker()).shape == (0, 11)


def test_confidence_grows_with_motion_time_size_and_returns() -> None:
    """In the map the vehicle moves along x by 1 m in 0.1 s: the LiDAR moves with it, a metre per frame."""
    tracker = Tracker()
    for frame in range(5):
        rows = boxes_in_map(frame, 2 * frame, [(fitted(12.0, 3.0, (2.0, 1.5)), 90)], map_from_lidar(frame), tracker)
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
        (row,) = boxes_in_map(frame, 2 * frame, [(fitted(12.0, 3.0), 90)], place, tracker)
    # It moves against x; the box points to 0.3 rad + 60°, so that its other end is the front.
    assert np.cos(row[7]) < 0.0
    assert row[7] == pytest.approx(0.3 + LIDAR_YAW_RAD + np.pi)


def test_what_is_no_vehicle_keeps_no_other_from_being_found() -> None:
    """Three clusters in any order: a hedge, a car, a wall."""
    open3d = pytest.importorskip("open3d")
    car, hedge = block(15.0, 5.0, 4.5, 1.8, 0.3, 1.5), block(-15.0, 5.0, 4.5, 1.8, 0.3, 0.7)
    wall = block(0.0, -15.0, 15.0, 1.8, 0.3, 1.5)
    for parts in ((car, hedge, wall), (hedge, wall, car), (wall, car, hedge)):
        ((box, _),) = boxes_of_sweep(open3d, sweep_of(GROUND, *parts))
        assert box.centre_m[:2] == pytest.approx([15.0, 5.0], abs=0.1)
    assert boxes_of_sweep(open3d, sweep_of(np.zeros((0, 3)))) == boxes_of_sweep(open3d, sweep_of(GROUND)) == []


def test_it_finds_vehicles_of_a_recorded_episode(frames: Frames) -> None:
    with pytest.raises(InputError, match="a detector that has weights"):
        run_detector("classical", frames.episodes[0], Path("made.onnx"))
    boxes, _ = run_detector("classical", frames.episodes[0], None)
    score = devkit_score(*counted_boxes(frames, FoundSet("c", "c", boxes, frames.scored, True), VEHICLE_NAMES))
    assert score.average_precision[2.0] > 0.1
    assert score.errors["ATE"] < 1.0


def test_boxes_of_four_sweeps_in_the_map() -> None:
    """Cars, a van and a bus around the LiDAR, which drives on; one is lost in the third sweep."""
    found, tracker = {}, Tracker()
    vehicles = ((12.0, 5.0, 0.35, 4.4, 1.8, 1.5), (-15.0, 7.0, -0.6, 5.4, 2.0, 2.4), (9.0, -14.0, 1.2, 11.0, 2.5, 3.0))
    vehicles += ((-8.0, -9.0, 2.8, 4.0, 1.7, 1.4),)
    for number in range(4):
        boxes = []
        for place, (x, y, yaw, length, width, top) in enumerate(vehicles):
            if (number, place) != (2, 1):
                points = sides((x + 0.8 * number * (place + 1), y - 0.2 * number), yaw, length, width, top)
                boxes.append((fit_box(points, GROUND_M), len(points) // 2))
        rows = boxes_in_map(number, 2 * number, boxes, map_from_lidar(number), tracker)
        found[str(number)] = [rows, [(box.yaw_rad, *box.seen_m) for box, _ in boxes]]
    assert_known(Path(__file__).parent / "known" / "classical.json", found, digits=6, decimals=5)
