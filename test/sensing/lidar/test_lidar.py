"""Sweeps of a LiDAR: ranges, intensities, noise, motion, and the reflectivity of surfaces."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from siren_ros.sensing.lidar.embree import RaycastWorld
from siren_ros.sensing.lidar.lidar import REFLECTIVITY, CarrierMotion, Lidar, reflectivity_of
from siren_ros.sensing.look import Look
from siren_ros.sensing.meshes.mesh import Material, Mesh, VehicleShape
from siren_ros.sensing.specification import LidarSpec, Mount, map_from_base
from siren_ros.simulation.world.actors import ActorClass

SPEC = LidarSpec("lidar", Mount(0.0, 0.0, 1.93), channels=16, points_per_second=16 * 360 * 20, resolution_m=0.0)
SEDAN, BUS = ActorClass.SEDAN, ActorClass.BUS


@pytest.fixture(name="world", scope="module")
def _world(boxes):
    return RaycastWorld(boxes.scene(boxes.box((30.0, 0.0, 5.0), (2.0, 60.0, 10.0))), boxes.shapes())


def positions(sweep):
    return np.stack([sweep.points[axis].astype(np.float64) for axis in "xyz"], axis=1)


def scan(world, placement, spec=SPEC, pose=None, **options):
    base = np.eye(4) if pose is None else pose
    return Lidar(spec, world, 0).scan(options.pop("step", 0), base @ spec.mount.base_from_sensor, placement, **options)


def test_a_wall_and_the_ground_give_the_ranges_of_trigonometry(world, boxes):
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
def test_returns_on_a_vehicle_lie_on_its_box(world, boxes, x, y, yaw, kind, seed):
    if np.hypot(x, y) < 8.0:
        x += 16.0
    carrier = map_from_base(0.3 * seed, -0.2 * seed, 0.0, 0.7 * seed)
    sweep = scan(world, boxes.placed((kind, x, y, yaw)), pose=carrier)
    hit = sweep.points["instance"] == 1
    assert sweep.points_on_actor.tolist() == [hit.sum()]
    relative = (positions(sweep)[hit] @ carrier[:3, :3].T + carrier[:3, 3] + [0.0, 0.0, 1.93]) - [x, y, 0.0]
    cos, sin = np.cos(yaw), np.sin(yaw)
    local = np.stack((cos * relative[:, 0] + sin * relative[:, 1], cos * relative[:, 1] - sin * relative[:, 0]), axis=1)
    shape = boxes.shapes()[kind]
    inside = np.abs(np.c_[local, relative[:, 2] - shape.height_m / 2])
    over = inside - np.array([shape.length_m, shape.width_m, shape.height_m]) / 2
    assert np.all(np.abs(over.max(axis=1, initial=-np.inf)) < 0.005)


@pytest.fixture(name="corner", scope="module")
def _corner(boxes):
    """Two long walls at right angles."""
    walls = [boxes.box((20.0, 0.0, 5.0), (2.0, 60.0, 10.0)), boxes.box((0.0, 15.0, 5.0), (60.0, 2.0, 10.0))]
    return RaycastWorld(boxes.scene(*walls), boxes.shapes())


@pytest.mark.parametrize("mount", [SPEC.mount, Mount(0.0, 0.0, 2.5, 0.3, 0.2, 0.1)], ids=["level", "tilted"])
def test_the_sweep_equals_one_ray_cast_into_one_scene(boxes, mount):
    """That of rays cast into one scene that holds the vehicles, too."""
    spec, static = replace(SPEC, mount=mount), boxes.scene(boxes.box((5.0, -6.0, 2.0), (1.0, 1.0, 4.0)))
    placement = boxes.placed((SEDAN, 9.0, 2.0, 0.4), (BUS, -12.0, 3.0, 1.2), (SEDAN, 15.0, -3.5, 0.0))
    ours = scan(RaycastWorld(static, boxes.shapes()), placement, spec)
    reference = scan(RaycastWorld(boxes.with_vehicles(static, placement), boxes.shapes()), boxes.placed(), spec)
    assert len(ours.points) == len(reference.points)
    assert np.allclose(positions(ours), positions(reference), atol=2e-3)
    assert set(np.unique(ours.points["instance"])) == {0, 1, 2, 3}


def test_a_ray_past_one_vehicle_meets_no_other_shape(boxes):
    """The shapes stand 1024 m apart in one tree: this ray passes over the sedan's bonnet, towards the bus's shape."""
    world = RaycastWorld(boxes.scene(), boxes.shapes())
    rays = np.array([(-10.0, 0.0, height_m, 1.0, 0.0, 0.0) for height_m in (1.0, 1.6)])
    distance, row = world.cast(rays, boxes.placed((SEDAN, 0.0, 0.0, 0.0)))
    assert distance.tolist() == [pytest.approx(7.7, abs=1e-4), np.inf]
    assert row.tolist() == [0, -1]


def test_the_described_size_scales_the_shape(world, boxes):
    placement = boxes.placed((SEDAN, 10.0, 0.0, 0.0))
    longer = replace(placement, scale=np.array([[2.0, 1.0, 1.5]]), size_m=placement.size_m * [2.0, 1.0, 1.5])
    sweep = scan(world, longer)
    hit = positions(sweep)[sweep.points["instance"] == 1]
    assert hit[:, 0].min() == pytest.approx(10.0 - 4.6, abs=2e-3)
    assert hit[:, 2].max() > 1.4 - 1.93
    assert scan(world, boxes.placed((SEDAN, 36.0, 0.0, 0.0))).points_on_actor.tolist() == [0], "behind the wall"


def tilted_plate(tilt_rad, material):
    """A square of 6 m with its middle at (12, 0, 1.5); it leans back by an angle and shows its edge to nobody."""
    up = np.array([np.sin(tilt_rad), 0.0, np.cos(tilt_rad)])
    across = np.array([0.0, 1.0, 0.0])
    corners = [12.0 * np.eye(3)[0] + 1.5 * np.eye(3)[2] + 3.0 * (i * across + j * up) for i in (-1, 1) for j in (-1, 1)]
    return Mesh.uniform(np.array(corners), np.array([(0, 1, 2), (1, 3, 2)]), material, (200, 200, 200))


def expected_intensity(sweep, rows, normal, reflectivity, per_m):
    """Reflectivity, cosine of the angle of incidence and attenuation, multiplied."""
    points = positions(sweep)[rows]
    distance = np.linalg.norm(points, axis=1)
    return reflectivity * np.abs(points @ normal) / distance * np.exp(-per_m * distance)


LEVEL = 0.51 / 255
"""Half a level of the 8 bits of an intensity."""


@pytest.mark.parametrize("per_m", [0.0, 0.03])
@pytest.mark.parametrize(
    ("tilt_rad", "material", "reflectivity"),
    [(0.0, Material.BUILDING_WALL, 0.45), (0.5, Material.GRASS, 0.45), (-1.0, Material.STOP_SIGN, 1.0)],
)
def test_intensity_of_a_tilted_surface(boxes, tilt_rad, material, reflectivity, per_m):
    world = RaycastWorld(boxes.scene(tilted_plate(tilt_rad, material)), boxes.shapes())
    sweep = scan(world, boxes.placed(), replace(SPEC, atmosphere_attenuation_per_m=per_m))
    x, _, z = positions(sweep).T
    normal = np.array([np.cos(tilt_rad), 0.0, -np.sin(tilt_rad)])
    off_plate_m = np.abs((x - 12.0) * normal[0] + (z + 1.93 - 1.5) * normal[2])
    on_plate = (off_plate_m < 1e-3) & (z > -1.9)
    assert on_plate.sum() > 100
    expected = expected_intensity(sweep, on_plate, normal, reflectivity, per_m)
    assert np.ptp(expected) > 0.01
    assert np.allclose(sweep.points["intensity"][on_plate], expected, rtol=per_m / 16, atol=LEVEL)
    on_ground = (np.abs(z + 1.93) < 1e-3) & (off_plate_m > 0.02)
    expected = expected_intensity(sweep, on_ground, np.array([0.0, 0.0, 1.0]), 0.17, per_m)
    assert np.allclose(sweep.points["intensity"][on_ground], expected, rtol=per_m / 16, atol=LEVEL)


def test_intensity_of_a_vehicle_whose_shape_is_stretched(boxes):
    """A slope of a shape has the normal of the stretched and turned slope, not that of the shape."""
    wedge = Mesh.uniform(
        np.array([(x, y, z) for x, z in ((-2.0, 0.0), (-2.0, 0.2), (2.0, 0.0), (2.0, 2.0)) for y in (-1.0, 1.0)]),
        np.array([(2, 6, 7), (2, 7, 3), (0, 1, 5), (0, 5, 4), (4, 5, 7), (4, 7, 6)]),
        Material.CAR_PAINT,
        (200, 200, 200),
    )
    world = RaycastWorld(boxes.scene(), {SEDAN: VehicleShape(SEDAN, wedge, (), 4.0, 2.0, 2.0)})
    stretch, yaw_rad = np.array([1.5, 1.0, 0.6]), 0.4
    placed = boxes.placed((SEDAN, 14.0, 1.0, yaw_rad))
    sweep = scan(world, replace(placed, scale=stretch[None], size_m=stretch[None] * [[4.0, 2.0, 2.0]]))
    slope = np.array([-1.8, 0.0, 4.0]) / stretch
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    normal = np.array([cos * slope[0], sin * slope[0], slope[2]]) / np.linalg.norm(slope)
    corner = np.array([14.0 - 3.0 * cos, 1.0 - 3.0 * sin, 0.12 - 1.93])
    on_slope = (sweep.points["instance"] == 1) & (np.abs((positions(sweep) - corner) @ normal) < 2e-3)
    assert on_slope.sum() > 20
    expected = expected_intensity(sweep, on_slope, normal, 0.6, SPEC.atmosphere_attenuation_per_m)
    assert np.allclose(sweep.points["intensity"][on_slope], expected, rtol=0.001, atol=LEVEL)


def test_fog_weakens_a_return_on_the_way_there_and_back_and_hides_the_weakest(world, boxes):
    """Seen is what is at least as strong as a target of 10 % at the sensor's range in clear air."""
    fog = Look(visibility_m=60.0)
    spec = replace(SPEC, atmosphere_attenuation_per_m=0.0, range_m=100.0)
    clear, foggy = (
        Lidar(spec, world, 0, look).scan(0, spec.mount.base_from_sensor, boxes.placed()) for look in (Look(), fog)
    )
    seen = np.isin(*(np.ascontiguousarray(positions(sweep)).view("V24")[:, 0] for sweep in (clear, foggy)))
    assert seen.sum() == len(foggy.points)
    distance = np.linalg.norm(positions(clear), axis=1)
    expected = clear.points["intensity"] * np.exp(-2.0 * fog.lidar_extinction_per_m * distance)
    assert np.allclose(foggy.points["intensity"], expected[seen], atol=0.005)
    assert foggy.points["intensity"].max() > 0.03
    above = expected - 0.1 * (distance / spec.range_m) ** 2
    assert above[seen].min() > -0.005
    assert above[~seen].max() < 0.005
    assert 0.1 < seen.mean() < 0.9


