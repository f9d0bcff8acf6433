"""Meshes as columns: the same triangles with the same colours, and no more of them than the page may draw."""

from collections.abc import Callable

import numpy as np
import pytest
from episode_page.unpacked import unpacked

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.reports.episode_page import shapes
from siren_ros.reports.episode_page.columns import ColumnFile
from siren_ros.sensing.meshes.mesh import Material, Mesh, StaticScene
from siren_ros.sensing.meshes.solids import box
from siren_ros.sensing.vehicles.vehicle_shapes import vehicle_shape
from siren_ros.simulation.world.actors import ActorClass

RecordOf = Callable[..., EpisodeRecord]


def corners_of(columns: dict[str, np.ndarray], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Place and colour at each corner of each triangle."""
    rows = columns[f"{name}.triangles"].astype(int)
    return columns[f"{name}.xyz"].reshape(3, -1).T[rows], columns[f"{name}.rgb"].astype(int)[rows]


def test_a_shape_keeps_its_triangles_colours_and_lamps() -> None:
    file = ColumnFile()
    shapes.add_shapes(file, [ActorClass.AMBULANCE])
    _, columns = unpacked(file.packed({}))
    mesh = vehicle_shape(ActorClass.AMBULANCE).at_rest
    places, colours = corners_of(columns, "shape.AMBULANCE")
    assert np.abs(places - mesh.vertices_m[mesh.triangles.ravel()]).max() <= 0.0005 + 1e-6
    red, green, blue = mesh.colour_rgb.astype(int).T
    plain = ~np.isin(mesh.material, (Material.CAR_PAINT, Material.CLOTHING))
    wanted = (red << 16) + (green << 8) + blue
    assert np.array_equal(colours.reshape(-1, 3)[plain], np.repeat(wanted[:, None], 3, axis=1)[plain])
    surface = columns["shape.AMBULANCE.surface"].astype(int)[columns["shape.AMBULANCE.triangles"].astype(int)]
    lit = surface.reshape(-1, 3)[:, 0]
    assert np.array_equal(lit == 2, mesh.material == Material.BRAKE_LAMP)
    assert np.array_equal(lit == 5, mesh.material == Material.BEACON_BLUE)


def test_wheels_and_limbs_know_what_they_turn_about() -> None:
    file = ColumnFile()
    shapes.add_shapes(file, [ActorClass.BICYCLE])
    _, columns = unpacked(file.packed({}))
    parts = vehicle_shape(ActorClass.BICYCLE).parts
    assert np.abs(columns["shape.BICYCLE.hubs"].reshape(-1, 4) - [hub for _, hub in parts]).max() <= 0.0005
    part, places = columns["shape.BICYCLE.part"].astype(int), columns["shape.BICYCLE.xyz"].reshape(3, -1).T
    for number, (mesh, _) in enumerate(parts):
        low, high = mesh.bounds_m
        assert places[part == number].min(axis=0) == pytest.approx(low, abs=0.001)
        assert places[part == number].max(axis=0) == pytest.approx(high, abs=0.001)


def boxes(count: int) -> Mesh:
    """Boxes of twelve triangles, each 10 m farther from the synthetic road's way."""
    return Mesh.joined(
        *(
            box((0.0, 20.0 + 10.0 * k, 0.0), (1.0, 21.0 + 10.0 * k, 1.0), Material.BUILDING_WALL, (9, 9, 9))
            for k in range(count)
        )
    )


def test_of_a_large_scene_the_triangles_near_the_emv_stay(record_of: RecordOf, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shapes, "STATIC_TRIANGLES", 36)
    file = ColumnFile()
    head = shapes.add_static_scene(file, [record_of(duration_s=6.0)], StaticScene(boxes(5), ()))
    _, columns = unpacked(file.packed({}))
    places, _ = corners_of(columns, "static")
    assert len(places) == 3 * 36
    assert places[:, 1].max() == pytest.approx(41.0)
    assert head["lamps"] == []


def test_signals_keep_their_housings_and_poles_where_buildings_are_cut(record_of: RecordOf) -> None:
    file = ColumnFile()
    slender = box((0.0, 0.0, 3.0), (0.2, 0.2, 4.0), Material.SIGNAL_HOUSING, (7, 7, 7))
    shapes.add_static_scene(file, [record_of(duration_s=1.0)], StaticScene(Mesh.joined(boxes(1), slender), ()))
    _, columns = unpacked(file.packed({}))
    heights = columns["static.xyz"].reshape(3, -1)[2]
    assert np.array_equal(columns["static.surface"] > 0, heights >= 3.0)


def test_of_a_small_scene_everything_stays(record_of: RecordOf) -> None:
    file = ColumnFile()
    shapes.add_static_scene(file, [record_of(duration_s=1.0)], StaticScene(boxes(2), ()))
    _, columns = unpacked(file.packed({}))
    assert len(columns["static.triangles"]) == 3 * 24
