"""Templates S3 to S7. The stop line is at 100 m, and the EMV's front is 3 m ahead of its centre."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import (
    BESIDE,
    CAR_LENGTH_M,
    EAST,
    EASTBOUND,
    EMV,
    EMV_LENGTH_M,
    IN_TURN_LANE,
    LEFT_X_M,
    NORTHBOUND,
    ON_SHOULDER,
    PARALLEL,
    RIGHT,
    RIGHT_X_M,
    SHOULDER_TURN,
    SHOULDER_X_M,
    SOUTH,
    SOUTHBOUND,
    STRAIGHT,
    Driven,
    at_speed,
    crossing,
    hand_made,
    line,
)

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.scoring.judging.junction_templates import (
    APPROACH_M,
    is_same_direction,
    least_free_speed_mps,
    on_shoulder_area,
    red_crossing,
    red_same_direction,
    shoulder_turn,
    stop_crossing,
    stop_same_direction,
    times_text,
    turned_right_rad,
)
from siren_ros.scoring.judging.traversals import find_traversals
from siren_ros.scoring.judging.verdict import Moment, Verdict
from siren_ros.simulation.roads.road_network import Edge, JunctionKind, LaneKind

LINE_M = 100.0 - EMV_LENGTH_M / 2.0
"""Where the EMV's centre is as its front passes the line."""
LEFT_LANE = line((LEFT_X_M, -120.0), (LEFT_X_M, 110.0))
"""The driving lane next to the EMV's."""
SIGNAL, STOP = crossing(), crossing(JunctionKind.PRIORITY_STOP)
STOP_THRESHOLDS = {"speed_min_mps": 2.0}
EMV_DRIVE = Driven(NORTHBOUND, at_speed(70.0, 10.0, 200))
"""Front at the line after 2.7 s, rear out of the junction after 6.3 s."""
INSIDE = at_speed(92.0, 5.0, 200)
"""Centre in the junction from 1.6 s to 7.6 s."""
BEFORE = at_speed(114.0, 10.0, 200)
"""Centre out of the junction at 1.6 s."""
AT_THE_LINE = np.full(200, 97.0)
"""Stands at the line."""
THRESHOLDS = {"shoulder_min_s": 2.0}


def profile(*parts):
    """Arc lengths for pieces of (way, speed)."""
    arc = [40.0]
    for way, speed in parts:
        count = round(way / (speed * 0.05))
        arc.extend(arc[-1] + speed * 0.05 * (np.arange(count) + 1))
    return np.array(arc)


def least(arc_m, others=None):
    record = hand_made(STOP, {EMV: Driven(NORTHBOUND, arc_m), **(others or {})})
    (traversal,) = [item for item in find_traversals(record) if item.actor_id == EMV]
    return least_free_speed_mps(record, traversal)


@pytest.mark.parametrize(("slow_from_m", "expected"), [(40.0, 8.0), (50.0, 2.0)])
def test_only_the_last_15_m_count(slow_from_m, expected):
    """Slow for 5 m, from 27 m or from 17 m before the line on."""
    arc = profile((slow_from_m - 10.0, 8.0), (5.0, 2.0), (80.0, 8.0))
    assert least(arc) == pytest.approx(expected, abs=0.05)
    assert APPROACH_M == 15.0


def test_the_speed_at_the_line_counts_where_it_is_the_least():
    """It brakes evenly over the line."""
    time = 0.05 * np.arange(140)
    arc = 60.0 + 10.0 * time - 0.5 * time**2
    at_line = np.sqrt(10.0**2 - 2.0 * (LINE_M - 60.0))
    assert least(arc) == pytest.approx(at_line, abs=0.06)


def standing(arc_m, points=NORTHBOUND, steps=400):
    return {2: Driven(points, np.full(steps, arc_m))}


