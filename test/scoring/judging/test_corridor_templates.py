"""The templates S1 and S8: queues that an EMV drives between, and the rescue lane."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import (
    CAR_LENGTH_M,
    EMV,
    EMV_LENGTH_M,
    LEFT_X_M,
    RIGHT_X_M,
    Driven,
    at_speed,
    crossing,
    hand_made,
    line,
    without,
)
from made_jam import AT_SIDE_M, CAR_WIDTH_M, EMV_WIDTH_M, LENGTH_M, TURN_RAD, WIDTH_M, at, jam, motorway

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.tracks import places_of
from siren_ros.scoring.judging.corridor_templates import (
    BODY_M,
    ON_SHOULDER_M,
    Bodies,
    RoadView,
    bodies_at,
    find_holding,
    find_overtakings,
    free_width_m,
    queues_split,
    rescue_lane,
)
from siren_ros.simulation.roads.road_network import Connection, LaneKind
from siren_ros.simulation.world.actors import Mode

NETWORK = crossing()
THRESHOLDS = {"holding_min": 6, "overtaken_min": 6, "lateral_max_m": 1.0}
STEPS = 300
LINE_X_M = (LEFT_X_M + RIGHT_X_M) / 2.0
PULLED_M = 0.7
"""How far the vehicles of both queues stand off their lanes' centre lines, away from the line between them."""


def _northbound(x_m: float) -> np.ndarray:
    return line((x_m, -120.0), (x_m, 110.0))


def _modes(hold_from: int = 40) -> np.ndarray:
    return np.where(np.arange(STEPS) < hold_from, Mode.YIELD_PULL_OVER, Mode.YIELD_HOLD).astype(np.uint8)


def _queues(
    emv_x_m: float = LINE_X_M,
    left: int = 4,
    right: int = 4,
    speed_mps: float = 0.0,
    pulled_m: float = PULLED_M,
    mode: Mode | np.ndarray | None = None,
    until_m: float = np.inf,
) -> EpisodeRecord:
    """Vehicles in two lanes every 8 m from 30 m on; the EMV passes them at 7 m/s and crosses the line, or stands."""
    vehicles = {EMV: Driven(_northbound(emv_x_m), np.minimum(at_speed(5.12, 7.0, STEPS), until_m))}
    for count, x_m, first_id in ((left, LEFT_X_M - pulled_m, 10), (right, RIGHT_X_M + pulled_m, 20)):
        for number in range(count):
            places = at_speed(30.0 + 8.0 * number, speed_mps, STEPS)
            vehicles[first_id + number] = Driven(_northbound(x_m), places, _modes() if mode is None else mode)
    return at_site(hand_made(NETWORK, vehicles))


def at_site(record: EpisodeRecord, approach: str = "s_in") -> EpisodeRecord:
    return replace(record, description=replace(record.description, site={"stretch": ["w_in", approach]}))


def test_an_emv_that_stands_before_the_line_has_not_got_through():
    """The line is at 100 m and the EMV 6 m long: its centre has to get over it."""
    for until_m, crossed in ((96.0, 0), (99.9, 0), (100.1, 1)):
        verdict = queues_split(_queues(until_m=until_m), THRESHOLDS)
        assert verdict.measures()["crossed"] == crossed
        assert [part.name for part in verdict.failing] == ([] if crossed else ["crossed"])
        assert ("did not cross" in verdict.text) is not bool(crossed)


def test_only_the_line_of_the_site_counts():
    for approach in ("n_in", "none"):
        assert [part.name for part in queues_split(at_site(_queues(), approach), THRESHOLDS).failing] == ["crossed"]


def test_an_emv_that_begins_beyond_the_line_has_not_crossed_it():
    record = hand_made(NETWORK, {EMV: Driven(_northbound(LINE_X_M), at_speed(100.5, 7.0, 100))})
    assert queues_split(at_site(record), THRESHOLDS).measures()["crossed"] == 0.0


