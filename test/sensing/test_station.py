from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st
from map_networks import network_of_map

from siren_ros.data.sensor_messages.sensor_topics import static_transforms
from siren_ros.errors import InputError
from siren_ros.sensing.rig import SensorRig
from siren_ros.sensing.specification import LidarSpec, Mount
from siren_ros.sensing.station import check_outdoors, crossings_above, station_mount
from siren_ros.sensing.suite import SensorSuite, Station, load_suite
from siren_ros.simulation.roads.road_network import JunctionKind, LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import ActorClass, ActorDescription

LIDAR = LidarSpec("lidar", Mount(0.0, 0.0, 4.0), channels=16, points_per_second=16 * 360 * 20)
NETWORK = RoadNetwork((), (), (), {}, (0.0, 0.0), "!")


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


def test_without_a_site_it_says_what_it_needs(town):
    for site in (None, {"junction": ""}, {"stretch": []}, {"stretch": ["nowhere"]}, {"stretch": 3}):
        with pytest.raises(InputError, match="with a site"):
            station_mount(Station(None), town, site)
    place = Mount(3.0, 4.0, 0.0, 1.0)
    assert station_mount(Station(place), town) == place


def test_at_a_road_the_pole_stands_beside_it_half_way_along(town):
    edge = max(town.edges, key=lambda edge: town.lanes[edge.lanes[0]].length_m)
    mount = station_mount(Station(None), town, {"junction": "", "stretch": [edge.edge_id]})
    assert_off_the_lanes(mount, town)
    lane = town.lanes[edge.lanes[0]]
    assert np.linalg.norm(np.asarray(lane.centre.at(lane.length_m / 2.0)) - (mount.x_m, mount.y_m)) < 15.0
    assert abs(np.cos(mount.yaw_rad - float(lane.centre.heading_rad(lane.length_m / 2.0)))) < 0.2


def test_a_sensor_inside_a_building_is_refused(boxes):
    scene = boxes.scene(boxes.box((50.0, 0.0, 5.0), (20.0, 20.0, 10.0)))
    suite = SensorSuite("pole", (LIDAR,), station=Station(Mount(50.0, 0.0, 0.0)))
    with pytest.raises(InputError, match="outside of buildings"):
        SensorRig(suite, NETWORK, 0, scene=scene)
    check_outdoors(scene, suite, Mount(35.0, 0.0, 0.0))


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


def test_only_solid_bodies_are_indoors(boxes):
    """A roof over the street, of one surface, and a body below the sensor do not enclose it."""
    suite = SensorSuite("pole", (LIDAR,), station=Station(Mount(50.0, 0.0, 0.0)))
    check_outdoors(boxes.scene(boxes.box((50.0, 0.0, 1.0), (20.0, 20.0, 2.0))), suite, Mount(50.0, 0.0, 0.0))
    with pytest.raises(InputError, match=r"\(50\.0, 3\.0, 4\.0\) m in the map frame"):
        check_outdoors(boxes.scene(boxes.box((50.0, 3.0, 5.0), (20.0, 1.0, 10.0))), suite, Mount(50.0, 3.0, 0.0))


def test_a_station_sees_the_emergency_vehicle_and_stays_where_it_is(boxes):
    suite = SensorSuite("pole", (LIDAR,), station=Station(Mount(0.0, -15.0, 0.0, np.pi / 2)))
    rig = SensorRig(suite, NETWORK, 0, scene=boxes.scene())
    states, _ = boxes.actors((ActorClass.SEDAN, 0.0, 0.0, 0.0), vx_mps=[10.0])
    descriptions = {1: ActorDescription(1, "emv", ActorClass.AMBULANCE, 6.0, 2.2, 2.6, (255, 255, 255), True)}
    seen = rig.observe(states, descriptions, (), 1)
    assert (seen.truth.actor_id.tolist(), seen.truth.x_m[0]) == ([1], pytest.approx(15.0))
    assert seen.truth.lidar_points[0] == (seen.sweeps[0].points["instance"] == 1).sum() > 10
    assert len(rig.observe(replace(boxes.actors()[0], step=1), descriptions, (), 1).sweeps) == 1


def test_its_frames_hang_from_the_map():
    suite = load_suite("roadside")
    frames = {t.child: t for t in static_transforms(suite, station=Mount(5.0, 6.0, 0.0))}
    assert (frames["station"].parent, frames["station"].translation_m) == ("map", (5.0, 6.0, 0.0))
    assert frames["lidar"].parent == frames["camera_left_optical_frame"].parent == "station"
