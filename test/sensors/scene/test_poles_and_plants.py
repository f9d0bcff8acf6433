"""Poles, signs, lamps and trees: where their parts are, which way they look."""

import numpy as np
import pytest
from solids import areas, gap_m2, volume

from siren_ros.sensors.meshes.material import LampColour, Material
from siren_ros.sensors.meshes.mesh import Mesh
from siren_ros.sensors.scene.poles import HEAD_HEIGHT_M, mast_arm, pole, signal_head, stop_sign, street_lamp, turned
from siren_ros.sensors.scene.vegetation import broadleaf, conifer


def middle(mesh: Mesh) -> np.ndarray:
    low, high = mesh.bounds_m
    return np.asarray((low + high) / 2.0)


@pytest.mark.parametrize("end", [(13.0, 8.0), (3.0, -16.0), (-7.0, 8.0), (13.0, 24.0)])
def test_an_arm_reaches_from_one_place_to_the_other(end: tuple[float, float]) -> None:
    start = (3.0, 8.0)
    beam = mast_arm(start, end, 6.0)
    length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
    assert middle(beam) == pytest.approx([(start[0] + end[0]) / 2, (start[1] + end[1]) / 2, 6.0], abs=1e-5)
    assert volume(beam.translated(-start[0], -start[1], -6.0)) == pytest.approx(length * 0.12**2, rel=1e-4)
    reach = np.abs((beam.vertices_m[:, :2] - start) @ (np.array(end) - start) / length)
    assert reach.max() == pytest.approx(length, abs=1e-4)
    assert gap_m2(beam) < 1e-6


def test_a_mesh_is_turned_about_its_origin_and_then_moved() -> None:
    """A point 2 m ahead and 1 m to the left, turned to the north, at (10, 20, 3)."""
    mesh = Mesh.uniform([(2, 1, 0.5), (3, 1, 0.5), (2, 2, 0.5)], [(0, 1, 2)], Material.KERB, (1, 2, 3))
    assert turned(mesh, 10.0, 20.0, 3.0, np.pi / 2.0).vertices_m[0] == pytest.approx([9.0, 22.0, 3.5])


def test_red_is_above_yellow_above_green_and_shines_ahead() -> None:
    head = signal_head()
    heights = {}
    for colour, start, stop in head.lamps:
        lens = head.mesh.vertices_m[head.mesh.triangles[start:stop]]
        assert set(head.mesh.material[start:stop].tolist()) == {colour.material}
        heights[colour] = float(lens[..., 2].mean())
        assert (head.mesh.normals[start:stop, 0] > 0.999).all()
        assert abs(float(lens[..., 1].max() + lens[..., 1].min())) < 0.01
        assert areas(head.mesh)[start:stop].sum() == pytest.approx(
            0.5 * 10 * 0.15**2 * np.sin(2 * np.pi / 10), rel=1e-4
        )
    assert heights[LampColour.RED] > heights[LampColour.YELLOW] + 0.35 > heights[LampColour.GREEN] + 0.7
    assert heights[LampColour.GREEN] - 0.15 > 0.0
    assert heights[LampColour.RED] + 0.15 < HEAD_HEIGHT_M
    board = head.mesh.vertices_m
    assert board[:, 1].min() == pytest.approx(-board[:, 1].max(), abs=1e-6)
    assert board[:, 2].min() == pytest.approx(-0.12)
    assert board[:, 2].max() == pytest.approx(HEAD_HEIGHT_M + 0.12)


def test_visors_hang_above_their_lenses() -> None:
    head = signal_head()
    tops = [float(head.mesh.vertices_m[head.mesh.triangles[start:stop]][..., 2].max()) for _, start, stop in head.lamps]
    ahead = head.mesh.vertices_m[head.mesh.vertices_m[:, 0] > 0.1]
    visors = np.unique(np.round(ahead[:, 2], 3))
    assert visors.tolist() == pytest.approx([z for top in tops for z in (top + 0.01, top + 0.03)], abs=0.012)


