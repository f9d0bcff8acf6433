from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys.store import Typestore
from synthetic_episode import Scene, SyntheticEpisode

from siren_ros.datasets.kitti import KittiCamera, KittiFrame, KittiWriter, camera_from_lidar, label_text, velodyne_bytes
from siren_ros.datasets.kitti_export import export_kitti
from siren_ros.errors import BagError, InputError
from siren_ros.interfaces import topics
from siren_ros.interfaces.images import CameraIntrinsics, to_camera_info, to_compressed_image
from siren_ros.interfaces.transforms import Transform, quaternion_of_matrix, to_tf
from siren_ros.numerics.units import time_ns_of_step
from siren_ros.recording.bag_writer import EpisodeBagWriter

CAMERA = CameraIntrinsics(800, 600, 335.64, 335.64, 400.0, 300.0)
BASE_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
MOUNTS = (
    Transform("base_link", "lidar", (0.0, 0.0, 1.93), (0.0, 0.0, 0.0, 1.0)),
    Transform("base_link", "camera_front_optical_frame", (2.5, 0.0, 1.0), quaternion_of_matrix(BASE_FROM_OPTICAL)),
)


def _numbers(line: str) -> list[float]:
    return [float(word) for word in line.split()[1:]]


def test_points_are_x_y_z_intensity() -> None:
    points = SyntheticEpisode().sweep(3)
    read = np.frombuffer(velodyne_bytes(points), dtype="<f4").reshape(-1, 4)
    assert read.shape == (300, 4)
    assert np.array_equal(read[:, 0], points["x"])
    assert np.array_equal(read[:, 3], points["intensity"])


def test_points_without_intensity_are_refused() -> None:
    with pytest.raises(InputError, match="intensity"):
        velodyne_bytes(np.zeros(2, dtype=[("x", "f4"), ("y", "f4"), ("z", "f4")]))


def test_a_label_is_the_box_in_the_lidar_frame() -> None:
    truth = SyntheticEpisode().ground_truth(60)
    lines = label_text(truth).splitlines()
    assert len(lines) == 3
    assert lines[0].split()[0] == "Car"
    assert len(lines[0].split()) == 15
    height, width, length, x, y, z, heading = _numbers(lines[0])[7:]
    assert (height, width, length) == pytest.approx((1.45, 1.8, 4.6))
    # At 3 s the EMV is at x = 52, the first civilian at x = 58 and on its way to the left.
    assert (x, z) == pytest.approx((6.0, 1.45 / 2 - 1.93), abs=1e-4)
    assert y > 0.0
    assert heading > 0.0
    assert _numbers(lines[0])[2] == pytest.approx(heading - np.arctan2(y, x), abs=1e-3)


def test_the_lateral_axis_and_the_heading_are_carlas_negated() -> None:
    episode = SyntheticEpisode()
    truth, states = episode.ground_truth(60), episode.states(60)
    carla_y, carla_yaw = -states.y_m, -states.yaw_rad
    *_, y, _, heading = _numbers(label_text(truth).splitlines()[0])
    assert y == pytest.approx(-(carla_y[1] - carla_y[0]), abs=1e-4)
    assert heading == pytest.approx(-(carla_yaw[1] - carla_yaw[0]), abs=1e-4)


def test_objects_beyond_50_m_are_dropped() -> None:
    truth = SyntheticEpisode().ground_truth(0)
    assert truth.x_m.tolist() == [30.0, 45.0, 60.0, 75.0]
    assert len(label_text(truth).splitlines()) == 2
    moved = replace(truth, x_m=np.full(4, 30.0), y_m=np.array([40.0, -40.0, 40.1, -40.1]))
    assert len(label_text(moved).splitlines()) == 2


def test_the_camera_stands_where_the_tree_puts_it() -> None:
    matrix = camera_from_lidar(MOUNTS, "lidar", "camera_front_optical_frame")
    # A point 10 m ahead of the LiDAR at its height: 7.5 m ahead of the camera, 0.93 m above it.
    assert matrix @ [10.0, 0.0, 0.0, 1.0] == pytest.approx([0.0, -0.93, 7.5, 1.0])
    assert matrix @ [10.0, 2.0, 0.0, 1.0] == pytest.approx([-2.0, -0.93, 7.5, 1.0])


