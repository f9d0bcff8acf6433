"""A lane change between lanes of different length, with SUMO's call written down instead of made."""

from types import SimpleNamespace

import libsumo
import numpy as np
import pytest

from siren_ros.numerics.polyline import Polyline
from siren_ros.numerics.units import STEP_S
from siren_ros.roads.road_network import Edge, Lane, LaneKind, RoadNetwork
from siren_ros.traffic.sumo import lane_continuity
from siren_ros.traffic.sumo.lane_continuity import LaneContinuity

RADIUS, WIDTH = 40.0, 4.0
OFFSET = (100.0, 50.0)
SUMO_LENGTH = RADIUS * np.pi / 2.0


def network():
    """A quarter circle to the left of two lanes, the right one outside; and a road of its own."""
    a = np.linspace(0.0, np.pi / 2.0, 200)
    lanes = []
    for position, radius in enumerate((RADIUS + WIDTH, RADIUS)):
        points = np.stack((radius * np.sin(a), RADIUS - radius * np.cos(a)), axis=-1)
        centre = Polyline.through(points)
        lanes.append(Lane(position, f"e0_{position}", 0, position, LaneKind.DRIVING, centre, WIDTH, 13.9, True, True))
    other = Polyline.through([[0.0, -50.0], [60.0, -50.0]])
    lanes.append(Lane(2, "e1_0", 1, 0, LaneKind.DRIVING, other, WIDTH, 13.9, True, True))
    edges = (Edge(0, "e0", (0, 1), "A", "B", internal=False), Edge(1, "e1", (2,), "C", "D", internal=False))
    return RoadNetwork(tuple(lanes), edges, (), {}, OFFSET, "!")


@pytest.fixture
def moved(monkeypatch):
    calls = []
    fake = SimpleNamespace(**{name: getattr(libsumo, name) for name in dir(libsumo) if name.startswith("VAR_")})
    fake.vehicle = SimpleNamespace(moveTo=lambda *arguments: calls.append(arguments))
    monkeypatch.setattr(lane_continuity, "libsumo", fake)
    return calls


NETWORK = network()
SCALE = {"e0_0": SUMO_LENGTH / NETWORK.lanes[0].length_m, "e0_1": 1.0, "e1_0": 1.0}


def result_at(lane, along, speed=8.0, lateral=0.3):
    """What SUMO says of a vehicle whose front is at an arc length of a lane."""
    found = NETWORK.lane_by_id[lane]
    x, y = found.centre.at(along)
    return {
        libsumo.VAR_LANE_ID: lane,
        libsumo.VAR_POSITION: (x + OFFSET[0], y + OFFSET[1]),
        libsumo.VAR_LANEPOSITION: along * SCALE[lane],
        libsumo.VAR_LANEPOSITION_LAT: lateral,
        libsumo.VAR_SPEED: speed,
    }


def after(before, now, skip=()):
    continuity = LaneContinuity(NETWORK, SCALE)
    continuity.correct({"v": before}, ())
    continuity.correct({"v": now}, skip)
    return now


@pytest.mark.parametrize(("origin", "target", "radii"), [("e0_1", "e0_0", 1.1), ("e0_0", "e0_1", 1.0 / 1.1)])
def test_a_lane_change_in_a_bend_goes_on_where_the_motion_leads(moved, origin, target, radii):
    """SUMO keeps the share of the length, so the place alongside; here it is 3 m off."""
    along = 30.0
    alongside = along * radii
    expected = alongside + 8.0 / SCALE[target] * STEP_S
    for off in (3.0, -3.0):
        moved.clear()
        now = after(result_at(origin, along), result_at(target, expected + off))
        ((name, lane, position),) = moved
        assert (name, lane) == ("v", target)
        assert position == pytest.approx(expected * SCALE[target], abs=0.02)
        assert now[libsumo.VAR_LANEPOSITION] == position
        point = NETWORK.lane_by_id[target].centre.offset_points(position / SCALE[target], 0.3)
        assert now[libsumo.VAR_POSITION] == pytest.approx((point[0] + OFFSET[0], point[1] + OFFSET[1]))


def test_a_lane_change_that_stands_right_is_left_alone(moved):
    expected = 33.0 + 8.0 / SCALE["e0_0"] * STEP_S
    after(result_at("e0_1", 30.0), result_at("e0_0", expected + 0.03))
    assert moved == []


@pytest.mark.parametrize(("origin", "target"), [("e0_1", "e0_1"), ("e0_1", "e1_0"), ("e0_1", "gone")])
def test_only_changes_to_a_lane_of_the_same_edge_are_corrected(moved, origin, target):
    now = result_at(origin, 40.0) if target == "gone" else result_at(target, 40.0)
    now[libsumo.VAR_LANE_ID] = target
    after(result_at(origin, 30.0), now)
    assert moved == []


def test_vehicles_moved_from_outside_and_places_beyond_the_lane_are_left_alone(moved):
    after(result_at("e0_1", 30.0), result_at("e0_0", 40.0), skip=("v",))
    after(result_at("e0_1", SUMO_LENGTH - 0.1, speed=30.0), result_at("e0_0", 40.0))
    assert moved == []


def test_what_counts_is_the_step_before(moved):
    continuity = LaneContinuity(NETWORK, SCALE)
    continuity.correct({"v": result_at("e0_1", 30.0)}, ())
    continuity.correct({}, ())
    continuity.correct({"v": result_at("e0_0", 40.0)}, ())
    assert moved == []
