"""The static world of a map: ground, signals, street furniture, buildings and trees as one mesh."""

from dataclasses import replace

from siren_ros.numerics.arrays import random_stream
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.sensors.meshes.mesh import Mesh, StaticScene
from siren_ros.sensors.scene.config import SceneConfig
from siren_ros.sensors.scene.free_space import FreeSpace
from siren_ros.sensors.scene.ground import ground_mesh
from siren_ros.sensors.scene.markings import road_markings
from siren_ros.sensors.scene.planting import parkland, street_buildings, street_lamps, street_trees
from siren_ros.sensors.scene.signals import junction_controls
from siren_ros.sensors.scene.surfaces import drawn_centres, road_surfaces


def static_scene(network: RoadNetwork, seed: int, config: SceneConfig | None = None) -> StaticScene:
    """Generates the static world of a map. The same arguments give the same triangles.

    Args:
        network: The map.
        seed: Varies buildings and trees; roads, markings and signals do not depend on it.
        config: Numbers of the world; defaults where None.
    """
    numbers = SceneConfig() if config is None else config
    centres = drawn_centres(network, numbers.road_extension_m)
    surfaces = road_surfaces(network, centres, numbers)
    ground = ground_mesh(surfaces, road_markings(network, centres, surfaces, numbers), numbers)
    space = FreeSpace(surfaces)
    controls = junction_controls(network, space, numbers)
    lamps = street_lamps(surfaces, space, numbers)
    trees = street_trees(surfaces, space, numbers, random_stream(seed, "scene trees"))
    houses = street_buildings(surfaces, space, numbers, random_stream(seed, "scene buildings"))
    park = parkland(surfaces, space, numbers, random_stream(seed, "scene park"))
    first = len(ground)
    return StaticScene(
        mesh=Mesh.concatenate([ground, controls.mesh, lamps, trees, houses, park]),
        signal_lamps=tuple(replace(lamp, start=lamp.start + first, stop=lamp.stop + first) for lamp in controls.lamps),
    )
