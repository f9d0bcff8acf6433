"""Encounters along the line of the EMV, and the corridor ahead of it."""

from dataclasses import replace

import numpy as np
import pytest
from evaluation.made_records import Track, moving, record_with
from hand_made_record import EMV, IN_TURN_LANE, Driven, crossing, hand_made, line
from made_encounters import CAR, IN_LANE, arc, encounters_in, line_of, record_of
from shapely import Polygon, contains_xy, points

from siren_ros.base.numerics.arrays import Points
from siren_ros.base.numerics.geometry import Polyline, footprint_corners
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.yielding.encounters import (
    REACH_M,
    CorridorSeries,
    EmvLine,
    LaneOffsets,
    OnLine,
    YieldThresholds,
    corridor_continuity,
    corridor_series,
    corridor_width_m,
    covered_cells,
    lane_offsets,
    on_line,
    road_cells,
    way_ahead,
    widest_way_m,
)
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.actors import ActorClass, Lights

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


@pytest.mark.parametrize(
    ("end_y_m", "left_m"),
    [(105.0, [106.0, 107.0, 108.0, 109.0]), (107.5, [108.5, 109.5]), (108.5, list(np.arange(109.5, 152.6)))],
)
def test_on_to_the_end_of_the_road_where_there_are_two_places(end_y_m: float, left_m: list[float]) -> None:
    """The road ends at 110 m; one place is no way, and the vehicle goes straight on."""
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
@pytest.mark.parametrize("turn_rad", [0.0, -np.pi / 6.0, np.pi / 2.0, 2.5])
def test_place_and_extent_of_a_turned_body(straight_road: RoadNetwork, left_m: float, turn_rad: float) -> None:
    found = placed(straight_road, 30.0, left_m, turn_rad)
    cos, sin = abs(np.cos(turn_rad)), abs(np.sin(turn_rad))
    assert found.arc_m == pytest.approx([30.0])
    assert found.left_m == pytest.approx([left_m])
    assert found.turn_rad == pytest.approx([turn_rad])
    assert found.half_along_m == pytest.approx([(5.0 * cos + 2.0 * sin) / 2.0])
    assert found.half_across_m == pytest.approx([(5.0 * sin + 2.0 * cos) / 2.0])
    for turn_deg, same in ((0, True), (59, True), (-59, True), (61, False), (-61, False), (419, True)):
        assert placed(straight_road, 30.0, left_m, np.radians(turn_deg)).same_way.tolist() == [same]


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


def offsets_along(way: Points, speed_mps: float) -> tuple[StateRows, LaneOffsets]:
    """Track and offsets of a car on a way, for ten seconds."""
    record = record_of(arc((1.0, 10.0)), {CAR: Driven(way, arc((speed_mps, 10.0)))})
    return record.track(CAR), lane_offsets(record, record.track(CAR))


def test_a_lane_change_is_one_way_across_the_road() -> None:
    _, offsets = offsets_along(line((5.25, -120.0), (5.25, -80.0), (1.75, -60.0), (1.75, 110.0)), 22.0)
    assert offsets.lateral_m[-1] == pytest.approx(3.5, abs=1e-6)
    assert np.abs(offsets.offset_m).max() == pytest.approx(1.75, abs=0.1)
    assert np.abs(np.diff(offsets.lateral_m)).max() < 0.2, "no jump from lane to lane, nor across the junction"


@pytest.mark.parametrize(
    ("way", "offset_m", "lateral_m"),
    [
        ([(5.25, -120.0), (5.25, -80.0), (12.0, -60.0), (12.0, -30.0)], (0.0, -3.75), (0.0, -6.75)),
        ([(1.25, -120.0), (1.25, -90.0), (5.25, -60.0), (5.25, -30.0)], (0.5, 0.0), (0.0, -4.0)),
    ],
    ids=["beyond the lanes the last one counts", "to the right lane, measured from the first state"],
)
def test_ends_of_a_way_across_the_lanes(way, offset_m, lateral_m) -> None:
    _, offsets = offsets_along(line(*way), 8.0)
    assert offsets.offset_m[[0, -1]] == pytest.approx(offset_m, abs=1e-6)
    assert offsets.lateral_m[[0, -1]] == pytest.approx(lateral_m, abs=1e-6)


