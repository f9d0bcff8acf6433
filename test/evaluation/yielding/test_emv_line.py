"""Where a vehicle would go on when its record ends."""

from dataclasses import replace

import numpy as np
import pytest
from evaluation.made_records import Track, moving, record_with
from hand_made_record import EMV, IN_TURN_LANE, Driven, crossing, hand_made, line
from made_encounters import CAR, arc, line_of, record_of

from siren_ros.errors import InputError
from siren_ros.evaluation.yielding.encounters import REACH_M, EmvLine, OnLine, on_line, way_ahead
from siren_ros.numerics.arrays import Points
from siren_ros.numerics.geometry import Polyline
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


LENGTH_M, WIDTH_M = 5.0, 2.0
HEADING_RAD = 2.4


def placed(network: RoadNetwork, along_m: float, left_m: float, turn_rad: float) -> OnLine:
    """One vehicle relative to a line from (10, −20) in a direction of the second quadrant."""
    cos, sin = np.cos(HEADING_RAD), np.sin(HEADING_RAD)
    start = np.array([10.0, -20.0])
    axis = Polyline.through([start, start + 100.0 * np.array([cos, sin])])
    x, y = start + along_m * np.array([cos, sin]) + left_m * np.array([-sin, cos])
    track = record_with({1: moving(x, y, 3.0, yaw_rad=HEADING_RAD + turn_rad, steps=1)}, network).track(1)
    return on_line(axis, track, LENGTH_M, WIDTH_M)


@pytest.mark.parametrize("left_m", [3.0, -2.0])
@pytest.mark.parametrize("turn_rad", [0.0, np.pi / 6.0, -np.pi / 6.0, np.pi / 2.0, 2.5])
def test_place_and_extent_of_a_turned_body(straight_road: RoadNetwork, left_m: float, turn_rad: float) -> None:
    found = placed(straight_road, 30.0, left_m, turn_rad)
    cos, sin = abs(np.cos(turn_rad)), abs(np.sin(turn_rad))
    assert found.arc_m == pytest.approx([30.0])
    assert found.left_m == pytest.approx([left_m])
    assert found.turn_rad == pytest.approx([turn_rad])
    assert found.half_along_m == pytest.approx([(5.0 * cos + 2.0 * sin) / 2.0])
    assert found.half_across_m == pytest.approx([(5.0 * sin + 2.0 * cos) / 2.0])


@pytest.mark.parametrize(("turn_deg", "same"), [(0, True), (59, True), (-59, True), (61, False), (-61, False)])
def test_sixty_degrees_off_the_line_is_another_way(straight_road: RoadNetwork, turn_deg: int, *, same: bool) -> None:
    assert placed(straight_road, 30.0, 0.0, np.radians(turn_deg)).same_way.tolist() == [same]
    assert placed(straight_road, 30.0, 0.0, np.radians(turn_deg + 360)).same_way.tolist() == [same]


def test_the_driven_line_ends_where_the_record_ends_and_goes_on_along_the_lane() -> None:
    record = record_of(arc((10.0, 4.0), (6.0, 0.1)), {})
    found = line_of(record)
    assert found.driven_m == pytest.approx(40.6)
    assert found.emv.arc_m == pytest.approx(np.append(np.arange(81) * 0.5, [40.3, 40.6]))
    assert (found.length_m, found.width_m) == (6.0, 2.1)
    # 41.6 to 99.6 m along the lane, then from 100 m across the junction.
    assert found.line.length_m > 40.6 + 45.0
    assert found.line.points[:, 0] == pytest.approx(np.full(len(found.line.points), 5.25))
    assert np.diff(found.line.arc_m).max() <= 1.0 + 1e-9, "a point for each metre"


def test_less_than_five_metres_are_no_line() -> None:
    assert EmvLine.of(record_of(arc((1.0, 4.9)), {})) is None
    assert line_of(record_of(arc((1.0, 5.1)), {})).driven_m == pytest.approx(5.1)


def test_what_the_pose_does_at_standstill_is_no_line(straight_road: RoadNetwork) -> None:
    """An EMV that stands, trembles by 5 mm and goes on does not turn its line round."""
    before = moving(20.0, -5.25, 10.0, steps=61).states
    still = np.tile(before[-1], (40, 1))
    still[:, 0] += 0.005 * (-1.0) ** np.arange(40)
    after = moving(50.5, -5.25, 10.0, steps=40).states
    record = record_with({1: Track(np.concatenate((before, still, after)), is_emv=True)}, straight_road)
    found = line_of(record)
    assert np.diff(found.line.points[:, 0]).min() > 0.0
    assert found.driven_m == pytest.approx(50.0)


def test_an_episode_needs_an_emv(straight_road: RoadNetwork) -> None:
    with pytest.raises(InputError, match="EMV"):
        EmvLine.of(record_with({1: moving(0.0, 0.0, 10.0)}, straight_road))
    with_emv = record_of(arc((10.0, 2.0)), {})
    unknown = replace(with_emv, description=replace(with_emv.description, emv_ids=(EMV + 7,)))
    with pytest.raises(InputError, match="EMV"):
        EmvLine.of(unknown)


def test_others_are_placed_while_the_emv_is_there() -> None:
    """The EMV is there at steps 0 to 100; the car comes at step 90."""
    way = line((1.75, -120.0), (1.75, 110.0))
    record = record_of(arc((10.0, 5.0)), {CAR: Driven(way, arc((2.0, 2.0), start_m=30.0), first_step=90)})
    found = line_of(record)
    car = found.place(record, CAR)
    assert car.track.step.tolist() == list(range(90, 101))
    assert car.left_m == pytest.approx(np.full(11, 3.5))
    assert car.arc_m == pytest.approx(30.0 + 0.1 * np.arange(11))
    assert car.half_along_m == pytest.approx(np.full(11, 2.0))
    assert car.half_across_m == pytest.approx(np.full(11, 0.9))
    emv = found.emv_at(car)
    assert emv.track.step.tolist() == list(range(90, 101))
    assert emv.arc_m == pytest.approx(45.0 + 0.5 * np.arange(11))
    chosen = car.select(car.track.step < 92)
    assert [len(chosen.track), len(chosen.arc_m), len(chosen.half_across_m)] == [2, 2, 2]
