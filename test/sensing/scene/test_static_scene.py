from dataclasses import replace

import numpy as np
import pytest
import shapely
from hand_made_record import crossing
from made_crossing import made_net
from made_district import write_district
from map_networks import network_of_map
from shapely.geometry import LineString, Point, Polygon
from solids import areas, gap_m2, volume

from siren_ros.sensing.lidar.embree import RaycastWorld
from siren_ros.sensing.lidar.lidar import Lidar
from siren_ros.sensing.meshes.mesh import LampColour, Material, Mesh, SemanticClass
from siren_ros.sensing.scene.kerbside import HEAD_HEIGHT_M, mast_arm, pole, signal_head, stop_sign, turned
from siren_ros.sensing.scene.static_scene import (
    Lot,
    broadleaf,
    building,
    conifer,
    facade,
    flat_roof,
    footprint,
    gable_roof,
    static_scene,
)
from siren_ros.sensing.scene.surfaces import SceneConfig
from siren_ros.sensing.specification import LidarSpec, Mount, map_from_base, transform
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import JunctionKind, LaneKind, mirrored_network
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


def test_the_head_on_the_post_is_the_right_lanes_and_those_on_the_mast_are_each_over_their_own(scene, network):
    """The driving lanes of an approach are those with the positions 2, on the right, and 3."""
    by_link = {c.signal_link: c for c in network.connections if c.direction == "s"}
    on_posts = set()
    for lamp in scene.signal_lamps:
        *place, z_m = scene.mesh.vertices_m[scene.mesh.triangles[lamp.start : lamp.stop]].mean(axis=(0, 1))
        if z_m < 4.0:
            on_posts.add(lamp.link)
        else:
            assert abs(network.lanes[by_link[lamp.link].to_lane].centre.project(place)[1]) < 0.5
    assert on_posts == {link for link, c in by_link.items() if network.lanes[c.from_lane].position == 2}


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


def test_stop_signs_stand_where_no_signal_does():
    """The right edge of the approach from the south is at x = 9.5 m, its line at y = −20 m."""
    scene = static_scene(crossing(JunctionKind.PRIORITY_STOP), seed=0)
    assert scene.signal_lamps == ()
    middles = scene.mesh.vertices_m[scene.mesh.triangles[scene.mesh.material == Material.STOP_SIGN]].mean(axis=1)
    assert len(middles) > 50
    assert (middles[:, 0] > 9.5).all()
    assert (np.abs(middles[:, 1] + 22.0) < 10.0).all()


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


def rails_of(scene):
    """Outlines in the plane of the faces of crash barriers, which lie between their two heights."""
    corners = scene.mesh.vertices_m[scene.mesh.triangles]
    rows = np.isclose(corners[:, :, 2, None], (0.44, 0.75)).any(axis=2).all(axis=1)
    return shapely.convex_hull(shapely.multipoints(corners[rows, :, :2].astype(float)))


def test_out_of_town_rails_stand_beside_the_road_and_no_houses_trees_or_lamps(scene, network):
    kinds = {LaneKind.SIDEWALK: LaneKind.KERB}
    lanes = [replace(x, speed_limit_mps=25.0, kind=kinds.get(x.kind, x.kind)) for x in network.lanes]
    country = static_scene(replace(network, lanes=tuple(lanes)), seed=3)
    road = shapely.union_all([LineString(x.centre.points) for x in network.lanes if x.kind is LaneKind.DRIVING])
    corners = country.mesh.vertices_m[country.mesh.triangles][:, :, :2].astype(float)
    houses, crowns, lamps = (
        corners[country.mesh.material == kind]
        for kind in (Material.BUILDING_WALL, Material.FOLIAGE, Material.STREET_LAMP)
    )
    assert shapely.distance(shapely.points(houses), road).min(initial=100.0) > 60.0
    assert shapely.distance(shapely.points(crowns), road).min(initial=100.0) > 8.0
    assert not len(lamps)
    rails = rails_of(country)
    apart_m = shapely.distance(rails, traffic_space(network))
    assert len(rails) > 500
    assert apart_m.min() > 0.25
    assert np.median(apart_m) < 0.8
    assert not len(rails_of(scene))


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


WIDTH_M, DEPTH_M = 16.0, 10.0


def lot(heading_rad, height_m):
    return Lot(50.0, -20.0, heading_rad, WIDTH_M, DEPTH_M, height_m)


def on_lot(mesh, heading_rad):
    """Corners seen from the middle of the front: to the back, to its left, up."""
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    x, y, z = (mesh.vertices_m[mesh.triangles].astype(float) - (50.0, -20.0, 0.0)).reshape(-1, 3).T
    return np.stack((cos * x + sin * y, cos * y - sin * x, z), axis=-1)