def test_to_the_left_and_back_is_no_way_and_each_change_is_one() -> None:
    """From the right lane by 3.5 m to the left one, and back again; some of the states keep their ways."""
    weaves = line((5.25, -120.0), (5.25, -100.0), (1.75, -80.0), (1.75, -60.0), (5.25, -40.0), (5.25, -25.0))
    track, offsets = offsets_along(weaves, 9.0)
    assert offsets.lateral_m == pytest.approx(5.25 - track.x_m)
    assert offsets.lateral_m.max() == pytest.approx(3.5)
    assert offsets.lateral_m[-1] == pytest.approx(0.0, abs=1e-6)
    near = np.where(track.x_m > 3.5, 5.25, 1.75) - track.x_m
    clear = np.abs(track.x_m - 3.5) > 0.2
    assert offsets.offset_m[clear] == pytest.approx(near[clear])
    late = offsets.select(track.y_m > -60.0)
    assert late.lateral_m == pytest.approx(5.25 - track.x_m[track.y_m > -60.0])
    assert len(late.offset_m) == len(late.lateral_m)


def test_a_change_with_the_second_state() -> None:
    """The lanes meet at 3.5 m."""
    track, offsets = offsets_along(line((3.502, -120.0), (1.75, -90.0)), 2.0)
    assert track.x_m[0] > 3.5 > track.x_m[1]
    assert offsets.lateral_m == pytest.approx(3.502 - track.x_m)
    assert offsets.offset_m[[0, 1]] == pytest.approx([5.25 - track.x_m[0], 1.75 - track.x_m[1]])


BODIES_M = 5.0
"""Half of the EMV's 6 m and half of the car's 4 m."""


def standing(aside_m: float, at_m: float = 60.0, time_s: float = 12.0) -> Driven:
    """A car that stands to the left of the EMV's line."""
    return Driven(IN_LANE - np.array([aside_m, 0.0]), arc((0.0, time_s), start_m=at_m))


@pytest.mark.parametrize(("aside_m", "met"), [(6.9, True), (-6.9, True), (7.1, False), (-7.1, False)])
def test_two_lanes_aside_is_too_far(aside_m: float, *, met: bool) -> None:
    assert bool(encounters_in(record_of(arc((10.0, 12.0)), {CAR: standing(aside_m)}))) is met


def test_rows_from_forty_metres_until_the_passing() -> None:
    """The EMV's centre is at 0.5 m for each step; the car's at 60 m."""
    (one,) = encounters_in(record_of(arc((10.0, 12.0)), {CAR: standing(3.0)}))
    assert one.driver.track.step[0] == (60 - 40 - BODIES_M) / 0.5
    assert one.gap_m[0] == pytest.approx(40.0)
    assert np.diff(one.gap_m) == pytest.approx(np.full(len(one.gap_m) - 1, -0.5))
    # Passed when the EMV's centre is more than 5 m ahead.
    assert one.driver.track.step[one.passed_row] == (60 + BODIES_M) / 0.5 + 1
    assert one.until_passed == slice(0, one.passed_row)
    assert len(one.emv.track) == len(one.gap_m) == len(one.in_the_way) == len(one.offsets.lateral_m)
    (ahead,) = encounters_in(record_of(arc((10.0, 6.0)), {CAR: standing(3.0, time_s=6.0)}))
    assert (ahead.passed_row, ahead.until_passed) == (-1, slice(0, None)), "until the end"


@pytest.mark.parametrize(("aside_m", "inside"), [(1.9, True), (-1.9, True), (2.0, False), (-2.0, False)])
def test_the_strip_is_as_wide_as_the_emv(aside_m: float, *, inside: bool) -> None:
    """1.05 m of the EMV and 0.9 m of the car."""
    (one,) = encounters_in(record_of(arc((10.0, 12.0)), {CAR: standing(aside_m)}))
    assert one.was_in_the_way is inside
    assert one.in_the_way.all() == inside


@pytest.mark.parametrize(("at_m", "inside"), [(19.9 + 40.0, True), (20.1 + 40.0, False)])
def test_the_strip_goes_on_fifteen_metres_beyond_the_emv(at_m: float, *, inside: bool) -> None:
    """The EMV's record ends at 40 m, its front at 43 m; the car's rear is 2 m behind its centre."""
    (one,) = encounters_in(record_of(arc((10.0, 4.0)), {CAR: standing(0.0, at_m=at_m, time_s=4.0)}))
    assert one.was_in_the_way is inside


