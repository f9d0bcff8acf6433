import io
from dataclasses import replace

import numpy as np
import pytest
import shapely
from PIL import Image

from siren_ros.sensing.meshes.mesh import ParkedVehicle
from siren_ros.sensing.navigation import Odometers
from siren_ros.sensing.rig import SensorRig
from siren_ros.sensing.specification import CameraSpec, LidarSpec, Mount
from siren_ros.sensing.suite import SensorSuite
from siren_ros.sensing.vehicles.vehicle_shapes import vehicle_shape
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.actors import FIRST_PARKED_ID, ActorClass, ActorDescription
from siren_ros.simulation.world.traffic_state import SignalState

LIDAR = LidarSpec("lidar", Mount(0.0, 0.0, 1.93), channels=16, points_per_second=16 * 360 * 20)
CAMERA = CameraSpec("camera_front", Mount(2.5, 0.0, 1.0), width=160, height=120, instance=True)
SUITE = SensorSuite("test", (LIDAR,), (CAMERA,))
NETWORK = RoadNetwork((), (), (), {}, (0.0, 0.0), "!")


def described(actor_id, kind, is_emv):
    shape = vehicle_shape(kind)
    size = (shape.length_m, shape.width_m, shape.height_m)
    return ActorDescription(actor_id, f"v{actor_id}", kind, *size, (30, 60, 200), is_emv)


@pytest.fixture(name="traffic")
def _traffic(boxes):
    states, _ = boxes.actors((ActorClass.SEDAN, 0.0, 0.0, 0.0), (ActorClass.SEDAN, 12.0, 0.5, 0.1))
    return states, {1: described(1, ActorClass.AMBULANCE, True), 2: described(2, ActorClass.SEDAN, False)}


def make(boxes, suite=SUITE):
    return SensorRig(suite, NETWORK, 0, scene=boxes.scene())


@pytest.fixture(name="observe")
def _observe(boxes, traffic):
    """What a suite measures at the first steps of standing traffic."""
    states, descriptions = traffic

    def observe(suite=SUITE, steps=1, carrier_id=1):
        rig, signals = make(boxes, suite), (SignalState("s", "r"),)
        return [rig.observe(replace(states, step=step), descriptions, signals, carrier_id) for step in range(steps)]

    return observe


def test_a_step_with_everything_due(observe):
    (seen,) = observe()
    sweep, frame = seen.sweeps[0], seen.frames[0]
    assert set(np.unique(sweep.points["instance"])) == {0, 2}
    assert seen.truth.actor_id.tolist() == [2]
    assert seen.truth.lidar_points[0] == (sweep.points["instance"] == 2).sum() > 10
    assert set(np.unique(frame.image.instance)) == {0, 2}
    decoded = np.asarray(Image.open(io.BytesIO(frame.jpeg)))
    assert decoded.shape == (120, 160, 3)
    assert np.abs(decoded.astype(int) - frame.rgb).mean() < 4
    assert len(sweep.payload) == sweep.points.nbytes


def test_measurements_in_the_background_are_the_same(boxes, traffic):
    states, descriptions = traffic
    here, background = make(boxes), SensorRig(SUITE, NETWORK, 0, scene=boxes.scene(), in_background=True)
    for step in range(3):
        now = replace(states, step=step, x_m=states.x_m + 0.4 * step)
        sensing = background.begin(now, descriptions, (), 1)
        expected = here.observe(now, descriptions, (), 1)
        assert sensing.under_way
        seen = sensing.finish()
        assert [bytes(sweep.payload) for sweep in seen.sweeps] == [bytes(sweep.payload) for sweep in expected.sweeps]
        assert [frame.jpeg for frame in seen.frames] == [frame.jpeg for frame in expected.frames]
        assert (seen.truth is None) == (expected.truth is None)
        if seen.truth is not None:
            assert seen.truth.lidar_points.tolist() == expected.truth.lidar_points.tolist()


def test_nothing_is_under_way_without_a_carrier(boxes, traffic):
    states, descriptions = traffic
    sensing = make(boxes).begin(states, descriptions, (), 9)
    assert not sensing.under_way
    assert sensing.finish().sweeps == ()


def test_sensors_measure_when_they_are_due(observe):
    assert [(len(seen.sweeps), len(seen.frames)) for seen in observe(steps=3)] == [(1, 1), (1, 0), (1, 1)]


