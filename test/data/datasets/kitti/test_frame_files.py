import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import simplejpeg
from PIL import Image
from synthetic_episode import Scene, SyntheticEpisode

from siren_ros.data.datasets.files import FileWriter
from siren_ros.data.datasets.kitti.exporter import KittiFrame, KittiFrames, png_bytes, png_of_jpeg, velodyne_bytes
from siren_ros.data.datasets.kitti.labels import KittiCamera, camera_from_lidar, label_text
from siren_ros.data.interfaces.transforms import Transform, quaternion_of_matrix
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.episode import KittiLayout
from siren_ros.simulation.world.measurements import CameraIntrinsics

CAMERA = CameraIntrinsics(800, 600, 335.64, 335.64, 400.0, 300.0)
BASE_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
MOUNTS = (
    Transform("base_link", "lidar", (0.0, 0.0, 1.93), (0.0, 0.0, 0.0, 1.0)),
    Transform("base_link", "camera_front_optical_frame", (2.5, 0.0, 1.0), quaternion_of_matrix(BASE_FROM_OPTICAL)),
)


@pytest.mark.parametrize("shape", [(1, 1, 3), (5, 7, 3), (60, 80, 3)])
def test_another_reader_sees_the_same_pixels(shape):
    rgb = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    with Image.open(io.BytesIO(png_bytes(rgb))) as picture:
        picture.load()
        assert np.array_equal(np.asarray(picture), rgb)


def test_a_jpeg_is_decoded_once_and_kept():
    rgb = np.full((16, 16, 3), (200, 30, 90), dtype=np.uint8)
    jpeg = simplejpeg.encode_jpeg(rgb, quality=95)
    with Image.open(io.BytesIO(png_of_jpeg(jpeg))) as picture:
        assert np.array_equal(np.asarray(picture), simplejpeg.decode_jpeg(jpeg))


def _numbers(line: str) -> list[float]:
    return [float(word) for word in line.split()[1:]]


def test_points_are_x_y_z_intensity():
    points = SyntheticEpisode().sweep(3)
    read = np.frombuffer(velodyne_bytes(points), dtype="<f4").reshape(-1, 4)
    assert read.shape == (300, 4)
    assert np.array_equal(read[:, 0], points["x"])
    assert np.array_equal(read[:, 3], points["intensity"])


def test_points_without_intensity_are_refused():
    with pytest.raises(InputError, match="intensity"):
        velodyne_bytes(np.zeros(2, dtype=[("x", "f4"), ("y", "f4"), ("z", "f4")]))


def test_a_label_is_the_box_in_the_lidar_frame():
    truth = SyntheticEpisode().ground_truth(60)
    lines = label_text(truth).splitlines()
    assert len(lines) == 3
    assert lines[0].split()[0] == "Car"
    assert len(lines[0].split()) == 15
    assert lines[0].split()[1:3] == ["0.00", "0"]
    assert _numbers(lines[0])[3:7] == [0.0, 0.0, 0.0, 0.0], "no box in a picture"
    height, width, length, x, y, z, heading = _numbers(lines[0])[7:]
    assert (height, width, length) == pytest.approx((1.45, 1.8, 4.6))
    # At 3 s the EMV is at x = 52, the first civilian at x = 58 and on its way to the left.
    assert (x, z) == pytest.approx((6.0, 1.45 / 2 - 1.93), abs=1e-4)
    assert y > 0.0
    assert heading > 0.0
    assert _numbers(lines[0])[2] == pytest.approx(heading - np.arctan2(y, x), abs=1e-3)


def test_the_lateral_axis_and_the_heading_are_carlas_negated():
    episode = SyntheticEpisode()
    truth, states = episode.ground_truth(60), episode.states(60)
    carla_y, carla_yaw = -states.y_m, -states.yaw_rad
    *_, y, _, heading = _numbers(label_text(truth).splitlines()[0])
    assert y == pytest.approx(-(carla_y[1] - carla_y[0]), abs=1e-4)
    assert heading == pytest.approx(-(carla_yaw[1] - carla_yaw[0]), abs=1e-4)


def test_objects_beyond_50_m_are_dropped():
    truth = SyntheticEpisode().ground_truth(0)
    assert truth.x_m.tolist() == [30.0, 45.0, 60.0, 75.0]
    assert len(label_text(truth).splitlines()) == 2
    moved = replace(truth, x_m=np.full(4, 30.0), y_m=np.array([40.0, -40.0, 40.1, -40.1]))
    assert len(label_text(moved).splitlines()) == 2


def test_the_camera_stands_where_the_tree_puts_it():
    matrix = camera_from_lidar(MOUNTS, "lidar", "camera_front_optical_frame")
    # A point 10 m ahead of the LiDAR at its height: 7.5 m ahead of the camera, 0.93 m above it.
    assert matrix @ [10.0, 0.0, 0.0, 1.0] == pytest.approx([0.0, -0.93, 7.5, 1.0])
    assert matrix @ [10.0, 2.0, 0.0, 1.0] == pytest.approx([-2.0, -0.93, 7.5, 1.0])


