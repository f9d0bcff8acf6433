import os
from dataclasses import replace

import numpy as np
import pytest

from siren_ros.sensing.camera.renderer import DrawingContext
from siren_ros.sensing.meshes.mesh import Limb, Material, SemanticClass, Swing, VehicleShape, Wheel
from siren_ros.sensing.specification import map_from_base, optical_from_map, transform
from siren_ros.simulation.world.actors import ActorClass, Lights
from siren_ros.simulation.world.carrier import CameraIntrinsics

CAMERA = CameraIntrinsics.centred(320, 240, 160.0)
SEDAN, BUS = ActorClass.SEDAN, ActorClass.BUS
EYE = transform(np.eye(3), (0.0, 0.0, 1.5))


@pytest.fixture(name="renderer", scope="module")
def _renderer(boxes):
    return boxes.renderer(boxes.crossroads())


def picture(renderer, placement, pose=EYE, signals=None, **options):
    step = options.pop("step", 0)
    rolled = np.zeros(len(placement))
    return renderer.render(CAMERA, pose, placement, rolled, signals or {}, step, labels=True, **options)


@pytest.mark.parametrize(("x", "y"), [(6.0, 0.0), (12.3, 2.7), (25.0, -6.1)])
def test_the_edges_of_a_labelled_box_land_within_half_a_pixel(renderer, boxes, x, y):
    rows, columns = np.nonzero(picture(renderer, boxes.placed((SEDAN, x, y, 0.0))).instance == 1)
    corners = boxes.shapes()[SEDAN].body.vertices_m + np.array([x, y, 0.0])
    uv, _ = CAMERA.project((np.c_[corners, np.ones(len(corners))] @ optical_from_map(EYE).T)[:, :3])
    low, high = uv.min(axis=0), np.minimum(uv.max(axis=0), [319.5, 239.5])
    assert [columns.min() - 0.5, rows.min() - 0.5] == pytest.approx(low, abs=0.501)
    assert [columns.max() + 0.5, rows.max() + 0.5] == pytest.approx(high, abs=0.501)


def test_the_same_state_gives_the_same_bytes_whatever_came_before(renderer, boxes):
    placement = boxes.placed((SEDAN, 8.0, 1.0, 0.3), lights=[9])
    first = picture(renderer, placement)
    picture(renderer, boxes.placed(), transform(np.eye(3), (90.0, 90.0, 1.5)))
    again = picture(renderer, placement)
    fresh = picture(boxes.renderer(boxes.crossroads()), placement)
    assert first.rgba.tobytes() == again.rgba.tobytes() == fresh.rgba.tobytes()
    bare = renderer.render(CAMERA, EYE, placement, np.zeros(1), {}, 0)
    assert bare.rgba.tobytes() == first.rgba.tobytes()
    assert bare.instance is None
    assert (first.semantic[2, 160], first.semantic[238, 5]) == (SemanticClass.SKY, SemanticClass.ROAD)
    assert (first.semantic[130, 160], first.depth_m[2, 160]) == (SemanticClass.CAR, 0.0)


def test_a_vehicle_throws_a_shadow_away_from_the_sun(renderer, boxes):
    empty = picture(renderer, boxes.placed())
    image = picture(renderer, boxes.placed((BUS, 12.0, 0.0, np.pi / 2)))
    road = (image.instance == 0) & (image.semantic == SemanticClass.ROAD)
    change = image.rgba[..., :3].astype(int).sum(axis=2) / 3 - empty.rgba[..., :3].astype(int).sum(axis=2) / 3
    assert (road & (change < -25)).sum() > 30
    assert not np.any(road & (change > 25))


def test_more_vehicles_of_a_class_than_there_was_room_for(renderer, boxes):
    rows = [(SEDAN, 2.0 * i - 90.0, 100.0, np.pi / 2) for i in range(90)]
    image = picture(renderer, boxes.placed(*rows), map_from_base(0.0, 0.0, 0.0, np.pi / 2) @ EYE)
    assert len(np.unique(image.instance)) == 91