def test_each_sensor_has_its_own_rate(observe):
    slow = replace(LIDAR, name="slow", rate_hz=5.0)
    names = [[sweep.sensor for sweep in seen.sweeps] for seen in observe(SensorSuite("two", (LIDAR, slow)), 5)]
    assert names == [["lidar", "slow"], ["lidar"], ["lidar"], ["lidar"], ["lidar", "slow"]]


def test_the_same_seed_gives_the_same_bytes(observe):
    noisy = SensorSuite("noisy", (replace(LIDAR, noise_stddev_m=0.02),), (replace(CAMERA, noise_stddev=4.0),))
    (first,), (second,), (clean,) = observe(noisy), observe(noisy), observe()
    assert first.sweeps[0].points.tobytes() == second.sweeps[0].points.tobytes()
    assert first.frames[0].jpeg == second.frames[0].jpeg
    assert 2.0 < (first.frames[0].rgb.astype(int) - clean.frames[0].rgb).std() < 5.0


def test_without_its_carrier_nothing_is_measured(observe):
    (seen,) = observe(carrier_id=9)
    assert (seen.sweeps, seen.frames, len(seen.truth)) == ((), (), 0)


def test_an_empty_suite_still_labels(traffic):
    states, descriptions = traffic
    rig = SensorRig(SensorSuite("none"), NETWORK, 0)
    seen = rig.observe(states, descriptions, (), 1)
    assert (seen.sweeps, seen.frames) == ((), ())
    assert rig.truth_frame == "base_link"
    assert seen.truth.z_m[0] == pytest.approx(descriptions[2].height_m / 2)


def test_people_alone_stand_on_the_sidewalk(boxes, traffic):
    states, descriptions = traffic
    static = replace(boxes.scene(), raised=shapely.box(5.0, -5.0, 20.0, 5.0), raised_m=0.13)
    for kind, high_m in ((ActorClass.PEDESTRIAN, 0.13), (ActorClass.SEDAN, 0.0)):
        actors = {**descriptions, 2: described(2, kind, False)}
        seen = SensorRig(SUITE, NETWORK, 0, scene=static).observe(states, actors, (), 1)
        above_lidar_m = high_m + actors[2].height_m / 2 - LIDAR.mount.z_m
        assert seen.truth.z_m[0] == pytest.approx(above_lidar_m, abs=1e-6)


def test_parked_vehicles_are_seen_and_labelled_though_no_actor_is_there(boxes, traffic):
    states, descriptions = traffic
    places = [(6.0, 6.0), (-8.0, 0.0), (400.0, 0.0)]
    parked = [
        ParkedVehicle(described(FIRST_PARKED_ID + number, ActorClass.SEDAN, False), x, y, 0.0, 0.3)
        for number, (x, y) in enumerate(places)
    ]
    static = replace(boxes.scene(), parked=tuple(parked))
    rig = SensorRig(SUITE, NETWORK, 0, scene=static)
    for step in range(2):
        seen = rig.observe(replace(states, step=step), descriptions, (), 1)
    seen = rig.observe(replace(states, step=20), descriptions, (), 1)
    near = [2, FIRST_PARKED_ID, FIRST_PARKED_ID + 1]
    assert seen.truth.actor_id.tolist() == near, "the third is too far away"
    instance = seen.sweeps[0].points["instance"]
    assert set(np.unique(instance)) == {0, *near}
    assert seen.truth.lidar_points.tolist() == [int((instance == one).sum()) for one in near]
    assert (seen.truth.vx_mps[1:], seen.truth.vy_mps[1:]) == (pytest.approx(0.0), pytest.approx(0.0))
    assert seen.truth.x_m[1:] == pytest.approx([6.0, -8.0])
    assert FIRST_PARKED_ID in np.unique(seen.frames[0].image.instance)
    assert SensorRig(SUITE, NETWORK, 0, scene=boxes.scene()).observe(
        states, descriptions, (), 1
    ).truth.actor_id.tolist() == [2]


def test_odometers_count_from_where_an_actor_was_first_seen(boxes):
    states, _ = boxes.actors((ActorClass.SEDAN, 0.0, 0.0, np.pi / 2), vy_mps=[10.0])
    odometers = Odometers()
    assert odometers.advance(states).tolist() == [0.0]
    assert odometers.advance(replace(states, step=1)) == pytest.approx([0.5])
    two, _ = boxes.actors((ActorClass.SEDAN, 0, 0, np.pi / 2), (ActorClass.SEDAN, 0, 0, 0), vy_mps=[-2.0, 0.0])
    assert odometers.advance(replace(two, step=3)) == pytest.approx([0.3, 0.0])
