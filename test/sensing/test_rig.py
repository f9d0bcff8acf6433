"""Sensors of a carrier at their steps, and the place of a roadside unit."""

import io
from dataclasses import dataclass, replace

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st
from map_networks import network_of_map
from PIL import Image

from siren_ros.data.sensor_messages.sensor_topics import static_transforms
from siren_ros.errors import InputError, SirenError
from siren_ros.sensing.meshes.mesh import ParkedVehicle
from siren_ros.sensing.navigation import Odometers
from siren_ros.sensing.rig import SensorRig, check_outdoors, crossings_above, station_mount
from siren_ros.sensing.specification import CameraSpec, LidarSpec, Mount, SensorSpec
from siren_ros.sensing.suite import SENSOR_TYPES, SensorSuite, SensorType, Station, load_suite
from siren_ros.sensing.vehicles.vehicle_shapes import vehicle_shape
from siren_ros.simulation.roads.road_network import JunctionKind, LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import FIRST_PARKED_ID, ActorClass, ActorDescription, SignalState

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
    assert seen.labels == {}, "the suite asks for an instance picture, not for boxes"


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


def test_each_sensor_has_its_own_rate(observe):
    slow = replace(LIDAR, name="slow", rate_hz=5.0)
    seen = observe(SensorSuite("two", (LIDAR, slow), (CAMERA,)), 5)
    names = [[sweep.sensor for sweep in one.sweeps] for one in seen]
    assert names == [["lidar", "slow"], ["lidar"], ["lidar"], ["lidar"], ["lidar", "slow"]]
    assert [len(one.frames) for one in seen] == [1, 0, 1, 0, 1]


def test_the_same_seed_gives_the_same_bytes(observe):
    noisy = SensorSuite("noisy", (replace(LIDAR, noise_stddev_m=0.02),), (replace(CAMERA, noise_stddev=4.0),))
    (first,), (second,), (clean,) = observe(noisy), observe(noisy), observe()
    assert first.sweeps[0].points.tobytes() == second.sweeps[0].points.tobytes()
    assert first.frames[0].jpeg == second.frames[0].jpeg
    assert 2.0 < (first.frames[0].rgb.astype(int) - clean.frames[0].rgb).std() < 5.0


def test_an_empty_suite_still_labels_and_without_a_carrier_nothing_is_measured(traffic, boxes):
    states, descriptions = traffic
    rig = SensorRig(SensorSuite("none"), NETWORK, 0)
    seen = rig.observe(states, descriptions, (), 1)
    assert (seen.sweeps, seen.frames) == ((), ())
    assert rig.truth_frame == "base_link"
    assert seen.truth.z_m[0] == pytest.approx(descriptions[2].height_m / 2)
    states, descriptions = traffic
    sensing = make(boxes).begin(states, descriptions, (), 9)
    assert not sensing.under_way
    seen = sensing.finish()
    assert (seen.sweeps, seen.frames, len(seen.truth)) == ((), (), 0)


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


def test_of_pictures_made_elsewhere_only_those_with_labels_are_drawn_here(boxes, traffic):
    drawn, plain = [], replace(CAMERA, name="plain", instance=False)

    def elsewhere(_away, _descriptions, _base, frames):
        drawn.append([frame.sensor for frame in frames])
        return (), frames

    suite = SensorSuite("two", (LIDAR,), (plain, CAMERA))
    seen = SensorRig(suite, NETWORK, 0, scene=boxes.scene(), elsewhere=elsewhere).observe(*traffic, (), 1)
    assert (drawn, seen.sweeps) == ([["camera_front"]], ())


@dataclass(frozen=True)
class PointerSpec(SensorSpec):
    """A sensor of a user, whose measurement is what it was given."""


def seen_by_pointer(observe, monkeypatch, casts=True, lidars=()):
    """What a suite with the sensor measures, and the view that the sensor got."""
    row = SensorType(PointerSpec, lambda *_: lambda view: view, casts=casts)
    monkeypatch.setitem(SENSOR_TYPES, "pointers", row)
    (seen,) = observe(SensorSuite("own", lidars, others=(PointerSpec("pointer", Mount(0.0, 0.0, 1.0)),)))
    return seen, seen.others[0][1]


