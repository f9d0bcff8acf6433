import numpy as np
import shapely
from hand_made_record import crossing
from made_crossing import made_net
from made_district import write_district
from map_networks import network_of_map
from shapely.geometry import LineString, Polygon

from siren_ros.sensing.lidar.embree import RaycastWorld
from siren_ros.sensing.lidar.lidar import Lidar
from siren_ros.sensing.meshes.mesh import LampColour, Material, SemanticClass
from siren_ros.sensing.scene.static_scene import (
    static_scene,
)
from siren_ros.sensing.scene.surfaces import SceneConfig
from siren_ros.sensing.specification import LidarSpec, Mount, map_from_base, transform
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import LaneKind, mirrored_network
from siren_ros.simulation.world.carrier import CameraIntrinsics

GROUND = [
    Material.GROUND, Material.GRASS, Material.ASPHALT, Material.SHOULDER_ASPHALT, Material.MARKING_WHITE,
    Material.MARKING_YELLOW, Material.KERB, Material.SIDEWALK, Material.MEDIAN,
]  # fmt: skip


def traffic_space(network):
    lanes = [
        LineString(lane.centre.points).buffer(lane.width_m / 2 - 0.02, cap_style="flat")
        for lane in network.lanes
        if lane.kind in {LaneKind.DRIVING, LaneKind.SHOULDER}
        or (lane.kind is LaneKind.INTERNAL and (lane.emergency_allowed or lane.civilian_allowed))
    ]
    outlines = [Polygon(j.outline).buffer(-0.02) for j in network.junctions.values() if len(j.outline) > 2]
    return shapely.union_all([*lanes, *outlines])


def standing_low(scene, below_m):
    """Triangles' outlines in the plane of all that is not ground and reaches below a height."""
    mesh = scene.mesh
    corners = mesh.vertices_m[mesh.triangles]
    rows = ~np.isin(mesh.material, GROUND) & (corners[:, :, 2].min(axis=1) < below_m)
    return shapely.convex_hull(shapely.multipoints(corners[rows, :, :2].astype(float)))


def heights_at(scene, points):
    """Height and material of the ground straight below places ``(N, 2)``, seen from a metre up."""
    import open3d as o3d

    caster = o3d.t.geometry.RaycastingScene(nthreads=1)
    caster.add_triangles(o3d.core.Tensor(scene.mesh.vertices_m), o3d.core.Tensor(scene.mesh.triangles))
    down = np.tile((1.0, 0.0, 0.0, -1.0), (len(points), 1))
    answer = caster.cast_rays(o3d.core.Tensor(np.concatenate((points, down), axis=1).astype(np.float32)))
    return 1.0 - answer["t_hit"].numpy(), scene.mesh.material[answer["primitive_ids"].numpy()]


def check(scene, network):
    """What holds on every map."""
    assert len(scene.mesh) <= max(180_000, 9.0 * sum(lane.length_m for lane in network.lanes))
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


def test_the_lamps_of_a_crossing_made_by_hand_face_their_approach(scene, network):
    by_link = {c.signal_link: network.lanes[c.from_lane] for c in network.connections}
    for lamp in scene.signal_lamps:
        lane = by_link[lamp.link]
        heading = float(lane.centre.heading_rad(lane.length_m))
        normal = scene.mesh.normals[lamp.start]
        np.testing.assert_allclose(normal, (-np.cos(heading), -np.sin(heading), 0.0), atol=1e-5)
    check(scene, network)
    approaches = {(lamp.signal_id, lamp.link) for lamp in scene.signal_lamps}
    assert approaches == {(c.signal_id, c.signal_link) for c in network.connections if c.direction == "s"}