def test_who_stands_behind_somebody_in_its_lane_has_not_stopped_for_the_line():
    """Somebody whose rear is before the line is ahead; who is past it, in another lane or behind is not."""
    arc = profile((45.0, 5.0), (10.0, 1.0), (60.0, 5.0))
    assert least(arc) == pytest.approx(1.0, abs=0.05)
    assert least(arc, standing(100.0 + CAR_LENGTH_M / 2.0 - 0.2)) == pytest.approx(5.0, abs=0.1)
    assert least(arc, standing(100.0 + CAR_LENGTH_M / 2.0 + 0.2)) == pytest.approx(1.0, abs=0.05)
    for points in (PARALLEL, LEFT_LANE):
        assert least(arc, standing(98.0, points)) == pytest.approx(1.0, abs=0.05)
    aside = line((5.25 + 1.7, -120.0), (5.25 + 1.7, 110.0))
    assert least(arc, standing(98.0, aside)) == pytest.approx(5.0, abs=0.1), "within half a lane's width it does"
    assert least(arc, standing(60.0)) == pytest.approx(1.0, abs=0.05)


def test_an_edge_before_the_line_that_is_shorter_than_a_step_is_found():
    """The lane of NORTHBOUND ends 10.3 m earlier, and a joint and a lane of 0.3 m lead to the line."""
    movement = SIGNAL.connections[STRAIGHT]
    lane = SIGNAL.lanes[movement.from_lane]
    count, edges = len(SIGNAL.lanes), len(SIGNAL.edges)
    parts = [lane.centre.cut(*ends) for ends in ((0.0, 89.7), (89.7, 99.7), (99.7, 100.0))]
    joint = replace(lane, index=count, edge=edges, kind=LaneKind.INTERNAL, centre=parts[1])
    short = replace(lane, index=count + 1, edge=edges + 1, position=0, centre=parts[2])
    lanes = [*SIGNAL.lanes, joint, short]
    lanes[lane.index] = replace(lane, centre=parts[0])
    added = (Edge(edges, ":K", (count,), "K", "K", True), Edge(edges + 1, "short", (count + 1,), "K", "J", False))
    onward = replace(movement, from_lane=count + 1)
    plain = replace(movement, to_lane=count + 1, via=(count,), signal_id=None, signal_link=-1, junction="K")
    others = [c for c in SIGNAL.connections if SIGNAL.lanes[c.from_lane].edge != lane.edge]
    cut = replace(SIGNAL, lanes=tuple(lanes), edges=(*SIGNAL.edges, *added), connections=(*others, plain, onward))
    drive = {EMV: Driven(NORTHBOUND, at_speed(70.1, 10.0, 200))}
    (whole,) = find_traversals(hand_made(SIGNAL, drive))
    _, found = find_traversals(hand_made(cut, drive))
    assert cut.connections[found.connection] == onward
    assert found.enter_step == whole.enter_step
    assert found.centre_steps == whole.centre_steps


@pytest.mark.parametrize("cut", [0, 20])
def test_the_way_is_free_from_the_very_step_at_which_the_one_ahead_has_left(cut):
    """The EMV gains speed, so that its least free speed is that of the first free step."""
    time = 0.05 * np.arange(160)
    arc = 82.0 + 1.0 * time + 0.6 * time**2
    gone = 60
    ahead = {2: Driven(NORTHBOUND, np.concatenate((np.full(gone, 101.0), np.full(300, 130.0))))}
    record = hand_made(STOP, {EMV: Driven(NORTHBOUND, arc), **ahead})
    record = replace(record, states=record.states[cut:], traffic=record.traffic[cut:])
    (traversal,) = [item for item in find_traversals(record) if item.actor_id == EMV]
    assert least_free_speed_mps(record, traversal) == pytest.approx(1.0 + 1.2 * 0.05 * gone, abs=1e-6)


def _red(link: int, letter: str = "r") -> Callable[[int], str]:
    """All links green but one."""
    state = "".join(letter if index == link else "G" for index in range(7))
    return lambda _: state


def _with(other: Driven, link: int = STRAIGHT, letter: str = "r") -> EpisodeRecord:
    return hand_made(SIGNAL, {EMV: EMV_DRIVE, 2: other}, _red(link, letter))


def _parts(verdict: object) -> dict[str, tuple[float, bool]]:
    return {part.name: (part.value, part.holds) for part in verdict.parts}


