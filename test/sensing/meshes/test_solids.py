"""Shells through cross-sections: a plain profile whose volume is known, arches, ends and sides."""

from dataclasses import replace

import numpy as np
import pytest
from shapely.geometry import Polygon
from shapely.geometry import box as rectangle
from solids import areas, gap_m2, open_edges, volume

from siren_ros.sensing.meshes import solids
from siren_ros.sensing.meshes.mesh import Material, Mesh

PLAIN = solids.BodyProfile(
    length_m=4.0, top_m=((0.0, 1.5), (4.0, 1.5)), belt_m=((0.0, 1.0), (4.0, 1.0)),
    bottom_m=((0.0, 0.2), (4.0, 0.2)), half_width_m=((0.0, 0.9), (4.0, 0.9)),
    roof_half_width_m=((0.0, 0.6), (4.0, 0.6)),
)  # fmt: skip
WHEELS = replace(PLAIN, axles=(solids.Axle(0.9, 0.3, 0.2), solids.Axle(3.1, 0.3, 0.2)))


def shell(profile):
    paint = (Material.CAR_PAINT, (9, 9, 9))
    return solids.loft(profile, lambda *_: paint, lambda *_: paint, lambda *_: paint)


def cross_section_m2(profile, s_m=2.0):
    """Of the polygon of one ring, both halves."""
    y, z = profile.half_rings_m()[int(np.argmin(abs(profile.stations_m() - s_m)))][:, 1:].T
    return float(abs(np.sum(y * np.roll(z, -1) - z * np.roll(y, -1))))


def test_the_points_of_a_cross_section():
    """Heights and half widths from the middle of the underbody to the middle of the roof."""
    rings = PLAIN.half_rings_m()
    assert PLAIN.stations_m().tolist() == [0.0, 4.0]
    assert rings[:, 0, 0].tolist() == [2.0, -2.0]
    y, z = rings[0, :, 1], rings[0, :, 2]
    well, sill = 0.9 - 0.2 - 0.06, 0.965 * 0.9
    assert y == pytest.approx([0.0, well, well, sill, 0.9, sill, 0.6, 0.86 * 0.6, 0.0])
    assert z == pytest.approx([0.2, 0.2, 0.2, 0.2, 0.2 + 0.6 * 0.8, 1.0, 1.5 - 0.07, 1.5 - 0.22 * 0.07, 1.5])


def test_a_shell_is_closed_and_has_the_volume_of_its_prism():
    mesh = shell(PLAIN)
    assert gap_m2(mesh) < 1e-3
    assert volume(mesh) == pytest.approx(4.0 * cross_section_m2(PLAIN), rel=1e-3)
    low, high = mesh.bounds_m
    assert (low, high) == (pytest.approx([-2.0, -0.9, 0.2], abs=1e-5), pytest.approx([2.0, 0.9, 1.5], abs=1e-5))
    wedge = replace(PLAIN, half_width_m=((0.0, 0.9), (4.0, 0.7)))
    front, rear = cross_section_m2(wedge, 0.0), cross_section_m2(wedge, 4.0)
    assert gap_m2(shell(wedge)) < 1e-3
    assert rear < volume(shell(wedge)) / 4.0 < front


def test_arches_are_round_and_as_high_as_the_tyre_and_its_clearance():
    """Over the hub the sill is at the tyre's top and the clearance; half the arch's width aside, on the circle."""
    radius = 0.3 + solids.ARCH_CLEARANCE_M
    heights = WHEELS.arch_m(np.array([0.9, 0.9 - 0.2, 0.9 + 0.2, 2.0, 0.3]))
    on_circle = 0.3 + np.sqrt(radius**2 - 0.2**2)
    assert heights == pytest.approx([0.3 + radius, on_circle, on_circle, 0.2, 0.2])
    stations = WHEELS.stations_m()
    reach = np.sqrt(radius**2 - 0.1**2)  # the sill is 10 cm below the hub
    for hub in (0.9, 3.1):
        near = stations[abs(stations - hub) <= reach + 1e-9]
        assert near == pytest.approx(hub - reach * np.cos(np.linspace(0.0, np.pi, 6)))
    assert gap_m2(shell(WHEELS)) < 1e-3
    assert volume(shell(WHEELS)) < volume(shell(PLAIN))


def test_knots_near_a_station_get_none_but_at_the_ends():
    knots = ((0.0, 1.5), (0.03, 1.5), (1.0, 1.5), (1.05, 1.5), (2.0, 1.5), (3.95, 1.5), (4.0, 1.5))
    profile = replace(PLAIN, top_m=knots, extra_stations_m=(1.5, 5.0))
    assert profile.stations_m().tolist() == [0.0, 0.03, 1.0, 1.5, 2.0, 3.95, 4.0]