def test_in_clear_air_every_return_is_seen(boxes):
    """At the range, on a wall almost along the beam."""
    spec = replace(SPEC, atmosphere_attenuation_per_m=0.0, range_m=60.0)
    world = RaycastWorld(boxes.scene(boxes.box((30.0, 5.0, 5.0), (60.0, 0.2, 10.0))), boxes.shapes())
    clear, hazy = (
        Lidar(spec, world, 0, look).scan(0, spec.mount.base_from_sensor, boxes.placed())
        for look in (Look(), Look(rain_mm_per_h=0.1))
    )
    distance = np.linalg.norm(positions(clear), axis=1)
    assert np.any(clear.points["intensity"] < 0.1 * (distance / spec.range_m) ** 2)
    assert len(hazy.points) < len(clear.points)


def test_coordinates_lie_on_the_grid_and_without_motion_distortion_vehicles_stand_still(world, boxes):
    sweep = scan(world, boxes.placed(), replace(SPEC, resolution_m=1 / 256))
    exact = scan(world, boxes.placed())
    on_grid = positions(sweep) * 256
    assert np.array_equal(on_grid, np.rint(on_grid))
    assert np.abs(positions(sweep) - positions(exact)).max() <= 0.5 / 256 + 1e-6
    moving = scan(world, boxes.placed((SEDAN, 10.0, 0.0, 0.0), vx_mps=[20.0], vy_mps=[5.0]))
    assert moving.points.tobytes() == scan(world, boxes.placed((SEDAN, 10.0, 0.0, 0.0))).points.tobytes()