def test_passing_between_two_queues_that_hold():
    verdict = queues_split(_queues(), THRESHOLDS)
    assert verdict.holds
    assert verdict.measures() == {"holding": 8.0, "overtaken": 8.0, "shorter_queue": 4.0, "crossed": 1.0}
    assert verdict.parts[0].detail.startswith("10 at 2.0 s (+0.70 m)")
    assert verdict.parts[2].detail == "4 on the left, 4 on the right"
    passed = [int(np.ceil((30.0 + 8.0 * k - 5.12) / 0.35)) for k in range(4)]
    holding, overtaken, shorter, crossed = ([moment.step for moment in part.moments] for part in verdict.parts)
    assert holding == [40] * 8
    assert overtaken == sorted(2 * passed)
    assert shorter == passed
    assert [f"{EMV} at {0.05 * step:.1f} s" for step in crossed] == [verdict.parts[3].detail]


def test_overtakings_lie_where_the_centres_are_abreast():
    record = _queues(emv_x_m=LINE_X_M + 0.4)
    overtakings = find_overtakings(record, places_of(record, record.rows), EMV)
    assert [item.actor_id for item in overtakings] == [10, 20, 11, 21, 12, 22, 13, 23]
    for item in overtakings:
        assert item.step == int(np.ceil((30.0 + 8.0 * (item.actor_id % 10) - 5.12) / 0.35))
        assert item.lateral_m == pytest.approx(0.4)
        assert item.side == (1 if item.actor_id < 20 else -1)


def test_who_begins_abreast_or_ahead_of_a_vehicle_does_not_overtake_it():
    for begins_m, passed in ((30.0, [11, 12, 13]), (29.99, [10, 11, 12, 13]), (38.5, [12, 13])):
        emv = Driven(_northbound(LINE_X_M), at_speed(begins_m, 7.0, STEPS))
        queue = {10 + k: Driven(_northbound(LEFT_X_M), np.full(STEPS, 30.0 + 8.0 * k)) for k in range(4)}
        record = hand_made(NETWORK, {EMV: emv, **queue})
        overtakings = find_overtakings(record, places_of(record, record.rows), EMV)
        assert [item.actor_id for item in overtakings] == passed


@pytest.mark.parametrize(("off_m", "holds"), [(0.95, True), (-0.95, True), (1.05, False), (-1.05, False)])
def test_the_emv_has_to_be_within_a_metre_of_the_line(off_m, holds):
    verdict = queues_split(_queues(emv_x_m=LINE_X_M + off_m), THRESHOLDS)
    assert verdict.holds == holds
    if not holds:
        assert [part.name for part in verdict.failing] == ["overtaken", "shorter_queue"]
        assert "off the line: 10 at 3.6 s (1.05 m)" in verdict.failing[0].detail


def test_who_stands_in_the_middle_of_the_lane_has_not_pulled_over():
    verdict = queues_split(_queues(pulled_m=0.2), THRESHOLDS)
    assert [(part.name, part.value) for part in verdict.failing] == [("holding", 0.0)]
    assert verdict.failing[0].detail.startswith("not pulled over: 10 at 2.0 s (+0.20 m)")


@pytest.mark.parametrize("changed", [{"speed_mps": 1.0}, {"mode": Mode.NOMINAL}], ids=["creeping", "not yielding"])
def test_neither_the_mode_nor_standing_alone_is_a_hold(changed):
    assert [part.name for part in queues_split(_queues(**changed), THRESHOLDS).failing] == ["holding"]


def test_a_hold_has_to_last_a_second():
    for steps, count in ((19, 0), (20, 8)):
        mode = _modes()
        mode[40 + steps :] = Mode.REJOIN
        record = _queues(mode=mode)
        assert len(find_holding(record, places_of(record, record.rows))) == count


def held_at(*stays: tuple[float, int]) -> list[tuple[int, float]]:
    """Step and offset of what counts of a civilian that stands at arc lengths for some steps each, 10 m/s between.

    Its line lies on the lane's centre up to 30 m and 0.7 m to the right of it from 40 m on.
    """
    points = line((RIGHT_X_M, -120.0), (RIGHT_X_M, -90.0), (RIGHT_X_M + 0.7, -80.0), (RIGHT_X_M + 0.7, -20.0))
    arc_m = np.zeros(0)
    for place_m, steps in stays:
        start = arc_m[-1] if len(arc_m) else place_m
        arc_m = np.concatenate((arc_m, np.arange(start, place_m, 0.5), np.full(steps, place_m)))
    record = hand_made(NETWORK, {10: Driven(points, arc_m, Mode.YIELD_HOLD)})
    return [(item.step, round(item.offset_m, 2)) for item in find_holding(record, places_of(record, record.rows))]