def test_red_with_a_vehicle_beside_holds_and_names_it():
    verdict = red_same_direction(_with(Driven(LEFT_LANE, INSIDE)), {})
    assert verdict.holds
    assert _parts(verdict) == dict.fromkeys(("against_red", "same_direction_inside", "through"), (1.0, True))
    line_part, others, _ = verdict.parts
    assert line_part.detail == "EMV 1 in junction J from 2.7 s to 6.3 s on r"
    assert others.detail == "2 from 1.6 s to 7.6 s"
    assert line_part.moments == (Moment(54, EMV),)
    assert others.moments == (Moment(54, 2),), "the EMV came later"
    assert verdict.text == "the EMV entered junction J against red with 1 vehicles of its direction inside"


@pytest.mark.parametrize(
    ("points", "same", "across"),
    [
        (LEFT_LANE, True, False),
        (IN_TURN_LANE, True, False),
        (PARALLEL, True, False),
        (EASTBOUND, False, True),
        (SOUTHBOUND, False, False),
    ],
)
def test_same_direction_and_crossing_are_told_apart(points, same, across):
    record = _with(Driven(points, INSIDE))
    assert red_same_direction(record, {}).holds == same
    assert red_crossing(record, {}).holds == across


def test_an_emv_that_is_still_inside_at_the_end_has_not_got_through():
    record = _with(Driven(LEFT_LANE, INSIDE))
    (inside,) = [item for item in find_traversals(record) if item.actor_id == EMV]
    for steps, through in ((inside.leave_step + 1, True), (inside.leave_step, False)):
        cut = replace(record, states=record.states[:steps], traffic=record.traffic[:steps])
        assert [part.name for part in red_same_direction(cut, {}).failing] == [] if through else ["through"]


@pytest.mark.parametrize("arc_m", [BEFORE, AT_THE_LINE], ids=["before", "at the line"])
def test_a_vehicle_that_is_not_inside_meanwhile_does_not_count(arc_m):
    for points, predicate in ((LEFT_LANE, red_same_direction), (EASTBOUND, red_crossing)):
        verdict = predicate(_with(Driven(points, arc_m)), {})
        assert [part.name for part in verdict.failing] == [verdict.parts[1].name]


def test_the_signal_is_the_one_of_the_emvs_own_link():
    verdict = red_crossing(_with(Driven(EASTBOUND, INSIDE), link=EAST), {})
    parts = {"against_red": (0.0, False), "crossing_inside": (1.0, True), "through": (1.0, True)}
    assert _parts(verdict) == parts
    assert verdict.failing[0].detail.endswith("on G")


@pytest.mark.parametrize(("letter", "red"), [("r", True), ("u", True), ("y", False), ("g", False), ("o", False)])
def test_red_and_red_with_yellow_forbid_entering(letter, red):
    assert red_same_direction(_with(Driven(LEFT_LANE, INSIDE), letter=letter), {}).holds == red


def test_the_signal_counts_as_the_front_passes_the_line_not_later():
    for red_from, holds in ((54, True), (55, False)):
        record = hand_made(
            SIGNAL,
            {EMV: EMV_DRIVE, 2: Driven(LEFT_LANE, INSIDE)},
            lambda step, first=red_from: ("r" if step >= first else "G") * 7,
        )
        assert red_same_direction(record, {}).holds == holds


def test_without_a_signal_or_a_stop_line_the_verdict_says_so():
    vehicles = {EMV: EMV_DRIVE, 2: Driven(LEFT_LANE, INSIDE)}
    for verdict in (
        red_same_direction(hand_made(STOP, vehicles), {}),
        stop_same_direction(hand_made(SIGNAL, vehicles, _red(STRAIGHT)), STOP_THRESHOLDS),
    ):
        assert not verdict.holds
        assert [part.value for part in verdict.parts] == [0.0, 0.0]
        assert "nowhere" in verdict.parts[0].detail
    other_way = {EMV: Driven(EASTBOUND, at_speed(70.0, 10.0, 200)), 2: Driven(NORTHBOUND, INSIDE)}
    assert stop_crossing(hand_made(STOP, other_way), STOP_THRESHOLDS).parts[0].value == 0.0


