"""Parked vehicles and clutter: how many, where they stand, and that nothing is there without being asked for."""

import numpy as np
import pytest
import shapely
from shapely.geometry import Point

from siren_ros.sensing.meshes.mesh import StaticScene
from siren_ros.sensing.scene.kerbside import clutter, scene_config_of
from siren_ros.sensing.scene.static_scene import static_scene
from siren_ros.sensing.scene.surfaces import FreeSpace, SceneConfig, drawn_centres, road_surfaces, union
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.scenario.scenario import VARIETY

VARIED = SceneConfig(parked_share=0.5, size_spread=0.1, clutter_per_100_m=10.0, colour_share=0.7)


@pytest.fixture(scope="module")
def varied(network: RoadNetwork) -> StaticScene:
    return static_scene(network, 3, VARIED)


def test_without_being_asked_the_scene_is_as_before(network: RoadNetwork, scene: StaticScene) -> None:
    assert scene.parked == ()
    assert scene_config_of({}) == SceneConfig()
    assert scene_config_of(dict(zip(VARIETY, (0.1, 0.5, 10.0, 0.7), strict=True))) == VARIED
    same = static_scene(network, 3, scene_config_of({"emv.speed_mps": 12.0}))
    assert np.array_equal(same.mesh.vertices_m, scene.mesh.vertices_m)


def test_parked_vehicles_stand_off_the_space_of_traffic_and_not_in_each_other(
    network: RoadNetwork, varied: StaticScene
) -> None:
    surfaces = road_surfaces(network, drawn_centres(network, VARIED.road_extension_m), VARIED)
    areas = []
    for one in varied.parked:
        half = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * [one.actor.length_m / 2, one.actor.width_m / 2]
        cos, sin = np.cos(one.yaw_rad), np.sin(one.yaw_rad)
        areas.append(shapely.polygons(half @ np.array([[cos, sin], [-sin, cos]]) + (one.x_m, one.y_m)))
        assert not areas[-1].intersects(surfaces.keep_clear)
        assert not areas[-1].intersects(surfaces.raised)
        assert Point(one.x_m, one.y_m).distance(surfaces.keep_clear) < 12.0
    assert len(areas) > 5
    first, second = shapely.STRtree(areas).query(areas, predicate="intersects")
    assert (first == second).all()


def test_most_of_the_clutter_that_is_asked_for_stands_between_road_and_houses(network: RoadNetwork) -> None:
    surfaces = road_surfaces(network, drawn_centres(network, VARIED.road_extension_m), VARIED)
    edge = union((surfaces.keep_clear, surfaces.raised))
    pieces = list(clutter(surfaces, FreeSpace(surfaces), VARIED, np.random.default_rng(5)))
    west, south, east, north = surfaces.bounds_m
    on_map = shapely.box(west, south, east, north).intersection(edge.boundary)
    asked = on_map.length * VARIED.clutter_per_100_m / 100.0
    assert 0.75 * asked < len(pieces) < 1.15 * asked
    corners = [shapely.multipoints(piece.vertices_m[:, :2]).convex_hull for piece in pieces]
    assert not any(area.intersects(edge) for area in corners)
    reach = edge.buffer(VARIED.building_setback_m)
    assert np.mean([reach.contains(area) for area in corners]) > 0.9
    longest = [shapely.get_coordinates(area)[:, None] - shapely.get_coordinates(area) for area in corners]
    assert np.mean([np.hypot(*gaps.T).max() > 2.5 for gaps in longest]) > 0.15, (
        "large pieces are not the ones that are left out"
    )