def test_sidewalks_stand_a_kerb_above_the_road_and_no_ray_falls_through_the_ground(scene, network):
    walks = [lane for lane in network.lanes if lane.kind is LaneKind.SIDEWALK]
    places = np.concatenate([lane.centre.at(np.arange(5.0, 80.0, 3.1)) for lane in walks])
    height, material = heights_at(scene, places)
    ground = np.isin(material, GROUND)
    assert ground.mean() > 0.9
    np.testing.assert_allclose(height[ground], SceneConfig().kerb_height_m, atol=1e-5)
    np.testing.assert_allclose(scene.ground_m(*places[ground].T), height[ground], atol=1e-5)
    height, material = heights_at(scene, np.random.default_rng(1).uniform(-150.0, 150.0, (20_000, 2)))
    slipped = (material == Material.GROUND) & (height < -0.01)
    assert np.isfinite(height).all()
    assert slipped.mean() < 1e-3


def test_the_same_seed_gives_the_same_bytes_and_another_one_other_houses(scene, network):
    again, other = static_scene(network, seed=3), static_scene(network, seed=4)
    for name in ("vertices_m", "triangles", "material", "colour_rgb"):
        assert getattr(again.mesh, name).tobytes() == getattr(scene.mesh, name).tobytes()
    assert again.signal_lamps == scene.signal_lamps == other.signal_lamps
    assert other.mesh.vertices_m.tobytes() != scene.mesh.vertices_m.tobytes()


def test_a_whole_district(tmp_path):
    network = network_of_map(write_district(tmp_path))
    check(static_scene(network, seed=0), network)


def straight_road(folder, x_m, y_m):
    """The network of 400 m of road around a place, with the place's coordinates."""
    folder.mkdir()
    net = folder / "road.net.xml"
    net.write_bytes(made_net(folder, {"a": (x_m - 200, y_m), "b": (x_m + 200, y_m)}, ("a b",), "--no-turnarounds"))
    return parse_road_network(compile_map(net, folder).read_bytes())


def test_far_from_the_origin_pictures_and_sweeps_are_those_at_the_origin(boxes, tmp_path):
    networks = [straight_road(tmp_path / f"{y_m}", x_m, y_m) for x_m, y_m in ((0, 0), (644_000, 5_491_000))]
    scenes = [static_scene(network, seed=0) for network in networks]
    assert scenes[0].mesh.vertices_m.tobytes() == scenes[1].mesh.vertices_m.tobytes()
    pose, seen = map_from_base(-50.0, -1.6, 0.0, 0.0), []
    eye = pose @ transform(np.eye(3), (0.0, 0.0, 1.5))
    for scene in scenes:
        lidar = Lidar(LidarSpec("lidar", Mount(0.0, 0.0, 1.9)), RaycastWorld(scene, boxes.shapes()), 0)
        sweep = lidar.scan(0, pose @ lidar.spec.mount.base_from_sensor, boxes.placed())
        image = boxes.renderer(scene).render(
            CameraIntrinsics.centred(320, 240, 160.0), eye, boxes.placed(), np.zeros(0), {}, 0, labels=True
        )
        seen.append((sweep.points.tobytes(), image.rgba.tobytes()))
        assert (image.semantic == SemanticClass.ROAD_LINE).sum() > 50
    assert seen[0] == seen[1]


def test_where_traffic_keeps_left_the_scene_is_the_mirror_image():
    network = crossing()
    scene, image = static_scene(network, seed=0), static_scene(mirrored_network(network), seed=0)
    assert np.array_equal(image.mesh.vertices_m, scene.mesh.vertices_m * np.float32((1.0, -1.0, 1.0)))
    assert np.array_equal(image.mesh.triangles, scene.mesh.triangles[:, ::-1])
    assert np.array_equal(image.mesh.material, scene.mesh.material)
    assert image.signal_lamps == scene.signal_lamps
    assert shapely.transform(image.raised, lambda points: points * (1.0, -1.0)).equals(scene.raised)
    x_m, y_m = shapely.get_coordinates(scene.raised.representative_point()).T
    assert image.ground_m(x_m, -y_m) == scene.ground_m(x_m, y_m) == scene.raised_m > 0.0