@pytest.mark.parametrize(("lidar", "camera"), [("nothing", "lidar"), ("lidar", "nothing")])
def test_an_unknown_frame_is_named(lidar, camera):
    with pytest.raises(InputError, match="nothing"):
        camera_from_lidar(MOUNTS, lidar, camera)


def test_frames_with_different_parents_are_refused():
    with pytest.raises(InputError, match="parent"):
        camera_from_lidar((MOUNTS[0], replace(MOUNTS[1], parent="map")), "lidar", MOUNTS[1].child)


def _live(folder: Path, layout: KittiLayout, jpeg: bytes | None, camera: KittiCamera | None) -> KittiFrames:
    episode = SyntheticEpisode(Scene(duration_s=1.0, lidar=True))
    folder.mkdir()
    with FileWriter(folder) as files:
        frames = KittiFrames(files, layout, camera)
        for step in range(0, 20, 2):
            frames.write(KittiFrame(step, episode.sweep(step), episode.ground_truth(step), jpeg))
    return frames


def _names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_papers_layout_says_what_it_is(tmp_path):
    camera = KittiCamera(CAMERA, camera_from_lidar(MOUNTS, "lidar", MOUNTS[1].child))
    assert _live(tmp_path / "out", KittiLayout.PAPER, b"a picture", camera).frames == 10
    out = tmp_path / "out"
    assert _names(out) == ["README.md", "calib", "frames.csv", "image_2", "label_2", "velodyne"]
    assert (out / "image_2" / "000003.jpg").read_bytes() == b"a picture"
    assert (out / "frames.csv").read_text().splitlines()[1:3] == ["000000,0,0.00", "000001,2,0.10"]
    assert "Tr_velo_to_cam: 0.00000000 -1.00000000 0.00000000" in (out / "calib" / "000000.txt").read_text()
    assert "not KITTI" in (out / "README.md").read_text()
    assert (out / "label_2" / "000000.txt").read_text() == label_text(SyntheticEpisode().ground_truth(0))


def test_the_papers_layout_needs_no_camera(tmp_path):
    _live(tmp_path / "out", KittiLayout.PAPER, None, None)
    assert _names(tmp_path / "out") == ["README.md", "frames.csv", "label_2", "velodyne"]


def test_kittis_own_layout_needs_a_camera(tmp_path):
    with pytest.raises(InputError, match="front camera"):
        _live(tmp_path / "out", KittiLayout.KITTI, None, None)


@pytest.mark.parametrize("threads", [1, 2])
def test_threads_write_the_same_files(tmp_path, threads):
    camera = KittiCamera(CAMERA, camera_from_lidar(MOUNTS, "lidar", MOUNTS[1].child))
    episode, out = SyntheticEpisode(Scene(duration_s=1.0, lidar=True)), tmp_path / "out"
    out.mkdir()
    pictures = np.random.default_rng(0).integers(0, 256, (10, 60, 80, 3), dtype=np.uint8)
    jpegs = [simplejpeg.encode_jpeg(picture) for picture in pictures]
    with FileWriter(out, threads) as files:
        frames = KittiFrames(files, KittiLayout.KITTI, camera)
        for number, step in enumerate(range(0, 20, 2)):
            frames.write(KittiFrame(step, episode.sweep(step), episode.ground_truth(step), jpegs[number]))
    assert [line.split(",")[0] for line in (out / "frames.csv").read_text().splitlines()[1:]] == [
        f"{number:06d}" for number in range(10)
    ]
    for number, jpeg in enumerate(jpegs):
        with Image.open(out / f"training/image_2/{number:06d}.png") as picture:
            assert np.array_equal(np.asarray(picture), simplejpeg.decode_jpeg(jpeg))


def test_a_picture_that_cannot_be_written_ends_the_export(tmp_path):
    camera = KittiCamera(CAMERA, camera_from_lidar(MOUNTS, "lidar", MOUNTS[1].child))
    episode = SyntheticEpisode(Scene(duration_s=1.0, lidar=True))
    jpeg = simplejpeg.encode_jpeg(np.zeros((60, 80, 3), dtype=np.uint8))
    (tmp_path / "training/image_2/000000.png").mkdir(parents=True)

    def export() -> None:
        with FileWriter(tmp_path, 2) as files:
            KittiFrames(files, KittiLayout.KITTI, camera).write(
                KittiFrame(0, episode.sweep(0), episode.ground_truth(0), jpeg)
            )

    with pytest.raises(InputError, match=r"image_2/000000\.png.*[Ii]s a directory"):
        export()