@pytest.mark.parametrize("first_step", [0, 60])
def test_the_siren_counts_as_the_encounter_begins(first_step: int) -> None:
    """It begins at step 30; the siren sounds from a step on."""
    record = record_of(arc((10.0, 12.0)), {CAR: standing(0.0)}, siren=False)
    states = []
    for state in record.states:
        on = (state.actor_id == EMV) & (state.step >= first_step)
        lights = np.where(on, int(Lights.SIREN | Lights.BEACON), int(Lights.BRAKE)).astype(np.uint8)
        states.append(replace(state, lights=lights))
    (one,) = encounters_in(replace(record, states=tuple(states)))
    assert one.with_siren is (first_step == 0)


def test_a_car_that_comes_from_behind_or_is_gone_before_the_emv_comes_is_not_met() -> None:
    """It overtakes the EMV within 40 m: from then on it is ahead, and the encounter begins there."""
    overtakes = Driven(line((1.75, -120.0), (1.75, 110.0)), arc((20.0, 9.0), start_m=0.0))
    (one,) = encounters_in(record_of(arc((5.0, 9.0)) + 20.0, {CAR: overtakes}))
    # 20 + 5 t + 5 = 20 t
    assert one.driver.track.time_s[0] == pytest.approx(25.0 / 15.0, abs=0.051)
    assert one.passed_row == -1
    gone = Driven(IN_LANE, arc((0.0, 2.0), start_m=50.0), first_step=100)
    assert encounters_in(record_of(arc((10.0, 3.0)), {CAR: gone})) == []


@pytest.mark.parametrize(
    ("kind", "met"), [(ActorClass.PEDESTRIAN, False), (ActorClass.BICYCLE, False), (ActorClass.MOTORCYCLE, True)]
)
def test_each_driver_is_met_once_and_those_who_do_not_make_way_are_none(kind: ActorClass, *, met: bool) -> None:
    record = record_of(arc((10.0, 12.0)), {CAR: standing(3.0), CAR + 1: standing(0.0, at_m=90.0)})
    record = replace(record, actors={**record.actors, CAR: replace(record.actors[CAR], actor_class=kind)})
    assert [one.actor_id for one in encounters_in(record)] == [CAR] * met + [CAR + 1]


ACROSS = np.arange(-10.0, 10.05, 0.1)
LIMITS = YieldThresholds()


def road(low_m: float, high_m: float, stations: int = 31) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    return np.tile((low_m < ACROSS) & (high_m > ACROSS), (stations, 1))


def series_of(record: EpisodeRecord) -> CorridorSeries:
    return corridor_series(record, line_of(record), LIMITS)


@pytest.fixture(scope="module")
def empty_road() -> tuple[RoadNetwork, EmvLine]:
    record = record_of(arc((10.0, 12.0)), {})
    return record.network, line_of(record)


def test_the_narrowest_place_counts() -> None:
    free = road(-4.05, 4.05)
    free[12, np.abs(ACROSS) > 1.05] = False
    assert widest_way_m(free, 0.0) == pytest.approx(2.1, abs=0.2)


def test_gaps_side_by_side_do_not_make_a_way() -> None:
    for second, wide in ((12, False), (30, True)):
        free = road(-4.05, 4.05)
        free[10, ACROSS > -2.0] = False
        free[second, ACROSS < 2.0] = False
        width_m = widest_way_m(free, 0.0)
        assert width_m > 1.5 if wide else width_m == 0.0, "with 20 m between them there is time to change sides"


def test_the_road_has_its_lanes_and_its_shoulder_from_its_beginning_to_its_end(
    empty_road: tuple[RoadNetwork, EmvLine],
) -> None:
    network, line = empty_road
    first, second, middle, last = road_cells(network, line, np.array([0.0, 0.3, 50.0, line.line.length_m]))
    # The shoulder ends 4.25 m to the right; the road of its own begins 7 m to the right.
    assert ACROSS[middle].min() == pytest.approx(-4.25, abs=0.15)
    assert ACROSS[middle].max() == pytest.approx(5.25, abs=0.15)
    assert first.tolist() == second.tolist()
    assert [first.sum(), middle.sum()] == pytest.approx([95, 95], abs=3)
    assert last.any()