@pytest.mark.parametrize("lidars", [(LIDAR,), ()], ids=["beside the LiDAR", "alone"])
def test_a_sensor_that_casts_rays_says_so_and_meets_what_the_lidar_meets(observe, monkeypatch, lidars):
    points = observe()[0].sweeps[0].points
    _, view = seen_by_pointer(observe, monkeypatch, lidars=lidars)
    towards = np.stack([points[axis] for axis in "xyz"], axis=1).astype(np.float32)
    rays = np.concatenate(
        (np.tile((view.map_from_base @ LIDAR.mount.base_from_sensor)[:3, 3], (len(towards), 1)), towards), 1
    )
    distance, row = view.cast(rays)
    actors = np.append(view.states.actor_id, 0)[row]
    assert actors.tolist() == points["instance"].tolist()
    assert {0, 2} == {*actors.tolist()}
    assert np.abs(distance - 1.0).max() < 0.002
    distance, row = view.cast(np.array([(-30.0, 0.2, 0.7, 2.0, 0.0, 0.0), (0.0, 0.0, 5.0, 0.0, 0.0, 1.0)]))
    assert row.tolist() == [1, -1], "through the carrier, and into the sky"
    assert view.states.actor_id[1] == 2
    assert distance[0] == pytest.approx((12.0 + 30.0 - 2.4) / 2.0, abs=0.3)
    assert np.isinf(distance[1])
    _, view = seen_by_pointer(observe, monkeypatch, casts=False)
    with pytest.raises(SirenError, match=r"own: .*casts=True"):
        view.cast(np.zeros((1, 6)))


def test_odometers_count_from_where_an_actor_was_first_seen(boxes):
    states, _ = boxes.actors((ActorClass.SEDAN, 0.0, 0.0, np.pi / 2), vy_mps=[10.0])
    odometers = Odometers()
    assert odometers.advance(states).tolist() == [0.0]
    assert odometers.advance(replace(states, step=1)) == pytest.approx([0.5])
    two, _ = boxes.actors((ActorClass.SEDAN, 0, 0, np.pi / 2), (ActorClass.SEDAN, 0, 0, 0), vy_mps=[-2.0, 0.0])
    assert odometers.advance(replace(two, step=3)) == pytest.approx([0.3, 0.0])


POLE_LIDAR = LidarSpec("lidar", Mount(0.0, 0.0, 4.0), channels=16, points_per_second=16 * 360 * 20)


@pytest.fixture(name="town", scope="module")
def _town():
    return network_of_map()


def assert_off_the_lanes(mount, town):
    pole = shapely.Point(mount.x_m, mount.y_m)
    for lane in town.lanes:
        if lane.kind in {LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL}:
            assert shapely.LineString(lane.centre.points).distance(pole) > lane.width_m / 2.0 + 0.7


def test_at_a_junction_the_pole_is_off_the_lanes_and_faces_the_middle(town):
    for junction in [j for j in town.junctions.values() if j.kind is JunctionKind.SIGNAL]:
        mount = station_mount(Station(None), town, {"junction": junction.junction_id})
        assert_off_the_lanes(mount, town)
        middle = shapely.Polygon(junction.outline).centroid
        away = np.array([middle.x - mount.x_m, middle.y - mount.y_m])
        assert np.linalg.norm(away) < 40.0
        assert np.cos(mount.yaw_rad) == pytest.approx(away[0] / np.linalg.norm(away))