def test_pictures_under_way_at_once_do_not_disturb_each_other(renderer, boxes):
    near, far = boxes.placed((SEDAN, 6.0, 0.0, 0.0)), boxes.placed((SEDAN, 20.0, 3.0, 0.5))
    alone = [picture(renderer, placed) for placed in (near, far)]
    begun = [renderer.begin(CAMERA, EYE, placed, np.zeros(1), {}, 0, labels=True) for placed in (near, far)]
    for finish, expected in zip(reversed(begun), reversed(alone), strict=True):
        seen = finish()
        assert seen.rgba.tobytes() == expected.rgba.tobytes()
        assert np.array_equal(seen.instance, expected.instance)
        assert np.array_equal(seen.depth_m, expected.depth_m)
    assert alone[0].rgba.tobytes() != alone[1].rgba.tobytes()


def of_one_part(boxes, parts):
    """Boxes with vehicles that are one mesh each, or one wheel or limb on a speck, by class; and a renderer."""

    class Made(boxes):
        @classmethod
        def shapes(cls):
            speck, shapes = cls.box((0.0, 0.0, 2.0), np.full(3, 0.01)), {}
            for kind, part in dict(parts).items():
                wheels, limbs = (tuple(one for one in (part,) if isinstance(one, sort)) for sort in (Wheel, Limb))
                body = speck if wheels or limbs else part
                shapes[kind] = VehicleShape(kind, body, wheels, 2.0, 2.0, 2.0, limbs)
            return shapes

    return Made, Made.renderer(boxes.crossroads())


def test_steered_wheels_turn_left_and_others_do_not_and_all_roll_forwards(boxes):
    """A wheel like a beam, whose longer end is ahead, about a hub in the middle of the vehicle: from the side."""
    class_of = {True: SEDAN, False: BUS}

    beam = boxes.box((0.6, 0.0, 0.0), (2.0, 0.3, 0.4))
    wheels = {class_of[steered]: Wheel(beam, (0.0, 0.0, 2.0), 2.0, steered) for steered in class_of}
    made, renderer = of_one_part(boxes, wheels)
    eye = map_from_base(0.0, -5.0, 0.0, np.pi / 2) @ EYE

    def mask(yaw, steer, rolled_m=0.0, steered=True):
        placement = made.placed((class_of[steered], 0.0, 0.0, yaw), steer_rad=[steer])
        return renderer.render(CAMERA, eye, placement, np.array([rolled_m]), {}, 0, labels=True).instance == 1

    for turn in (0.4, -0.4):
        assert np.array_equal(mask(0.0, turn), mask(turn, 0.0))
        assert np.array_equal(mask(0.0, turn, steered=False), mask(0.0, 0.0))
    assert not np.array_equal(mask(0.4, 0.0), mask(-0.4, 0.0))
    for steered in class_of:
        up, level, down = (np.nonzero(mask(0.0, 0.0, way_m, steered))[0].mean() for way_m in (-np.pi, 0.0, np.pi))
        assert up < level - 5.0 < down - 10.0


def test_limbs_swing_with_the_way_and_against_those_of_the_other_side(boxes):
    """A beam of 1 m below a joint, from the right: its middle goes 0.5 m times the sine of the angle."""
    beam, kinds = boxes.box((0.0, 0.0, -0.5), (0.1, 0.1, 1.0)), tuple(ActorClass)
    turns = {Swing.WALKING_LEG: (0.42, 4.2), Swing.PEDALLING_LEG: (0.24, 1.26), Swing.ARM: (-0.3, 4.2)}
    cases = [(swing, side) for swing in turns for side in (1, -1)]
    limbs = [(kinds[n], Limb(beam, (0.0, 0.05 * side, 1.5), swing)) for n, (swing, side) in enumerate(cases)]
    made, renderer = of_one_part(boxes, limbs)
    eye = map_from_base(0.0, -5.0, 0.0, np.pi / 2) @ EYE
    places = {kind: made.placed((kind, 0.0, 0.0, 0.0)) for kind, _ in limbs}

    def middle(kind, way_m):
        image = renderer.render(CAMERA, eye, places[kind], np.array([way_m]), {}, 0, labels=True)
        return np.nonzero(image.instance == 1)[1].mean()

    for (kind, _), (swing, side) in zip(limbs, cases, strict=True):
        angle_rad, phase_1pm = turns[swing]
        still, quarter, half = (middle(kind, turn * np.pi / phase_1pm) for turn in (0.0, 0.5, 1.0))
        assert quarter - still == pytest.approx(-side * 160.0 / 5.0 * 0.5 * np.sin(angle_rad), abs=0.8), (swing, side)
        assert half == pytest.approx(still, abs=0.3)


