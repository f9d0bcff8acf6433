"""Measurements and transforms as messages."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sensor_message_readers import from_audio, from_image, from_imu, from_nav_sat_fix, from_odometry

from siren_ros.data.interfaces import measurements
from siren_ros.data.interfaces.boxes import from_camera_truth, to_camera_truth, to_image_boxes
from siren_ros.data.interfaces.measurements import (
    Transform,
    from_tf,
    matrix_between,
    matrix_of_quaternion,
    quaternion_of_matrix,
    quaternion_of_yaw,
    to_odometry,
    to_tf,
    yaw_of_quaternion,
)
from siren_ros.data.interfaces.topics import ODOMETRY, TF
from siren_ros.errors import InputError
from siren_ros.sensing.lidar.lidar import LIDAR_POINT_DTYPE
from siren_ros.sensing.specification import rotation_from_rpy
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.carrier import (
    CAMERA_TRUTH_DTYPES,
    AudioChunk,
    CameraIntrinsics,
    CameraTruth,
    GnssFix,
    ImuSample,
    Odometry,
)


@pytest.mark.parametrize(
    ("shape", "dtype", "encoding"),
    [((3, 5, 3), "u1", "rgb8"), ((3, 5), "u1", "mono8"), ((3, 5), "<u2", "mono16"), ((3, 5), "<f4", "32FC1")],
)
def test_pixels_come_back_as_they_were(round_trip, shape, dtype, encoding):
    pixels = np.arange(np.prod(shape)).reshape(shape).astype(dtype)
    message = round_trip(measurements.to_image(7, "camera_front_optical_frame", pixels))
    assert message.encoding == encoding
    assert np.array_equal(from_image(message), pixels)
    turned = np.swapaxes(pixels, 0, 1)
    assert np.array_equal(from_image(measurements.to_image(0, "camera", turned)), turned), "in reading order"


def test_jpeg_bytes_pass_unchanged(round_trip):
    jpeg = bytes(range(256))
    message = round_trip(measurements.to_compressed_image(2, "camera", jpeg))
    assert (message.format, measurements.from_compressed_image(message)) == ("jpeg", jpeg)


def test_intrinsics_come_back(round_trip):
    camera = CameraIntrinsics(800, 600, 335.6, 336.7, 400.0, 300.0)
    message = round_trip(measurements.to_camera_info(1, "camera", camera))
    assert measurements.from_camera_info(message) == camera
    assert np.array_equal(message.p.reshape(3, 4)[:, :3], camera.matrix)
    assert camera.matrix.tolist() == [[335.6, 0.0, 400.0], [0.0, 336.7, 300.0], [0.0, 0.0, 1.0]]


SHARED_FIXTURES = settings(deadline=None, max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])


def _sweep(count, seed=0):
    rng = np.random.default_rng(seed)
    points = np.zeros(count, LIDAR_POINT_DTYPE)
    for axis in ("x", "y", "z", "intensity", "time"):
        points[axis] = rng.normal(size=count)
    points["ring"] = rng.integers(0, 64, count)
    points["instance"] = rng.integers(0, 2**16, count)
    return points


@SHARED_FIXTURES
@given(count=st.integers(0, 200), step=st.integers(0, 10**6))
def test_a_sweep_comes_back_as_it_was(round_trip, count, step):
    points = _sweep(count)
    message = round_trip(measurements.to_point_cloud(step, "lidar", points))
    assert message.header.frame_id == "lidar"
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == step * 50_000_000
    back = measurements.from_point_cloud(message)
    assert back.dtype == LIDAR_POINT_DTYPE
    assert np.array_equal(back, points)


def test_a_point_takes_24_bytes_and_the_fields_say_where():
    message = measurements.to_point_cloud(0, "lidar", _sweep(3))
    assert message.point_step == 24
    offsets = {"x": 0, "y": 4, "z": 8, "intensity": 12, "time": 16, "ring": 20, "instance": 22}
    assert [(field.name, field.offset) for field in message.fields] == list(offsets.items())


AUTOWARE = {"x": 0, "y": 4, "z": 8, "intensity": 12, "return_type": 13, "channel": 14}
AUTOWARE_LONG = AUTOWARE | {"azimuth": 16, "elevation": 20, "distance": 24, "time_stamp": 28}


@pytest.mark.parametrize(("layout", "offsets", "size"), [("xyzirc", AUTOWARE, 16), ("xyzircaedt", AUTOWARE_LONG, 32)])
@pytest.mark.parametrize("count", [0, 50])
def test_autowares_layouts_have_its_offsets_and_come_back_with_place_intensity_and_ring(
    round_trip, layout, offsets, size, count
):
    points = _sweep(count)
    points["intensity"] = np.linspace(0.0, 1.0, count)
    message = round_trip(measurements.to_point_cloud(0, "lidar", measurements.in_layout(points, layout, 0.0)))
    assert message.point_step == size
    assert {field.name: field.offset for field in message.fields} == offsets
    back = measurements.from_point_cloud(message)
    for name in ("x", "y", "z", "ring"):
        assert np.array_equal(back[name], points[name])
    assert np.allclose(back["intensity"], points["intensity"], atol=0.5 / 255.0 + 1e-6)
    assert not back["instance"].any()


def test_autowares_angles_distance_and_time_of_known_points():
    points = np.zeros(3, LIDAR_POINT_DTYPE)
    points["x"], points["y"], points["z"] = (3.0, 0.0, -1.0), (4.0, -2.0, 0.0), (5.0, 0.0, 1.0)
    points["time"], points["intensity"], points["ring"] = (-0.05, -0.01, 0.0), (0.0, 0.5, 1.0), (0, 7, 63)
    turned = measurements.in_layout(points, "xyzircaedt", 0.05)
    half, quarter = np.pi / 2.0, np.pi / 4.0
    assert np.allclose(turned["azimuth"], (np.arctan2(4.0, 3.0), 3.0 * half, np.pi))
    assert np.allclose(turned["elevation"], (quarter, 0.0, quarter))
    assert np.allclose(turned["distance"], (np.sqrt(50.0), 2.0, np.sqrt(2.0)))
    assert np.allclose(turned["time_stamp"], (0, 40_000_000, 50_000_000), atol=5)
    assert turned["intensity"].tolist() == [0, 128, 255]
    assert set(turned["return_type"].tolist()) == {1}
    assert not measurements.in_layout(points, "xyzircaedt", 0.0)["time_stamp"].any()
    assert measurements.in_layout(points, "siren", 0.05) is points


def test_reads_big_endian_rows_with_padding():
    message = measurements.to_point_cloud(0, "lidar", np.array([(1.0,), (2.0,)], dtype=[("x", "<f4")]))
    rows = np.zeros((2, 6), np.uint8)
    rows[:, :4] = np.array([[3.5], [-7.0]], dtype=">f4").view(np.uint8)
    foreign = replace(message, height=2, width=1, row_step=6, is_bigendian=True, data=rows.reshape(-1))
    assert measurements.from_point_cloud(foreign)["x"].tolist() == [3.5, -7.0]


def test_wider_instances_are_kept_and_a_field_of_several_numbers_has_an_axis(round_trip):
    points = np.array([(1.5, 70_000)], dtype=[("x", "<f4"), ("instance", "<u4")])
    cloud = round_trip(measurements.to_point_cloud(0, "lidar", points))
    assert measurements.from_point_cloud(cloud)["instance"][0] == 70_000
    points = np.array([(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)], dtype=[(n, "<f4") for n in "xyz"])
    message = measurements.to_point_cloud(0, "lidar", points)
    for count in (2, 3):
        merged = measurements.from_point_cloud(replace(message, fields=[replace(message.fields[0], count=count)]))
        assert merged["x"].tolist() == [[1.0, 2.0, 3.0][:count], [4.0, 5.0, 6.0][:count]]


@pytest.mark.parametrize(
    "change", [{"data": np.zeros(5, np.uint8)}, {"point_step": 2}, {"row_step": 1}, {"width": 2**31}, {"height": 3}]
)
def test_refuses_clouds_whose_sizes_do_not_fit(change):
    message = measurements.to_point_cloud(0, "lidar", _sweep(4))
    with pytest.raises(InputError, match="point cloud"):
        measurements.from_point_cloud(replace(message, **change))


def test_refuses_fields_and_pixels_without_a_ros_type():
    with pytest.raises(InputError, match="pixels"):
        measurements.to_image(0, "camera", np.zeros((2, 2, 4), np.uint8))
    with pytest.raises(InputError, match=r"points\.t"):
        measurements.to_point_cloud(0, "lidar", np.zeros(2, dtype=[("t", "<i8")]))


def test_big_endian_numbers_are_refused_and_little_endian_ones_taken():
    """The message says once for all fields that it is little-endian."""
    for kind in ("f4", "f8", "u2", "i4"):
        with pytest.raises(InputError, match=r"points\.x.*little-endian"):
            measurements.to_point_cloud(0, "lidar", np.zeros(2, dtype=[("x", f">{kind}")]))
        cloud = measurements.to_point_cloud(0, "lidar", np.array([(1,), (3,)], dtype=[("x", f"<{kind}")]))
        assert measurements.from_point_cloud(cloud)["x"].tolist() == [1, 3]


def test_an_imu_reading_survives_and_says_that_it_has_no_orientation(round_trip):
    reading = ImuSample(7, "imu", np.array([0.1, -0.2, 9.8]), np.array([0.0, 0.0, 0.3]), 4e-4, 1e-6)
    message = round_trip(measurements.to_imu(reading))
    assert message.orientation_covariance[0] == -1.0
    turn = message.orientation
    assert (turn.x, turn.y, turn.z, turn.w) == (0.0, 0.0, 0.0, 1.0)
    back = from_imu(message)
    assert back.specific_force_mps2.tolist() == reading.specific_force_mps2.tolist()
    assert back.angular_rate_radps.tolist() == reading.angular_rate_radps.tolist()
    assert (back.step, back.frame_id) == (7, "imu")
    assert (back.force_variance, back.rate_variance) == (4e-4, 1e-6)


def test_a_fix_survives_with_its_covariance(round_trip):
    message = round_trip(measurements.to_nav_sat_fix(GnssFix(4, "gnss", 49.001, 8.4, 1.9, np.array([1.0, 2.0, 3.0]))))
    assert message.position_covariance.tolist() == [1.0, 0, 0, 0, 2.0, 0, 0, 0, 3.0]
    assert message.position_covariance_type == 2
    back = from_nav_sat_fix(message)
    assert (back.step, back.latitude_deg, back.longitude_deg, back.altitude_m) == (4, 49.001, 8.4, 1.9)
    assert back.variance_m2.tolist() == [1.0, 2.0, 3.0]


def test_sound_survives(round_trip):
    samples = np.arange(-400, 400, dtype=np.int16)
    back = from_audio(round_trip(measurements.to_audio(AudioChunk(3, "ear", 16_000, samples))))
    assert (back.step, back.frame_id, back.sample_rate_hz) == (3, "ear", 16_000)
    assert back.samples.tolist() == samples.tolist()


def labels():
    values = {name: np.array([1, 2], dtype) for name, dtype in CAMERA_TRUTH_DTYPES.items()}
    values |= {
        "actor_class": np.array([int(ActorClass.BUS), int(ActorClass.AMBULANCE)], np.uint8),
        "u_min_px": np.array([9.5, 0.0]), "u_max_px": np.array([29.5, 0.0]), "v_min_px": np.array([-0.5, 0.0]),
        "v_max_px": np.array([99.5, 0.0]), "visible_px": np.array([1500, 0], np.uint32),
        "visible_fraction": np.array([0.75, 0.0]),
    }  # fmt: skip
    return CameraTruth(step=12, **values)


def test_labels_of_a_picture_survive(round_trip):
    truth = labels()
    back = from_camera_truth(round_trip(to_camera_truth(truth, "camera")))
    assert back.step == 12
    for name in CAMERA_TRUTH_DTYPES:
        assert getattr(back, name).tolist() == getattr(truth, name).tolist()


def test_only_what_shows_becomes_a_detection(round_trip):
    (detection,) = round_trip(to_image_boxes(labels(), "camera")).detections
    assert detection.id == "1"
    assert (detection.bbox.center.position.x, detection.bbox.center.position.y) == (19.5, 49.5)
    assert (detection.bbox.size_x, detection.bbox.size_y) == (20.0, 100.0)
    assert detection.results[0].hypothesis.class_id == "bus"
    assert detection.results[0].hypothesis.score == 0.75
    nowhere = detection.results[0].pose
    place, turn = nowhere.pose.position, nowhere.pose.orientation
    assert (place.x, place.y, place.z) == (0.0, 0.0, 0.0)
    assert (turn.x, turn.y, turn.z, turn.w) == (0.0, 0.0, 0.0, 1.0)
    assert not np.any(nowhere.covariance)


ANGLES = st.floats(-math.pi + 1e-9, math.pi)


@given(ANGLES)
def test_yaw_survives_the_quaternion_which_turns_x_towards_y(yaw_rad):
    assert yaw_of_quaternion(quaternion_of_yaw(yaw_rad)) == pytest.approx(yaw_rad, abs=1e-9)
    turned = matrix_of_quaternion(quaternion_of_yaw(yaw_rad)) @ [1.0, 0.0, 0.0]
    assert np.allclose(turned, [math.cos(yaw_rad), math.sin(yaw_rad), 0.0])


def test_transforms_come_back(round_trip):
    transforms = (
        Transform("map", "base_link", (1.0, -2.0, 0.5), quaternion_of_yaw(0.3)),
        Transform("base_link", "lidar", (0.0, 0.0, 1.93), (0.0, 0.0, 0.0, 1.0)),
    )
    message = round_trip(to_tf(3, transforms), TF.type_name)
    assert (from_tf(message), message.transforms[0].header.stamp.nanosec) == (transforms, 150_000_000)


def test_transforms_are_chained_through_the_frames_between():
    chain = (
        Transform("odom", "base_link", (2.0, 0.0, 0.0), quaternion_of_yaw(0.5)),
        Transform("map", "odom", (10.0, 20.0, 1.0), quaternion_of_yaw(math.pi / 2.0)),
    )
    map_from_base = matrix_between(chain, "map", "base_link")
    assert np.allclose(map_from_base[:3, 3], [10.0, 22.0, 1.0])
    assert np.allclose(map_from_base[:2, 0], [math.cos(math.pi / 2.0 + 0.5), math.sin(math.pi / 2.0 + 0.5)])
    assert np.array_equal(matrix_between(chain, "map", "map"), np.eye(4))
    for circle in (chain[:1], (Transform("base_link", "base_link", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),)):
        with pytest.raises(InputError, match="chain of transforms from map"):
            matrix_between(circle, "map", "base_link")


def test_odometry_comes_back_with_its_time(round_trip):
    pose = np.array([[4.0, 0.1, 0.2], [0.1, 5.0, 0.3], [0.2, 0.3, 6.0]])
    odometry = Odometry(1.0, 2.0, -2.5, 13.9, -0.1, 0.2, pose, 0.1 * pose)
    message = round_trip(to_odometry(41, odometry, "av/odom", "av/base_link"), ODOMETRY.type_name)
    time_ns, back = from_odometry(message)
    assert time_ns == 41 * 50_000_000
    assert (message.header.frame_id, message.child_frame_id) == ("av/odom", "av/base_link")
    assert back.yaw_rad == pytest.approx(odometry.yaw_rad)
    assert (back.x_m, back.y_m, back.forward_mps, back.left_mps, back.yaw_rate_radps) == (1.0, 2.0, 13.9, -0.1, 0.2)
    assert np.array_equal(back.pose_covariance, pose)
    assert np.array_equal(back.twist_covariance, 0.1 * pose)
    place, speed, turn = message.pose.pose.position, message.twist.twist.linear, message.twist.twist.angular
    assert (place.x, place.y, place.z, speed.z, turn.x, turn.y) == (1.0, 2.0, 0.0, 0.0, 0.0, 0.0), "on the plane"
    full = np.array(message.pose.covariance).reshape(6, 6)  # x, y, z, and rotations about x, y, z (REP 103)
    assert (full[0, 1], full[0, 5], full[5, 5]) == (0.1, 0.2, 6.0)
    assert np.all(np.linalg.eigvalsh(full) > 0.0)


@given(ANGLES, st.floats(-1.4, 1.4), ANGLES)
def test_the_yaw_of_a_tilted_body_is_that_of_its_x_axis_on_the_ground(yaw, pitch, roll):
    quaternion = quaternion_of_matrix(rotation_from_rpy(roll, pitch, yaw))
    matrix = matrix_of_quaternion(quaternion)
    assert np.allclose(matrix, rotation_from_rpy(roll, pitch, yaw))
    ahead = matrix[:, 0]
    difference = yaw_of_quaternion(quaternion) - math.atan2(ahead[1], ahead[0])
    assert math.remainder(difference, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)