def test_the_first_hold_pulled_over_counts_and_else_the_first_hold():
    assert held_at((10.0, 30), (25.0, 30)) == [(0, 0.0)]
    assert held_at((60.0, 30), (75.0, 30)) == [(0, -0.7)]
    ((step, offset_m),) = held_at((10.0, 30), (60.0, 30), (75.0, 30))
    assert offset_m == -0.7
    assert 125 < step < 135, "the second stay begins after 30 steps and 50 m at 0.5 m a step"
    assert held_at((10.0, 5), (60.0, 5)) == []


def test_vehicles_that_drive_are_no_queue():
    verdict = queues_split(_queues(speed_mps=3.0), THRESHOLDS)
    assert verdict.measures()["overtaken"] == 0.0
    assert queues_split(_queues(speed_mps=2.5), {**THRESHOLDS, "holding_min": 0}).measures()["overtaken"] > 5.0


@pytest.mark.parametrize(("left", "right", "failing"), [(7, 0, "shorter_queue"), (7, 1, "shorter_queue"), (3, 2, "")])
def test_both_lanes_need_a_queue(left, right, failing):
    verdict = queues_split(_queues(left=left, right=right), {**THRESHOLDS, "holding_min": 4, "overtaken_min": 4})
    assert [part.name for part in verdict.failing] == ([failing] if failing else [])
    if left + right == 5:
        few = queues_split(_queues(left=left, right=right), THRESHOLDS).failing
        assert [(part.name, part.value) for part in few] == [("holding", 5.0), ("overtaken", 5.0)]


def _with_the_queues_on_a_junction(*, turns_off: bool) -> EpisodeRecord:
    """The record, where the lanes of the queues are paths over a junction; one also leads elsewhere, if wanted."""
    record = _queues()
    by_name = record.network.lane_by_id
    right, left = by_name["s_in_1"].index, by_name["s_in_2"].index
    ends = [(by_name["p_in_0"], right, by_name["p_out_0"]), (by_name["w_in_0"], left, by_name["s_out_0"])]
    joints = [Connection(a.index, b.index, (via,), "s", None, -1, False, "K") for a, via, b in ends]
    if turns_off:
        joints += [replace(joint, to_lane=by_name["e_out_1"].index, via=(), direction="r") for joint in joints]
    lanes = [
        replace(lane, kind=LaneKind.INTERNAL) if lane.index in (left, right) else lane for lane in record.network.lanes
    ]
    return replace(record, network=replace(record.network, lanes=tuple(lanes), connections=tuple(joints)))


def test_a_junction_that_nobody_crosses_is_part_of_the_road():
    verdict = queues_split(_with_the_queues_on_a_junction(turns_off=False), THRESHOLDS)
    assert verdict.holds
    verdict = queues_split(_with_the_queues_on_a_junction(turns_off=True), THRESHOLDS)
    assert verdict.measures()["overtaken"] == 0.0


def test_an_episode_without_an_emv_has_no_verdict_that_holds():
    record = _queues()
    actors = {key: replace(actor, is_emv=False) for key, actor in record.actors.items()}
    alone = replace(record, actors=actors, description=replace(record.description, emv_ids=()))
    assert not queues_split(alone, {**THRESHOLDS, "overtaken_min": 1}).holds


def test_a_hold_is_of_one_vehicle_and_without_a_gap_in_the_record():
    """One civilian is away for a step; another one's record begins where the first one's ends."""
    points = _northbound(RIGHT_X_M + PULLED_M)
    vehicles = {
        10: Driven(points, np.full(12, 40.0), Mode.YIELD_HOLD),
        11: Driven(points, np.full(12, 60.0), Mode.YIELD_HOLD, first_step=12),
        12: Driven(points, np.full(40, 80.0), Mode.YIELD_HOLD),
    }
    record = hand_made(NETWORK, vehicles)
    for changed, held in ((record, [(12, 0)]), (without(record, 12, lambda step: step == 15), [(12, 16)])):
        holdings = find_holding(changed, places_of(changed, changed.rows))
        assert [(item.actor_id, item.step) for item in holdings] == held


