from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from siren_ros.sensors.lidar.lidar import CarrierMotion, Lidar, LidarSweep
from siren_ros.sensors.lidar.raycast_world import RaycastWorld
from siren_ros.sensors.suite.mount import Mount, map_from_base
from siren_ros.sensors.suite.suite import LidarSpec
from siren_ros.world.actors import ActorClass

SPEC = LidarSpec("lidar", Mount(0.0, 0.0, 1.93), channels=16, points_per_second=16 * 360 * 20, resolution_m=0.0)
SEDAN, BUS = ActorClass.SEDAN, ActorClass.BUS


@pytest.fixture(name="world", scope="module")
def _world(boxes: Any) -> RaycastWorld:
    wall = boxes.box((30.0, 0.0, 5.0), (2.0, 60.0, 10.0))
    return RaycastWorld(boxes.scene(wall), boxes.shapes())


def positions(sweep: LidarSweep) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.stack([sweep.points[axis].astype(np.float64) for axis in "xyz"], axis=1)


def scan(world: RaycastWorld, placement: Any, spec: LidarSpec = SPEC, pose: Any = None, **options: Any) -> LidarSweep:
    base = np.eye(4) if pose is None else pose
    return Lidar(spec, world, 0).scan(options.pop("step", 0), base @ spec.mount.base_from_sensor, placement, **options)


def test_a_wall_and_the_ground_give_the_ranges_of_trigonometry(world: RaycastWorld, boxes: Any) -> None:
    sweep = scan(world, boxes.placed())
    x, y, z = positions(sweep).T
    low = np.linspace(SPEC.lower_fov_rad, SPEC.upper_fov_rad, 16)[sweep.points["ring"]]
    assert np.allclose(np.arctan2(z, np.hypot(x, y)), low, atol=1e-5)
    on_wall = np.abs(x - 29.0) < 1e-3
    on_ground = np.abs(z + 1.93) < 1e-3
    assert np.all((on_wall & (np.abs(y) < 30.01)) | on_ground | (np.hypot(x, y) > 29.0))
    distance = np.linalg.norm(np.stack((x, y, z)), axis=0)
    assert np.allclose(distance[on_ground], 1.93 / np.sin(-low[on_ground]), rtol=1e-4)
    assert on_wall.sum() > 100
    assert on_ground.sum() > 1000


@settings(max_examples=25, deadline=None)
@given(
    st.floats(-25.0, 25.0),
    st.floats(-25.0, 25.0),
    st.floats(-3.2, 3.2),
    st.sampled_from([SEDAN, BUS]),
    st.integers(0, 9),
)
def test_returns_on_a_vehicle_lie_on_its_box(x: float, y: float, yaw: float, kind: ActorClass, seed: int) -> None:
    boxes, world = _state["boxes"], _state["world"]
    if np.hypot(x, y) < 8.0:
        x += 16.0
    carrier = map_from_base(0.3 * seed, -0.2 * seed, 0.0, 0.7 * seed)
    sweep = scan(world, boxes.placed((kind, x, y, yaw)), pose=carrier)
    hit = sweep.points["instance"] == 1
    assert sweep.points_on_actor.tolist() == [hit.sum()]
    in_map = positions(sweep)[hit] @ carrier[:3, :3].T + carrier[:3, 3] + [0.0, 0.0, 1.93]
    relative = in_map - [x, y, 0.0]
    cos, sin = np.cos(yaw), np.sin(yaw)
    local = np.stack((cos * relative[:, 0] + sin * relative[:, 1], cos * relative[:, 1] - sin * relative[:, 0]), axis=1)
    shape = boxes.shapes()[kind]
    over = np.stack(
        (
            np.abs(local[:, 0]) - shape.length_m / 2,
            np.abs(local[:, 1]) - shape.width_m / 2,
            np.abs(relative[:, 2] - shape.height_m / 2) - shape.height_m / 2,
        )
    ).max(axis=0, initial=-np.inf)
    assert np.all(np.abs(over) < 0.005)


_state: dict[str, Any] = {}


@pytest.fixture(autouse=True)
def _remember(world: RaycastWorld, boxes: Any) -> None:
    _state.update(world=world, boxes=boxes)