def test_noise_depends_on_seed_sensor_and_step_alone(world, boxes):
    noisy = replace(SPEC, noise_stddev_m=0.05)
    first = scan(world, boxes.placed(), noisy, step=7)
    lidar = Lidar(noisy, world, 0)
    pose = noisy.mount.base_from_sensor
    lidar.scan(3, pose, boxes.placed())
    assert first.points.tobytes() == lidar.scan(7, pose, boxes.placed()).points.tobytes()
    assert first.points.tobytes() != lidar.scan(8, pose, boxes.placed()).points.tobytes()
    exact = scan(world, boxes.placed())
    error = np.linalg.norm(positions(first), axis=1) - np.linalg.norm(positions(exact), axis=1)
    assert error.std() == pytest.approx(0.05, rel=0.1)
    assert abs(error.mean()) < 0.01
    for ring in range(3):
        in_ring = error[exact.points["ring"] == ring]
        assert len(in_ring) > 100
        assert in_ring.std() == pytest.approx(0.05, rel=0.2), "each column has errors of its own"


@pytest.mark.parametrize(("general", "limit", "at_zero"), [(0.45, 0.8, 0.0), (0.0, 0.3, 1.0), (0.2, 0.4, 0.9)])
def test_drop_off_rates_by_intensity(world, boxes, general, limit, at_zero):
    """CARLA's documentation: a general rate, and one that falls from ``at_zero`` to 0 at the intensity limit."""
    lossy = replace(SPEC, dropoff_general_rate=general, dropoff_intensity_limit=limit, dropoff_zero_intensity=at_zero)
    spread = boxes.placed(*((SEDAN, 7.0 * np.cos(a), 7.0 * np.sin(a), 1.7 * a) for a in (0.3, 1.5, 2.6, 4.0, 5.2)))
    lossless = scan(world, spread)
    ray = np.rint(lossless.points["time"] * -7200).astype(int) * 16 + lossless.points["ring"]
    assert len(set(ray.tolist())) == len(ray)
    kept = np.zeros(len(ray))
    steps = 12
    for step in range(steps):
        seen = scan(world, spread, lossy, step=step).points
        kept += np.isin(ray, np.rint(seen["time"] * -7200).astype(int) * 16 + seen["ring"])
    intensity = lossless.points["intensity"].astype(float)
    expected = 1.0 - (1.0 - general) * (1.0 - (at_zero * np.clip(1.0 - intensity / limit, 0.0, 1.0)))
    bins = np.digitize(intensity, [0.02, 0.06, 0.1, 0.15, 0.25, 0.35, 0.45])
    assert len(np.unique(bins)) >= 6
    for number in np.unique(bins):
        within = bins == number
        tolerance = 4.0 * np.sqrt(0.25 / (steps * within.sum())) + 0.01
        assert 1.0 - kept[within].mean() / steps == pytest.approx(expected[within].mean(), abs=tolerance)
    if general == 0.0:
        assert np.all(kept[intensity > limit + 0.01] == steps)


