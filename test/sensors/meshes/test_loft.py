"""Shells through cross-sections: a plain profile whose volume is known, arches, ends and sides."""

import numpy as np
import pytest
from solids import areas, gap_m2, volume

from siren_ros.sensors.meshes.loft import ARCH_CLEARANCE_M, Axle, Band, BodyProfile, from_quads, loft
from siren_ros.sensors.meshes.material import Material
from siren_ros.sensors.meshes.mesh import Mesh

PLAIN = BodyProfile(
    length_m=4.0,
    top_m=((0.0, 1.5), (4.0, 1.5)),
    belt_m=((0.0, 1.0), (4.0, 1.0)),
    bottom_m=((0.0, 0.2), (4.0, 0.2)),
    half_width_m=((0.0, 0.9), (4.0, 0.9)),
    roof_half_width_m=((0.0, 0.6), (4.0, 0.6)),
)
WHEELS = BodyProfile(**{**PLAIN.__dict__, "axles": (Axle(0.9, 0.3, 0.2), Axle(3.1, 0.3, 0.2))})


def made(profile: BodyProfile) -> Mesh:
    paint = (Material.CAR_PAINT, (9, 9, 9))
    return loft(profile, lambda *_: paint, lambda *_: paint, lambda *_: paint)


def cross_section_m2(profile: BodyProfile, s_m: float = 2.0) -> float:
    """Of the polygon of one ring, both halves."""
    ring = profile.half_rings_m()[int(np.argmin(abs(profile.stations_m() - s_m)))][:, 1:]
    y, z = ring.T
    return float(abs(np.sum(y * np.roll(z, -1) - z * np.roll(y, -1))))


def test_the_points_of_a_cross_section() -> None:
    """Heights and half widths from the middle of the underbody to the middle of the roof."""
    rings = PLAIN.half_rings_m()
    assert PLAIN.stations_m().tolist() == [0.0, 4.0]
    assert rings[:, 0, 0].tolist() == [2.0, -2.0]
    y, z = rings[0, :, 1], rings[0, :, 2]
    well, sill = 0.9 - 0.2 - 0.06, 0.965 * 0.9
    assert y == pytest.approx([0.0, well, well, sill, 0.9, sill, 0.6, 0.86 * 0.6, 0.0])
    crease = 0.2 + 0.6 * 0.8
    assert z == pytest.approx([0.2, 0.2, 0.2, 0.2, crease, 1.0, 1.5 - 0.07, 1.5 - 0.22 * 0.07, 1.5])


def test_a_shell_is_closed_and_has_the_volume_of_its_prism() -> None:
    mesh = made(PLAIN)
    assert gap_m2(mesh) < 1e-3
    assert volume(mesh) == pytest.approx(4.0 * cross_section_m2(PLAIN), rel=1e-3)
    low, high = mesh.bounds_m
    assert low == pytest.approx([-2.0, -0.9, 0.2], abs=1e-5)
    assert high == pytest.approx([2.0, 0.9, 1.5], abs=1e-5)


def test_a_wedge_has_the_mean_of_its_ends() -> None:
    wedge = BodyProfile(
        **{**PLAIN.__dict__, "half_width_m": ((0.0, 0.9), (4.0, 0.7)), "roof_half_width_m": PLAIN.roof_half_width_m}
    )
    front, rear = cross_section_m2(wedge, 0.0), cross_section_m2(wedge, 4.0)
    assert front > rear
    mesh = made(wedge)
    assert gap_m2(mesh) < 1e-3
    assert rear < volume(mesh) / 4.0 < front


def test_arches_are_round_and_as_high_as_the_tyre_and_its_clearance() -> None:
    """Over the hub the sill is at the tyre's top and the clearance; half the arch's width aside, on the circle."""
    radius = 0.3 + ARCH_CLEARANCE_M
    heights = WHEELS.arch_m(np.array([0.9, 0.9 - 0.2, 0.9 + 0.2, 2.0, 0.3]))
    on_circle = 0.3 + np.sqrt(radius**2 - 0.2**2)
    assert heights == pytest.approx([0.3 + radius, on_circle, on_circle, 0.2, 0.2])
    stations = WHEELS.stations_m()
    reach = np.sqrt(radius**2 - 0.1**2)  # the sill is 10 cm below the hub
    for hub in (0.9, 3.1):
        own = stations[abs(stations - hub) <= reach + 1e-9]
        assert own == pytest.approx(hub - reach * np.cos(np.linspace(0.0, np.pi, 6)))
    assert gap_m2(made(WHEELS)) < 1e-3
    assert volume(made(WHEELS)) < volume(made(PLAIN))