@pytest.mark.parametrize(("lidar", "camera"), [("nothing", "lidar"), ("lidar", "nothing")])
def test_an_unknown_frame_is_named(lidar: str, camera: str) -> None:
    with pytest.raises(InputError, match="nothing"):
        camera_from_lidar(MOUNTS, lidar, camera)


def test_frames_with_different_parents_are_refused() -> None:
    with pytest.raises(InputError, match="parent"):
        camera_from_lidar((MOUNTS[0], replace(MOUNTS[1], parent="map")), "lidar", MOUNTS[1].child)


def _bag_with_camera(path: Path, store: Typestore) -> Path:
    episode = SyntheticEpisode(Scene(duration_s=1.0, lidar=True))
    image = topics.IMAGE_COMPRESSED.of_sensor("camera_front", 2)
    info = topics.CAMERA_INFO.of_sensor("camera_front", 2)
    writer = EpisodeBagWriter(path, store)

    def write(topic: topics.Topic, step: int, message: object) -> None:
        cdr = bytes(store.serialize_cdr(message, topic.type_name))
        writer.write(topic.name, topic.type_name, cdr, time_ns_of_step(step))

    write(topics.TF_STATIC, 0, to_tf(0, MOUNTS))
    for topic, step, message in episode.messages():
        write(topic, step, message)
        if topic is topics.EVENTS and step % 2 == 0:
            jpeg = f"jpeg of step {step}".encode()
            write(image, step, to_compressed_image(step, MOUNTS[1].child, jpeg))
            write(info, step, to_camera_info(step, MOUNTS[1].child, CAMERA))
    return writer.finish().path


def _tree(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_live_frames_and_exported_frames_are_the_same_bytes(tmp_path: Path, typestore: Typestore) -> None:
    bag = _bag_with_camera(tmp_path / "bag", typestore)
    assert export_kitti(bag, tmp_path / "offline") == 10
    episode = SyntheticEpisode(Scene(duration_s=1.0, lidar=True))
    camera = KittiCamera(CAMERA, camera_from_lidar(MOUNTS, "lidar", MOUNTS[1].child))
    live = KittiWriter(tmp_path / "live", camera)
    for step in range(0, 20, 2):
        jpeg = f"jpeg of step {step}".encode()
        live.write(KittiFrame(step, episode.sweep(step), episode.ground_truth(step), jpeg))
    exported = _tree(tmp_path / "offline")
    assert exported == _tree(tmp_path / "live")
    assert exported["image_2/000003.jpg"] == b"jpeg of step 6"
    assert exported["frames.csv"].splitlines()[1:3] == [b"000000,0,0.00", b"000001,2,0.10"]
    assert "Tr_velo_to_cam: 0.000000 -1.000000 0.000000" in exported["calib/000000.txt"].decode()
    assert sorted({name.split("/")[0] for name in exported}) == [
        "calib",
        "frames.csv",
        "image_2",
        "label_2",
        "velodyne",
    ]


def test_without_a_camera_there_are_no_images(tmp_path: Path, write_bag: Callable[..., Path]) -> None:
    bag = write_bag(tmp_path / "bag", duration_s=1.0, lidar=True)
    export_kitti(bag, tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["frames.csv", "label_2", "velodyne"]
    assert len(list((tmp_path / "out" / "velodyne").iterdir())) == 10


def test_an_episode_without_a_lidar_is_refused_before_anything_is_made(
    tmp_path: Path, write_bag: Callable[..., Path]
) -> None:
    bag = write_bag(tmp_path / "bag", duration_s=1.0)
    with pytest.raises(BagError, match="LiDAR"):
        export_kitti(bag, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_folder_with_something_in_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("mine")
    with pytest.raises(InputError, match="new or empty"):
        KittiWriter(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["precious"]