def test_paint_and_clothing_have_the_actors_colour_and_head_lamps_shine(boxes):
    kinds = [Material.CAR_PAINT, Material.CLOTHING, Material.FLEET_PAINT, Material.PLASTIC, Material.HEAD_LAMP]
    parts = [(kind, boxes.box((0.0, 0.0, 1.0), (1.0, 1.0, 2.0), kinds[k])) for k, kind in enumerate([*ActorClass][:5])]
    made, renderer = of_one_part(boxes, parts)
    placed = made.placed(*((kind, 9.0, 2.5 * k - 5.0, 0.0) for k, (kind, _) in enumerate(parts)))
    means = []
    for rgb in ((200, 20, 20), (20, 200, 20)):
        image = picture(renderer, replace(placed, colour_rgb=np.full((5, 3), rgb, np.uint8)))
        means.append([image.rgba[..., :3][image.instance == actor].mean(axis=0) for actor in range(1, 6)])
    assert [bool(red[0] > green[0] + 60) for red, green in zip(*means, strict=True)] == [True] * 2 + [False] * 3
    assert means[0][4].mean() > means[0][3].mean() + 8


LAMPS = {
    ActorClass.SEDAN: (Material.BRAKE_LAMP, Lights.BRAKE, (0, 5)),
    ActorClass.BUS: (Material.INDICATOR_LEFT_LAMP, Lights.INDICATOR_LEFT, (0, 5)),
    ActorClass.VAN: (Material.INDICATOR_RIGHT_LAMP, Lights.INDICATOR_RIGHT, (0, 5)),
    ActorClass.TRUCK: (Material.BEACON_BLUE, Lights.BEACON, (0,)),
    ActorClass.PICKUP: (Material.BEACON_RED, Lights.BEACON, (5,)),
}
"""The lamp that a vehicle consists of, what switches it, and the steps 0 and 5 (0.25 s) at which it then shines."""


def test_each_lamp_shines_by_its_own_switch_alone_and_the_beacons_by_turns(boxes):
    bodies = {kind: boxes.box((0.0, 0.0, 1.0), (1.0, 1.0, 2.0), material) for kind, (material, *_) in LAMPS.items()}
    made, renderer = of_one_part(boxes, bodies)
    for kind, (_, switch, shines) in LAMPS.items():
        for step in (0, 5):
            off, on, others = (
                picture(renderer, made.placed((kind, 6.0, 0.0, 0.0), lights=[lights]), step=step)
                for lights in (0, int(switch), int(~switch & sum(Lights)))
            )
            brighter = int(on.rgba.sum(dtype=np.int64) - off.rgba.sum(dtype=np.int64))
            assert (brighter > 1000) is (step in shines), (kind, step)
            assert others.rgba.tobytes() == off.rgba.tobytes(), kind


OPTION = "mesa_glthread"


@pytest.mark.parametrize("threads", [None, "false"])
def test_the_environment_is_as_it_was_before_the_context(renderer, monkeypatch, threads):
    assert renderer.device
    monkeypatch.delenv(OPTION, raising=False)
    if threads is not None:
        monkeypatch.setenv(OPTION, threads)
    DrawingContext().gl.release()
    assert os.environ.get(OPTION) == threads