def test_times_run_from_50_ms_before_the_stamp_to_the_stamp_as_the_beams_turn(world, boxes):
    sweep = scan(world, boxes.placed())
    x, y, _ = positions(sweep).T
    columns = 360
    turned = np.rint((np.pi - np.arctan2(y, x)) / (2.0 * np.pi) * columns) % columns
    assert np.allclose(sweep.points["time"], (turned - (columns - 1)) / columns * 0.05, atol=1e-7)
    assert (sweep.points["time"][0], sweep.points["time"][-1]) == (pytest.approx(-0.05 * 359 / 360), 0.0)
    assert np.all(np.diff(sweep.points["time"]) >= 0)
    assert np.all(np.diff(sweep.points["ring"].astype(int))[np.diff(turned) == 0] > 0)


velocities = st.floats(-25.0, 25.0)
turns = st.floats(-1.0, 1.0)


def pose_at(time_s, x_m, y_m, yaw_rad, motion):
    """x, y and yaw of a vehicle that moves steadily, some time after the pose that is given."""
    return x_m + motion[0] * time_s, y_m + motion[1] * time_s, yaw_rad + motion[2] * time_s


def column_of(sweep, time_s):
    """Place and actor by ring of what the column at a time hit, infinite where nothing was hit, ``(rings, 4)``."""
    points = sweep.points[np.abs(sweep.points["time"] - time_s) < 1e-5]
    of_ring = np.full((SPEC.channels, 4), np.inf)
    of_ring[points["ring"]] = np.stack([points[name] for name in ("x", "y", "z", "instance")], axis=1)
    return of_ring


