"""The templates S1 and S8: queues that an EMV drives between, and the rescue lane."""

from dataclasses import replace
from pathlib import Path

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
from known_outputs import assert_known
from made_jam import AT_SIDE_M, CAR_WIDTH_M, EMV_WIDTH_M, LENGTH_M, TURN_RAD, WIDTH_M, at, jam, motorway
from told_verdicts import told_first

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

KNOWN = Path(__file__).parent / "known"
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


def _emvs(record: EpisodeRecord, *ids: int) -> EpisodeRecord:
    actors = {key: replace(actor, is_emv=key in ids) for key, actor in record.actors.items()}
    return replace(record, actors=actors, description=replace(record.description, emv_ids=ids))


def _held_for(steps: int) -> EpisodeRecord:
    mode = _modes()
    mode[40 + steps :] = Mode.REJOIN
    return _queues(mode=mode)


def test_verdicts_of_queues() -> None:
    """The line is at 100 m and the EMV 6 m long; its centre has to get over it, and to be 1 m off the line at most."""
    beyond = hand_made(NETWORK, {EMV: Driven(_northbound(LINE_X_M), at_speed(100.5, 7.0, 100))})
    cases = {
        "between two queues": _queues(),
        **{f"stands at {until_m} m": _queues(until_m=until_m) for until_m in (96.0, 99.9, 100.1)},
        **{f"a site of {name}": at_site(_queues(), name) for name in ("n_in", "none")},
        "begins beyond the line": at_site(beyond),
        **{f"{off_m} m off the line": _queues(LINE_X_M + off_m) for off_m in (0.95, -0.95, 1.05, -1.05)},
        "in the middle of their lanes": _queues(pulled_m=0.2),
        "creeping": _queues(speed_mps=1.0),
        "driving": _queues(speed_mps=3.0),
        "not yielding": _queues(mode=Mode.NOMINAL),
        **{f"held for {steps} steps": _held_for(steps) for steps in (19, 20)},
        "one lane alone": _queues(left=7, right=0),
        "one in the right lane": _queues(left=7, right=1),
        "five": _queues(left=3, right=2),
        "over a junction that nobody crosses": _with_the_queues_on_a_junction(turns_off=False),
        "over a junction": _with_the_queues_on_a_junction(turns_off=True),
        "without an EMV": _emvs(_queues()),
        "the second EMV stands in a queue": _emvs(_queues(), EMV, 12),
        "the first EMV stands in a queue": _emvs(_queues(), 12, EMV),
    }
    verdicts = {name: queues_split(record, THRESHOLDS) for name, record in cases.items()}
    assert_known(KNOWN / "queues.json", told_first(verdicts))


RESCUE = {"open_share_min": 0.95, "ahead_m": 90.0, "side_m": 0.2, "through_min_m": 100.0, "speed_min_mps": 5.0}
NEEDED_M = EMV_WIDTH_M + 0.4


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


def _late() -> EpisodeRecord:
    """Cars that make way 40 m before the EMV is there: what counts is the width before."""
    record = jam(0.0, 0.0)
    along_m, _ = Polyline.through([at(0.0, 0.0), at(LENGTH_M, 0.0)]).project(record.track(EMV).xy_m)

    def moved(state):
        x_m, y_m = state.x_m.copy(), state.y_m.copy()
        for row, (x, y) in enumerate(zip(x_m, y_m, strict=True)):
            place_m, left_m = x * np.cos(TURN_RAD) + y * np.sin(TURN_RAD), y * np.cos(TURN_RAD) - x * np.sin(TURN_RAD)
            if state.actor_id[row] != EMV and place_m - along_m[state.step] < 40.0:
                x_m[row], y_m[row] = at(place_m, left_m + (AT_SIDE_M if left_m > -1.0 else -AT_SIDE_M))
        return replace(state, x_m=x_m, y_m=y_m)

    return replace(record, states=tuple(map(moved, record.states)))


def test_verdicts_of_rescue_lanes() -> None:
    """The width is compared with the EMV's and 0.2 m to each side; 0.02 m to either side of a shoulder's edge."""
    wide_m, edge_m = 0.5 * (NEEDED_M - WIDTH_M + CAR_WIDTH_M), -1.5 * WIDTH_M + 0.5 * CAR_WIDTH_M
    on_shoulder = [jam(more=[(350.0, edge_m - ON_SHOULDER_M + more_m)]) for more_m in (0.02, -0.02)]
    record = jam()
    cases = {
        "open": (record, {}),
        "just open": (jam(wide_m + 0.01, -wide_m), {}),
        "just too narrow": (jam(wide_m - 0.01, -wide_m), {}),
        "opened late": (_late(), {}),
        "opened in time": (_late(), {"ahead_m": 20.0}),
        "just beside the shoulder": (on_shoulder[0], {}),
        "on the shoulder": (on_shoulder[1], {}),
        "in the middle": (jam(0.0, 0.0), {}),
        "a short way": (record, {"through_min_m": 300.0}),
        "slow": (jam(speed_mps=4.0), {}),
        "two EMVs": (_emvs(record, EMV, 2), {}),
        "one lane": (replace(record, network=motorway(1)), {}),
        "no site": (replace(record, description=replace(record.description, site={})), {}),
    }
    verdicts = {name: rescue_lane(record, {**RESCUE, **more}) for name, (record, more) in cases.items()}
    assert_known(KNOWN / "rescue_lanes.json", told_first(verdicts))
