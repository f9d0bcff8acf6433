"""Where a vehicle would go on when its record ends."""

from dataclasses import replace

import numpy as np
import pytest
from evaluation.made_records import moving, record_with
from hand_made_record import EMV, IN_TURN_LANE, Driven, crossing, hand_made, line

from siren_ros.evaluation.yielding.way_ahead import REACH_M, way_ahead
from siren_ros.numerics.arrays import Points
from siren_ros.numerics.polyline import Polyline
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.roads.road_network import RoadNetwork

N_OUT, E_OUT = 1, 2
"""Indices of the edges behind the crossing."""


def northbound(x_m: float, end_y_m: float) -> EpisodeRecord:
    """A vehicle whose record ends at a place of the approach, after 10 m."""
    way = line((x_m, end_y_m - 10.0), (x_m, end_y_m))
    return hand_made(crossing(), {EMV: Driven(way, np.linspace(0.0, 10.0, 21))})


def with_route(record: EpisodeRecord, *edges: int) -> EpisodeRecord:
    """SUMO's word on the vehicle's route at the last step; at the steps before it was another one."""
    last = len(record.traffic) - 1
    traffic = tuple(
        replace(
            state,
            actor_id=np.array([EMV], dtype=np.uint32),
            lane=np.array([1], dtype=np.int32),
            route_offset=np.array([0, len(edges) if state.step == last else 0], dtype=np.int32),
            route_edges=np.array(edges if state.step == last else [], dtype=np.int32),
        )
        for state in record.traffic
    )
    return replace(record, traffic=traffic)


def ahead(record: EpisodeRecord) -> Points:
    return way_ahead(record, record.track(EMV))


@pytest.mark.parametrize("aside_m", [0.0, 0.6, -0.8])
def test_along_the_lane_and_straight_across_at_the_same_offset(aside_m: float) -> None:
    found = ahead(northbound(5.25 - aside_m, -40.0))
    assert found[:, 0] == pytest.approx(np.full(len(found), 5.25 - aside_m))
    # 19 places before the stop line, then 30 across the junction, with which 45 m are reached.
    assert found[:, 1] == pytest.approx(np.arange(-39.0, 9.5))


def test_the_route_turns() -> None:
    found = ahead(with_route(northbound(5.25, -40.0), 0, E_OUT))
    radius = 14.75
    centre = np.array([5.25 + radius, -20.0])
    bend = found[found[:, 1] > -19.9]
    assert np.hypot(*(bend - centre).T).min() > radius - 0.05
    assert found[-1, 0] > 19.0
    assert ahead(with_route(northbound(5.25, -40.0), 0, N_OUT))[-1] == pytest.approx([5.25, 9.0])


def test_from_the_middle_of_a_turn_into_the_lane_behind_it() -> None:
    turned = 100.0 + 14.75 * np.pi / 2.0
    record = hand_made(crossing(), {EMV: Driven(IN_TURN_LANE, np.linspace(90.0, turned - 2.0, 21))})
    found = ahead(record)
    assert found[5:, 1] == pytest.approx(np.full(len(found) - 5, -5.25), abs=0.01)
    assert np.diff(found[5:, 0]) == pytest.approx(np.ones(len(found) - 6), abs=0.01)
    assert found[-1, 0] > 20.0 + REACH_M


def test_straight_on_where_nothing_is_known(crossroads: RoadNetwork) -> None:
    """The first connection of the lane leads to the left."""
    record = record_with({EMV: moving(-30.0, 0.4, 10.0, steps=41, is_emv=True)}, crossroads)
    found = ahead(record)
    assert found[:, 1] == pytest.approx(np.full(len(found), 0.4))
    assert found[:, 0].min() == pytest.approx(-9.0)


def test_on_to_the_end_of_the_road() -> None:
    assert ahead(northbound(5.25, 105.0))[:, 1] == pytest.approx([106.0, 107.0, 108.0, 109.0])


@pytest.mark.parametrize(("end_y_m", "left_m"), [(107.5, [108.5, 109.5]), (108.5, list(np.arange(109.5, 152.6)))])
def test_two_places_are_a_way_and_one_is_none(end_y_m: float, left_m: list[float]) -> None:
    """The road ends at 110 m."""
    assert ahead(northbound(5.25, end_y_m))[:, 1] == pytest.approx(left_m)


def test_a_way_across_has_all_its_parts(crossroads: RoadNetwork) -> None:
    """The path straight on is in two parts, of 15 and of 25 m; the EMV ends before it, or in the first part."""
    lanes = list(crossroads.lanes)
    lanes[5] = replace(lanes[5], centre=Polyline.through([(0.0, 0.0), (15.0, 0.0)]))
    second = Polyline.through([(15.0, 0.0), (40.0, 0.0)])
    lanes.append(replace(lanes[5], index=7, lane_id="l7", edge=7, centre=second))
    edges = (*crossroads.edges, replace(crossroads.edges[5], index=7, edge_id="e7", lanes=(7,)))
    straight = replace(crossroads.connections[1], via=(5, 7))
    network = replace(crossroads, lanes=tuple(lanes), edges=edges, connections=(straight,))
    for end_m in (-10.0, 6.0):
        track = moving(end_m - 20.0, 0.0, 10.0, steps=41, is_emv=True)
        found = ahead(record_with({EMV: track}, network))
        assert found[:, 1] == pytest.approx(np.zeros(len(found)))
        assert found[0, 0] == pytest.approx(end_m + 1.0)
        assert np.diff(found[:, 0]).max() <= 1.0 + 1e-9, "without a hole"
        assert found[-1, 0] >= end_m + REACH_M - 1.0


@pytest.mark.parametrize(("start", "yaw_rad"), [((5.25, 108.5), np.pi / 2.0), ((60.0, 60.0), 0.7), ((60, 60), -2.4)])
def test_straight_on_off_the_lanes_and_where_they_end(start: tuple[float, float], yaw_rad: float) -> None:
    heading = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
    way = np.array([np.array(start) - 10.0 * heading, start])
    found = ahead(hand_made(crossing(), {EMV: Driven(way, np.linspace(0.0, 10.0, 21))}))
    assert found == pytest.approx(np.array(start) + np.arange(1.0, 45.0)[:, None] * heading)
