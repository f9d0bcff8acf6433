"""Training samples of detection, and the batches of them."""

from dataclasses import replace

import numpy as np
import pytest
from datasets.made_bag import truth_of
from made_training_data import SMALL_GRID, made_episode

from siren_ros.errors import InputError
from siren_ros.lab.training.detection.samples import (
    BOX_CHANNELS,
    FrameDraws,
    TrainingFrame,
    boxes_of_truth,
    check_apart,
    frames_among,
    gaussian_radius,
    read_frames_file,
    targets_of,
    turned,
    varied,
    write_frames,
)
from siren_ros.scoring.evaluation.detection.boxes import CLASS_NAMES
from siren_ros.scoring.evaluation.detection.pillar_detector import PillarGrid
from siren_ros.simulation.world.actors import ActorClass

BOX = np.array([[10.0, 4.0, -0.5, 4.0, 2.0, 1.5, 0.6, 5.0, 1.0, 0.0, 9.0]], dtype=np.float32)


def _frame() -> TrainingFrame:
    """One vehicle with a return at its front left lower corner, now and half a second ago."""
    ahead, left = np.array([np.cos(0.6), np.sin(0.6)]), np.array([-np.sin(0.6), np.cos(0.6)])
    corner = BOX[0, :2] + 2.0 * ahead + 1.0 * left
    rows = [(*corner, -1.25, 0.3, 0.0), (*(corner - 0.5 * BOX[0, 7:9]), -1.25, 0.3, 0.5)]
    return TrainingFrame(np.array(rows, dtype=np.float32), BOX.copy())


def _in_box(frame: TrainingFrame) -> np.ndarray:
    """The newest point along, across and above the middle of the box, in halves of its size."""
    box, point = frame.boxes[0], frame.points[0]
    away, yaw = point[:2] - box[:2], box[6]
    along, across = np.cos(yaw) * away[0] + np.sin(yaw) * away[1], np.cos(yaw) * away[1] - np.sin(yaw) * away[0]
    return np.array([along, across, point[2] - box[2]]) / (0.5 * box[3:6])


@pytest.mark.parametrize("angle_rad", [0.0, 1.1, -2.8])
@pytest.mark.parametrize(("mirrored", "side"), [(False, 1.0), (True, -1.0)])
def test_a_corner_stays_the_corner(angle_rad: float, mirrored: bool, side: float) -> None:
    frame = turned(_frame(), angle_rad, mirrored=mirrored, scale=1.04)
    assert _in_box(frame) == pytest.approx([1.0, side, -1.0], abs=1e-5)
    velocity = (frame.points[0, :2] - frame.points[1, :2]) / 0.5
    assert velocity == pytest.approx(frame.boxes[0, 7:9], abs=1e-4)
    assert np.hypot(*frame.boxes[0, 7:9]) == pytest.approx(1.04 * np.hypot(5.0, 1.0), rel=1e-5)
    frame, random = _frame(), np.random.default_rng(3)
    first, second = varied(frame, random), varied(frame, random)
    assert abs(_in_box(first)) == pytest.approx([1.0, 1.0, 1.0], abs=1e-4)
    assert not np.allclose(first.points, second.points)
    assert np.array_equal(frame.boxes, BOX), "variants leave the frame alone"


GRID = PillarGrid(half_width_m=16.0, cells=64)
"""Cells of the answer: 16 along each axis, 2 m wide."""
CAR = (3.3, -4.6, -1.0, 4.5, 1.8, 1.5, 0.7, 3.0, -1.0, 0.0, 12.0)


def _boxes(*rows: tuple[float, ...]) -> np.ndarray:
    return np.array(rows, dtype=np.float32).reshape(-1, 11)


def test_the_centre_is_the_only_highest_cell() -> None:
    targets = targets_of(_boxes(CAR), GRID)
    # x 3.3 is in column (3.3 + 16) / 2 = 9, y -4.6 in row 5.
    assert np.argwhere(targets.heat == 1.0).tolist() == [[5, 9]]
    assert targets.heat[5, 10] == pytest.approx(np.exp(-1.0 / (2.0 * 0.5**2)))
    assert targets.heat[8, 9] == 0.0
    assert targets.counts.all()