@pytest.mark.parametrize(("offset_m", "pulled"), [(0.29, False), (0.31, True), (-0.29, False), (-0.31, True)])
def test_pulled_over_is_0_3_m_off_the_middle_to_either_side(offset_m, pulled):
    vehicles = {10: Driven(_northbound(RIGHT_X_M + offset_m), np.full(30, 40.0), Mode.YIELD_HOLD)}
    record = hand_made(NETWORK, vehicles)
    (held,) = find_holding(record, places_of(record, record.rows))
    assert held.pulled_over is pulled


def test_of_two_emvs_the_first_one_counts_and_neither_is_overtaken_as_a_civilian():
    """One passes between the queues; the other one stands far from the line, and the first passes it."""
    queues = _queues().actors.keys() - {EMV}
    drives = {EMV: Driven(_northbound(LINE_X_M), at_speed(5.12, 7.0, STEPS))}
    drives[2] = Driven(_northbound(LEFT_X_M - 1.5), np.full(STEPS, 45.0))
    for key in queues:
        x_m = LEFT_X_M - PULLED_M if key < 20 else RIGHT_X_M + PULLED_M
        drives[key] = Driven(_northbound(x_m), np.full(STEPS, 30.0 + 8.0 * (key % 10)), _modes())
    record = at_site(hand_made(NETWORK, drives))
    actors = {**record.actors, 2: replace(record.actors[2], is_emv=True)}
    for ids, holds, overtaken in (((EMV, 2), True, 8.0), ((2, EMV), False, 0.0)):
        changed = replace(record, actors=actors, description=replace(record.description, emv_ids=ids))
        verdict = queues_split(changed, THRESHOLDS)
        assert verdict.holds is holds
        assert verdict.measures()["overtaken"] == overtaken


RESCUE = {"open_share_min": 0.95, "ahead_m": 90.0, "side_m": 0.2, "through_min_m": 100.0, "speed_min_mps": 5.0}
NEEDED_M = EMV_WIDTH_M + 0.4


def test_an_open_lane_that_the_emv_drives_through_holds():
    verdict = rescue_lane(jam(), RESCUE)
    assert verdict.holds
    measures = verdict.measures()
    assert measures["open_share"] == 1.0
    assert measures["speed_mps"] == pytest.approx(8.0, abs=0.01)
    # The jam is 156 m between the first and the last car; 15 m, half a car and half a second on both sides count too.
    assert measures["through_m"] == pytest.approx(152.0 + 30.0 + CAR_LENGTH_M, abs=4.0)
    free_m = WIDTH_M + 2.0 * AT_SIDE_M - CAR_WIDTH_M
    assert f"narrowest {free_m:.2f} m" in verdict.parts[0].detail
    through, out = verdict.parts[1].decisive.step, verdict.parts[2].decisive.step
    assert (out - through) * 0.05 == pytest.approx((measures["through_m"] - 100.0) / 8.0, abs=0.5)


def test_the_free_width_is_compared_with_the_emvs_and_the_margins():
    offset_m = 0.5 * (NEEDED_M - WIDTH_M + CAR_WIDTH_M)
    assert rescue_lane(jam(offset_m + 0.01, -offset_m), RESCUE).measures()["open_share"] == 1.0
    assert rescue_lane(jam(offset_m - 0.01, -offset_m), RESCUE).measures()["open_share"] < 0.3


def test_what_counts_is_the_width_before_the_emv_comes():
    """Cars that make way for the siren, 40 m before the EMV is there, are too late."""
    record = jam(0.0, 0.0)
    emv = record.track(EMV)
    along_m, _ = Polyline.through([at(0.0, 0.0), at(LENGTH_M, 0.0)]).project(emv.xy_m)

    def moved(state):
        x_m, y_m = state.x_m.copy(), state.y_m.copy()
        for row, (x, y) in enumerate(zip(x_m, y_m, strict=True)):
            place_m, left_m = x * np.cos(TURN_RAD) + y * np.sin(TURN_RAD), y * np.cos(TURN_RAD) - x * np.sin(TURN_RAD)
            if state.actor_id[row] != EMV and place_m - along_m[state.step] < 40.0:
                x_m[row], y_m[row] = at(place_m, left_m + (AT_SIDE_M if left_m > -1.0 else -AT_SIDE_M))
        return replace(state, x_m=x_m, y_m=y_m)

    late = replace(record, states=tuple(map(moved, record.states)))
    assert [part.name for part in rescue_lane(late, RESCUE).failing] == ["open_share"]
    assert rescue_lane(late, {**RESCUE, "ahead_m": 20.0}).holds


