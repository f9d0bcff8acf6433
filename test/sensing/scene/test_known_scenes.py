"""Every material of whole static scenes, with lamps and parked vehicles, as stored next to this file."""

from dataclasses import astuple, replace
from pathlib import Path

import pytest
import shapely
from hand_made_record import crossing
from known_outputs import assert_known
from made_legs import network_of_legs
from made_street import VARIED, street_scene
from map_networks import network_of_map
from repository import REPOSITORY
from solids import by_material

from siren_ros.sensing.meshes.mesh import Mesh, StaticScene
from siren_ros.sensing.scene.static_scene import static_scene
from siren_ros.simulation.roads.road_network import JunctionKind, LaneKind, mirrored_network

KNOWN = Path(__file__).parent / "known"


def figures(scene: StaticScene) -> dict[str, object]:
    mesh = scene.mesh
    lenses = []
    for lamp in scene.signal_lamps:
        own = slice(lamp.start, lamp.stop)
        part = Mesh(mesh.vertices_m, mesh.triangles[own], mesh.material[own], mesh.colour_rgb[own])
        lenses.append([lamp.signal_id, lamp.link, lamp.colour, *by_material(part)[lamp.colour.material.name][:7]])
    return {"materials": by_material(mesh), "lenses": lenses}


def out_of_town() -> StaticScene:
    network = network_of_legs()
    kinds = {LaneKind.SIDEWALK: LaneKind.KERB}
    lanes = [replace(x, speed_limit_mps=25.0, kind=kinds.get(x.kind, x.kind)) for x in network.lanes]
    return static_scene(replace(network, lanes=tuple(lanes)), 2)


SCENES = {
    "street": street_scene,
    "crossing": lambda: static_scene(crossing(), 0, replace(VARIED, parked_share=0.0)),
    "stop_signs_left_hand": lambda: static_scene(mirrored_network(crossing(JunctionKind.PRIORITY_STOP)), 5, VARIED),
    "out_of_town": out_of_town,
    "bends": lambda: static_scene(network_of_map(REPOSITORY / "test" / "maps" / "bends.xodr"), 1, VARIED),
}


@pytest.mark.parametrize("name", SCENES)
def test_scenes(name: str) -> None:
    scene = SCENES[name]()
    parked = [
        [one.actor.actor_class, one.x_m, one.y_m, one.z_m, one.yaw_rad, *astuple(one.actor)[3:6], *one.actor.colour_rgb]
        for one in scene.parked
    ]
    raised = [scene.raised.area, *shapely.get_coordinates(scene.raised.centroid).ravel(), scene.raised_m]
    value = figures(scene) | {"parked": parked, "raised": raised}
    assert_known(KNOWN / f"{name}.json", value, digits=5, decimals=3)
