"""Light on the ground by day and at night, its projections, rain, and which walls lie in the sun."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from siren_ros.sensing.camera import ground_light, surface_light
from siren_ros.sensing.camera.culling import VERTEX
from siren_ros.sensing.camera.surface_light import LIGHT_GRID_M, LIGHT_HALF_M, Shading, shading_of
from siren_ros.sensing.look import Look
from siren_ros.sensing.meshes.mesh import Material, Mesh, SemanticClass
from siren_ros.sensing.scene.kerbside import street_lamp, turned
from siren_ros.sensing.specification import transform
from siren_ros.simulation.world.actors import ActorClass, Lights
from siren_ros.simulation.world.carrier import CameraIntrinsics

CAMERA = CameraIntrinsics.centred(320, 240, 160.0)
SEDAN = ActorClass.SEDAN
EYE = transform(np.eye(3), (0.0, 0.0, 2.5))
NIGHT = Look(
    sun_elevation_rad=-0.4, zenith_colour=(0.006, 0.009, 0.02), horizon_colour=(0.03, 0.03, 0.036), ambient=0.5
)


def picture(renderer, placement, step=0, *, labels=False):
    return renderer.render(CAMERA, EYE, placement, np.zeros(len(placement)), {}, step, labels=labels)


def road(image):
    return image.semantic == SemanticClass.ROAD


def test_each_street_lamp_is_found_once_and_lights_the_road_below_it_at_night(boxes):
    lamp = turned(street_lamp(8.0), 20.0, -4.0, 0.0, np.pi / 2)
    lit, dark = (picture(boxes.renderer(scene, NIGHT), boxes.placed()) for scene in (boxes.scene(lamp), boxes.scene()))
    assert lit.rgba[140:165, 150:170, :3].mean() > dark.rgba[140:165, 150:170, :3].mean() + 30
    assert (lit.rgba[..., :3].min(axis=2) > 200).sum() > 3, "the lens"
    places = [(0.0, 0.0), (30.0, 5.0), (31.0, 40.0)]
    middles = ground_light.luminaires(Mesh.joined(*[turned(street_lamp(8.0), x, y, 0.0, 0.7) for x, y in places]))
    assert middles.shape == (3, 3)
    assert np.linalg.norm(middles[:, :2] - places, axis=1) == pytest.approx(1.5, abs=0.1)
    assert middles[:, 2] == pytest.approx(7.9, abs=0.1)


def test_walls_have_the_light_that_falls_before_them(boxes):
    wall, seen = boxes.box((12.5, 0.0, 3.0), (1.0, 1.0, 6.0), Material.BUILDING_WALL), []
    for x_m in (6.5, 18.0, 40.0):  # 5.5 m before the face, 6 m behind it, farther
        scene = boxes.scene(wall, turned(street_lamp(8.0), x_m, -1.5, 0.0, np.pi / 2))
        seen.append(picture(boxes.renderer(scene, NIGHT), boxes.placed()).rgba[80:118, 156:164, :3].mean())
    assert seen[0] > seen[1] > 1.5 * seen[2]


def test_beacons_light_the_road_on_all_sides(boxes):
    renderer, blue = boxes.renderer(boxes.scene(), NIGHT), []
    for yaw_rad, lights in itertools.product((0.0, np.pi / 2), (0, int(Lights.BEACON))):
        image = picture(renderer, boxes.placed((ActorClass.BUS, 18.0, 0.0, yaw_rad), lights=[lights]))
        blue.append(image.rgba[160:165, 150:170, 2].mean())
    assert min(blue[1] - blue[0], blue[3] - blue[2]) > 10.0, "9 m behind and 9 m beside"


def test_rain_falls_over_the_colours_alone(boxes):
    placement = boxes.placed((SEDAN, 8.0, 1.0, 0.3))
    wet = Look(rain_mm_per_h=10.0)
    dry = picture(boxes.renderer(boxes.scene()), placement, labels=True)
    renderer = boxes.renderer(boxes.scene(), wet)
    first, later = picture(renderer, placement, labels=True), picture(renderer, placement, 1, labels=True)
    again = picture(boxes.renderer(boxes.scene(), wet), placement)
    assert 0.002 < np.any(first.rgba[..., :3] != dry.rgba[..., :3], axis=2).mean() < 0.2
    assert first.rgba.tobytes() == again.rgba.tobytes() != later.rgba.tobytes()
    wall = boxes.scene(boxes.box((2.0, 0.0, 5.0), (2.0, 40.0, 10.0)))
    shares = []
    for scene, rate in ((boxes.scene(), 40.0), (boxes.scene(), 4.0), (wall, 40.0)):
        pair = [picture(boxes.renderer(scene, look), boxes.placed()) for look in (Look(), Look(rain_mm_per_h=rate))]
        shares.append((pair[0].rgba != pair[1].rgba).any(axis=2).mean())
    assert shares[0] > 2.0 * shares[1], "heavy rain has more drops"
    assert shares[0] > 2.0 * shares[2], "those behind a wall are not seen"
    for rainy in (first, later):
        assert np.array_equal(rainy.semantic, dry.semantic)
        assert np.array_equal(np.asarray(rainy.instance), np.asarray(dry.instance))
        assert np.array_equal(np.asarray(rainy.depth_m), np.asarray(dry.depth_m))


CENTRE = (30.0, -12.0)


def test_the_square_of_light_is_the_whole_texture_and_stands_on_a_grid():
    scale, x, y = ground_light.light_from_map(CENTRE)
    for aside, texture in (((0.0, 0.0), (0.5, 0.5)), ((1.0, -1.0), (1.0, 0.0)), ((-1.0, 0.0), (0.0, 0.5))):
        point = np.array(CENTRE) + LIGHT_HALF_M * np.array(aside)
        assert scale * point + (x, y) == pytest.approx(texture)
    assert ground_light.cell_of(np.array([2.4 * LIGHT_GRID_M, -0.6 * LIGHT_GRID_M, 9.0])) == (2, -1)


def sun(elevation_deg, azimuth_deg):
    e, a = np.radians((elevation_deg, azimuth_deg))
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


@pytest.mark.parametrize("direction", [(60.0, 0.0), (35.0, 130.0), (80.0, -60.0), (90.0, 0.0)])
def test_the_view_along_the_sun_holds_the_square_and_what_shades_it(direction):
    """Points along one ray of the sun fall on one texel, the nearer to the sun in front."""
    towards = sun(*direction)
    view = ground_light.sun_view(towards, CENTRE, 40.0, (0.0, 25.0))

    def seen(point):
        return (view @ np.array([*point, 1.0]))[:3]

    corners = [(CENTRE[0] + sx * 40.0, CENTRE[1] + sy * 40.0, 0.0) for sx in (-1, 1) for sy in (-1, 1)]
    assert np.abs(np.array([seen(corner) for corner in corners])[:, :2]).max(axis=0) == pytest.approx([1.0, 1.0])
    assert seen((*CENTRE, 0.0))[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
    for corner in corners:
        low = np.array(corner)
        high = low + towards * 25.0 / towards[2]
        assert seen(high)[:2] == pytest.approx(seen(low)[:2], abs=1e-9)
        assert -1.0 <= seen(high)[2] < seen(low)[2] <= 1.0
    unit = ground_light.UNIT_FROM_CLIP @ view @ np.array([*CENTRE, 0.0, 1.0])
    assert unit[:2] == pytest.approx([0.5, 0.5])
    assert unit[2] == pytest.approx(0.5 + 0.5 * seen((*CENTRE, 0.0))[2])


def test_walls_that_face_away_from_the_sun_are_shady_unless_lamps_are_lit():
    """Normals at 60°, 89°, 91° and 120° from the sun's direction, turned about the vertical."""
    look = Look()
    x, y, _ = look.towards_sun
    azimuth = np.arctan2(y, x)
    turned = np.deg2rad([60.0, 89.0, 91.0, 120.0])
    normals = np.column_stack((np.cos(azimuth + turned), np.sin(azimuth + turned), np.zeros(4))).astype(np.float32)
    walls = np.full(4, Material.BUILDING_WALL, dtype=np.uint8)
    sunny, shady = Shading.WALL_SUNNY, Shading.WALL_SHADY
    assert shading_of(walls, normals, look).tolist() == [sunny, sunny, shady, shady]
    assert shading_of(walls, normals, replace(look, sun_elevation_rad=-0.2)).tolist() == [sunny] * 4
    assert shading_of(np.full(4, Material.ASPHALT, dtype=np.uint8), normals, look).max() not in {sunny, shady}


