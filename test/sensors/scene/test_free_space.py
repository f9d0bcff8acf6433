"""Places that are free: off the traffic, and not taken by something else."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from shapely.geometry import Point, box

from siren_ros.sensors.scene.free_space import FreeSpace, ring_samples
from siren_ros.sensors.scene.ground import _cut
from siren_ros.sensors.scene.poles import clear_pole


@pytest.fixture
def space() -> FreeSpace:
    """Traffic between y = −5 and 5 m."""
    surfaces: Any = SimpleNamespace(keep_clear=box(-100.0, -5.0, 100.0, 5.0))
    return FreeSpace(surfaces)


def test_traffics_space_is_never_free(space: FreeSpace) -> None:
    assert not space.place_disc(0.0, 5.9, 1.0)
    assert space.place_disc(0.0, 6.1, 1.0)
    points = np.array([(0.0, 5.9), (0.0, 6.1), (0.0, -7.0)])
    assert space.clear_of_traffic(points, 1.0).tolist() == [False, True, True]


def test_what_is_taken_is_taken_also_across_cells(space: FreeSpace) -> None:
    """Cells are 20 m wide: an area over several of them is found from each."""
    space.occupy(box(15.0, 30.0, 65.0, 34.0))
    for x_m in (16.0, 30.0, 50.0, 64.0):
        assert not space.is_clear(Point(x_m, 35.0).buffer(1.5))
        assert space.is_clear(Point(x_m, 36.0).buffer(1.5))
    assert space.is_clear(Point(13.0, 32.0).buffer(1.5))
    assert not space.is_clear(Point(14.0, 32.0).buffer(1.5))


def test_discs_do_not_overlap(space: FreeSpace) -> None:
    assert space.place_disc(19.5, 20.5, 1.0)
    assert not space.place_disc(21.0, 20.5, 1.0)
    assert space.place_disc(21.6, 20.5, 1.0)


def test_the_first_clear_place_is_taken(space: FreeSpace) -> None:
    candidates = np.array([(0.0, 0.0), (0.0, 5.5), (0.0, 7.0), (0.0, 9.0)])
    assert space.first_clear(candidates, 1.0) == (0.0, 7.0)
    assert space.first_clear(candidates, 0.9) == (0.0, 9.0)
    assert space.first_clear(candidates, 1.0) is None


def test_a_pole_is_looked_for_every_quarter_metre(space: FreeSpace) -> None:
    found = clear_pole(space, 3.0, 0.0, (0.0, 1.0), 14.0, 0.3)
    assert found == (3.0, 5.5)
    assert clear_pole(space, 3.0, 0.0, (0.0, -1.0), 5.0, 0.3) is None


def test_samples_of_a_ring_have_the_area_on_their_left() -> None:
    area = box(0.0, 0.0, 40.0, 20.0) - box(10.0, 5.0, 20.0, 15.0)
    places, tangents = ring_samples(area, 2.0)
    assert len(places) == (120 + 40) // 2
    assert np.hypot(tangents[:, 0], tangents[:, 1]) == pytest.approx(np.ones(len(places)))
    # Half a metre to the left is inside, to the right outside; not at corners, where the tangent turns.
    left = places + 0.05 * np.stack((-tangents[:, 1], tangents[:, 0]), axis=-1) + 0.01 * tangents
    right = places - 0.05 * np.stack((-tangents[:, 1], tangents[:, 0]), axis=-1) + 0.01 * tangents
    inside = [area.contains(Point(*point)) for point in left]
    assert np.mean(inside) > 0.95
    assert np.mean([area.contains(Point(*point)) for point in right]) < 0.05
    gaps = np.hypot(*np.diff(places[:60], axis=0).T)
    assert np.median(gaps) == pytest.approx(2.0)


def test_short_rings_have_no_samples() -> None:
    places, tangents = ring_samples(box(0.0, 0.0, 0.3, 0.3), 2.0)
    assert places.shape == tangents.shape == (0, 2)


def test_an_area_is_cut_along_the_grid() -> None:
    area = box(-12.0, 3.0, 25.0, 17.0) - box(0.0, 5.0, 5.0, 8.0)
    pieces = _cut(area, 10.0)
    assert sum(piece.area for piece in pieces) == pytest.approx(area.area)
    for piece in pieces:
        west, south, east, north = piece.bounds
        assert np.floor(west / 10.0) == np.ceil(east / 10.0) - 1
        assert np.floor(south / 10.0) == np.ceil(north / 10.0) - 1
    assert len(pieces) == 10
    assert _cut(box(1.0, 1.0, 9.0, 9.0), 10.0) == [box(1.0, 1.0, 9.0, 9.0)]