def test_faces_know_their_band_side_and_place():
    seen, ends = [], {"front": set(), "rear": set()}
    materials = {1: Material.INDICATOR_LEFT_LAMP, -1: Material.INDICATOR_RIGHT_LAMP}

    def side(band, s_m, hand):
        seen.append((band, s_m, hand))
        return materials[hand], (1, 1, 1)

    def end(name):
        def finish(band, zone):
            ends[name].add((band, zone))
            return (Material.PLATE, (1, 1, 1)) if zone == 2 else (Material.CAR_PAINT, (1, 1, 1))

        return finish

    mesh = solids.loft(PLAIN, side, end("front"), end("rear"))
    assert {(band, hand) for band, _, hand in seen} == {(band, hand) for band in solids.Band for hand in (1, -1)}
    assert {s for _, s, _ in seen} == {2.0}
    expected = {(band, zone) for band in list(solids.Band)[solids.Band.LOWER_SIDE :] for zone in range(-2, 3)}
    assert ends == {"front": expected, "rear": expected}
    middle = mesh.vertices_m[mesh.triangles].mean(axis=1)
    assert (middle[mesh.material == Material.INDICATOR_LEFT_LAMP, 1] > 0).all()
    assert (middle[mesh.material == Material.INDICATOR_RIGHT_LAMP, 1] < 0).all()
    # The leftmost zone begins at 0.86 of the half width, at both ends.
    left = mesh.vertices_m[mesh.triangles[mesh.material == Material.PLATE]]
    assert set(np.round(left[..., 0], 3).ravel().tolist()) == {2.0, -2.0}
    share = areas(mesh)[mesh.material == Material.PLATE].sum() / (cross_section_m2(PLAIN) * 2)
    assert 0.03 < share < 0.0701, "0.14 / 2 of the bands above the sill"


def test_quads_become_two_triangles_and_slivers_none():
    quad = np.array([(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)], dtype=float)
    sliver = np.array([(0, 0, 1), (1, 0, 1), (1, 0, 1), (0, 0, 1)], dtype=float)
    mesh = solids.from_quads([(quad, (Material.PLATE, (1, 2, 3))), (sliver, (Material.TYRE, (4, 5, 6)))])
    assert (len(mesh), areas(mesh).tolist()) == (2, [1.0, 1.0])
    assert (mesh.normals.tolist(), set(mesh.material.tolist())) == ([[0.0, 0.0, 1.0]] * 2, {Material.PLATE})
    assert len(mesh.vertices_m) == 4
    two = solids.flat_polygons([TRIANGLE, rectangle(20, 0, 21, 1)], 0.0, Material.KERB, GREY)
    assert areas(two).sum() == pytest.approx(7.0)
    assert len(solids.flat_polygons([], 0.0, Material.KERB, GREY)) == 0


@pytest.mark.parametrize(
    "wrong",
    [
        *[{"top_m": ((0.0, 1.5), (2.0, 1.5), (1.0, 1.5), (4.0, 1.5))}, {"belt_m": ((0.0, 1.0), (3.9, 1.0))}],
        *[{"bottom_m": ((-1.0, 0.2), (4.0, 0.2))}, {"belt_m": ((0.0, 1.7), (4.0, 1.0))}],
        *[{"bottom_m": ((0.0, 0.2), (4.0, 1.1))}, {"roof_half_width_m": ((0.0, 0.6), (2.0, 1.6), (4.0, 0.6))}],
    ],
)
def test_outlines_that_cannot_be_a_body_are_refused(wrong):
    """Knots that go back, other lengths, a belt above the roof or below the sill, an overhanging roof."""
    with pytest.raises(ValueError, match="outline"):
        replace(PLAIN, **wrong)


GREY = (1, 2, 3)
TRIANGLE = Polygon([(0.0, 0.0), (4.0, 0.0), (0.0, 3.0)])
RING = rectangle(0, 0, 10, 8) - rectangle(2, 2, 5, 6)


def bounds(mesh):
    return [side.tolist() for side in mesh.bounds_m]


