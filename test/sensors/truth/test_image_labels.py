from typing import Any

import numpy as np
import pytest

from siren_ros.sensors.camera.camera_model import Pinhole, optical_from_map
from siren_ros.sensors.camera.context import RendererUnavailableError
from siren_ros.sensors.camera.renderer import Renderer
from siren_ros.sensors.suite.mount import map_from_base, transform
from siren_ros.sensors.truth.image_labels import ImageLabeller, pixel_boxes
from siren_ros.world.actors import ActorClass
from siren_ros.world.carrier import CameraTruth

CAMERA = Pinhole(400, 300, 200.0)
EYE = transform(np.eye(3), (0.0, 0.0, 1.5))
SEDAN, BUS = ActorClass.SEDAN, ActorClass.BUS


@pytest.fixture(name="renderer", scope="module")
def _renderer(boxes: Any) -> Renderer:
    try:
        return Renderer(boxes.scene(), boxes.shapes())
    except RendererUnavailableError as error:
        pytest.skip(str(error))


def labels(renderer: Renderer, boxes: Any, *rows: Any, pose: Any = EYE) -> CameraTruth:
    placement = boxes.placed(*rows)
    image = renderer.render(CAMERA, pose, placement, np.zeros(len(placement)), {}, 0, instances=True)
    emv = np.arange(len(placement)) == 0
    assert image.instance is not None
    assert image.depth_m is None
    return ImageLabeller(boxes.shapes()).label(0, CAMERA, pose, placement, image.instance, emv)


def test_pixels_are_counted_and_bounded() -> None:
    image = np.zeros((6, 8), np.uint32)
    image[1:4, 2:5] = 7
    image[5, 7] = 9
    found = pixel_boxes(image, np.array([3, 7, 9], np.uint32))
    assert found.count.tolist() == [0, 9, 1]
    assert found.bounds[1:].tolist() == [[2, 1, 4, 3], [7, 5, 7, 5]]


def test_a_vehicle_in_the_open_is_wholly_visible_and_its_box_fits_its_corners(renderer: Renderer, boxes: Any) -> None:
    truth = labels(renderer, boxes, (SEDAN, 12.0, 1.0, 0.4))
    assert truth.actor_id.tolist() == [1]
    assert truth.is_emv.tolist() == [True]
    assert truth.visible_fraction[0] > 0.97
    assert truth.truncation[0] == pytest.approx(0.0, abs=1e-9)
    turned = map_from_base(12.0, 1.0, 0.0, 0.4)
    corners = boxes.shapes()[SEDAN].body.vertices_m @ turned[:3, :3].T + turned[:3, 3]
    uv, _ = CAMERA.project((np.c_[corners, np.ones(len(corners))] @ optical_from_map(EYE).T)[:, :3])
    box = [truth.u_min_px[0], truth.v_min_px[0], truth.u_max_px[0], truth.v_max_px[0]]
    assert box == pytest.approx([*uv.min(axis=0), *uv.max(axis=0)], abs=0.51)


def test_half_hidden_behind_a_bus(renderer: Renderer, boxes: Any) -> None:
    alone = labels(renderer, boxes, (SEDAN, 30.0, 0.0, np.pi / 2))
    behind = labels(renderer, boxes, (SEDAN, 30.0, 0.0, np.pi / 2), (BUS, 20.0, 6.0, np.pi / 2))
    assert alone.visible_fraction[0] > 0.9
    assert 0.3 < behind.visible_fraction[0] < 0.75
    hidden = labels(renderer, boxes, (SEDAN, 30.0, 0.0, np.pi / 2), (BUS, 20.0, 0.0, np.pi / 2))
    assert hidden.visible_fraction[0] == hidden.visible_px[0] == hidden.u_max_px[0] == 0.0


def test_at_the_pictures_edge_the_rest_is_cut_off(renderer: Renderer, boxes: Any) -> None:
    truth = labels(renderer, boxes, (BUS, 10.0, 10.0, np.pi / 2))
    assert 0.3 < truth.truncation[0] < 0.7
    assert truth.u_min_px[0] == -0.5
    assert truth.visible_fraction[0] > 0.95


def test_around_the_camera_and_out_of_view(renderer: Renderer, boxes: Any) -> None:
    truth = labels(renderer, boxes, (BUS, 0.0, 2.6, 0.0), (SEDAN, -20.0, 0.0, 0.0), (SEDAN, 0.0, 60.0, 0.0))
    assert truth.actor_id.tolist() == [1]
    assert truth.truncation[0] > 0.5