def test_channels_lead_back_to_the_box_from_every_cell() -> None:
    targets = targets_of(_boxes(CAR), GRID)
    assert len(targets.cell) == 9
    for cell, channels in zip(targets.cell, targets.box, strict=True):
        box = dict(zip(BOX_CHANNELS, channels.tolist(), strict=True))
        row, column = divmod(int(cell), 16)
        assert (column + 0.5) * 2.0 - 16.0 + box["dx"] == pytest.approx(CAR[0], abs=1e-5)
        assert (row + 0.5) * 2.0 - 16.0 + box["dy"] == pytest.approx(CAR[1], abs=1e-5)
        sizes = [np.exp(box[f"log_{name}"]) for name in ("length", "width", "height")]
        assert sizes == pytest.approx(CAR[3:6], rel=1e-5)
        assert np.arctan2(box["sin"], box["cos"]) == pytest.approx(CAR[6], abs=1e-5)
        assert (box["z"], box["vx"], box["vy"]) == pytest.approx((CAR[2], CAR[7], CAR[8]))


def test_a_cell_between_two_belongs_to_the_nearer_centre() -> None:
    ambulance = (7.3, -4.6, *CAR[2:9], float(CLASS_NAMES.index("ambulance")), 5.0)
    targets = targets_of(_boxes(CAR, ambulance), GRID)
    label = dict(zip(targets.cell.tolist(), targets.label.tolist(), strict=True))
    assert (label[5 * 16 + 9], label[5 * 16 + 11]) == (0, CLASS_NAMES.index("ambulance"))
    assert len(targets.cell) == 15


def test_vehicles_without_a_return_and_boxes_outside_teach_nothing() -> None:
    hidden = (*CAR[:10], 0.0)
    targets = targets_of(_boxes(hidden), GRID)
    assert targets.heat.max() == 0.0
    assert targets.counts[5, 9] == 0.0
    assert targets.counts[0, 0] == 1.0
    outside = targets_of(_boxes((16.1, *CAR[1:])), GRID)
    assert len(targets.cell) == len(outside.cell) == 0


@pytest.mark.parametrize(("length", "width"), [(4.5, 1.8), (12.0, 2.55), (2.0, 2.0)])
def test_a_box_shifted_by_the_radius_overlaps_by_the_share(length: float, width: float) -> None:
    radius = gaussian_radius(length, width, 0.3)
    shared = (length - radius) * (width - radius)
    assert shared / (2.0 * length * width - shared) == pytest.approx(0.3)


def _draws(seed: int = 0) -> FrameDraws:
    return FrameDraws([made_episode(1, 4), made_episode(2, 3)], SMALL_GRID, seed, 2)


def test_every_frame_comes_once_in_each_turn_and_a_step_is_the_same_whenever_it_is_asked_for() -> None:
    draws = _draws()
    rows = [row for step in range(7) for row in draws.rows(step)]
    assert sorted(rows[:7]) == sorted(rows[7:]) == list(range(7))
    assert rows[:7] != rows[7:]
    (pillars, target), _ = _draws().batch_of(5)
    (again, same), _ = _draws().batch_of(5)
    assert np.array_equal(pillars.points, again.points)
    assert np.array_equal(target.heat, same.heat)
    assert not np.array_equal(target.heat, _draws(1).batch_of(5)[0][1].heat)


def test_a_file_keeps_frames_to_two_millimetres_and_others_are_refused(tmp_path) -> None:
    frames = made_episode(4, 2)
    write_frames(tmp_path / "a.npz", frames)
    read = read_frames_file(tmp_path / "a.npz")
    assert (read.about, len(read)) == (frames.about, 2)
    (again,) = frames_among([tmp_path / "a.npz"], tmp_path, SMALL_GRID, print)
    assert np.array_equal(again.frame(1).points, frames.frame(1).points)
    assert np.array_equal(again.frame(1).boxes, frames.frame(1).boxes)
    assert frames.frame(1).points[0, 3] == pytest.approx(0.4, abs=0.002)
    (tmp_path / "a.npz").write_bytes(b"nothing")
    with pytest.raises(InputError, match="a file of an earlier run"):
        frames_among([tmp_path / "a.npz"], tmp_path, SMALL_GRID, print)


def test_seeds_and_maps_of_the_training_do_not_judge() -> None:
    trained = [{"template": "S1", "map": "town", "seed": 4}]
    check_apart(trained, [{"template": "S1", "map": "town", "seed": 5}, {"template": "S1", "map": "b", "seed": 4}])
    with pytest.raises(InputError, match="S2 on town, seed 4"):
        check_apart(trained, [{"template": "S2", "map": "town", "seed": 4}])


def test_people_are_no_vehicles() -> None:
    """Of a car and a bus; then one of them is a person."""
    truth = truth_of(10)
    whole = boxes_of_truth(truth)
    assert len(whole) == 2
    for kind in (ActorClass.PEDESTRIAN, ActorClass.BICYCLE, ActorClass.MOTORCYCLE):
        changed = replace(truth, actor_class=np.array([kind, ActorClass.BUS], dtype=np.uint8))
        assert np.array_equal(boxes_of_truth(changed), whole[1:])