def test_a_stop_line_passed_at_speed_with_others_inside():
    beside = hand_made(STOP, {EMV: EMV_DRIVE, 2: Driven(LEFT_LANE, INSIDE)})
    across = hand_made(STOP, {EMV: EMV_DRIVE, 2: Driven(EASTBOUND, INSIDE)})
    assert [stop_same_direction(item, STOP_THRESHOLDS).holds for item in (beside, across)] == [True, False]
    assert [stop_crossing(item, STOP_THRESHOLDS).holds for item in (beside, across)] == [False, True]


@pytest.mark.parametrize(("speed_mps", "holds"), [(1.9, False), (2.1, True)])
def test_the_speed_is_the_least_on_the_approach(speed_mps, holds):
    """The EMV comes in fast, passes the line slowly and goes on fast."""
    speed = np.where(np.abs(np.arange(300) - 100) < 40, speed_mps, 8.0)
    arc = np.concatenate(([0.0], np.cumsum(speed[:-1] * 0.05)))
    arc += 97.0 - arc[100]
    stepping_in = np.concatenate((np.linspace(90.0, 110.0, 60), np.full(240, 110.0)))
    record = hand_made(STOP, {EMV: Driven(NORTHBOUND, arc), 2: Driven(EASTBOUND, stepping_in)})
    verdict = stop_crossing(record, STOP_THRESHOLDS)
    assert verdict.holds == holds
    assert verdict.parts[0].value == pytest.approx(speed_mps, abs=0.01)
    assert verdict.parts[1].holds


def _at_give_way(
    control: str, kind: JunctionKind, held: np.ndarray, junction: str = "J", first: np.ndarray = INSIDE
) -> Verdict:
    """The EMV passes a line without a sign while one vehicle crosses; another one comes to the crossing line."""
    network = crossing(kind)
    ways = tuple(replace(way, gives_way=index in {STRAIGHT, RIGHT}) for index, way in enumerate(network.connections))
    vehicles = {EMV: EMV_DRIVE, 2: Driven(EASTBOUND, first), 3: Driven(EASTBOUND, held)}
    record = hand_made(replace(network, connections=ways), vehicles)
    site = {"junction": junction, "control": control}
    return stop_crossing(replace(record, description=replace(record.description, site=site)), STOP_THRESHOLDS)


STOPS_FOR_THE_EMV = np.concatenate((np.full(120, 97.0), 97.0 + 0.4 * np.arange(80)))
"""Stands with its front at the line until 6 s; the EMV is inside from 2.7 s to 6.3 s."""
COMES_LATER = np.concatenate((np.linspace(60.0, 88.0, 130), 88.0 + 0.4 * np.arange(70)))
"""Goes on at 4 m/s and more, and enters behind the EMV."""


def test_without_a_sign_somebody_with_the_right_of_way_has_to_stop_for_the_emv():
    verdict = _at_give_way("give_way", JunctionKind.PRIORITY, STOPS_FOR_THE_EMV)
    assert verdict.holds
    assert verdict.measures()["went_before"] == 1
    assert verdict.parts[2].moments[0].actor_id == 3
    assert "give-way line" in verdict.text
    later = _at_give_way("give_way", JunctionKind.PRIORITY, COMES_LATER)
    assert not later.holds
    assert [part.name for part in later.failing] == ["went_before"]


def test_who_stops_for_the_emv_behind_its_own_line_counts_unless_a_civilian_is_ahead():
    """It enters after the EMV, at 3.2 s, and stands inside from 4 s to 6.5 s."""
    stops = np.concatenate((np.linspace(89.0, 99.0, 80), np.full(50, 99.0), 99.0 + 0.4 * np.arange(70)))
    verdict = _at_give_way("give_way", JunctionKind.PRIORITY, stops, first=at_speed(92.0, 10.0, 200))
    assert verdict.holds
    assert verdict.parts[2].moments[0].actor_id == 3
    behind = _at_give_way("give_way", JunctionKind.PRIORITY, stops)
    assert [part.name for part in behind.failing] == ["went_before"]


def test_who_comes_from_the_left_has_no_right_of_way_without_any_control():
    verdict = _at_give_way("uncontrolled", JunctionKind.UNCONTROLLED, STOPS_FOR_THE_EMV)
    assert [part.name for part in verdict.failing] == ["went_before"]