def test_a_pole_tapers() -> None:
    mesh = pole(4.0, -3.0, 5.0, 0.1)
    assert mesh.bounds_m[0] == pytest.approx([3.9, -3.1, 0.0], abs=0.01)
    assert mesh.bounds_m[1][2] == 5.0
    top = mesh.vertices_m[mesh.vertices_m[:, 2] > 4.9]
    assert np.hypot(top[:, 0] - 4.0, top[:, 1] + 3.0) == pytest.approx(np.full(7, 0.075), rel=1e-4)
    assert gap_m2(mesh) < 1e-6


def test_a_stop_sign_is_an_octagon_that_says_stop() -> None:
    sign = stop_sign()
    faces = sign.normals[:, 0]
    assert np.abs(faces) == pytest.approx(np.ones(len(sign)), abs=1e-6)
    red = (sign.colour_rgb == (178, 20, 24)).all(axis=1)
    octagon = 0.5 * 8 * np.sin(2 * np.pi / 8)
    assert areas(sign)[red].sum() == pytest.approx(octagon * 0.41**2, rel=1e-4)
    assert (faces[red] > 0).all()
    back = sign.material == Material.METAL_POLE
    assert (faces[back] < 0).all()
    assert (sign.vertices_m[sign.triangles[back]][..., 0] < 0).all()
    white = (sign.colour_rgb == (240, 240, 240)).all(axis=1)
    cells = sign.vertices_m[sign.triangles[white]]
    # 11, 7, 12 and 10 cells of 45 mm, in front of the red, in the middle of the sign.
    assert areas(sign)[white].sum() == pytest.approx((11 + 7 + 12 + 10) * 0.045**2, rel=1e-3)
    assert (cells[..., 0] > 0.01).all()
    assert abs(float(cells[..., 1].min() + cells[..., 1].max())) < 0.01
    assert abs(float(cells[..., 2].min() + cells[..., 2].max())) < 0.01
    # Who looks at it has −y on the left: there is the S.
    first = cells[cells[..., 1].max(axis=1) < -0.19]
    assert areas(sign)[white][cells[..., 1].max(axis=1) < -0.19].sum() == pytest.approx(11 * 0.045**2, rel=1e-3)
    assert len(first) == 22


def test_a_street_lamps_arm_reaches_ahead() -> None:
    lamp = street_lamp(7.5)
    low, high = lamp.bounds_m
    assert (high[0], high[2]) == pytest.approx((1.8, 7.5))
    assert low[0] > -0.1
    light = lamp.vertices_m[lamp.triangles[lamp.material == Material.STREET_LAMP]]
    assert light.reshape(-1, 3).min(axis=0) == pytest.approx([1.2, -0.12, 7.37], abs=1e-5)
    assert light.reshape(-1, 3).max(axis=0) == pytest.approx([1.8, 0.12, 7.45], abs=1e-5)
    assert gap_m2(lamp) < 1e-6


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("make", [broadleaf, conifer])
def test_trees_stand_on_the_ground_and_keep_to_their_radius(make, seed: int) -> None:  # type: ignore[no-untyped-def] # either
    tree = make(30.0, -12.0, 2.0, np.random.default_rng(seed))
    away = np.hypot(tree.vertices_m[:, 0] - 30.0, tree.vertices_m[:, 1] + 12.0)
    assert 1.5 < away.max() <= 2.0 + 1e-5
    height = float(tree.vertices_m[:, 2].max())
    assert tree.vertices_m[:, 2].min() == 0.0
    assert (4.0 if make is broadleaf else 6.8) < height < (7.0 if make is broadleaf else 8.9)
    crown = tree.vertices_m[tree.triangles[tree.material == Material.FOLIAGE]]
    stem = tree.vertices_m[tree.triangles[tree.material == Material.TREE_TRUNK]]
    assert crown[..., 2].min() < stem[..., 2].max() < crown[..., 2].max(), "the stem reaches into the crown"
    assert crown[..., 2].min() > 0.1 * height
    assert volume(tree.translated(-30.0, 12.0, 0.0)) > 0.0
    assert gap_m2(tree) < 1e-3