@pytest.mark.parametrize("heading_rad", [0.0, 1.1, -2.4])
@pytest.mark.parametrize("height_m", [8.0, 20.0])
def test_walls_stand_on_the_lot(heading_rad, height_m):
    for seed in range(4):
        mesh = building(lot(heading_rad, height_m), np.random.default_rng(seed), detailed=True)
        places = on_lot(mesh, heading_rad)
        material = np.repeat(mesh.material, 3)
        walls = places[(material == Material.BUILDING_WALL) & (places[:, 2] < height_m - 0.5)]
        assert walls.min(axis=0) == pytest.approx([0.0, -WIDTH_M / 2, 0.0], abs=1e-4)
        assert walls.max(axis=0)[:2] == pytest.approx([DEPTH_M, WIDTH_M / 2], abs=1e-4)
        panes = places[material == Material.BUILDING_GLASS]
        outside = np.maximum(np.maximum(-panes[:, 0], panes[:, 0] - DEPTH_M), np.abs(panes[:, 1]) - WIDTH_M / 2)
        assert outside == pytest.approx(np.full(len(panes), 0.03), abs=1e-4), "3 cm in front of one of the walls"
        assert 0.3 < panes[:, 2].min() <= panes[:, 2].max() < height_m
        glass = mesh.normals[mesh.material == Material.BUILDING_GLASS]
        centres = mesh.vertices_m[mesh.triangles[mesh.material == Material.BUILDING_GLASS]].mean(axis=1)
        house = np.array([50.0 + np.cos(heading_rad) * DEPTH_M / 2, -20.0 + np.sin(heading_rad) * DEPTH_M / 2])
        assert (np.einsum("ij,ij->i", glass[:, :2], centres[:, :2] - house) > 0.0).all(), "panes look out"


def test_windows_ribbons_and_shops_lie_side_by_side_in_each_storey():
    """16 m and 5 storeys of 3 m: (16 − 0.8) / 2.9 makes five windows, 46 % of their field each."""
    mesh = facade((0.0, 8.0), (0.0, -8.0), 5, 15.0, np.random.default_rng(0), ribbons=False, shop=False)
    quads = mesh.vertices_m.reshape(-1, 4, 3)
    assert len(quads) == 25
    step = 15.2 / 5
    lefts = np.sort(np.unique(np.round(8.0 - quads[:, 0, 1].astype(float), 4)))
    assert lefts == pytest.approx(0.4 + (np.arange(5) + 0.27) * step, abs=1e-3)
    assert quads[:, 0, 1] - quads[:, 1, 1] == pytest.approx(np.full(25, 0.46 * step), abs=1e-4)
    assert np.unique(np.round(quads[:, 0, 2], 3)).tolist() == pytest.approx([0.95, 3.95, 6.95, 9.95, 12.95])
    assert quads[:, 2, 2] - quads[:, 0, 2] == pytest.approx(np.full(25, 1.45), abs=1e-4)
    mesh = building(lot(0.0, 12.0), np.random.default_rng(0), detailed=False)
    panes = on_lot(mesh, 0.0)[np.repeat(mesh.material == Material.BUILDING_GLASS, 3)]
    assert panes[:, 0] == pytest.approx(np.full(len(panes), -0.03), abs=1e-5)
    mesh = facade((0.0, 8.0), (0.0, -8.0), 3, 9.0, np.random.default_rng(0), ribbons=True, shop=True)
    quads = mesh.vertices_m.reshape(-1, 4, 3)
    shop = quads[quads[:, 0, 2] < 0.5]
    assert len(shop) == 4, "16 m / 3.6 m"
    assert shop[:, 0, 1] - shop[:, 1, 1] == pytest.approx(np.full(4, 3.5), abs=1e-4)
    ribbons = quads[quads[:, 0, 2] > 0.5]
    assert ribbons[:, 0, 1] - ribbons[:, 1, 1] == pytest.approx(np.full(2, 15.0), abs=1e-4)
    assert ribbons[:, 0, 2].tolist() == pytest.approx([3.95, 6.95])


def test_a_saddle_roof_is_closed_and_has_its_volume_and_a_flat_one_lies_on_the_walls():
    """A ridge of 16.8 m, 0.28 of the depth above the eaves; half of the box around it."""
    (roof,) = gable_roof(8.0, DEPTH_M, 7.0, np.random.default_rng(0))
    assert gap_m2(roof) < 1e-4
    rise = 0.28 * DEPTH_M
    assert volume(roof.translated(0.0, 0.0, -7.0)) == pytest.approx(0.5 * 16.8 * 10.8 * rise, rel=1e-4)
    low, high = roof.bounds_m
    assert (low, high) == (pytest.approx([-0.4, -8.4, 7.0]), pytest.approx([10.4, 8.4, 7.0 + rise]))
    assert roof.vertices_m[roof.vertices_m[:, 2] > 7.1][:, 0] == pytest.approx([5.0, 5.0])
    parts = flat_roof(8.0, DEPTH_M, 9.0, (100, 100, 100), np.random.default_rng(0))
    assert len(parts) == 2
    edge, roof = parts
    assert edge.bounds_m[0] == pytest.approx([-0.15, -8.15, 8.55])
    assert edge.bounds_m[1] == pytest.approx([10.15, 8.15, 9.0])
    assert roof.bounds_m[0] == pytest.approx([0.1, -7.9, 8.8])
    assert roof.bounds_m[1] == pytest.approx([9.9, 7.9, 9.04])
    assert np.unique(edge.colour_rgb).tolist() == [82]
    low, high = flat_roof(8.0, DEPTH_M, 12.0, (100, 100, 100), np.random.default_rng(0))[2].bounds_m
    assert (high - low, low[2]) == (pytest.approx([3.2, 3.6, 2.2], abs=1e-4), 12.0)
    assert low[0] > 0.0
    assert high[0] < DEPTH_M
    assert max(abs(low[1]), high[1]) < 8.0