@pytest.mark.parametrize(("control", "junction"), [("all_way_stop", "J"), ("give_way", "K")])
def test_lines_without_a_sign_count_only_at_a_site_that_is_one(control, junction):
    verdict = _at_give_way(control, JunctionKind.PRIORITY, STOPS_FOR_THE_EMV, junction)
    assert "nowhere" in verdict.text


@pytest.mark.parametrize(
    ("first", "second", "same"),
    [
        (STRAIGHT, BESIDE, True),
        (STRAIGHT, RIGHT, True),
        (RIGHT, BESIDE, False),
        (RIGHT, EAST, False),
        (STRAIGHT, SOUTH, False),
    ],
)
def test_both_ends_of_two_movements_have_to_point_the_same_way(first, second, same):
    """From different edges: equal at the entry alone, or at the exit alone, is another direction."""
    assert is_same_direction(SIGNAL, first, second) == is_same_direction(SIGNAL, second, first) == same


def test_who_crosses_another_junction_meanwhile_is_not_inside():
    """The road of its own beside the EMV's crosses a junction K."""
    record = _with(Driven(PARALLEL, INSIDE))
    assert red_same_direction(record, {}).holds
    connections = tuple(
        replace(connection, junction="K") if index == BESIDE else connection
        for index, connection in enumerate(record.network.connections)
    )
    other = replace(record, network=replace(record.network, connections=connections))
    verdict = red_same_direction(other, {})
    assert [part.name for part in verdict.failing] == ["same_direction_inside"]


def test_other_emvs_are_neither_inside_nor_forgotten():
    """Two EMVs pass together: neither counts for the other, and either one's entry counts."""
    record = _with(Driven(LEFT_LANE, EMV_DRIVE.arc_m))
    actors = {key: replace(actor, is_emv=True) for key, actor in record.actors.items()}
    both = replace(record, actors=actors, description=replace(record.description, emv_ids=(EMV, 2)))
    assert [part.name for part in red_same_direction(both, {}).failing] == ["same_direction_inside"]
    swapped = replace(record, description=replace(record.description, emv_ids=(2,)))
    assert [part.name for part in red_same_direction(swapped, {}).failing] == ["against_red"], "its own link is green"


def _verdict(points: np.ndarray, speed_mps: float = 8.0, start_m: float = 40.0) -> Verdict:
    arc_m = at_speed(start_m, speed_mps, round(150.0 / speed_mps / 0.05))
    return shoulder_turn(hand_made(SIGNAL, {EMV: Driven(points, arc_m)}), THRESHOLDS)


def test_a_right_turn_on_the_shoulder_holds_with_its_times():
    verdict = _verdict(ON_SHOULDER)
    turned, shoulder, _ = verdict.parts
    assert verdict.holds
    assert turned.value == pytest.approx(90.0)
    assert turned.detail.startswith("EMV 1 at junction J from ")
    # 50 m before the line, the quarter circle, 50 m after it, at 8 m/s; the EMV's length is part of the traversal
    assert shoulder.value == pytest.approx((100.0 + 6.0 + 11.75 * np.pi / 2.0) / 8.0, abs=0.1)
    assert " s to " in shoulder.detail
    begin_s = float(shoulder.detail.split(" s to ")[0])
    (reached,) = shoulder.moments
    assert reached.step * 0.05 == pytest.approx(begin_s + THRESHOLDS["shoulder_min_s"], abs=0.1)
    (half_turned,) = turned.moments
    assert begin_s < half_turned.step * 0.05 < begin_s + shoulder.value


def test_a_turn_in_the_driving_lane_fails_on_the_shoulder_alone_and_straight_ahead_is_no_turn():
    verdict = _verdict(IN_TURN_LANE)
    assert [(part.name, part.value, part.moments) for part in verdict.failing] == [("shoulder_s", 0.0, ())]
    verdict = _verdict(NORTHBOUND)
    assert [part.name for part in verdict.failing] == ["right_turn_deg", "shoulder_s"]
    assert "nowhere" in verdict.failing[0].detail
    vehicles = {EMV: Driven(NORTHBOUND, at_speed(40.0, 8.0, 200)), 2: Driven(ON_SHOULDER, at_speed(40.0, 8.0, 300))}
    assert shoulder_turn(hand_made(SIGNAL, vehicles), THRESHOLDS).parts[0].value == 0.0, "others do not count"


