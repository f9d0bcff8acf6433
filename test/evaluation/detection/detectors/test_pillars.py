"""Points at known places end in the pillars that contain them, with the features that the formulas give."""

from dataclasses import replace

import numpy as np
import pytest

from siren_ros.evaluation.detection.detectors.pillars import FEATURES, PillarGrid, pillars_of, sorted_points

GRID = PillarGrid(half_width_m=8.0, cells=16, points=4, pillars=50)


def _points(*rows: tuple[float, ...]) -> np.ndarray:
    return np.array([(*row, 0.5, 0.1)[:5] for row in rows], dtype=np.float32).reshape(-1, 5)


def test_a_point_is_in_the_pillar_that_contains_it() -> None:
    found = sorted_points(_points((2.4, -3.2, 0.0)), GRID)
    # One metre a cell: x from 2 to 3 is column 10, y from -4 to -3 is row 4.
    assert found.cell.tolist() == [4 * 16 + 10]
    assert found.count.tolist() == [1]


def test_points_outside_are_left_out() -> None:
    outside = _points((8.1, 0.0, 0.0), (0.0, -8.1, 0.0), (6.0, 6.0, 0.0), (1.0, 1.0, 3.1), (1.0, 1.0, -5.1))
    assert len(pillars_of(outside, GRID)) == 0
    assert len(pillars_of(_points((5.6, 5.6, 3.0)), GRID)) == 1


def test_features_are_places_and_ways_from_mean_and_middle() -> None:
    found = pillars_of(_points((2.2, -3.4, 1.0), (2.6, -3.8, 0.0)), GRID)
    first = dict(zip(FEATURES, found.points[0, 0].tolist(), strict=True))
    expected = {"x": 2.2 / 8.0, "y": -3.4 / 8.0, "z": 0.5, "intensity": 0.5, "age": 0.4}
    expected |= {"x_mean": -0.2, "y_mean": 0.2, "z_mean": 0.5, "x_middle": -0.3, "y_middle": 0.1}
    assert first == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("cell_m", [0.5, 2.0])
def test_middles_of_cells_of_another_width(cell_m: float) -> None:
    """A point 0.1 m behind and 0.2 m left of the middle of a cell."""
    grid = PillarGrid(half_width_m=8.0, cells=round(16 / cell_m), points=4, pillars=50)
    column, row = round(10 / cell_m), round(4 / cell_m)
    middle_x, middle_y = (column + 0.5) * cell_m - 8.0, (row + 0.5) * cell_m - 8.0
    found = pillars_of(_points((middle_x - 0.1, middle_y + 0.2, 0.0)), grid)
    assert found.cell.tolist() == [row * grid.cells + column]
    assert found.points[0, 0, -2:] == pytest.approx([-0.1, 0.2], abs=1e-6)


def test_free_slots_repeat_the_first_point() -> None:
    found = pillars_of(_points((2.2, -3.4, 1.0), (2.6, -3.8, 0.0)), GRID)
    assert np.array_equal(found.points[0, 2], found.points[0, 0])
    assert not np.array_equal(found.points[0, 1], found.points[0, 0])


def test_a_full_pillar_keeps_a_sample_of_all_its_points() -> None:
    """Each of 40 points has a chance of 4 in 40: over many frames the kept ones are spread over all of them."""
    kept = np.zeros(40)
    for shift in range(100):
        points = np.zeros((40 + shift, 5), dtype=np.float32)
        points[:shift, :2], points[shift:, :2] = (-3.5, -3.5), (0.5, 0.5)
        points[shift:, 3] = np.arange(40) / 40.0
        found = sorted_points(points, GRID)
        slots = found.slots[found.cell == 8 * 16 + 8][0, :, 3]
        kept[np.rint(slots * 40.0).astype(int)] += 1
    assert kept.sum() == 400
    assert kept[:20].sum() == pytest.approx(200, abs=60)
    assert np.array_equal(sorted_points(points, GRID).slots, found.slots)


def test_pillars_of_the_newest_points_come_first() -> None:
    points = _points((0.5, 0.5, 0.0), (1.5, 0.5, 0.0), (2.5, 0.5, 0.0))
    found = pillars_of(points, replace(GRID, pillars=2))
    assert found.cell.tolist() == [8 * 16 + 8, 8 * 16 + 9]


@pytest.mark.parametrize(
    ("x_m", "y_m", "cell"),
    [(-8.0, 0.0, 8 * 16), (0.0, -8.0, 8), (8.0, 0.0, None), (0.0, 8.0, None), (7.999, 0.0, 8 * 16 + 15)],
)
def test_the_grid_holds_its_lower_edges_and_not_its_upper_ones(x_m: float, y_m: float, cell: int | None) -> None:
    assert sorted_points(_points((x_m, y_m, 0.0)), GRID).cell.tolist() == ([] if cell is None else [cell])


@pytest.mark.parametrize("count", [4, 5, 6, 40])
def test_a_full_pillar_leaves_the_next_one_alone(count: int) -> None:
    """The pillars lie next to each other in memory: a point behind the last slot would be the first of the next."""
    points = np.array(
        [(0.5, 0.5, 0.0, 0.1, 0.0), (3.5, 0.5, 0.0, 0.9, 0.0), *[(0.6, 0.6, 0.0, 0.2, 0.0)] * (count - 1)]
    )
    found = sorted_points(points.astype(np.float32), GRID)
    assert found.count.tolist() == [4, 1]
    assert found.slots[1, 0] == pytest.approx([3.5, 0.5, 0.0, 0.9, 0.0])
    assert not found.slots[1, 1:].any()
    assert found.slots[0, :, 3].min() >= 0.1 - 1e-6


@pytest.mark.parametrize(("x_m", "y_m", "there"), [(7.5, -4.0, 0), (3.0, 7.5, 0), (-2.0, 7.7, 1), (7.7, -2.0, 1)])
def test_the_grid_holds_a_circle(x_m: float, y_m: float, there: int) -> None:
    """Of 8 m: 8.5 m and 8.08 m are outside, 7.96 m is not."""
    assert len(sorted_points(_points((x_m, y_m, 0.0)), GRID).cell) == there


def test_of_five_points_every_one_has_four_chances_in_five() -> None:
    """In every pillar of the circle, whose centres lie within 7 m: the last point stays in four of five."""
    middles = np.arange(-7.5, 8.0, 1.0)
    places = [(x, y) for x in middles for y in middles if np.hypot(x, y) < 7.0]
    points = np.array([(x, y, 0.0, number / 10.0, 0.0) for x, y in places for number in range(5)], dtype=np.float32)
    slots = sorted_points(points, GRID).slots[..., 3]
    assert len(slots) == 50, "no more pillars than the grid allows"
    slots = sorted_points(points, replace(GRID, pillars=len(places))).slots[..., 3]
    stays = [float(np.isclose(slots, number / 10.0).any(axis=1).mean()) for number in range(5)]
    assert stays == pytest.approx([0.8] * 5, abs=0.12)
