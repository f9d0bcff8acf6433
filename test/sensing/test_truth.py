from dataclasses import replace

import numpy as np
import pytest

from siren_ros.sensing.lidar.lidar import LidarSweep
from siren_ros.sensing.specification import Mount, map_from_base, optical_from_map, transform
from siren_ros.sensing.truth import ImageLabeller, label_boxes, pixel_boxes
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.carrier import CameraIntrinsics

SEDAN, BUS = ActorClass.SEDAN, ActorClass.BUS


def test_points_are_counted_by_actor(boxes):
    states, descriptions = boxes.actors((SEDAN, 0.0, 0.0, 0.0), (SEDAN, 9.0, 0.0, 0.0), (SEDAN, 118.0, 9.0, 0.0))
    sweep = LidarSweep("lidar", 0, np.empty(0, np.void), np.array([2], np.uint32), np.array([77]))
    assert label_boxes(states, descriptions, 1, np.eye(4), sweep).lidar_points.tolist() == [77, 0]
    counted = np.array([11, 22, 33])
    for seen, points in (([1, 2, 3], [22, 33]), ([1, 3, 9], [0, 22]), ([2, 3, 9], [11, 22]), ([4, 5, 6], [0, 0])):
        sweep = LidarSweep("lidar", 0, np.empty(0, np.void), np.array(seen, np.uint32), counted)
        assert label_boxes(states, descriptions, 1, np.eye(4), sweep).lidar_points.tolist() == points


@pytest.mark.parametrize("turn", np.radians([0.0, 35.0, 130.0, -100.0]))
def test_ahead_left_and_moving_are_the_same_for_a_carrier_that_points_anywhere(boxes, turn):
    """The bus is 12 m ahead and 5 m to the left, turned by 0.6, and moves ahead at 3 m/s and to the right at 1 m/s."""
    along, left = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    at = np.array([40.0, -25.0]) + 12.0 * along + 5.0 * left
    velocity = 3.0 * along - 1.0 * left
    states, descriptions = boxes.actors(
        (SEDAN, 40.0, -25.0, turn),
        (BUS, *at, turn + 0.6),
        vx_mps=[0.0, velocity[0]],
        vy_mps=[0.0, velocity[1]],
        accel_mps2=[0.5, -1.0],
        z_m=[0.0, 0.75],
    )
    states, descriptions[2] = replace(states, step=9), replace(descriptions[2], is_emv=True)
    pose = map_from_base(40.0, -25.0, 0.0, turn) @ Mount(1.5, 0.0, 2.0).base_from_sensor
    truth = label_boxes(states, descriptions, 1, pose)
    assert (truth.x_m[0], truth.y_m[0], truth.z_m[0]) == pytest.approx((10.5, 5.0, 0.75 + 1.5 - 2.0))
    assert (truth.vx_mps[0], truth.vy_mps[0]) == pytest.approx((3.0, -1.0))
    assert truth.yaw_rad[0] == pytest.approx(0.6)
    assert (truth.actor_id.tolist(), truth.actor_class.tolist(), truth.is_emv.tolist()) == ([2], [int(BUS)], [True])
    assert (truth.length_m[0], truth.width_m[0], truth.height_m[0]) == (12.0, 2.5, 3.0)
    assert (truth.step, truth.accel_mps2.tolist(), truth.lidar_points.tolist()) == (9, [-1.0], [0])


@pytest.mark.parametrize("bearing", np.radians([20.0, 110.0, -70.0, 200.0]))
def test_the_range_is_a_circle_about_the_sensor(boxes, bearing):
    way = np.array([np.cos(bearing), np.sin(bearing)])
    rows = [(SEDAN, *(np.array([30.0, 60.0]) + distance * way), 0.0) for distance in (0.0, 49.9, 50.1)]
    states, descriptions = boxes.actors(*rows)
    pose = map_from_base(30.0, 60.0, 0.0, 1.0)
    far, actors = boxes.actors((SEDAN, 0.0, 0.0, 0.0), (SEDAN, 119.0, 0.0, 0.0), (SEDAN, 121.0, 0.0, 0.0))
    assert label_boxes(far, actors, 1, np.eye(4)).actor_id.tolist() == [2], "of itself"
    assert label_boxes(states, descriptions, 1, pose, range_m=50.0).actor_id.tolist() == [2]


CAMERA = CameraIntrinsics.centred(400, 300, 200.0)
EYE = transform(np.eye(3), (0.0, 0.0, 1.5))


