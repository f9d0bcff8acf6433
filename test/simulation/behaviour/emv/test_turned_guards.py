"""Every number that a guard takes from the scene is the same on a road that points elsewhere."""

import numpy as np
import pytest

from siren_ros.simulation.behaviour.civilians.pull_over import edge_offset_m, emv_waits_behind
from siren_ros.simulation.behaviour.civilians.yield_manager import EmvRoad, region_members, way_from_emv_m
from siren_ros.simulation.behaviour.driving import lane_change
from siren_ros.simulation.behaviour.driving.civilian_unit import emv_fully_passed
from siren_ros.simulation.behaviour.driving.emv_unit import EmvUnit
from siren_ros.simulation.behaviour.driving.speed_mechanisms import anticipated_limit, free_way, passage_limit
from siren_ros.simulation.behaviour.emv.controller import follow_route
from siren_ros.simulation.behaviour.emv.gap_escape import blocker_of, in_the_way, reference_line, search_gap
from siren_ros.simulation.behaviour.emv.rescue_corridor import braking_ahead, corridor_offsets, corridor_path
from siren_ros.simulation.behaviour.paths.lane_path import LaneEnd, path_on_lanes
from siren_ros.simulation.scenario.paper import ControlConstants
from siren_ros.simulation.world.actors import ActorClass, Owner

TURNS = np.radians([35.0, 125.0, -100.0])
CARS = [
    # id, lane, s, left, turned, speed
    (1, 0, 100.0, 0.3, 0.03, 6.0),
    (2, 0, 125.0, -0.6, 0.05, 3.0),
    (3, 1, 122.0, 0.9, -0.08, 0.0),
    (4, 1, 80.0, -0.2, 0.1, 9.0),
    (5, 0, 140.0, 0.4, -0.1, 0.2),
]


def view_at(lab, turn):
    network, along, across = lab.turned_road(turn, length=300.0)
    poses = np.array(
        [[*(s * along + (3.3 * lane + left) * across), turn + yaw, speed] for _, lane, s, left, yaw, speed in CARS]
    )
    cars = [
        lab.Car(number, lane, s, speed, (0,), ActorClass.AMBULANCE if number == 1 else ActorClass.SEDAN)
        for number, lane, s, _, _, speed in CARS
    ]
    traffic = lab.traffic_of(network, cars, poses=poses, owners=dict.fromkeys((2, 3, 5), int(Owner.ROS)))
    return lab.view_of(lab.world_of(network, lab.L3), traffic), along, across


def numbers(lab, turn):
    """By name; places along and across the road."""
    view, along, across = view_at(lab, turn)
    unit = follow_route(EmvUnit(1), view.ego(0))[0]
    reference = path_on_lanes(view.world.network, (0,), LaneEnd.HORIZON, 98.0, 80.0)
    s = np.linspace(2.0, 78.0, 77)
    path = search_gap(reference_line(view.ego(0), 0), view.ego(0))
    corridor = corridor_path(EmvUnit(1, corridor=True), view.ego(0)).navigator.path
    query = lane_change.LaneChangeQuery(view.ego(4), 0, 1, 5.0, civilian=True)
    change = lane_change.lane_change_path(query, lane_change.assess(query), stop_at_end=True).curve.points
    road = EmvRoad.ahead_of(view.ego(0), None)
    escaping = EmvUnit(1, unit.navigator, gap_escape_active=True)
    return {
        "anticipated": anticipated_limit(unit, view.ego(0)).speed_mps,
        "corridor": corridor_offsets(reference, s, view.ego(0))[::8],
        "corridor path": (corridor.curve.points @ across)[::6],
        "braking ahead": braking_ahead(unit, view.ego(0)),
        "escape": (path.left_m[-1], path.length_m, path.clearance_m),
        "free way": (free_way(unit, view.ego(0)).free_m, free_way(escaping, view.ego(0)).free_m),
        "passage": passage_limit(escaping, view.ego(0)).speed_mps,
        "in the way": [in_the_way(view.ego(0), row, 0) for row in range(1, 5)],
        "blocker": blocker_of(escaping, view.ego(0)),
        "gaps": [
            (gaps.front_m, gaps.rear_m, gaps.front_id)
            for gaps in (lane_change.gaps_in_lane(view.ego(row), lane) for row in range(5) for lane in range(2))
        ],
        "offsets": [lane_change.offset_in_lane(view.ego(row), lane) for row in range(5) for lane in range(2)],
        "entered": [lane_change.entered_lane(view.ego(row), lane) for row in range(5) for lane in range(2)],
        "way": way_from_emv_m(view, 0, road.road_start_m),
        "members": region_members(view.seen, 0, np.empty(0, np.uint32), ControlConstants(region_enter_m=30.0)),
        "waits": [emv_waits_behind(view.ego(row), 2) for row in range(5)],
        "passed": [emv_fully_passed(view.ego(row), 0) for row in range(1, 5)],
        "edges": [edge_offset_m(view.ego(row), row % 2, side) for row in range(1, 5) for side in (1, -1)],
        "change": (query.length_m, change[::6] @ along, change[::6] @ across),
    }


@pytest.fixture(scope="module")
def cache():
    return {}


@pytest.mark.parametrize("turn", TURNS)
def test_a_turned_scene_has_the_same_numbers(lab, cache, turn):
    plain = cache.setdefault("plain", numbers(lab, 0.0))
    assert plain["braking ahead"]
    assert plain["escape"][1] > 8.0
    assert np.ptp(plain["corridor"]) > 0.1
    other = numbers(lab, turn)
    for name, value in plain.items():
        flat, turned = (
            np.hstack([np.ravel(np.asarray(part, dtype=float)) for part in _parts(v)]) for v in (value, other[name])
        )
        np.testing.assert_allclose(turned, flat, atol=0.08, err_msg=name)


def _parts(value):
    return value if isinstance(value, list | tuple) else [value]
