"""The road network, its place on Earth, and mirror images of the map and of the world."""

from dataclasses import fields, replace

import numpy as np
import pytest

from siren_ros.simulation.roads.road_network import (
    geodetic_from_projected,
    mirror_image,
    mirrored_network,
    projected_from_geodetic,
    right_hand_image,
)
from siren_ros.simulation.world.actors import (
    ACTOR_STATE_DTYPES,
    TRAFFIC_STATE_DTYPES,
    ActorStates,
    EmvAdvice,
    Event,
    EventKind,
    Lights,
    TrafficFlags,
    TrafficState,
)
from siren_ros.simulation.world.commands import COMMAND_DTYPES, AvControl, VehicleCommands

UTM_33 = "+proj=utm +zone=33 +ellps=WGS84 +datum=WGS84 +units=m +no_defs"


@pytest.mark.parametrize(
    ("projection", "projected_m", "lat_lon_deg"),
    [
        (UTM_33, (500_000.0, 4_984_944.378 * 0.9996), (45.0, 15.0)),
        (f"{UTM_33} +south", (500_000.0, 10_000_000.0 - 4_984_944.378 * 0.9996), (-45.0, 15.0)),
        (UTM_33, (391_440.0321, 5_820_079.6668), (52.52, 13.40)),
        ("+proj=tmerc +lat_0=48.5 +lon_0=9.25 +k=0.9999 +x_0=1000 +y_0=2000", (1000.0, 2000.0), (48.5, 9.25)),
    ],
    ids=["on the meridian", "in the south", "off the meridian", "an origin of its own"],
)
def test_places_are_those_of_proj(projection, projected_m, lat_lon_deg):
    """The WGS 84 meridian arc from the equator to 45° is 4 984 944.378 m; off it the numbers are PROJ's."""
    assert geodetic_from_projected(projection, *projected_m) == pytest.approx(lat_lon_deg, abs=1e-8)
    assert projected_from_geodetic(projection, *lat_lon_deg) == pytest.approx(projected_m, abs=1e-3)


@pytest.mark.parametrize(
    "projection", ["!", "-", "", "+proj=merc", "+proj=utm", "+proj=utm +zone=x", "+proj=tmerc +k=0"]
)
def test_other_projections_have_no_answer(projection):
    assert geodetic_from_projected(projection, 0.0, 0.0) is None


def test_neighbours_to_the_left_and_right_are_those_of_the_geometry(town):
    """Position 0 is at the outer kerb: on the left where traffic keeps left."""
    for network in (town, mirrored_network(town)):
        for edge in (edge for edge in network.edges if not edge.internal):
            lanes = [network.lanes[lane] for lane in edge.lanes][:: -1 if network.left_hand else 1]
            assert lanes[0].centre.project(lanes[-1].centre.at(5.0))[1] >= 0.0
            assert [network.neighbour(lane, 1) for lane in lanes] == [*lanes[1:], None]
            assert [network.neighbour(lane, -1) for lane in lanes] == [None, *lanes[:-1]]


def test_the_image_of_the_image_is_the_map(town):
    crossed = replace(
        town, cycle_connections=town.connections, crossings=tuple(lane.centre.points for lane in town.lanes)
    )
    image = mirrored_network(crossed)
    assert image.cycle_connections == image.connections != town.connections
    for before, after in zip(crossed.crossings, image.crossings, strict=True):
        assert np.array_equal(after, before * (1.0, -1.0))
    image = mirrored_network(town)
    again = mirrored_network(image)
    assert again.connections == town.connections
    assert not again.left_hand
    assert again.origin_lat_lon_deg == town.origin_lat_lon_deg
    assert all(np.array_equal(a.centre.points, b.centre.points) for a, b in zip(again.lanes, town.lanes, strict=True))
    assert right_hand_image(town) is town
    assert right_hand_image(image) is again, "one image of each map"


EVENT = Event(3, EventKind.YIELD_HELD, 5, 1, 2.0, 7.0, {"side": -1, "offset_m": -1.5, "partial": 0, "reason": "x"})
ADVICE = EmvAdvice(1, 1, 5, 20.0, 9.0, 2)
SIGNED = {
    "y_m",
    "sumo_y_m",
    "yaw_rad",
    "sumo_yaw_rad",
    "vy_mps",
    "yaw_rate_radps",
    "lateral_accel_mps2",
    "steer_rad",
    "lateral_offset_m",
}
CODED = {"lights", "flags"}


def columns(dtypes):
    rng = np.random.default_rng(2)
    return {name: (rng.random(4) * 3.0 + 1.0).astype(dtype) for name, dtype in dtypes.items()}


STATES = ActorStates(step=4, **columns(ACTOR_STATE_DTYPES))
TRAFFIC = TrafficState(step=4, spawned=(), emvs=(ADVICE,), signals=(), events=(EVENT,), **columns(TRAFFIC_STATE_DTYPES))
COMMANDS = VehicleCommands(step=4, source="me", events=(EVENT,), **columns(COMMAND_DTYPES))


@pytest.mark.parametrize("content", [STATES, TRAFFIC, COMMANDS], ids=["states", "traffic", "commands"])
def test_every_column(content):
    image = mirror_image(content)
    for field in fields(content):
        before, after = getattr(content, field.name), getattr(image, field.name)
        if field.name in {"events", "emvs"}:
            assert after == tuple(map(mirror_image, before))
        elif field.name not in CODED:
            factor = -1.0 if field.name in SIGNED else 1.0
            assert np.array_equal(after, np.multiply(factor, before) if field.name in SIGNED else before), field.name


def test_lights_and_wishes_change_sides():
    every = np.arange(16, dtype=np.uint8)
    states = ActorStates(step=0, **{name: every.astype(kind) for name, kind in ACTOR_STATE_DTYPES.items()})
    lights = [Lights(int(code)) for code in mirror_image(states).lights]
    for code, image in enumerate(lights):
        assert bool(image & Lights.INDICATOR_LEFT) is bool(code & Lights.INDICATOR_RIGHT)
        assert bool(image & Lights.INDICATOR_RIGHT) is bool(code & Lights.INDICATOR_LEFT)
        assert image & (Lights.BRAKE | Lights.BEACON) == code & (Lights.BRAKE | Lights.BEACON)
    assert int(TrafficFlags.WANTS_LEFT) == int(Lights.INDICATOR_LEFT)
    assert int(TrafficFlags.WANTS_RIGHT) == int(Lights.INDICATOR_RIGHT)


def test_events_and_advice():
    image = mirror_image(EVENT)
    assert (image.x_m, image.y_m) == (2.0, -7.0)
    assert image.detail == {"side": 1, "offset_m": 1.5, "partial": 0, "reason": "x"}
    assert mirror_image(ADVICE).lane_change_intent == -1
    assert mirror_image(mirror_image(EVENT)) == EVENT


def test_yaws_stay_in_their_range():
    yaws = np.array([np.pi, -3.0, 0.5, 0.0])
    states = ActorStates(step=0, **{name: yaws.astype(kind) for name, kind in ACTOR_STATE_DTYPES.items()})
    assert mirror_image(states).yaw_rad.tolist() == [np.pi, 3.0, -0.5, 0.0]


def test_the_image_of_an_answer_from_the_seat_turns_the_other_way():
    control = AvControl(4, 0.5, 0.0, 0.25, int(Lights.INDICATOR_LEFT))
    image = mirror_image(control)
    assert image == AvControl(4, 0.5, 0.0, -0.25, int(Lights.INDICATOR_RIGHT))
    assert type(image.lights) is int
    assert mirror_image(image) == control