def test_the_sweep_equals_one_ray_cast_into_one_scene(boxes: Any) -> None:
    placement = boxes.placed((SEDAN, 9.0, 2.0, 0.4), (BUS, -12.0, 3.0, 1.2), (SEDAN, 15.0, 2.5, 0.0))
    static = boxes.scene(boxes.box((5.0, -6.0, 2.0), (1.0, 1.0, 4.0)))
    parts = [static.mesh]
    for row in range(3):
        pose = map_from_base(placement.x_m[row], placement.y_m[row], 0.0, placement.yaw_rad[row])
        shape = boxes.shapes()[ActorClass(int(placement.actor_class[row]))]
        parts.append(shape.body.transformed(pose[:3, :3], pose[:3, 3]))
    whole = RaycastWorld(replace(static, mesh=type(static.mesh).concatenate(parts)), boxes.shapes())
    ours = scan(RaycastWorld(static, boxes.shapes()), placement)
    reference = scan(whole, boxes.placed())
    assert len(ours.points) == len(reference.points)
    assert np.allclose(positions(ours), positions(reference), atol=2e-3)
    assert set(np.unique(ours.points["instance"])) == {0, 1, 2, 3}


def test_a_vehicle_behind_the_wall_is_not_hit(world: RaycastWorld, boxes: Any) -> None:
    sweep = scan(world, boxes.placed((SEDAN, 36.0, 0.0, 0.0)))
    assert sweep.points_on_actor.tolist() == [0]


def test_the_described_size_scales_the_shape(world: RaycastWorld, boxes: Any) -> None:
    placement = boxes.placed((SEDAN, 10.0, 0.0, 0.0))
    longer = replace(placement, scale=np.array([[2.0, 1.0, 1.5]]), size_m=placement.size_m * [2.0, 1.0, 1.5])
    sweep = scan(world, longer)
    hit = positions(sweep)[sweep.points["instance"] == 1]
    assert hit[:, 0].min() == pytest.approx(10.0 - 4.6, abs=2e-3)
    assert hit[:, 2].max() > 1.4 - 1.93


def test_intensity_falls_with_distance_and_incidence(world: RaycastWorld, boxes: Any) -> None:
    clear = replace(SPEC, atmosphere_attenuation_per_m=0.0)
    hazy = replace(SPEC, atmosphere_attenuation_per_m=0.01)
    a, b = scan(world, boxes.placed(), clear), scan(world, boxes.placed(), hazy)
    distance = np.linalg.norm(positions(a), axis=1)
    expected = a.points["intensity"] * np.exp(-0.01 * distance)
    assert np.allclose(b.points["intensity"], expected, atol=0.005)
    ground = np.abs(positions(a)[:, 2] + 1.93) < 1e-3
    steep, flat = a.points["ring"] == 0, a.points["ring"] == 9
    assert a.points["intensity"][ground & steep].mean() > 2 * a.points["intensity"][ground & flat].mean()


def test_coordinates_lie_on_the_grid_that_is_asked_for(world: RaycastWorld, boxes: Any) -> None:
    sweep = scan(world, boxes.placed(), replace(SPEC, resolution_m=1 / 256))
    exact = scan(world, boxes.placed())
    on_grid = positions(sweep) * 256
    assert np.array_equal(on_grid, np.rint(on_grid))
    assert np.abs(positions(sweep) - positions(exact)).max() <= 0.5 / 256 + 1e-6


def test_noise_depends_on_seed_sensor_and_step_alone(world: RaycastWorld, boxes: Any) -> None:
    noisy = replace(SPEC, noise_stddev_m=0.05)
    first = scan(world, boxes.placed(), noisy, step=7)
    lidar = Lidar(noisy, world, 0)
    pose = noisy.mount.base_from_sensor
    lidar.scan(3, pose, boxes.placed())
    again = lidar.scan(7, pose, boxes.placed())
    assert first.points.tobytes() == again.points.tobytes()
    other = lidar.scan(8, pose, boxes.placed())
    assert first.points.tobytes() != other.points.tobytes()
    exact = scan(world, boxes.placed())
    error = np.linalg.norm(positions(first), axis=1) - np.linalg.norm(positions(exact), axis=1)
    assert error.std() == pytest.approx(0.05, rel=0.1)
    assert abs(error.mean()) < 0.01


def test_drop_off_takes_the_share_and_the_weak_returns(world: RaycastWorld, boxes: Any) -> None:
    exact = scan(world, boxes.placed())
    half = scan(world, boxes.placed(), replace(SPEC, dropoff_general_rate=0.45))
    assert len(half.points) / len(exact.points) == pytest.approx(0.55, abs=0.03)
    weak = replace(SPEC, dropoff_intensity_limit=0.1, dropoff_zero_intensity=1.0)
    kept = scan(world, boxes.placed(), weak)
    strong = (exact.points["intensity"] >= 0.11).sum()
    assert (kept.points["intensity"] >= 0.11).sum() == strong
    assert len(kept.points) < len(exact.points)