def test_boxes_lie_between_their_corners_and_their_normals_look_out():
    mesh = solids.box((1, 2, 3), (2, 4, 6), Material.KERB, GREY)
    assert (bounds(mesh), open_edges(mesh)) == ([[1, 2, 3], [2, 4, 6]], 0)
    assert areas(mesh).sum() == pytest.approx(2 * (1 * 2 + 2 * 3 + 1 * 3))
    assert (volume(mesh), set(mesh.material.tolist())) == (pytest.approx(6.0), {Material.KERB})
    assert np.unique(mesh.colour_rgb, axis=0).tolist() == [list(GREY)]
    for high in ((0.9, 4.0, 6.0), (2.0, 1.9, 6.0), (2.0, 4.0, 2.9)):
        with pytest.raises(ValueError, match="a box from"):
            solids.box((1.0, 2.0, 3.0), high, Material.KERB, GREY)
    corners = [(0, 0, 0), (4, 0, 0), (4, 2, 0), (0, 2, 0), (0, 1, 1), (4, 1, 1), (4, 1, 1), (0, 1, 1)]
    assert volume(solids.hexahedron(corners, Material.KERB, GREY)) == pytest.approx(4.0)
    two = np.array((corners, corners)) + np.array([[[0.0, 0.0, 0.0]], [[9.0, 0.0, 0.0]]])
    assert volume(solids.hexahedra(two, Material.KERB, GREY)) == pytest.approx(8.0)
    mesh = solids.box((0, 0, 0), (1, 2, 3), Material.KERB, GREY)
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(np.ones(12))
    outward = mesh.vertices_m[mesh.triangles].mean(axis=1) - (0.5, 1.0, 1.5)
    assert (np.einsum("ij,ij->i", mesh.normals, outward) > 0.1).all()
    assert {tuple(normal) for normal in mesh.normals.tolist()} == {
        tuple(float(sign * (axis == k)) + 0.0 for k in range(3)) for axis in range(3) for sign in (1, -1)
    }
    flat = Mesh.uniform([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2)], Material.KERB, GREY)
    assert flat.normals.tolist() == [[0.0, 0.0, 0.0]]


@pytest.mark.parametrize(("low", "high"), [(2.0, 2.0), (2.0, 1.0), (0.5, 1.5)], ids=["cylinder", "cone", "funnel"])
def test_a_cone_stump_stands_on_its_base(low, high):
    mesh = solids.frustum((1.0, -2.0, 5.0), 3.0, (low, high), 8, Material.KERB, GREY)
    wide = max(low, high)
    corners = np.array([[1 - wide, -2 - wide, 5], [1 + wide, -2 + wide, 8]])
    assert (np.array(bounds(mesh)), open_edges(mesh)) == (pytest.approx(corners, abs=1e-6), 0)
    polygon = 0.5 * 8 * np.sin(2 * np.pi / 8)
    moved = mesh.translated(-1.0, 2.0, -5.0)
    assert volume(moved) == pytest.approx(polygon * 3.0 * (low**2 + low * high + high**2) / 3.0, rel=1e-5)
    top = mesh.vertices_m[mesh.vertices_m[:, 2] > 7.9]
    assert np.hypot(top[:, 0] - 1.0, top[:, 1] + 2.0) == pytest.approx(np.full(8, high), rel=1e-5)


@pytest.mark.parametrize("area", [TRIANGLE, RING, Polygon(list(TRIANGLE.exterior.coords)[::-1])])
def test_flat_faces_look_up(area):
    mesh = solids.flat_polygons([area], 0.25, Material.KERB, GREY)
    assert areas(mesh).sum() == pytest.approx(area.area)
    assert mesh.normals.tolist() == [[0.0, 0.0, 1.0]] * len(mesh)
    assert set(mesh.vertices_m[:, 2].tolist()) == {0.25}


@pytest.mark.parametrize("area", [TRIANGLE, RING, Polygon(list(TRIANGLE.exterior.coords)[::-1])])
def test_walls_look_out_of_their_polygon(area):
    """With floor and roof they make a closed prism."""
    mesh = solids.walls(area, 0.5, 2.0, Material.KERB, GREY)
    assert areas(mesh).sum() == pytest.approx(1.5 * area.length)
    roof = solids.flat_polygons([area], 2.0, Material.KERB, GREY)
    floor = solids.flat_polygons([area], 0.5, Material.KERB, GREY)
    below = Mesh(floor.vertices_m, floor.triangles[:, ::-1].copy(), floor.material, floor.colour_rgb)
    solid = Mesh.joined(mesh, roof, below)
    assert (volume(solid), open_edges(solid)) == (pytest.approx(1.5 * area.area, rel=1e-5), 0)
    assert np.abs(mesh.normals[:, 2]).max() == 0.0


def test_spheres_are_closed_with_points_on_the_unit_sphere_and_look_outward():
    points, faces = solids.sphere_points(1)
    mesh = Mesh.uniform(points, faces, Material.KERB, GREY)
    assert (open_edges(mesh), len(points)) == (0, 42)
    assert 3.5 < volume(mesh) < 4.0 / 3.0 * np.pi
    points, faces = solids.sphere_points(2)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0)
    a, b, c = (points[faces[:, k]] for k in range(3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) > 0).all()
    assert len(faces) == 20 * 16
