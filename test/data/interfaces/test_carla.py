"""What CARLA calls and places things as, next to what its own client makes of it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.data.interfaces.carla import (
    GREEN,
    OFF,
    RED,
    YELLOW,
    actor_pose,
    blueprints,
    carla_lights,
    carla_pose,
    cast_of,
    classes_of,
    depth_of,
    signal_colour,
)
from siren_ros.sensing.meshes.mesh import SemanticClass
from siren_ros.sensing.specification import rotation_from_rpy, transform
from siren_ros.simulation.world.actors import ActorClass, ActorDescription, Lights

carla = pytest.importorskip("carla", reason="CARLA's client has no wheel for this machine")
ANGLES = st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
PLACES = st.tuples(*[st.floats(-300.0, 300.0)] * 3)


def carla_transform(pose):
    return carla.Transform(carla.Location(*pose[:3]), carla.Rotation(*pose[3:]))


def actor(kind=ActorClass.SEDAN, actor_id=7, length_m=4.9):
    return ActorDescription(actor_id, "a", kind, length_m, 1.8, 1.5, (1, 2, 3))


@given(ANGLES, PLACES, PLACES)
def test_the_client_puts_a_point_where_our_matrix_puts_it(rpy, place, point):
    matrix = transform(rotation_from_rpy(*rpy), place)
    there = carla_transform(carla_pose(matrix)).transform(carla.Location(point[0], -point[1], point[2]))
    assert (there.x, -there.y, there.z) == pytest.approx(tuple((matrix @ (*point, 1.0))[:3]), abs=0.01)


@given(st.floats(-3.1, 3.1), PLACES, st.tuples(*[st.floats(-1.0, 1.0)] * 3), st.tuples(*[st.floats(0.5, 5.0)] * 3))
def test_the_box_stands_on_the_ground_around_the_middle_of_the_footprint(yaw_rad, place, centre, extent):
    x, y, ground = place
    pose = carla_transform(actor_pose(x, y, yaw_rad, ground, np.array(centre), np.array(extent)))
    middle = pose.transform(carla.Location(*centre))
    assert (middle.x, -middle.y, middle.z - extent[2]) == pytest.approx(place, abs=0.001)


def test_lights_are_those_of_the_client():
    names = carla.VehicleLightState
    special = int(names.Special1) | int(names.Special2)
    for ours, theirs in (
        (Lights.BRAKE, int(names.Brake)),
        (Lights.INDICATOR_LEFT, int(names.LeftBlinker)),
        (Lights.INDICATOR_RIGHT, int(names.RightBlinker)),
        (Lights.BEACON, special),
        (Lights.SIREN, 0),
        (Lights.BRAKE | Lights.BEACON, int(names.Brake) | special),
    ):
        assert carla_lights(int(ours)) == theirs


def test_signals_show_what_the_most_permissive_movement_has():
    for letters, colour, name in (
        ("rG", GREEN, "Green"),
        ("ry", YELLOW, "Yellow"),
        ("rr", RED, "Red"),
        ("O", OFF, "Off"),
    ):
        assert signal_colour(letters) == colour == int(getattr(carla.TrafficLightState, name))


def test_the_same_actor_has_the_same_blueprint_and_its_length_decides_first():
    table = blueprints()
    assert set(table) == set(ActorClass)
    for actor_id in range(1, 40):
        best, *_ = cast_of(actor(actor_id=actor_id))
        assert best in table[ActorClass.SEDAN]
        assert abs(table[ActorClass.SEDAN][best] - 4.9) <= 0.25
        assert cast_of(actor(actor_id=actor_id))[0] == best
    assert len({cast_of(actor(actor_id=actor_id))[0] for actor_id in range(1, 40)}) > 2
    assert cast_of(actor(ActorClass.AMBULANCE, length_m=6.0))[0] == "vehicle.ford.ambulance"


def test_what_a_server_lacks_is_replaced_by_a_like_body_and_people_only_by_people():
    has = {"vehicle.mercedes.sprinter", "vehicle.audi.a2", "walker.pedestrian.0002"}
    assert cast_of(actor(ActorClass.AMBULANCE), has) == ("vehicle.mercedes.sprinter", "vehicle.audi.a2")
    assert cast_of(actor(ActorClass.PEDESTRIAN), has) == ("walker.pedestrian.0002",)
    assert cast_of(actor(ActorClass.PEDESTRIAN), {"vehicle.audi.a2"}) == ()


def test_depth_and_classes_are_those_of_the_channels():
    bgra = np.array([[[0, 0, 0, 255], [0, 1, 0, 255], [255, 255, 255, 255], [0, 0, 14, 255]]], np.uint8)
    assert depth_of(bgra)[0, 1] == pytest.approx(1000.0 * 256 / (256**3 - 1))
    assert depth_of(bgra)[0, 2] == 0.0
    assert classes_of(bgra)[0, 3] == SemanticClass.CAR
    tags = {int(tag): str(tag) for tag in carla.CityObjectLabel.values.values() if tag != carla.CityObjectLabel.Any}
    known = classes_of(np.array([[[0, 0, tag, 0] for tag in tags]], np.uint8))[0]
    assert set(known.tolist()) <= {int(each) for each in SemanticClass}
    assert {name: int(value) for (_, name), value in zip(tags.items(), known, strict=True)}[
        "Roads"
    ] == SemanticClass.ROAD