def test_times_end_at_the_stamp_and_rays_run_column_by_column(world: RaycastWorld, boxes: Any) -> None:
    sweep = scan(world, boxes.placed())
    times = sweep.points["time"]
    assert np.all(np.diff(times) >= 0)
    assert times.max() == pytest.approx(0.0, abs=1e-9)
    assert times.min() > -0.05
    assert sweep.points["ring"].max() == 15


def test_motion_distortion_shifts_what_was_seen_early(world: RaycastWorld, boxes: Any) -> None:
    moving = replace(SPEC, motion_distortion=True)
    still = scan(world, boxes.placed(), moving, motion=CarrierMotion())
    driven = scan(world, boxes.placed(), moving, motion=CarrierMotion(vx_mps=20.0))
    frozen = scan(world, boxes.placed())
    assert np.allclose(positions(still), positions(frozen), atol=1e-4)
    points = driven.points
    on_wall = (points["ring"] == 13) & (np.abs(points["y"]) < 10) & (points["x"] > 0)
    seen_from = 29.0 - 20.0 * points["time"][on_wall]
    assert np.allclose(points["x"][on_wall], seen_from, atol=1e-3)


def test_a_moving_vehicle_is_smeared_only_with_motion_distortion(world: RaycastWorld, boxes: Any) -> None:
    placement = boxes.placed((SEDAN, 10.0, 0.0, 0.0), vx_mps=[20.0])
    smeared = scan(world, placement, replace(SPEC, motion_distortion=True), motion=CarrierMotion())
    hit = smeared.points[smeared.points["instance"] == 1]
    rear = hit["x"] - 20.0 * hit["time"]
    assert rear.min() == pytest.approx(10.0 - 2.3, abs=2e-3)


def test_tilted_sensors_find_the_same_vehicle_as_one_scene(boxes: Any) -> None:
    static, placement = boxes.scene(), boxes.placed((SEDAN, 8.0, 1.0, 0.5))
    pose = map_from_base(8.0, 1.0, 0.0, 0.5)
    moved = boxes.shapes()[SEDAN].body.transformed(pose[:3, :3], pose[:3, 3])
    whole = replace(static, mesh=type(static.mesh).concatenate([static.mesh, moved]))
    tilted = replace(SPEC, mount=Mount(0.0, 0.0, 2.5, 0.3, 0.2, 0.1))
    ours = scan(RaycastWorld(static, boxes.shapes()), placement, tilted)
    reference = scan(RaycastWorld(whole, boxes.shapes()), boxes.placed(), tilted)
    assert len(ours.points) == len(reference.points)
    assert np.allclose(positions(ours), positions(reference), atol=2e-3)
    assert ours.points_on_actor[0] > 50


@pytest.mark.parametrize("distortion", [False, True])
def test_a_sweep_in_the_background_is_the_same_to_the_byte(world: RaycastWorld, boxes: Any, distortion: bool) -> None:
    spec = replace(SPEC, noise_stddev_m=0.02, dropoff_general_rate=0.1, motion_distortion=distortion)
    motion, pose = CarrierMotion(5.0, 0.5, 0.3), spec.mount.base_from_sensor
    here, background = Lidar(spec, world, 4), Lidar(spec, world, 4)
    with ThreadPoolExecutor(1) as helper:
        for step in range(4):
            placed = boxes.placed((SEDAN, 6.0 + step, 2.0, 0.1 * step), (BUS, -12.0, step, 1.0))
            finish = background.begin(step, pose, placed, motion, helper)
            expected, sweep = here.scan(step, pose, placed, motion), finish()
            assert sweep.step == step
            assert bytes(sweep.payload) == bytes(expected.payload) != b""
            np.testing.assert_array_equal(sweep.points_on_actor, expected.points_on_actor)
            np.testing.assert_array_equal(sweep.actor_id, expected.actor_id)


def test_vehicles_that_fill_more_rays_than_expected_are_seen_wholly(world: RaycastWorld, boxes: Any) -> None:
    crowd = boxes.placed(*((BUS, 16.0 * np.cos(a), 16.0 * np.sin(a), a + np.pi / 2) for a in np.arange(0.0, 6.2, 0.7)))
    spec = replace(SPEC, lower_fov_rad=-0.09, upper_fov_rad=0.02)
    with ThreadPoolExecutor(1) as helper:
        sweep = Lidar(spec, world, 0).begin(0, spec.mount.base_from_sensor, crowd, None, helper)()
    assert sweep.points_on_actor.sum() > len(sweep.points) / 2
    assert bytes(sweep.payload) == bytes(scan(world, crowd, spec).payload)