@pytest.mark.parametrize("aside_m", [[0.0], [2.6, 0.3, -2.0, -4.3], []])
def test_cars_in_the_road_leave_the_rest_of_it(aside_m: list[float]) -> None:
    """The road is 3.5 + 3.5 + 2.5 m wide; the way to the left of the one car is 5.25 − 0.9 m; four close the road."""
    ways = [IN_LANE + np.array([to_the_right_m, 0.0]) for to_the_right_m in aside_m]
    cars = {CAR + place: Driven(way, arc((0.0, 12.0), start_m=60.0)) for place, way in enumerate(ways)}
    series = series_of(record_of(arc((10.0, 12.0)), cars))
    ahead = series.contested & (series.step < 100)
    assert ahead.any() == bool(aside_m)
    if len(aside_m) == 1:
        assert series.width_m[ahead].min() == pytest.approx(4.35, abs=0.3)
        assert series.passable[ahead & (series.step < 60)].all()
    elif aside_m:
        assert not series.passable[ahead].any()
    else:
        assert corridor_width_m(series).lack
        assert corridor_continuity(series).lack


def test_the_way_narrows_on_its_nearer_side() -> None:
    """Free from −1 to 4 m: around 0 m the nearest edge is 1 m away; around 1.5 m, 2.5 m."""
    free = road(-1.05, 4.05)
    assert widest_way_m(free[:1], 0.0) == pytest.approx(2 * 1.4, abs=0.15)
    assert widest_way_m(free[:1], 3.5) == pytest.approx(2 * 0.8, abs=0.15)
    assert widest_way_m(free[:5], 0.0) == pytest.approx(2 * 1.4, abs=0.15), "no wider than where it begins"


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_the_way_changes_sides_by_three_tenths_of_a_metre_per_metre(mirror: float) -> None:
    """Right of −1 m before a gate, left of 1 m behind it: 2 m and the way's own width aside."""
    free = road(-4.05, 4.05)
    free[:10, ACROSS * mirror > -1.0] = False
    free[16:, ACROSS * mirror < 1.0] = False
    # From −2 − w/2 to 2 … seven steps of 0.3 m carry a way of no width from −1 to 1.1 m.
    assert 0.0 < widest_way_m(free, -1.5 * mirror) < 0.5
    free[12:, ACROSS * mirror < 1.0] = False
    assert widest_way_m(free, -1.5 * mirror) == 0.0


def test_nothing_is_free_where_the_emv_is() -> None:
    free = road(-4.05, 4.05)
    free[0, np.abs(ACROSS - 2.0) < 0.5] = False
    assert widest_way_m(free, 2.0) == 0.0
    assert widest_way_m(free, -2.0) > 0.0


def test_a_turned_car_takes_its_width_where_it_is() -> None:
    """A car of 4 m across the road, 3 m to the left of the line; half a metre more, as stations are 1 m apart."""
    across = Driven(np.array([(0.25, -60.0), (4.25, -60.0)]), arc((0.0, 12.0), start_m=2.0))
    series = series_of(record_of(arc((10.0, 12.0)), {CAR: across}))
    near = series.contested & (series.step < 90)
    # Its right end is 0.5 m to the left of the line: the road ends 4.25 m to the right.
    assert near.any()
    assert series.width_m[near].min() == pytest.approx(4.25 + 0.5, abs=0.25)


def test_the_corridor_is_measured_every_half_second_thirty_metres_ahead() -> None:
    """A car whose rear is 60 m after the start; the EMV's front is 3 m ahead of its centre at 0.5 m per step."""
    record = record_of(arc((10.0, 12.0)), {CAR: Driven(IN_LANE, arc((0.0, 12.0), start_m=62.5))})
    series = series_of(record)
    assert set(np.diff(series.step)) == {10}
    assert series.step[0] == 0
    first = series.step[series.contested][0]
    assert 3.0 + 0.5 * first + 30.0 >= 60.0 > 3.0 + 0.5 * (first - 10) + 30.0
    last = series.step[series.contested][-1]
    assert 3.0 + 0.5 * last <= 65.0 < 3.0 + 0.5 * (last + 10)
    assert series.needed_m == pytest.approx(2.1 + 2 * 0.2)


