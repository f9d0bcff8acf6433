import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.base.params.folders import names_in_params
from siren_ros.errors import InputError
from siren_ros.sensing import specification
from siren_ros.sensing.navigation import GnssSpec, ImuSpec
from siren_ros.sensing.suite import load_suite

PAPER_CAMERAS = {
    # name: CARLA's vehicle frame, y right, yaw clockwise in degrees (paper, table of the sensor suite)
    "camera_front": (2.5, 0.0, 1.0, 0.0),
    "camera_right_rear": (0.0, 0.3, 1.8, 100.0),
    "camera_left_rear": (0.0, -0.3, 1.8, -100.0),
    "camera_rear": (-2.0, 0.0, 1.5, 180.0),
}


def test_suites_have_names_or_are_a_users_file(tmp_path):
    assert {"none", "lidar", "front", "full"} <= set(names_in_params("suites"))
    none = load_suite("none")
    assert (none.lidars, none.cameras, none.others) == ((), (), ())
    front = load_suite("front")
    assert ([camera.name for camera in front.cameras], len(front.lidars)) == (["camera_front"], 1)
    path = write(tmp_path, "lidars:\n  roof:\n    mount: {x_m: 0, y_m: 0, z_m: 3, yaw_deg: 90}\n    rate_hz: 10\n")
    suite = load_suite(path)
    assert (suite.name, suite.lidars[0].mount.yaw_rad) == ("mine", pytest.approx(np.pi / 2))
    assert suite.lidars[0].channels == specification.LidarSpec("", suite.lidars[0].mount).channels
    assert suite.lidars[0].period_steps == 2


def test_the_full_suite_is_the_papers():
    suite = load_suite("full")
    lidar = suite.lidars[0]
    assert (lidar.mount.x_m, lidar.mount.y_m, lidar.mount.z_m) == (0.0, 0.0, 1.93)
    assert (lidar.channels, lidar.range_m, lidar.rate_hz) == (64, 120.0, 20.0)
    assert (np.degrees(lidar.upper_fov_rad), np.degrees(lidar.lower_fov_rad)) == pytest.approx((5.0, -25.0))
    assert lidar.columns * lidar.channels * lidar.rate_hz == pytest.approx(1.3e6, rel=1e-3)
    assert {camera.name for camera in suite.cameras} == set(PAPER_CAMERAS)
    for camera in suite.cameras:
        x, y, z, yaw_deg = PAPER_CAMERAS[camera.name]
        assert (camera.mount.x_m, camera.mount.y_m, camera.mount.z_m) == (x, -y, z)
        assert np.cos(camera.mount.yaw_rad + np.radians(yaw_deg)) == pytest.approx(1.0)
        assert (camera.width, camera.height) == (800, 600)
        assert np.degrees(camera.horizontal_fov_rad) == pytest.approx(100.0)
    assert [(type(spec), spec.mount) for spec in suite.others] == [(GnssSpec, lidar.mount), (ImuSpec, lidar.mount)]


def write(folder, text):
    path = folder / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return str(path)


MOUNT = "mount: {x_m: 0, y_m: 0, z_m: 1}"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        *[("radars: {}", "radars"), ("- 1", "mapping")],
        (f"cameras:\n  c: {{{MOUNT}, horizontal_fov_deg: 0}}", "horizontal_fov_deg"),
        (f"cameras:\n  c: {{{MOUNT}, horizontal_fov_deg: 180}}", "160"),
        (f"cameras:\n  c: {{{MOUNT}, width: 8.5}}", "whole number"),
        (f"cameras:\n  c: {{{MOUNT}, depth: 1}}", "true or false"),
        (f"cameras:\n  c: {{{MOUNT}, rate_hz: 7}}", "divides 20 Hz"),
        (f"cameras:\n  c: {{{MOUNT}, rate_hz: 0}}", "divides 20 Hz"),
        *[(f"cameras:\n  c: {{{MOUNT}, lens: wide}}", "lens"), ("cameras:\n  c: {width: 800}", "mount")],
        ("cameras:\n  c: {mount: {x_m: 0, y_m: 0}}", "z_m"),
        ("cameras:\n  c: {mount: {x_m: 0, y_m: 0, z_m: high}}", "z_m"),
        (f"cameras:\n  'a b': {{{MOUNT}}}", "letters"),
        (f"lidars:\n  s: {{{MOUNT}}}\ncameras:\n  s: {{{MOUNT}}}", "once"),
        (f"lidars:\n  s: {{{MOUNT}, upper_fov_deg: -30}}", "lower_fov_deg"),
        (f"lidars:\n  s: {{{MOUNT}, channels: true}}", "channels"),
        *[(f"lidars:\n  s: {{{MOUNT}, range_m: .nan}}", "range_m"), ("lidars: [", "valid YAML")],
        *[("station: corner", "station"), ("station: {x_m: 1}", "y_m")],
        ("station: {x_m: 1, y_m: 2, z_m: 3}", "z_m"),
        *[("station: site\nimus:\n  imu:\n    mount: {x_m: 0, y_m: 0, z_m: 1}", "imus"), ("labels: 3", "labels")],
        (f"cameras:\n  a__b: {{{MOUNT}}}", "single underscores"),
        (f"cameras:\n  1a: {{{MOUNT}}}", "not a digit first"),
        ("cameras:\n" + "".join(f"  c{k}: {{{MOUNT}}}\n" for k in range(33)), "at most 32"),
        (f"lidars:\n  s: {{{MOUNT}, upper_fov_deg: -25}}", "lower_fov_deg"),
        ("cameras:\n  c: {mount: {x_m: 0, y_m: 0, z_m: 1, tilt_deg: 3}}", "tilt_deg"),
        ("cameras:\n  c: {mount: {x_m: 0, y_m: 0, z_m: 1, pitch_deg: 91}}", "pitch_deg"),
        ("station: site\ngnss:\n  g:\n    mount: {x_m: 0, y_m: 0, z_m: 1}", "gnss"),
        ("microphones:\n  ear:\n    mount: {x_m: 0, y_m: 0, z_m: 1}\n    sample_rate_hz: 1", "sample_rate_hz"),
    ],
)
def test_what_cannot_be_used_is_named(tmp_path, text, said):
    path = write(tmp_path, text)
    with pytest.raises(InputError) as caught:
        load_suite(path)
    assert said in str(caught.value)
    assert "mine.yaml" in str(caught.value)


