"""A wall hides what stands behind it, and nothing else."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from siren_ros.sensing.camera.occlusion import Horizon, bounding_circles, standing_walls
from siren_ros.sensing.meshes.mesh import Material, Mesh
from siren_ros.sensing.meshes.solids import box

EYE = np.array([0.0, 0.0, 1.5])


def house(low, high, material=Material.BUILDING_WALL):
    return box(low, high, material, (200, 200, 200))


def hidden(scene, low, high, eye=EYE, smallest=0.0, reach_m=450.0):
    horizon = Horizon(scene)
    horizon.look_from(eye, smallest, reach_m)
    circles = bounding_circles(np.array([low], dtype=float), np.array([high], dtype=float))
    return not horizon.visible(eye, circles)[0]


HOUSE = house((20.0, -10.0, 0.0), (30.0, 10.0, 9.0))


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        pytest.param((50, -1, 0), (52, 1, 2), True, id="behind"),
        pytest.param((50, -1, 0), (52, 1, 30), False, id="higher than the wall's shadow"),
        pytest.param((50, -1, 0), (52, 1, 19), True, id="just below the wall's shadow"),
        pytest.param((50, 19, 0), (52, 21, 2), True, id="behind its end"),
        pytest.param((50, 26, 0), (52, 28, 2), False, id="beside"),
        pytest.param((10, -1, 0), (12, 1, 2), False, id="before"),
        pytest.param((-52, -1, 0), (-50, 1, 2), False, id="on the other side of the eye"),
        pytest.param((50, -1, -1), (52, 1, 2), False, id="lower than the wall"),
        pytest.param((19.9, -1, 1), (19.95, 1, 2), False, id="on the wall"),
    ],
)
def test_a_house_hides_what_stands_behind_it(low, high, expected):
    assert hidden(HOUSE, low, high) is expected


def test_only_walls_that_stand_on_the_ground_and_are_drawn_hide():
    behind = (50, -1, 0), (52, 1, 2)
    assert hidden(HOUSE, *behind)
    assert not hidden(house((20.0, -10.0, 0.1), (30.0, 10.0, 9.0)), *behind)
    assert not hidden(house((20.0, -10.0, 0.0), (30.0, 10.0, 9.0), Material.BUILDING_GLASS), *behind)
    assert not hidden(HOUSE, *behind, reach_m=20.0)
    assert not hidden(HOUSE, *behind, smallest=1.0)
    assert not hidden(Mesh.joined(), *behind)


def test_a_box_has_four_walls():
    walls = standing_walls(HOUSE)
    assert sorted(walls[:, 7].tolist()) == pytest.approx([90.0, 90.0, 180.0, 180.0])
    assert walls[:, 6].tolist() == pytest.approx([9.0] * 4)
    assert {tuple(np.round(n).astype(int)) for n in walls[:, 4:6]} == {(1, 0), (-1, 0), (0, 1), (0, -1)}


def crosses(eye, points, walls):
    """Whether the line from the eye to each point goes through a wall, shape (N,)."""
    through = np.zeros(len(points), bool)
    for x0, y0, x1, y1, nx, ny, top, _ in walls:
        normal, foot = np.array([nx, ny]), np.array([x0, y0])
        own, other = (eye[:2] - foot) @ normal, (points[:, :2] - foot) @ normal
        share = own / np.where(own == other, np.inf, own - other)
        at = eye + share[:, None] * (points - eye)
        along = (at[:, :2] - foot) @ np.array([x1 - x0, y1 - y0]) / ((x1 - x0) ** 2 + (y1 - y0) ** 2)
        within = (along >= 0.0) & (along <= 1.0) & (at[:, 2] <= top) & (at[:, 2] >= 0.0)
        through |= (own > 0.0) & (share > 0.0) & (share < 1.0) & within
    return through


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 100_000))
def test_no_line_of_sight_leads_to_what_is_hidden(seed):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-150.0, 150.0, (25, 2))
    houses = []
    for x, y in corners[np.abs(corners).max(axis=1) > 20.0]:
        width, depth, height = rng.uniform(5.0, 40.0), rng.uniform(5.0, 15.0), rng.uniform(2.0, 20.0)
        houses.append(house((x, y, 0.0), (x + width, y + depth, height)))
    scene = Mesh.joined(*houses)
    eye = np.array([0.0, 0.0, rng.uniform(0.5, 8.0)])
    horizon = Horizon(scene)
    horizon.look_from(eye, 0.0, 450.0)
    low = np.column_stack((rng.uniform(-200.0, 200.0, (300, 2)), rng.uniform(0.0, 3.0, 300)))
    high = low + rng.uniform(0.1, 4.0, (300, 3))
    visible = horizon.visible(eye, bounding_circles(low, high))
    inside = low[:, None] + (high - low)[:, None] * rng.random((300, 8, 3))
    walls = standing_walls(scene)
    for points in inside[~visible]:
        assert crosses(eye, points, walls).all()
