"""Targets of boxes at known places, and the way back from them."""

import numpy as np
import pytest

from siren_ros.evaluation.detection.metrics.named_classes import CLASS_NAMES
from siren_ros.evaluation.detection.pillars.grid import PillarGrid
from siren_ros.training.detection.targets import BOX_CHANNELS, gaussian_radius, targets_of

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
        told = dict(zip(BOX_CHANNELS, channels.tolist(), strict=True))
        row, column = divmod(int(cell), 16)
        assert (column + 0.5) * 2.0 - 16.0 + told["dx"] == pytest.approx(CAR[0], abs=1e-5)
        assert (row + 0.5) * 2.0 - 16.0 + told["dy"] == pytest.approx(CAR[1], abs=1e-5)
        sizes = [np.exp(told[f"log_{name}"]) for name in ("length", "width", "height")]
        assert sizes == pytest.approx(CAR[3:6], rel=1e-5)
        assert np.arctan2(told["sin"], told["cos"]) == pytest.approx(CAR[6], abs=1e-5)
        assert (told["z"], told["vx"], told["vy"]) == pytest.approx((CAR[2], CAR[7], CAR[8]))


def test_a_cell_between_two_belongs_to_the_nearer_centre() -> None:
    ambulance = (7.3, -4.6, *CAR[2:9], float(CLASS_NAMES.index("ambulance")), 5.0)
    targets = targets_of(_boxes(CAR, ambulance), GRID)
    label = dict(zip(targets.cell.tolist(), targets.label.tolist(), strict=True))
    assert (label[5 * 16 + 9], label[5 * 16 + 11]) == (0, CLASS_NAMES.index("ambulance"))
    assert len(targets.cell) == 15


def test_vehicles_without_a_return_teach_nothing() -> None:
    hidden = (*CAR[:10], 0.0)
    targets = targets_of(_boxes(hidden), GRID)
    assert targets.heat.max() == 0.0
    assert targets.counts[5, 9] == 0.0
    assert targets.counts[0, 0] == 1.0
    assert len(targets.cell) == 0


def test_boxes_outside_are_no_targets() -> None:
    assert len(targets_of(_boxes((16.1, *CAR[1:])), GRID).cell) == 0


@pytest.mark.parametrize(("length", "width"), [(4.5, 1.8), (12.0, 2.55), (2.0, 2.0)])
def test_a_box_shifted_by_the_radius_overlaps_by_the_share(length: float, width: float) -> None:
    radius = gaussian_radius(length, width, 0.3)
    shared = (length - radius) * (width - radius)
    assert shared / (2.0 * length * width - shared) == pytest.approx(0.3)