GREEN = {Material.GROUND, Material.GRASS, Material.MEDIAN}
ROADS = {Material.ASPHALT, Material.SHOULDER_ASPHALT}
PAINT = {Material.MARKING_WHITE, Material.MARKING_YELLOW}
LENSES = {Material.SIGNAL_RED, Material.SIGNAL_YELLOW, Material.SIGNAL_GREEN}


@pytest.mark.parametrize(("wetness", "kept"), [(0.0, 1.0), (0.5, 0.775), (1.0, 0.55)])
def test_the_light_that_each_material_reflects_by_day_dry_and_wet(wetness, kept):
    """The sun is above a slope of 4 by 3; the sky is 0.21 everywhere, a tenth of what comes is from the ground."""
    sky = {"zenith_colour": (0.1, 0.2, 0.4), "horizon_colour": (0.3, 0.2, 0.0), "ambient": 0.5}
    look = Look(sun_elevation_rad=np.pi / 2.0, sun_colour=(2.0, 1.5, 1.0), wetness=wetness, **sky)
    vertices = np.zeros(len(Material), VERTEX)
    vertices["normal_material"] = [(0.6, 0.0, 0.8, material) for material in Material]
    vertices["colour"] = (204, 153, 102, 51)
    ambient = 0.5 * (0.1 * np.array(surface_light.GROUND_AMBIENT) + 0.9 * 0.21)
    for material, row in zip(Material, surface_light.static_vertices(vertices, look), strict=True):
        wets, leaves = material in {*ROADS, *PAINT, Material.KERB, Material.SIDEWALK}, material == Material.FOLIAGE
        albedo = np.array([0.64, 0.36, 0.16]) * (kept if wets else 1.0)
        albedo *= 0.72 if material in GREEN else 0.1 if material in LENSES else 1.0
        hidden = 0.28 if wets or material in GREEN else 0.0
        sun = albedo * ((1.0 if leaves else 0.8) * np.array([2.0, 1.5, 1.0]) + hidden * ambient)
        grain = 0.42 if material in ROADS else 0.35 if material in PAINT else 1.1 / 0.72 if material in GREEN else 0.3
        other = 0.85 if leaves else 1.0 if material == Material.BUILDING_WALL else 0.0
        gloss = 0.55 if material == Material.BUILDING_GLASS else 0.5 if material in PAINT else 0.0
        assert row["sun"].tolist() == pytest.approx([*sun, grain if hidden else other], rel=2e-3), material
        assert row["shade"].tolist() == pytest.approx([*(albedo * (1.0 - hidden) * ambient), 0.2], rel=2e-3), material
        assert row["normal"].tolist() == pytest.approx([0.6, 0.0, 0.8, gloss], rel=2e-3), material


def test_the_sun_is_mirrored_by_glass_that_it_shines_on(boxes):
    """The sun is low behind the camera; its mirror image is in the middle of a pane, which a wall shades or not."""
    look = Look(sun_azimuth_rad=np.pi, sun_elevation_rad=0.2, sun_colour=(0.6, 0.6, 0.6))
    pane = boxes.box((8.5, 0.0, 4.0), (1.0, 20.0, 20.0), Material.BUILDING_GLASS)
    wall = boxes.box((-13.5, 0.0, 8.0), (1.0, 30.0, 30.0))
    for scene, mirrored in ((boxes.scene(pane), True), (boxes.scene(pane, wall), False)):
        seen = picture(boxes.renderer(scene, look), boxes.placed()).rgba[87, :, :3].sum(axis=1, dtype=int)
        assert bool(seen[160] > max(seen[80], seen[240])) is mirrored
