"""KITTI's labels of one car, written out: places in the camera's frame, angles, the box in the picture, occlusion."""

import numpy as np
import pytest

from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.data.datasets.kitti.labels import (
    TYPE_OF_CLASS,
    CameraLabels,
    KittiCamera,
    calibration_text,
    camera_labels,
    label_lines,
)
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.carrier import GroundTruth
from siren_ros.simulation.world.measurements import CameraIntrinsics

LENGTH_M, WIDTH_M, HEIGHT_M = 4.0, 1.8, 1.5
CAMERA = KittiCamera(
    CameraIntrinsics(800, 600, 400.0, 400.0, 400.0, 300.0),
    np.array([[0.0, -1.0, 0, 0], [0, 0, -1.0, -0.5], [1.0, 0, 0, -1.5], [0, 0, 0, 1.0]]),
)
"""1.5 m ahead of the LiDAR and 0.5 m below it; right, down, ahead."""
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("instance", "<u2")])


def truth_of(x_m: float, y_m: float, yaw_rad: float, lidar_points: int = 10) -> GroundTruth:
    """A van whose centre is 1 m below the LiDAR."""
    pose = {name: np.array([value]) for name, value in (("x_m", x_m), ("y_m", y_m), ("yaw_rad", yaw_rad))}
    return GroundTruth(
        step=3,
        carrier_id=1,
        actor_id=np.array([5], dtype=np.uint32),
        actor_class=np.array([ActorClass.VAN], dtype=np.uint8),
        is_emv=np.array([False]),
        z_m=np.array([-1.0]),
        length_m=np.array([LENGTH_M]),
        width_m=np.array([WIDTH_M]),
        height_m=np.array([HEIGHT_M]),
        vx_mps=np.zeros(1),
        vy_mps=np.zeros(1),
        accel_mps2=np.zeros(1),
        lidar_points=np.array([lidar_points], dtype=np.uint32),
        **pose,
    )


def labels_of(truth: GroundTruth, before: int = 0) -> CameraLabels:
    """With some returns half way to the box."""
    points = np.zeros(before, dtype=POINT)
    points["x"], points["y"], points["z"] = truth.x_m[0] / 2.0, truth.y_m[0] / 2.0, truth.z_m[0] / 2.0
    return camera_labels(truth, points, CAMERA)


@pytest.mark.parametrize("y_m", [4.0, -6.0])
def test_the_place_is_the_middle_of_the_bottom_in_the_cameras_frame(y_m):
    labels = labels_of(truth_of(20.0, y_m, 0.4))
    # To the right, down, ahead; the bottom is half a height below the centre.
    assert labels.bottom_m == pytest.approx(np.array([[-y_m, 1.0 + 0.75 - 0.5, 18.5]]))
    assert labels.size_m.tolist() == [[HEIGHT_M, WIDTH_M, LENGTH_M]]
    assert labels.types() == ["Van"]


@pytest.mark.parametrize("yaw_rad", [0.0, 0.4, np.pi / 2.0, -2.0, 3.0])
def test_angles_are_from_the_cameras_right(yaw_rad):
    """Ahead is −π/2; alpha is without the direction in which the box is seen, here 4 m to the left at 18.5 m."""
    labels = labels_of(truth_of(20.0, 4.0, yaw_rad))
    expected = wrap_angle(-yaw_rad - np.pi / 2.0)
    assert labels.rotation_rad[0] == pytest.approx(expected)
    alpha = float(label_lines(labels).split()[3])
    assert alpha == pytest.approx(wrap_angle(expected - np.arctan2(-4.0, 18.5)), abs=1e-4)


def test_the_box_in_the_picture_is_that_of_its_nearest_corners():
    """A car straight ahead: its rear is 16.5 m before the camera, 0.9 m to each side, 0.25 m above to 1.25 m below."""
    labels = labels_of(truth_of(20.0, 0.0, 0.0))
    left, right = 400.0 - 400.0 * 0.9 / 16.5, 400.0 + 400.0 * 0.9 / 16.5
    # The top is 0.25 m above the LiDAR's centre … 0.5 m below it is the camera: −0.25 + 0.5 = 0.25 m above that.
    top, bottom = 300.0 + 400.0 * (1.0 - 0.75 - 0.5) / 16.5, 300.0 + 400.0 * (1.0 + 0.75 - 0.5) / 16.5
    assert labels.box_px[0] == pytest.approx([left, top, right, bottom])
    assert labels.truncated[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("returns", "before", "state"), [(10, 0, 0), (8, 2, 0), (7, 3, 1), (4, 6, 1), (3, 7, 2), (1, 9, 2), (0, 0, 3)]
)
def test_occlusion_is_the_share_of_returns_before_the_box(returns, before, state):
    labels = labels_of(truth_of(20.0, 4.0, 0.0, returns), before)
    assert labels.occluded.tolist() == [state]
    assert labels.visible[0] == pytest.approx(returns / max(returns + before, 1))


def test_a_car_behind_has_no_label():
    assert len(labels_of(truth_of(-20.0, 0.0, 0.0))) == 0
    assert label_lines(labels_of(truth_of(-20.0, 0.0, 0.0))) == ""


def test_a_line_has_kittis_fifteen_words():
    words = label_lines(labels_of(truth_of(20.0, 4.0, 0.4))).split()
    assert len(words) == 15
    assert words[:3] == ["Van", "0.00", "0"]
    assert [float(word) for word in words[8:]] == pytest.approx(
        [1.5, 1.8, 4.0, -4.0, 1.25, 18.5, float(wrap_angle(-0.4 - np.pi / 2.0))], abs=1e-4
    )


def test_the_calibration_has_the_projection_four_times_and_the_lidars_mount():
    rows = dict(line.split(": ") for line in calibration_text(CAMERA).splitlines())
    assert list(rows) == ["P0", "P1", "P2", "P3", "R0_rect", "Tr_velo_to_cam", "Tr_imu_to_velo"]
    numbers = {name: np.array([float(word) for word in row.split()]) for name, row in rows.items()}
    assert len({rows[f"P{index}"] for index in range(4)}) == 1
    point = np.array([2.0, 1.0, 10.0, 1.0])
    u, v, w = numbers["P2"].reshape(3, 4) @ point
    assert (u / w, v / w) == pytest.approx((400.0 + 400.0 * 0.2, 300.0 + 400.0 * 0.1))
    assert numbers["Tr_velo_to_cam"].reshape(3, 4) == pytest.approx(CAMERA.camera_from_lidar[:3])
    assert numbers["R0_rect"].reshape(3, 3).tolist() == np.eye(3).tolist()
    assert numbers["Tr_imu_to_velo"].reshape(3, 4).tolist() == np.eye(4)[:3].tolist()


def test_every_class_has_kittis_nearest_one():
    names: dict[str, set[str]] = {}
    for kind in ActorClass:
        names.setdefault(TYPE_OF_CLASS[kind], set()).add(kind.name)
    assert names == {
        "Car": {"HATCHBACK", "SEDAN", "ESTATE", "SUV", "PICKUP", "POLICE"},
        "Van": {"VAN", "AMBULANCE"},
        "Truck": {"TRUCK", "FIRE_TRUCK"},
        "Misc": {"BUS", "MOTORCYCLE"},
        "Cyclist": {"BICYCLE"},
        "Pedestrian": {"PEDESTRIAN"},
    }
