"""What CARLA measures as ours: made measurements, and each of their values."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hand_made_record import actor_states

from siren_ros.running.carla.sensed import DEPTH, LIDAR, RGB, SEMANTIC, carla_sensors, frame_of, sweep_of
from siren_ros.sensing.meshes.mesh import SemanticClass
from siren_ros.sensing.specification import CameraSpec, LidarSpec, Mount, map_from_base
from siren_ros.simulation.world.actors import ActorClass, ActorDescription

LIDAR_SPEC = LidarSpec("lidar", Mount(0.0, 0.0, 2.0), channels=2, points_per_second=2 * 8 * 10, rate_hz=10.0)
SIZES = {7: (4.0, 2.0, 1.5), 9: (9.0, 2.5, 3.2), 11: (0.4, 0.4, 0.8), 12: (4.0, 1.9, 1.5), 13: (4.0, 2.0, 1.5)}
PLACES = {7: (100, 60, 0.3), 9: (95, 50, 1.5), 11: (105, 50, 0.0), 12: (100, 46, 0.0), 13: (100, 190, 0.0)}


def actors():
    """Ahead of the LiDAR, to its left, to its right, behind it, and out of its range; it looks north."""
    x_m, y_m, yaw_rad = zip(*PLACES.values(), strict=True)
    described = {i: ActorDescription(i, "", ActorClass.SEDAN, *size, (0, 0, 0)) for i, size in SIZES.items()}
    return actor_states(6, actor_id=list(PLACES), x_m=x_m, y_m=y_m, yaw_rad=yaw_rad), described


def test_a_sweep_is_sorted_as_it_was_fired_and_its_points_belong_to_the_boxes_that_they_lie_in():
    """CARLA's y is to the right, and its rings come from the top."""
    upper = [(10.0, 0.0, 1.0, 0.5), (0.0, -5.0, 1.0, 0.25)]
    lower = [(10.0, 0.0, -1.0, 0.125), (0.0, 5.0, -1.0, 0.75), (-3.0, 0.0, -1.0, 1.0), (9.0, -9.0, -1.95, 0.0)]
    raw = np.array([*upper, *lower], np.float32).tobytes()
    measured = SimpleNamespace(raw_data=raw, channels=2, get_point_count=[len(upper), len(lower)].__getitem__)
    sweep = sweep_of(LIDAR_SPEC, measured, map_from_base(100.0, 50.0, 2.0, np.pi / 2.0), *actors())
    fired = [
        # x, y, z, intensity, column, ring, actor
        (-3.0, 0.0, -1.0, 1.0, 0, 0, 12),
        (0.0, 5.0, 1.0, 0.25, 2, 1, 9),
        (9.0, 9.0, -1.95, 0.0, 3, 0, 0),
        (10.0, 0.0, -1.0, 0.125, 4, 0, 7),
        (10.0, 0.0, 1.0, 0.5, 4, 1, 0),
        (0.0, -5.0, -1.0, 0.75, 6, 0, 0),
    ]
    x, y, z, intensity, column, ring, instance = (np.array(values) for values in zip(*fired, strict=True))
    for name, values in (("x", x), ("y", y), ("z", z), ("intensity", intensity), ("time", (column - 7) / 80.0)):
        assert sweep.points[name] == pytest.approx(values, abs=1e-6)
    assert (sweep.points["ring"].tolist(), sweep.points["instance"].tolist()) == (ring.tolist(), instance.tolist())
    assert (sweep.sensor, sweep.step) == ("lidar", 6)
    assert (sweep.actor_id.tolist(), sweep.points_on_actor.tolist()) == ([7, 9, 11, 12], [1, 1, 0, 1])


def test_a_lidar_of_carlas_turns_once_in_a_step_with_the_firings_of_the_suites():
    spec = replace(
        LIDAR_SPEC, range_m=90.0, noise_stddev_m=0.02, dropoff_general_rate=0.1, dropoff_intensity_limit=0.7,
        dropoff_zero_intensity=0.3, upper_fov_rad=np.radians(10.0), lower_fov_rad=np.radians(-20.0),
    )  # fmt: skip
    assert dict(carla_sensors(spec)) == {
        LIDAR: {
            "channels": "2", "range": "90", "points_per_second": "320", "rotation_frequency": "20", "upper_fov": "10",
            "lower_fov": "-20", "atmosphere_attenuation_rate": "0.004", "dropoff_general_rate": "0.1",
            "dropoff_intensity_limit": "0.7", "dropoff_zero_intensity": "0.3", "noise_stddev": "0.02",
        }
    }  # fmt: skip


CAMERA = CameraSpec("camera", Mount(0.0, 0.0, 1.0), width=32, height=16, horizontal_fov_rad=np.radians(90.0))


@pytest.mark.parametrize(("depth", "semantic"), [(False, False), (True, False), (False, True), (True, True)])
def test_a_camera_is_as_many_of_carlas_as_it_records_and_their_pictures_are_one_of_ours(depth, semantic):
    """Edges stay as CARLA draws them; its pictures are blue, green, red."""
    spec = replace(CAMERA, depth=depth, semantic=semantic)
    kinds = [RGB, *[DEPTH] * depth, *[SEMANTIC] * semantic]
    size = {"image_size_x": "32", "image_size_y": "16", "fov": "90"}
    assert list(carla_sensors(spec)) == [(kind, size) for kind in kinds]
    drawn = {kind: np.zeros((16, 32, 4), np.uint8) for kind in kinds}
    drawn[RGB][np.triu_indices(16, 0, 32)] = 10, 20, 230, 255  # a staircase
    if depth:
        drawn[DEPTH][..., 0], drawn[DEPTH][0, 0] = 1, 255
    if semantic:
        drawn[SEMANTIC][2, 3, 2] = SemanticClass.CAR
    images = {kind: SimpleNamespace(raw_data=each.tobytes(), width=32, height=16) for kind, each in drawn.items()}
    with ThreadPoolExecutor(1) as encoder:
        frame = frame_of(spec, 0, 3, images, encoder)
    assert (frame.sensor, frame.step, frame.image.instance) == ("camera", 3, None)
    np.testing.assert_array_equal(frame.rgb, drawn[RGB][..., 2::-1])
    classes = np.zeros((16, 32), np.uint8)
    classes[2, 3] = SemanticClass.CAR * semantic
    np.testing.assert_array_equal(frame.image.semantic, classes)
    if not depth:
        assert frame.image.depth_m is None
        return
    expected = np.full((16, 32), 65536.0 / (2**24 - 1) * 1000.0)
    expected[0, 0] = 0.0
    np.testing.assert_allclose(frame.image.depth_m, expected, rtol=1e-6)