def test_share_and_median_are_of_the_contested_times() -> None:
    series = CorridorSeries(
        np.arange(5), np.array([2.0, 2.6, 9.0, 2.4, 4.0]), np.array([True, True, False, True, True]), 2.5
    )
    assert corridor_width_m(series).value == pytest.approx(2.5)
    assert corridor_continuity(series).value == pytest.approx(0.5)


@pytest.mark.parametrize(("start_m", "last"), [(1.5, 380), (0.5, 390)])
def test_the_corridor_is_measured_while_the_line_goes_on_for_all_of_the_look_ahead(start_m: float, last: int) -> None:
    """The line ends at 109 m, 227.5 m or 228.5 m after its start: from 195 m on, 3 m and 30 m ahead are 228 m."""
    record = record_of(arc((10.0, 22.0 - 0.1 * start_m), start_m=start_m), {})
    line = line_of(record)
    assert line.line.length_m == pytest.approx(229.0 - start_m)
    assert corridor_series(record, line, LIMITS).step[-1] == last


@pytest.mark.parametrize(
    ("turn_deg", "arc_m", "left_m"), [(0.0, 12.0, 1.5), (25.0, 9.5, -2.2), (-40.0, 12.0, 1.5), (135.0, 9.5, -2.2)]
)
def test_a_body_covers_the_cells_of_its_turned_rectangle(turn_deg: float, arc_m: float, left_m: float) -> None:
    """A body of 4.6 m by 1.8 m, half a metre longer at each end: stations are 1 m apart."""
    turn = np.radians(turn_deg)
    track = record_of(arc((10.0, 1.0)), {}).track(1).select(np.arange(21) == 0)
    numbers = (np.array([value]) for value in (arc_m, left_m, turn, 2.0, 1.0))
    other = OnLine(track, *numbers)
    stations = np.arange(0.0, 25.0, 1.0)
    found = covered_cells(other, 0, (4.6, 1.8), stations)
    corners = footprint_corners(*(np.array([value]) for value in (arc_m, left_m, turn, 5.6, 1.8)))[0]
    body = Polygon(corners)
    along, across = np.meshgrid(stations, ACROSS, indexing="ij")
    clear = body.exterior.distance(points(along, across)) > 1e-6
    assert np.array_equal(found[clear], contains_xy(body, along, across)[clear])
    assert found.sum() > 10


def test_where_everything_is_free_the_way_is_as_wide_as_the_search() -> None:
    """10 m to each side, and the cells at their ends."""
    free = np.ones((5, len(ACROSS)), dtype=np.bool_)
    assert widest_way_m(free, 0.0) == pytest.approx(20.1)
    # From 8.95 m the way begins up to 0.3 m nearer to the middle, at 8.7 m: 14 cells from the end.
    assert widest_way_m(free[:1], 8.95) == pytest.approx(2.7)
    assert widest_way_m(free[:1], -8.95) == pytest.approx(2.7)


def test_the_order_of_lanes_does_not_matter(empty_road: tuple[RoadNetwork, EmvLine]) -> None:
    network, line = empty_road
    places = np.arange(0.0, 140.0, 5.0)
    expected = road_cells(network, line, places)
    for first in range(len(network.lanes)):
        turned = replace(network, lanes=network.lanes[first:] + network.lanes[:first])
        assert np.array_equal(road_cells(turned, line, places), expected)


def test_a_lane_reaches_half_a_metre_beyond_its_ends(empty_road: tuple[RoadNetwork, EmvLine]) -> None:
    """The EMV's lane ends 100 m after its start; it is as wide as it is, up to the edge of the search."""
    network, line = empty_road
    (lane,) = (lane for lane in network.lanes if lane.lane_id == "s_in_1")
    alone = replace(network, lanes=(lane,))
    cells = road_cells(alone, line, np.array([0.0, 50.0, 99.0, 99.8, 100.3, 100.7]))
    assert cells.any(axis=1).tolist() == [True] * 5 + [False]
    assert ACROSS[cells[1]] == pytest.approx(np.arange(-1.8, 1.85, 0.1))
    wide = replace(alone, lanes=(replace(lane, width_m=30.0),))
    assert road_cells(wide, line, np.array([50.0])).all()