def test_a_file_may_have_several_sensors_of_every_kind(tmp_path):
    """They stand in the order of the kinds and, within a kind, of the file; 10 Hz and 4 Hz meet at 2 Hz."""
    rates = {"ear": None, "imu": None, "b": 4, "a": 20, "gnss": None, "roof": 10, "hood": 20}
    kinds = {
        "microphones": ["ear"],
        "imus": ["imu"],
        "cameras": ["b", "a"],
        "gnss": ["gnss"],
        "lidars": ["roof", "hood"],
    }
    lines = []
    for kind, names in kinds.items():
        rows = (f"  {name}: {{{MOUNT}{f', rate_hz: {rates[name]}' if rates[name] else ''}}}" for name in names)
        lines += [f"{kind}:", *rows]
    suite = load_suite(write(tmp_path, "\n".join(lines)))
    assert [name for name, _ in suite.mounts] == ["roof", "hood", "b", "a", "gnss", "imu", "ear"]
    assert suite.common_period_steps == 10


def test_a_mount_has_each_angle_and_place_under_its_own_key(tmp_path):
    keys = "x_m: 1, y_m: -2, z_m: 3, roll_deg: 10, pitch_deg: 20, yaw_deg: 30"
    single = f"s: {{mount: {{{keys}}}, channels: 1, upper_fov_deg: -30}}"
    (spec,) = load_suite(write(tmp_path, f"lidars:\n  {single}")).lidars
    angles = np.radians((10.0, 20.0, 30.0))
    assert (spec.mount.x_m, spec.mount.y_m, spec.mount.z_m) == (1.0, -2.0, 3.0)
    assert (spec.mount.roll_rad, spec.mount.pitch_rad, spec.mount.yaw_rad) == pytest.approx(angles)
    most = "cameras:\n" + "".join(f"  c{k}: {{{MOUNT}}}\n" for k in range(32))
    assert len(load_suite(write(tmp_path, most)).cameras) == 32


@pytest.mark.parametrize("layout", ["siren", "xyzirc", "xyzircaedt"])
def test_a_lidar_has_one_of_the_layouts_of_points(tmp_path, layout):
    file = tmp_path / "own.yaml"
    mount = "{x_m: 0, y_m: 0, z_m: 2}"
    file.write_text(f"lidars: {{top: {{mount: {mount}, points_layout: {layout}}}, plain: {{mount: {mount}}}}}")
    assert [spec.points_layout for spec in load_suite(str(file)).lidars] == [layout, "siren"]
    file.write_text(f"lidars: {{top: {{mount: {mount}, points_layout: xyz}}}}")
    with pytest.raises(InputError, match="one of siren, xyzirc, xyzircaedt"):
        load_suite(str(file))
    with pytest.raises(InputError, match=r"lidar.*none"):
        load_suite("everything")


def test_a_roadside_suite_stands_at_the_site_or_at_a_place_and_labels_its_pictures(tmp_path):
    suite = load_suite("roadside")
    assert (suite.station.place, suite.labels, load_suite("full").station) == (None, True, None)
    place = load_suite(write(tmp_path, "station: {x_m: 10, y_m: -4, yaw_deg: 90}\n")).station.place
    assert (place.x_m, place.y_m, place.yaw_rad) == (10.0, -4.0, pytest.approx(np.pi / 2))


angles = st.floats(-3.0, 3.0)


@given(angles, angles, angles)
def test_rotations_are_proper_and_inverse_undoes_a_transform(roll, pitch, yaw):
    rotation = specification.rotation_from_rpy(roll, pitch, yaw)
    assert np.allclose(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    mount = specification.Mount(1.0, -2.0, 3.0, yaw, pitch, roll)
    assert np.allclose(specification.inverse(mount.base_from_sensor) @ mount.base_from_sensor, np.eye(4))


def test_yaw_turns_left_pitch_looks_down_roll_lowers_the_right_side_and_optical_frames_look_along_z():
    forward, left = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    assert np.allclose(specification.rotation_from_rpy(0, 0, np.pi / 2) @ forward, [0, 1, 0])
    assert (specification.rotation_from_rpy(0, 0.1, 0) @ forward)[2] < 0
    assert (specification.rotation_from_rpy(0.1, 0, 0) @ left)[2] > 0
    pose = specification.map_from_base(10.0, 20.0, 0.5, np.pi / 2)
    assert np.allclose(pose @ [2.0, 0.0, 1.0, 1.0], [10.0, 22.0, 1.5, 1.0])
    forward, left, up = (specification.OPTICAL_FROM_BODY @ np.eye(3)).T
    assert np.allclose([forward, left, up], [[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
