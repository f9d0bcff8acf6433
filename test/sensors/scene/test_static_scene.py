from dataclasses import replace
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest
import shapely
from repository import SHARED
from shapely.geometry import LineString, Polygon

from siren_ros.roads.maps.map_compiler import compile_map
from siren_ros.roads.net_parser import parse_road_network
from siren_ros.roads.road_network import LaneKind, RoadNetwork
from siren_ros.sensors.meshes.material import LampColour, Material
from siren_ros.sensors.meshes.mesh import StaticScene
from siren_ros.sensors.scene.config import SceneConfig
from siren_ros.sensors.scene.static_scene import static_scene

TOWN10 = SHARED / "maps" / "Town10HD_Opt.xodr"
GROUND = [
    Material.GROUND, Material.GRASS, Material.ASPHALT, Material.SHOULDER_ASPHALT, Material.MARKING_WHITE,
    Material.MARKING_YELLOW, Material.KERB, Material.SIDEWALK, Material.MEDIAN,
]  # fmt: skip


def traffic_space(network: RoadNetwork) -> shapely.Geometry:
    lanes = [
        LineString(lane.centre.points).buffer(lane.width_m / 2 - 0.02, cap_style="flat")
        for lane in network.lanes
        if lane.kind in {LaneKind.DRIVING, LaneKind.SHOULDER}
        or (lane.kind is LaneKind.INTERNAL and (lane.emergency_allowed or lane.civilian_allowed))
    ]
    outlines = [Polygon(j.outline).buffer(-0.02) for j in network.junctions.values() if len(j.outline) > 2]
    return shapely.union_all([*lanes, *outlines])


def standing_low(scene: StaticScene, below_m: float) -> np.ndarray:
    """Triangles' outlines in the plane of all that is not ground and reaches below a height."""
    mesh = scene.mesh
    corners = mesh.vertices_m[mesh.triangles]
    rows = ~np.isin(mesh.material, GROUND) & (corners[:, :, 2].min(axis=1) < below_m)
    return shapely.convex_hull(shapely.multipoints(corners[rows, :, :2].astype(float)))