def assert_same_columns(pairs):
    """Columns are the same but for one, which may pass a vehicle's edge within the rounding of single precision."""
    assert [np.allclose(ours, reference, rtol=0.0, atol=2e-3) for ours, reference in pairs].count(False) <= 1


@settings(max_examples=12, deadline=None)
@given(velocities, velocities, turns, st.floats(-3.1, 3.1), st.floats(-3.1, 3.1))
@example(-12.9, -21.4, 0.0, 2.6, -2.11)  # across the view, beyond the sphere about where it is at the stamp
@example(25.0, 0.0, 1.0, -3.1, 0.0)
def test_a_moving_vehicle_is_seen_where_it_was_when_the_beam_passed(
    world, boxes, vx_mps, vy_mps, turn_radps, azimuth, yaw_rad
):
    motion = (vx_mps, vy_mps, turn_radps)
    x_m, y_m = 7.0 * np.cos(azimuth), 7.0 * np.sin(azimuth)
    fields = {name: [value] for name, value in zip(("vx_mps", "vy_mps", "yaw_rate_radps"), motion, strict=True)}
    spec = replace(SPEC, motion_distortion=True)
    moving = scan(world, boxes.placed((SEDAN, x_m, y_m, yaw_rad), **fields), spec, motion=CarrierMotion())
    middle = round((np.pi - azimuth) / (2.0 * np.pi) * 360)
    pairs = []
    for column in range(middle - 40, middle + 41, 4):
        time_s = (column % 360 - 359) / 7200
        frozen = scan(world, boxes.placed((SEDAN, *pose_at(time_s, x_m, y_m, yaw_rad, motion))))
        pairs.append((column_of(moving, time_s), column_of(frozen, time_s)))
    assert_same_columns(pairs)
    assert sum(int(np.count_nonzero(ours[:, 3] == 1)) for ours, _ in pairs) > 10