def test_a_short_stay_on_the_shoulder_is_not_enough():
    """Onto the shoulder 4 m before the line, across on its path, and off it at once."""
    short = np.concatenate(
        (
            line((RIGHT_X_M, -120.0), (RIGHT_X_M, -28.0), (SHOULDER_X_M, -23.0)),
            SHOULDER_TURN,
            line((24, -5.25), (120, -5.25)),
        )
    )
    verdict = _verdict(short, speed_mps=14.0)
    assert [part.name for part in verdict.failing] == ["shoulder_s"]
    assert 1.2 < verdict.failing[0].value < 2.0
    assert _verdict(short, speed_mps=8.0).holds


def test_the_shoulder_long_before_the_turn_does_not_count():
    early = np.concatenate((line((SHOULDER_X_M, -120.0), (SHOULDER_X_M, -80.0), (RIGHT_X_M, -74.0)), IN_TURN_LANE[1:]))
    verdict = _verdict(early, start_m=2.0, speed_mps=8.0)
    assert verdict.parts[0].holds
    assert verdict.parts[1].value == 0.0


def test_the_turn_is_measured_alone_and_not_summed_with_a_bend_to_the_left():
    left, right = np.linspace(0.0, 0.9, 20), np.linspace(0.9, -0.45, 30)
    turned_rad = turned_right_rad(np.concatenate((left, right)))
    assert turned_rad[:20] == pytest.approx(0.0)
    assert turned_rad[20:] == pytest.approx(0.9 - right)
    assert turned_right_rad(np.concatenate((left, right, right[::-1])))[-1] == pytest.approx(1.35)
    assert turned_right_rad(np.linspace(-3.0, -3.6, 10))[-1] == pytest.approx(0.6), "across π"


def test_on_a_shoulder_is_within_its_width_its_length_and_90_degrees():
    x_m, south_m = SHOULDER_X_M, -60.0
    on = [(x_m, south_m, degrees) for degrees in (90.0, 1.0, 179.0)]
    on += [(x_m + 1.2, south_m, 90.0), (60.0, -8.25, 0.0), (*SHOULDER_TURN[9], 45.0)]
    off = [(x_m, south_m, degrees) for degrees in (-1.0, 181.0)]
    off += [(x_m + aside_m, south_m, 90.0) for aside_m in (1.3, -1.3)]
    off += [(x_m, -121.0, 90.0), (RIGHT_X_M, south_m, 90.0), (60.0, -5.25, 0.0)]
    x, y, degrees = np.array([*on, *off]).T
    rows = hand_made(SIGNAL, {EMV: Driven(NORTHBOUND, at_speed(0.0, 1.0, len(x)))}).track(EMV)
    placed = replace(rows, x_m=x, y_m=y, yaw_rad=np.radians(degrees))
    assert on_shoulder_area(SIGNAL, placed).tolist() == [True] * len(on) + [False] * len(off)


def test_a_record_that_ends_inside_the_turn_is_judged_as_far_as_it_goes():
    """Five steps after half of the quarter circle on the shoulder."""
    steps = round((60.0 + 11.75 * np.pi / 4.0) / 8.0 / 0.05)
    verdict = shoulder_turn(hand_made(SIGNAL, {EMV: Driven(ON_SHOULDER, at_speed(40.0, 8.0, steps))}), THRESHOLDS)
    turned, shoulder, through = verdict.parts
    assert turned.value == pytest.approx(45.0, abs=3.0)
    assert shoulder.value == pytest.approx((50.0 + 3.0 + 11.75 * np.pi / 4.0) / 8.0, abs=0.5)
    assert not through.holds


def test_an_interval_ends_with_the_step_after_its_last_one():
    rows = hand_made(SIGNAL, {EMV: Driven(ON_SHOULDER, at_speed(0.0, 8.0, 40))}).track(EMV)
    holds = np.zeros(40, dtype=np.bool_)
    holds[4:9] = holds[20:23] = True
    assert times_text(rows, holds) == "0.2 s to 0.5 s, 1.0 s to 1.2 s"