def test_at_a_road_the_pole_stands_beside_it_and_without_a_site_it_says_what_it_needs(town):
    edge = max(town.edges, key=lambda edge: town.lanes[edge.lanes[0]].length_m)
    mount = station_mount(Station(None), town, {"junction": "", "stretch": [edge.edge_id]})
    assert_off_the_lanes(mount, town)
    lane = town.lanes[edge.lanes[0]]
    assert np.linalg.norm(np.asarray(lane.centre.at(lane.length_m / 2.0)) - (mount.x_m, mount.y_m)) < 15.0
    assert abs(np.cos(mount.yaw_rad - float(lane.centre.heading_rad(lane.length_m / 2.0)))) < 0.2
    for site in (None, {"junction": ""}, {"stretch": []}, {"stretch": ["nowhere"]}, {"stretch": 3}):
        with pytest.raises(InputError, match="with a site"):
            station_mount(Station(None), town, site)
    place = Mount(3.0, 4.0, 0.0, 1.0)
    assert station_mount(Station(place), town) == place


def test_a_sensor_inside_a_building_is_refused(boxes):
    scene = boxes.scene(boxes.box((50.0, 0.0, 5.0), (20.0, 20.0, 10.0)))
    suite = SensorSuite("pole", (POLE_LIDAR,), station=Station(Mount(50.0, 0.0, 0.0)))
    with pytest.raises(InputError, match="outside of buildings"):
        SensorRig(suite, NETWORK, 0, scene=scene)
    check_outdoors(scene, suite, Mount(35.0, 0.0, 0.0))
    # A body below the sensor does not enclose it.
    check_outdoors(boxes.scene(boxes.box((50.0, 0.0, 1.0), (20.0, 20.0, 2.0))), suite, Mount(50.0, 0.0, 0.0))
    with pytest.raises(InputError, match=r"\(50\.0, 3\.0, 4\.0\) m in the map frame"):
        check_outdoors(boxes.scene(boxes.box((50.0, 3.0, 5.0), (20.0, 1.0, 10.0))), suite, Mount(50.0, 3.0, 0.0))


@given(
    corners=st.lists(st.tuples(*[st.integers(-8, 8)] * 9), min_size=1, max_size=6),
    place=st.tuples(*[st.integers(-8, 8)] * 3),
)
def test_triangles_above_a_place_are_those_of_their_planes(corners, place):
    """Of tilted triangles of either sense of rotation: the plane through the corners, where the outline holds it."""
    x_m, y_m, z_m = place[0] + 0.37, place[1] + 0.1913, place[2] + 0.5
    triangles = np.array(corners, dtype=np.float64).reshape(-1, 3, 3)
    expected = 0
    for triangle in triangles:
        normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
        if abs(normal[2]) > 1e-9 and shapely.Polygon(triangle[:, :2]).contains(shapely.Point(x_m, y_m)):
            height_m = triangle[0, 2] - (normal[:2] @ (np.array([x_m, y_m]) - triangle[0, :2])) / normal[2]
            assume(abs(height_m - z_m) > 1e-2)
            expected += bool(height_m > z_m)
    assert crossings_above(triangles, x_m, y_m, z_m) == expected


def test_a_station_sees_the_emergency_vehicle_and_stays_where_it_is(boxes):
    suite = SensorSuite("pole", (POLE_LIDAR,), station=Station(Mount(0.0, -15.0, 0.0, np.pi / 2)))
    rig = SensorRig(suite, NETWORK, 0, scene=boxes.scene())
    states, _ = boxes.actors((ActorClass.SEDAN, 0.0, 0.0, 0.0), vx_mps=[10.0])
    descriptions = {1: ActorDescription(1, "emv", ActorClass.AMBULANCE, 6.0, 2.2, 2.6, (255, 255, 255), True)}
    seen = rig.observe(states, descriptions, (), 1)
    assert (seen.truth.actor_id.tolist(), seen.truth.x_m[0]) == ([1], pytest.approx(15.0))
    assert seen.truth.lidar_points[0] == (seen.sweeps[0].points["instance"] == 1).sum() > 10
    assert len(rig.observe(replace(boxes.actors()[0], step=1), descriptions, (), 1).sweeps) == 1
    suite = load_suite("roadside")
    frames = {t.child: t for t in static_transforms(suite, station=Mount(5.0, 6.0, 0.0))}
    assert (frames["station"].parent, frames["station"].translation_m) == ("map", (5.0, 6.0, 0.0))
    assert frames["lidar"].parent == frames["camera_left_optical_frame"].parent == "station"
