"""Finds the place of a roadside unit: a given place, the corner of the episode's junction, or the side of its road."""

from collections.abc import Mapping
from typing import Final

import numpy as np
import shapely

from siren_ros.base.numerics.arrays import Floats
from siren_ros.errors import InputError
from siren_ros.sensing.meshes.mesh import Material, StaticScene
from siren_ros.sensing.specification import Mount
from siren_ros.sensing.suite import SensorSuite, Station
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.roads.sites import middle_of_site

_BESIDE_M: Final = 0.8
"""Distance between the pole and the nearest lane."""
_SPACING_M: Final = 1.0
_REACH_M: Final = 80.0
_SOLID: Final = (Material.BUILDING_WALL, Material.BUILDING_ROOF, Material.FOLIAGE, Material.TREE_TRUNK)
_ASIDE_M: Final = (1.7e-5, 2.3e-5)
"""Offset of a ray straight up from the sensor, so that it does not pass exactly through the edge of two triangles."""
_TRAFFIC: Final = (LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL)


def station_mount(station: Station, network: RoadNetwork, site: Mapping[str, object] | None = None) -> Mount:
    """The pose of a station in the ``map`` frame, on the ground.

    At a site, given as in the episode's description, it is the free place nearest to the site's middle that is off all
    lanes, facing that middle; of several the one nearest to the east. The middle of a road is half way along it.

    Raises:
        InputError: The station waits for a site, and there is none.
    """
    if station.place is not None:
        return station.place
    middle = middle_of_site(network, site or {})
    if middle is None:
        raise InputError("sensors", "station: site", "an episode with a site, or a station with x_m and y_m")
    place = shapely.Point(*middle)
    lanes = shapely.union_all(
        [
            shapely.LineString(lane.centre.points).buffer(lane.width_m / 2.0 + _BESIDE_M)
            for lane in network.lanes
            if lane.kind in _TRAFFIC and shapely.LineString(lane.centre.points).distance(place) < _REACH_M
        ]
    )
    blocks = [block for block in shapely.get_parts(lanes) if block.distance(place) < _REACH_M]
    edge = max(blocks, key=lambda block: float(block.area)).exterior
    count = max(2, int(edge.length / _SPACING_M))
    places = shapely.get_coordinates(shapely.line_interpolate_point(edge, np.arange(count) * edge.length / count))
    away = places - middle
    chosen = int(np.lexsort((np.abs(np.arctan2(away[:, 1], away[:, 0])).round(6), np.hypot(*away.T).round(3)))[0])
    x_m, y_m = (float(value) for value in places[chosen])
    return Mount(x_m, y_m, 0.0, float(np.arctan2(middle[1] - y_m, middle[0] - x_m)))


def check_outdoors(scene: StaticScene, suite: SensorSuite, station: Mount) -> None:
    """Raise InputError if a sensor is inside a building or tree.

    A ray straight up from there crosses an odd number of surfaces.
    """
    solid = np.isin(scene.mesh.material, [int(kind) for kind in _SOLID])
    corners = scene.mesh.vertices_m[scene.mesh.triangles[solid]].astype(np.float64)
    for name, mount in suite.mounts:
        x, y, z = (station.base_from_sensor @ mount.base_from_sensor)[:3, 3]
        if crossings_above(corners, float(x), float(y), float(z)) % 2:
            place = f"({x:.1f}, {y:.1f}, {z:.1f}) m in the map frame"
            raise InputError(f"{suite.name}: {name}.mount", place, "a place outside of buildings and trees")


def crossings_above(corners: Floats, x_m: float, y_m: float, z_m: float) -> int:
    """How many triangles of shape ``(T, 3, 3)`` a ray straight up from a point crosses: odd inside a closed body."""
    a, b, c = (corners[:, k, :2] - (x_m + _ASIDE_M[0], y_m + _ASIDE_M[1]) for k in range(3))
    ab, bc, ca = _cross(a, b), _cross(b, c), _cross(c, a)
    around = ((ab > 0) & (bc > 0) & (ca > 0)) | ((ab < 0) & (bc < 0) & (ca < 0))
    weight = np.stack((bc, ca, ab), axis=1)[around]
    height = np.einsum("ij,ij->i", weight, corners[around, :, 2]) / weight.sum(axis=1)
    return int(np.count_nonzero(height > z_m))


def _cross(a: Floats, b: Floats) -> Floats:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