@pytest.fixture(name="renderer", scope="module")
def _renderer(boxes):
    return boxes.renderer(boxes.scene())


def labels(renderer, boxes, *rows, step=0, scale=1.0):
    placement = boxes.placed(*rows)
    placement = replace(placement, scale=placement.scale * scale)
    image = renderer.render(CAMERA, EYE, placement, np.zeros(len(placement)), {}, 0, instances=True)
    emv = placement.actor_id % 2 == 1
    assert image.depth_m is None
    return ImageLabeller(boxes.shapes()).label(step, CAMERA, EYE, placement, image.instance, emv)


def test_pixels_are_counted_and_bounded():
    image = np.zeros((6, 8), np.uint32)
    image[1:4, 2:5] = 7
    image[5, 7] = 9
    boxes = pixel_boxes(image, np.array([3, 7, 9], np.uint32))
    assert (boxes.count.tolist(), boxes.bounds[1:].tolist()) == ([0, 9, 1], [[2, 1, 4, 3], [7, 5, 7, 5]])


def test_a_vehicle_in_the_open_is_wholly_visible_and_its_box_fits_its_corners(renderer, boxes):
    truth = labels(renderer, boxes, (SEDAN, 12.0, 1.0, 0.4))
    assert (truth.actor_id.tolist(), truth.is_emv.tolist()) == ([1], [True])
    assert truth.visible_fraction[0] > 0.97
    assert truth.truncation[0] == pytest.approx(0.0, abs=1e-9)
    turned = map_from_base(12.0, 1.0, 0.0, 0.4)
    corners = boxes.shapes()[SEDAN].body.vertices_m @ turned[:3, :3].T + turned[:3, 3]
    uv, _ = CAMERA.project((np.c_[corners, np.ones(len(corners))] @ optical_from_map(EYE).T)[:, :3])
    box = [truth.u_min_px[0], truth.v_min_px[0], truth.u_max_px[0], truth.v_max_px[0]]
    assert box == pytest.approx([*uv.min(axis=0), *uv.max(axis=0)], abs=0.51)


def test_half_hidden_behind_a_bus_and_cut_off_at_the_pictures_edge(renderer, boxes):
    alone = labels(renderer, boxes, (SEDAN, 30.0, 0.0, np.pi / 2))
    behind = labels(renderer, boxes, (SEDAN, 30.0, 0.0, np.pi / 2), (BUS, 20.0, 6.0, np.pi / 2))
    assert alone.visible_fraction[0] > 0.9
    assert 0.3 < behind.visible_fraction[0] < 0.75
    hidden = labels(renderer, boxes, (SEDAN, 30.0, 0.0, np.pi / 2), (BUS, 20.0, 0.0, np.pi / 2))
    assert hidden.visible_fraction[0] == hidden.visible_px[0] == hidden.u_max_px[0] == 0.0
    truth = labels(renderer, boxes, (BUS, 10.0, 10.0, np.pi / 2))
    assert 0.3 < truth.truncation[0] < 0.7
    assert truth.u_min_px[0] == -0.5
    assert truth.visible_fraction[0] > 0.95
    around = labels(renderer, boxes, (BUS, 0.0, 2.6, 0.0), (SEDAN, -20.0, 0.0, 0.0), (SEDAN, 0.0, 60.0, 0.0))
    assert around.actor_id.tolist() == [1]
    others = labels(renderer, boxes, (SEDAN, -20.0, 0.0, 0.0), (SEDAN, 12.0, 1.0, 0.0), (BUS, 25.0, -6.0, 0.0))
    assert (others.actor_id.tolist(), others.is_emv.tolist()) == ([2, 3], [False, True])
    assert around.truncation[0] > 0.5


def test_a_label_is_the_same_beside_others_whatever_the_vehicles_size(renderer, boxes):
    rows = (SEDAN, 200.0, 0.0, 0.0), (SEDAN, 14.0, -3.0, 0.4), (BUS, 25.0, 8.0, -0.7)
    together = labels(renderer, boxes, *rows, step=7, scale=0.8)
    assert (together.step, together.actor_id.tolist(), together.is_emv.tolist()) == (7, [2, 3], [False, True])
    assert together.visible_fraction.min() > 0.97
    for place, row in enumerate(rows[1:]):
        alone = labels(renderer, boxes, row, scale=0.8)
        for name in set(vars(alone)) - {"step", "actor_id", "is_emv"}:
            assert getattr(alone, name)[0] == getattr(together, name)[place]
