"""sensor_msgs_py and rosidl_runtime_py, as programs written for a ROS installation use them."""

import numpy as np
import pytest
import yaml

pytest.importorskip("rclpy", reason="needs ROS")

import rosidl_runtime_py
from geometry_msgs.msg import PoseArray, Twist
from rosidl_runtime_py.utilities import get_interface, get_message, get_service
from sensor_msgs.msg import PointCloud2, PointField
from sensor_msgs_py import point_cloud2
from std_msgs.msg import Header, String, UInt8MultiArray

from siren_ros.data.interfaces.measurements import to_point_cloud
from siren_ros.data.interfaces.messages import decode_cdr, typestore
from siren_ros.data.interfaces.topics import LIDAR

HEADER = Header(frame_id="lidar")
FIELDS = [
    PointField(name="x", offset=0, datatype=PointField.FLOAT32, count=1),
    PointField(name="y", offset=4, datatype=PointField.FLOAT32, count=1),
    PointField(name="ring", offset=10, datatype=PointField.UINT16, count=1),
    PointField(name="pair", offset=12, datatype=PointField.UINT8, count=2),
]
ROWS = [(1.0, 2.0, 3, 4, 5), (np.nan, 7.0, 8, 9, 10), (11.0, 12.0, 13, 14, 15)]


def test_a_cloud_comes_back_with_gaps_and_fields_of_several_values() -> None:
    cloud = point_cloud2.create_cloud(HEADER, FIELDS, ROWS, step=16)
    assert (cloud.width, cloud.height, cloud.point_step, cloud.row_step) == (3, 1, 16, 48)
    points = point_cloud2.read_points(cloud)
    assert points.dtype.names == ("x", "y", "ring", "pair_0", "pair_1")
    np.testing.assert_array_equal(points["pair_1"], [5, 10, 15])
    assert point_cloud2.read_points_list(cloud, ["y", "ring"], uvs=[2, 0]) == [(12.0, 13), (2.0, 3)]
    assert len(point_cloud2.read_points(cloud, skip_nans=True)) == 2
    assert len(point_cloud2.read_points(cloud, ["y"], skip_nans=True)) == 3
    np.testing.assert_array_equal(
        point_cloud2.read_points_numpy(cloud, ["x", "y"], skip_nans=True), [[1.0, 2.0], [11.0, 12.0]]
    )
    with pytest.raises(AssertionError, match="same datatype"):
        point_cloud2.read_points_numpy(cloud)


def test_organized_clouds_keep_rows_and_foreign_bytes_are_swapped() -> None:
    grid = np.arange(24, dtype=np.float32).reshape(2, 4, 3)
    cloud = point_cloud2.create_cloud_xyz32(HEADER, grid)
    assert (cloud.height, cloud.width) == (2, 4)
    read = point_cloud2.read_points(cloud, reshape_organized_cloud=True)
    np.testing.assert_array_equal(read["z"], grid[..., 2])
    assert point_cloud2.read_points_list(cloud, ["x"], uvs=[(3, 1)]) == [(21.0,)]
    swapped = PointCloud2(fields=cloud.fields, height=2, width=4, point_step=12, row_step=48, is_bigendian=True)
    swapped.data.frombytes(np.frombuffer(cloud.data, ">f4").astype("<f4").tobytes())
    np.testing.assert_array_equal(point_cloud2.read_points_numpy(swapped), grid.reshape(-1, 3))


def test_a_sweep_of_ours_is_read() -> None:
    from rclpy.serialization import deserialize_message  # the module skips where there is no ROS

    sweep = np.zeros(5, dtype=[("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])
    sweep["x"] = np.arange(5)
    message = to_point_cloud(3, "lidar", sweep)
    cdr = bytes(typestore().serialize_cdr(message, LIDAR.type_name))
    assert decode_cdr(typestore(), LIDAR, cdr) is not None
    cloud = deserialize_message(cdr, PointCloud2)
    np.testing.assert_array_equal(point_cloud2.read_points_numpy(cloud, ["x", "y", "z"])[:, 0], np.arange(5))


def test_messages_as_yaml_dictionaries_and_csv() -> None:
    twist = Twist()
    twist.linear.x = 1.5
    assert yaml.safe_load(rosidl_runtime_py.message_to_yaml(twist))["linear"] == {"x": 1.5, "y": 0.0, "z": 0.0}
    assert rosidl_runtime_py.message_to_csv(twist) == "1.5,0.0,0.0,0.0,0.0,0.0"
    assert list(rosidl_runtime_py.message_to_ordereddict(twist)) == ["linear", "angular"]
    assert rosidl_runtime_py.message_to_yaml(String(data="grüezi"), flow_style=True) == "{data: grüezi}\n"
    numbers = UInt8MultiArray(data=list(range(200)))
    assert rosidl_runtime_py.message_to_ordereddict(numbers, truncate_length=2)["data"] == [0, 1, "..."]
    assert "length: 200" in rosidl_runtime_py.message_to_yaml(numbers, no_arr=True)
    assert rosidl_runtime_py.message_to_yaml(String(data="long"), truncate_length=2) == "data: lo...\n"


def test_fields_are_set_from_dictionaries() -> None:
    poses = PoseArray()
    values = {"header": {"frame_id": "map"}, "poses": [{"position": {"x": 2}}, {}]}
    rosidl_runtime_py.set_message_fields(poses, values)
    assert (poses.header.frame_id, len(poses.poses), poses.poses[0].position.x) == ("map", 2, 2.0)
    with pytest.raises(AttributeError, match="no_such"):
        rosidl_runtime_py.set_message_fields(poses, {"no_such": 1})
    with pytest.raises(TypeError):
        rosidl_runtime_py.set_message_fields(poses, [1])


def test_types_are_found_by_name() -> None:
    assert get_message("std_msgs/msg/String") is get_message("std_msgs/String") is String
    assert get_service("rosbag2_interfaces/srv/Seek").Request
    assert get_interface("std_msgs/msg/Header") is Header
    for wrong in ("String", "std_msgs/srv/String/x", "std_msgs//String"):
        with pytest.raises(ValueError, match="name"):
            get_interface(wrong)
    assert "msg/ActorStates" in rosidl_runtime_py.get_message_interfaces(["siren_msgs"])["siren_msgs"]
    assert "srv/Seek" in rosidl_runtime_py.get_service_interfaces()["rosbag2_interfaces"]
    assert rosidl_runtime_py.get_interface_path(["siren_msgs", "msg", "ActorStates"]).endswith("ActorStates.msg")
    with pytest.raises(LookupError):
        rosidl_runtime_py.get_interfaces(["no_msgs"])