@pytest.mark.parametrize(("beyond_m", "counted"), [(ON_SHOULDER_M - 0.02, 0), (ON_SHOULDER_M + 0.02, 1)])
def test_nobody_stands_on_the_hard_shoulder(beyond_m, counted):
    edge_m = -1.5 * WIDTH_M
    verdict = rescue_lane(jam(more=[(350.0, edge_m - beyond_m + 0.5 * CAR_WIDTH_M)]), RESCUE)
    assert verdict.measures()["on_shoulder"] == counted
    assert verdict.holds == (counted == 0)
    assert [moment.step for moment in verdict.parts[3].moments] == [0] * counted


@pytest.mark.parametrize(
    ("record", "changed", "failing"),
    [
        (jam(0.0, 0.0), {}, "open_share"),
        (jam(), {"through_min_m": 300.0}, "through_m"),
        (jam(speed_mps=4.0), {}, "speed_mps"),
    ],
)
def test_cars_in_the_middle_a_short_way_and_a_slow_one_do_not_hold(record, changed, failing):
    assert [part.name for part in rescue_lane(record, {**RESCUE, **changed}).failing] == [failing]


def test_every_emv_has_to_get_through():
    record = jam()
    second = replace(record.actors[2], is_emv=True)
    description = replace(record.description, emv_ids=(EMV, 2))
    both = replace(record, actors={**record.actors, 2: second}, description=description)
    assert rescue_lane(record, RESCUE).holds
    assert "EMV 2 drove 0 m" in rescue_lane(both, RESCUE).text


def test_a_road_without_a_right_neighbour_has_no_rescue_lane():
    record = jam()
    one = replace(record, network=motorway(1))
    assert not rescue_lane(one, RESCUE).holds
    nowhere = replace(record, description=replace(record.description, site={}))
    assert not rescue_lane(nowhere, RESCUE).holds


def test_cars_near_a_place_narrow_it_and_others_do_not():
    line = Polyline.through([(0.0, 0.0), (100.0, 0.0)])
    road = RoadView(line, -0.5 * WIDTH_M, -1.5 * WIDTH_M, ())
    ids, zero = np.array([2, 3], np.uint32), np.zeros(2)
    left = np.array([1.5, -3.0])
    bodies = Bodies(ids, np.array([10.0, 30.0]), np.array([14.0, 34.0]), left - 0.9, left + 0.9, zero)
    before, inside, between, after = free_width_m(
        bodies, np.array([10.0 - BODY_M - 0.1, 12.0, 22.0, 34.0 + BODY_M + 0.1]), road
    )
    assert np.isinf([before, inside, between, after]).all(), "one side alone narrows nothing"
    close = replace(bodies, from_m=np.array([10.0, 16.0]), to_m=np.array([14.0, 20.0]))
    assert free_width_m(close, np.array([15.0]), road)[0] == pytest.approx(0.6 + 2.1)


def test_bodies_are_those_of_civilians_on_this_road():
    record = jam(more=[(350.0, 12.0), (350.0, -40.0)])
    road = RoadView(
        Polyline.through([at(0.0, 0.0), at(LENGTH_M, 0.0)]), -0.5 * WIDTH_M, -1.5 * WIDTH_M, ((0.0, LENGTH_M),)
    )
    bodies = bodies_at(record, road, 0)
    assert bodies.actor_id.tolist() == list(range(2, 42))
    assert bodies.to_m - bodies.from_m == pytest.approx(CAR_LENGTH_M)
    assert bodies.left_m - bodies.right_m == pytest.approx(CAR_WIDTH_M)
    assert EMV_LENGTH_M > CAR_LENGTH_M