def heights_at(scene: StaticScene, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Height and material of the ground straight below places ``(N, 2)``, seen from a metre up."""
    caster = o3d.t.geometry.RaycastingScene(nthreads=1)
    caster.add_triangles(o3d.core.Tensor(scene.mesh.vertices_m), o3d.core.Tensor(scene.mesh.triangles))
    down = np.tile((1.0, 0.0, 0.0, -1.0), (len(points), 1))
    rays = np.concatenate((points, down), axis=1).astype(np.float32)
    answer = caster.cast_rays(o3d.core.Tensor(rays))
    return 1.0 - answer["t_hit"].numpy(), scene.mesh.material[answer["primitive_ids"].numpy()]


def check(scene: StaticScene, network: RoadNetwork) -> None:
    """What holds on every map."""
    assert len(scene.mesh) <= 150_000
    shapes = standing_low(scene, 4.5)
    assert not shapely.STRtree(shapes).query(traffic_space(network), predicate="intersects").size
    lanes = [lane for lane in network.lanes if lane.kind is LaneKind.DRIVING]
    middles = np.concatenate([lane.centre.at(np.arange(0.5, lane.length_m - 0.5, 1.7)) for lane in lanes])
    height, material = heights_at(scene, middles)
    np.testing.assert_allclose(height, 0.0, atol=1e-5)
    assert np.isin(material, [Material.ASPHALT, Material.MARKING_WHITE, Material.MARKING_YELLOW]).all()
    signalled = {(c.signal_id, c.signal_link) for c in network.connections if c.signal_id is not None}
    for lamp in scene.signal_lamps:
        assert (lamp.signal_id, lamp.link) in signalled
        assert (scene.mesh.material[lamp.start : lamp.stop] == lamp.colour.material).all()
    lit = np.concatenate([np.arange(lamp.start, lamp.stop) for lamp in scene.signal_lamps])
    lenses = np.isin(scene.mesh.material, [colour.material for colour in LampColour])
    np.testing.assert_array_equal(np.sort(lit), np.nonzero(lenses)[0])


def test_a_crossing_made_by_hand(scene: StaticScene, network: RoadNetwork) -> None:
    check(scene, network)
    approaches = {(lamp.signal_id, lamp.link) for lamp in scene.signal_lamps}
    straight = {(c.signal_id, c.signal_link) for c in network.connections if c.direction == "s"}
    assert approaches == straight


def test_lamps_face_their_approach(scene: StaticScene, network: RoadNetwork) -> None:
    by_link = {c.signal_link: network.lanes[c.from_lane] for c in network.connections}
    for lamp in scene.signal_lamps:
        lane = by_link[lamp.link]
        heading = float(lane.centre.heading_rad(lane.length_m))
        normal = scene.mesh.normals[lamp.start]
        np.testing.assert_allclose(normal, (-np.cos(heading), -np.sin(heading), 0.0), atol=1e-5)


def test_sidewalks_stand_a_kerb_above_the_road(scene: StaticScene, network: RoadNetwork) -> None:
    walks = [lane for lane in network.lanes if lane.kind is LaneKind.SIDEWALK]
    places = np.concatenate([lane.centre.at(np.arange(5.0, 80.0, 3.1)) for lane in walks])
    height, material = heights_at(scene, places)
    ground = np.isin(material, GROUND)
    assert ground.mean() > 0.9
    np.testing.assert_allclose(height[ground], SceneConfig().kerb_height_m, atol=1e-5)


def test_no_ray_falls_through_the_ground(scene: StaticScene) -> None:
    places = np.random.default_rng(1).uniform(-150.0, 150.0, (20_000, 2))
    height, material = heights_at(scene, places)
    slipped = (material == Material.GROUND) & (height < -0.01)
    assert np.isfinite(height).all()
    assert slipped.mean() < 1e-3


def test_the_same_seed_gives_the_same_bytes_and_another_one_other_houses(
    scene: StaticScene, network: RoadNetwork
) -> None:
    again, other = static_scene(network, seed=3), static_scene(network, seed=4)
    for name in ("vertices_m", "triangles", "material", "colour_rgb"):
        assert getattr(again.mesh, name).tobytes() == getattr(scene.mesh, name).tobytes()
    assert again.signal_lamps == scene.signal_lamps == other.signal_lamps
    assert other.mesh.vertices_m.tobytes() != scene.mesh.vertices_m.tobytes()


def test_stop_signs_stand_where_no_signal_does(stop_network: RoadNetwork) -> None:
    scene = static_scene(stop_network, seed=0)
    assert scene.signal_lamps == ()
    middles = scene.mesh.vertices_m[scene.mesh.triangles[scene.mesh.material == Material.STOP_SIGN]].mean(axis=1)
    quadrants = {(float(np.sign(x)), float(np.sign(y))) for x, y, _ in middles}
    assert len(quadrants) == 4


def test_a_map_without_sidewalks_gets_a_verge(network: RoadNetwork) -> None:
    bare = replace(
        network,
        lanes=tuple(replace(x, kind=LaneKind.KERB) if x.kind is LaneKind.SIDEWALK else x for x in network.lanes),
    )
    scene = static_scene(bare, seed=0)
    assert (scene.mesh.material == Material.SIDEWALK).sum() > 0
    corners = scene.mesh.vertices_m[scene.mesh.triangles[scene.mesh.material == Material.GROUND]]
    assert (np.abs(corners[:, :, 2]).max(axis=1) < 1e-6).sum() > 50


@pytest.mark.parametrize("source", [None, TOWN10], ids=["town", "Town10"])
def test_whole_maps(source: Path | None, tmp_path: Path) -> None:
    if source is not None and not source.is_file():
        pytest.skip("the paper's map is not beside this checkout")
    network = parse_road_network(compile_map(source, tmp_path).read_bytes())
    check(static_scene(network, seed=0), network)