@pytest.mark.parametrize("heading_rad", [0.0, 1.1, -2.4])
def test_a_footprint_holds_the_house_and_its_eaves(heading_rad):
    area = footprint(lot(heading_rad, 8.0))
    assert area.area == pytest.approx((WIDTH_M + 0.8) * (DEPTH_M + 0.8))
    mesh = building(lot(heading_rad, 8.0), np.random.default_rng(1), detailed=False)
    assert all(area.buffer(1e-3).contains(Point(x, y)) for x, y in mesh.vertices_m[:, :2].tolist())


def middle(mesh):
    low, high = mesh.bounds_m
    return np.asarray((low + high) / 2.0)


@pytest.mark.parametrize("end", [(13.0, 8.0), (3.0, -16.0), (-7.0, 8.0), (13.0, 24.0)])
def test_an_arm_reaches_from_one_place_to_the_other(end):
    start = (3.0, 8.0)
    beam = mast_arm(start, end, 6.0)
    length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
    assert middle(beam) == pytest.approx([(start[0] + end[0]) / 2, (start[1] + end[1]) / 2, 6.0], abs=1e-5)
    assert volume(beam.translated(-start[0], -start[1], -6.0)) == pytest.approx(length * 0.12**2, rel=1e-4)
    reach = np.abs((beam.vertices_m[:, :2] - start) @ (np.array(end) - start) / length)
    assert reach.max() == pytest.approx(length, abs=1e-4)
    assert gap_m2(beam) < 1e-6


def test_a_mesh_is_turned_about_its_origin_and_then_moved():
    """A point 2 m ahead and 1 m to the left, turned to the north, at (10, 20, 3)."""
    mesh = Mesh.uniform([(2, 1, 0.5), (3, 1, 0.5), (2, 2, 0.5)], [(0, 1, 2)], Material.KERB, (1, 2, 3))
    assert turned(mesh, 10.0, 20.0, 3.0, np.pi / 2.0).vertices_m[0] == pytest.approx([9.0, 22.0, 3.5])
    low, high = pole(4.0, -3.0, 5.0, 0.1).bounds_m
    assert ([*low], high[2]) == (pytest.approx([3.9, -3.1, 0.0], abs=0.01), 5.0)


def test_red_is_above_yellow_above_green_and_shines_ahead():
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


def test_a_stop_sign_is_an_octagon_that_says_stop():
    sign = stop_sign()
    faces = sign.normals[:, 0]
    red = (sign.colour_rgb == (178, 20, 24)).all(axis=1)
    assert areas(sign)[red].sum() == pytest.approx((0.5 * 8 * np.sin(2 * np.pi / 8)) * 0.41**2, rel=1e-4)
    assert (faces[red] > 0).all()
    assert (faces[sign.material == Material.METAL_POLE] < 0).all()
    white = (sign.colour_rgb == (240, 240, 240)).all(axis=1)
    cells = sign.vertices_m[sign.triangles[white]]
    # 11, 7, 12 and 10 cells of 45 mm, in front of the red, in the middle of the sign.
    assert areas(sign)[white].sum() == pytest.approx((11 + 7 + 12 + 10) * 0.045**2, rel=1e-3)
    assert (cells[..., 0] > 0.01).all()
    # Who looks at it has −y on the left: there is the S.
    assert areas(sign)[white][cells[..., 1].max(axis=1) < -0.19].sum() == pytest.approx(11 * 0.045**2, rel=1e-3)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("make", [broadleaf, conifer])
def test_trees_stand_on_the_ground_and_keep_to_their_radius(make, seed):
    tree = make(30.0, -12.0, 2.0, np.random.default_rng(seed))
    assert 1.5 < np.hypot(tree.vertices_m[:, 0] - 30.0, tree.vertices_m[:, 1] + 12.0).max() <= 2.0 + 1e-5
    height = float(tree.vertices_m[:, 2].max())
    assert tree.vertices_m[:, 2].min() == 0.0
    assert (4.0 if make is broadleaf else 6.8) < height < (7.0 if make is broadleaf else 8.9)
    crown = tree.vertices_m[tree.triangles[tree.material == Material.FOLIAGE]]
    stem = tree.vertices_m[tree.triangles[tree.material == Material.TREE_TRUNK]]
    assert crown[..., 2].min() < stem[..., 2].max() < crown[..., 2].max(), "the stem reaches into the crown"
    assert crown[..., 2].min() > 0.1 * height
    assert volume(tree.translated(-30.0, 12.0, 0.0)) > 0.0
    assert gap_m2(tree) < 1e-3