def test_knots_near_a_station_get_none_but_at_the_ends() -> None:
    knots = ((0.0, 1.5), (0.03, 1.5), (1.0, 1.5), (1.05, 1.5), (2.0, 1.5), (3.95, 1.5), (4.0, 1.5))
    profile = BodyProfile(**{**PLAIN.__dict__, "top_m": knots, "extra_stations_m": (1.5, 5.0)})
    assert profile.stations_m().tolist() == [0.0, 0.03, 1.0, 1.5, 2.0, 3.95, 4.0]


def test_faces_know_their_band_side_and_place() -> None:
    seen: list[tuple[Band, float, int]] = []
    ends: dict[str, set[tuple[Band, int]]] = {"front": set(), "rear": set()}
    materials = {1: Material.INDICATOR_LEFT_LAMP, -1: Material.INDICATOR_RIGHT_LAMP}

    def side(band: Band, s_m: float, hand: int) -> tuple[Material, tuple[int, int, int]]:
        seen.append((band, s_m, hand))
        return materials[hand], (1, 1, 1)

    def end(name: str):  # type: ignore[no-untyped-def] # a finish
        def finish(band: Band, zone: int) -> tuple[Material, tuple[int, int, int]]:
            ends[name].add((band, zone))
            return (Material.PLATE, (1, 1, 1)) if zone == 2 else (Material.CAR_PAINT, (1, 1, 1))

        return finish

    mesh = loft(PLAIN, side, end("front"), end("rear"))
    assert {(band, hand) for band, _, hand in seen} == {(band, hand) for band in Band for hand in (1, -1)}
    assert {s for _, s, _ in seen} == {2.0}
    expected = {(band, zone) for band in list(Band)[Band.LOWER_SIDE :] for zone in range(-2, 3)}
    assert ends == {"front": expected, "rear": expected}
    middle = mesh.vertices_m[mesh.triangles].mean(axis=1)
    assert (middle[mesh.material == Material.INDICATOR_LEFT_LAMP, 1] > 0).all()
    assert (middle[mesh.material == Material.INDICATOR_RIGHT_LAMP, 1] < 0).all()
    # The leftmost zone begins at 0.86 of the half width, at both ends.
    left = mesh.vertices_m[mesh.triangles[mesh.material == Material.PLATE]]
    assert set(np.round(left[..., 0], 3).ravel().tolist()) == {2.0, -2.0}
    share = areas(mesh)[mesh.material == Material.PLATE].sum() / (cross_section_m2(PLAIN) * 2)
    assert 0.03 < share < 0.0701, "0.14 / 2 of the bands above the sill"


def test_ends_look_ahead_and_back() -> None:
    mesh = made(PLAIN)
    middle = mesh.vertices_m[mesh.triangles].mean(axis=1)
    for x_m, sign in ((2.0, 1.0), (-2.0, -1.0)):
        normals = mesh.normals[abs(middle[:, 0] - x_m) < 1e-4]
        assert len(normals) > 20
        assert normals[:, 0] == pytest.approx(np.full(len(normals), sign), abs=1e-5)


def test_quads_become_two_triangles_and_slivers_none() -> None:
    quad = np.array([(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)], dtype=float)
    sliver = np.array([(0, 0, 1), (1, 0, 1), (1, 0, 1), (0, 0, 1)], dtype=float)
    mesh = from_quads([(quad, (Material.PLATE, (1, 2, 3))), (sliver, (Material.TYRE, (4, 5, 6)))])
    assert len(mesh) == 2
    assert areas(mesh).tolist() == [1.0, 1.0]
    assert mesh.normals.tolist() == [[0.0, 0.0, 1.0]] * 2
    assert set(mesh.material.tolist()) == {Material.PLATE}
    assert len(mesh.vertices_m) == 4


@pytest.mark.parametrize(
    "wrong",
    [
        {"top_m": ((0.0, 1.5), (2.0, 1.5), (1.0, 1.5), (4.0, 1.5))},
        {"belt_m": ((0.0, 1.0), (3.9, 1.0))},
        {"bottom_m": ((-1.0, 0.2), (4.0, 0.2))},
        {"belt_m": ((0.0, 1.7), (4.0, 1.0))},
        {"bottom_m": ((0.0, 0.2), (4.0, 1.1))},
        {"roof_half_width_m": ((0.0, 0.6), (2.0, 1.6), (4.0, 0.6))},
    ],
)
def test_outlines_that_cannot_be_a_body_are_refused(wrong: dict[str, object]) -> None:
    """Knots that go back, other lengths, a belt above the roof or below the sill, an overhanging roof."""
    with pytest.raises(ValueError, match="outline"):
        BodyProfile(**{**PLAIN.__dict__, **wrong})  # type: ignore[arg-type] # fields by name