@settings(max_examples=8, deadline=None)
@given(velocities, velocities, turns, st.floats(-3.1, 3.1))
def test_a_moving_carrier_sees_the_world_from_where_it_was(corner, boxes, vx_mps, vy_mps, turn_radps, yaw_rad):
    motion, standing = (vx_mps, vy_mps, turn_radps), boxes.placed((SEDAN, -9.0, 4.0, 0.4))
    still = replace(SPEC, mount=Mount(1.5, 0.4, 1.93, 0.3))
    pose = map_from_base(2.0, -1.0, 0.0, yaw_rad)
    moving = scan(corner, standing, replace(still, motion_distortion=True), pose, motion=CarrierMotion(*motion))
    pairs = []
    for column in range(0, 360, 23):
        time_s = (column - 359) / 7200
        x_m, y_m, turned_rad = pose_at(time_s, 2.0, -1.0, yaw_rad, motion)
        frozen = scan(corner, standing, still, map_from_base(x_m, y_m, 0.0, turned_rad))
        pairs.append((column_of(moving, time_s), column_of(frozen, time_s)))
    assert_same_columns(pairs)


@pytest.mark.parametrize("distortion", [False, True])
def test_a_sweep_in_the_background_is_the_same_to_the_byte(world, boxes, distortion):
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


def test_vehicles_that_fill_more_rays_than_expected_are_seen_wholly(world, boxes):
    crowd = boxes.placed(*((BUS, 16.0 * np.cos(a), 16.0 * np.sin(a), a + np.pi / 2) for a in np.arange(0.0, 6.2, 0.7)))
    spec = replace(SPEC, lower_fov_rad=-0.09, upper_fov_rad=0.02)
    with ThreadPoolExecutor(1) as helper:
        sweep = Lidar(spec, world, 0).begin(0, spec.mount.base_from_sensor, crowd, None, helper)()
    assert sweep.points_on_actor.sum() > len(sweep.points) / 2
    assert bytes(sweep.payload) == bytes(scan(world, crowd, spec).payload)


def test_a_dark_car_is_darker_than_a_white_one_where_colours_count(world, boxes):
    """From the same rays; without the share both have the paint's one value."""
    white, black = (
        replace(boxes.placed((SEDAN, 12.0, 0.0, 0.0)), colour_rgb=np.array([[c, c, c]], np.uint8)) for c in (255, 0)
    )
    for share, ratio in ((0.0, 1.0), (1.0, 0.04 / 0.85)):
        lidar = Lidar(SPEC, world, 0, colour_share=share)
        sweeps = [lidar.scan(0, SPEC.mount.base_from_sensor, placed) for placed in (white, black)]
        bright, dark = (sweep.points["intensity"][sweep.points["instance"] == 1] for sweep in sweeps)
        assert len(bright) == len(dark) > 20
        assert np.allclose(dark, ratio * bright, atol=2.0 * LEVEL)


SURFACES = (Material.CAR_PAINT, Material.BUILDING_WALL, Material.METAL_POLE, Material.TYRE, Material.ASPHALT)
MATERIAL = np.array(SURFACES, np.uint8)


def of_colour(red, share):
    colour = np.tile(np.array([red, 99, 7], np.uint8), (len(MATERIAL), 1))
    return reflectivity_of(MATERIAL, colour, share).tolist()


def test_paint_walls_and_sheet_metal_follow_their_colour_and_nothing_else_does():
    assert REFLECTIVITY.shape == (len(Material),)
    assert ((REFLECTIVITY > 0.0) & (REFLECTIVITY <= 1.0)).all()
    assert REFLECTIVITY[Material.PLATE] == REFLECTIVITY[Material.LIVERY] == 1.0
    assert of_colour(120, 0.0) == REFLECTIVITY[MATERIAL].tolist()
    assert of_colour(0, 1.0) == pytest.approx([0.04, 0.04, 0.04, 0.07, 0.17])
    assert of_colour(255, 1.0) == pytest.approx([0.85, 0.85, 0.85, 0.07, 0.17])
    assert of_colour(0, 0.5) == pytest.approx([0.32, 0.245, 0.27, 0.07, 0.17])
