"""Templates S3 to S7. The stop line is at 100 m, and the EMV's front is 3 m ahead of its centre."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

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
from known_outputs import assert_known
from told_verdicts import told_first

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
from siren_ros.scoring.judging.verdict import Verdict
from siren_ros.simulation.roads.road_network import Edge, JunctionKind, LaneKind

KNOWN = Path(__file__).parent / "known"
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


def _cut(record: EpisodeRecord, steps: int) -> EpisodeRecord:
    return replace(record, states=record.states[:steps], traffic=record.traffic[:steps])


def _emvs(record: EpisodeRecord, *ids: int) -> EpisodeRecord:
    actors = {key: replace(actor, is_emv=True) for key, actor in record.actors.items()}
    return replace(record, actors=actors, description=replace(record.description, emv_ids=ids))


def test_verdicts_at_signals() -> None:
    """The EMV is in the junction from 2.7 s to 6.3 s, and its own link is red unless the case says otherwise."""
    beside, across = _with(Driven(LEFT_LANE, INSIDE)), _with(Driven(EASTBOUND, INSIDE))
    on_its_road = _with(Driven(PARALLEL, INSIDE))
    ways = on_its_road.network.connections
    at_k = tuple(replace(way, junction="K") if index == BESIDE else way for index, way in enumerate(ways))
    both = _emvs(_with(Driven(LEFT_LANE, EMV_DRIVE.arc_m)), EMV, 2)
    cars = {EMV: EMV_DRIVE, 2: Driven(LEFT_LANE, INSIDE)}
    red_from = {first: hand_made(SIGNAL, cars, lambda step, first=first: "Gr"[step >= first] * 7) for first in (54, 55)}
    cases = {
        "beside": beside,
        "turns right from the same lane": _with(Driven(IN_TURN_LANE, INSIDE)),
        "on a road of its own": on_its_road,
        "on a road of its own at another junction": replace(on_its_road, network=replace(SIGNAL, connections=at_k)),
        "across": across,
        "oncoming": _with(Driven(SOUTHBOUND, INSIDE)),
        "left before": _with(Driven(LEFT_LANE, BEFORE)),
        "stands at the line": _with(Driven(LEFT_LANE, AT_THE_LINE)),
        "crossed before": _with(Driven(EASTBOUND, BEFORE)),
        "stands at the line across": _with(Driven(EASTBOUND, AT_THE_LINE)),
        "the rear leaves with the last step": _cut(beside, 127),
        "the rear leaves a step later": _cut(beside, 126),
        "another link is red": _with(Driven(EASTBOUND, INSIDE), link=EAST),
        **{f"the letter {letter}": _with(Driven(LEFT_LANE, INSIDE), letter=letter) for letter in "ruygo"},
        **{f"red from step {first} on": record for first, record in red_from.items()},
        "no signal": hand_made(STOP, cars),
        "two EMVs": both,
        "the second EMV alone": _emvs(both, 2),
    }
    verdicts = {}
    for name, record in cases.items():
        verdicts[f"S3 {name}"], verdicts[f"S4 {name}"] = red_same_direction(record, {}), red_crossing(record, {})
    assert_known(KNOWN / "signals.json", told_first(verdicts))


def test_verdicts_at_lines() -> None:
    """In the last cases the EMV passes a line without a sign; one vehicle crosses, and another one may stop for it."""
    beside, across = (hand_made(STOP, {EMV: EMV_DRIVE, 2: Driven(way, INSIDE)}) for way in (LEFT_LANE, EASTBOUND))
    from_west = hand_made(STOP, {EMV: Driven(EASTBOUND, at_speed(70.0, 10.0, 200)), 2: Driven(NORTHBOUND, INSIDE)})
    found = {
        f"{template} {name}": judged(record, STOP_THRESHOLDS)
        for template, judged in (("S5", stop_same_direction), ("S6", stop_crossing))
        for name, record in {
            "beside": beside,
            "across": across,
            "a signal": hand_made(SIGNAL, {EMV: EMV_DRIVE, 2: Driven(LEFT_LANE, INSIDE)}, _red(STRAIGHT)),
            "no line of its own": from_west,
            "at 1.9 m/s": _slow_at_the_line(1.9),
            "at 2.1 m/s": _slow_at_the_line(2.1),
        }.items()
    }
    # It enters after the EMV, at 3.2 s, and stands inside from 4 s to 6.5 s.
    inside = np.concatenate((np.linspace(89.0, 99.0, 80), np.full(50, 99.0), 99.0 + 0.4 * np.arange(70)))
    gives_way = "give_way", JunctionKind.PRIORITY
    found |= {
        "stops for the EMV": _at_give_way(*gives_way, STOPS_FOR_THE_EMV),
        "comes later": _at_give_way(*gives_way, COMES_LATER),
        "stops behind its own line": _at_give_way(*gives_way, inside, first=at_speed(92.0, 10.0, 200)),
        "stops behind a civilian": _at_give_way(*gives_way, inside),
        "comes from the left": _at_give_way("uncontrolled", JunctionKind.UNCONTROLLED, STOPS_FOR_THE_EMV),
        "the site is an all-way stop": _at_give_way("all_way_stop", JunctionKind.PRIORITY, STOPS_FOR_THE_EMV),
        "the site is elsewhere": _at_give_way(*gives_way, STOPS_FOR_THE_EMV, "K"),
    }
    assert_known(KNOWN / "lines.json", told_first(found))


def _slow_at_the_line(speed_mps: float) -> EpisodeRecord:
    """The EMV comes in fast, passes the line slowly and goes on fast."""
    speed = np.where(np.abs(np.arange(300) - 100) < 40, speed_mps, 8.0)
    arc = np.concatenate(([0.0], np.cumsum(speed[:-1] * 0.05)))
    stepping_in = np.concatenate((np.linspace(90.0, 110.0, 60), np.full(240, 110.0)))
    return hand_made(STOP, {EMV: Driven(NORTHBOUND, arc + 97.0 - arc[100]), 2: Driven(EASTBOUND, stepping_in)})


def test_verdicts_of_turns_on_the_shoulder() -> None:
    """50 m before the line, a quarter circle of 11.75 m and 50 m after it, at 8 m/s; the EMV's length is part of it."""
    short_ways = line((RIGHT_X_M, -120.0), (RIGHT_X_M, -28.0), (SHOULDER_X_M, -23.0)), line((24, -5.25), (120, -5.25))
    short = np.concatenate((short_ways[0], SHOULDER_TURN, short_ways[1]))
    early = np.concatenate((line((SHOULDER_X_M, -120.0), (SHOULDER_X_M, -80.0), (RIGHT_X_M, -74.0)), IN_TURN_LANE[1:]))
    others = {EMV: Driven(NORTHBOUND, at_speed(40.0, 8.0, 200)), 2: Driven(ON_SHOULDER, at_speed(40.0, 8.0, 300))}
    half = round((60.0 + 11.75 * np.pi / 4.0) / 8.0 / 0.05)
    verdicts = {
        "on the shoulder": _verdict(ON_SHOULDER),
        "in the driving lane": _verdict(IN_TURN_LANE),
        "straight ahead": _verdict(NORTHBOUND),
        "another one turns": shoulder_turn(hand_made(SIGNAL, others), THRESHOLDS),
        "4 m before the line and across, fast": _verdict(short, speed_mps=14.0),
        "4 m before the line and across": _verdict(short),
        "long before the turn": _verdict(early, start_m=2.0),
        "half of it": shoulder_turn(
            _cut(hand_made(SIGNAL, {EMV: Driven(ON_SHOULDER, at_speed(40.0, 8.0, 400))}), half), THRESHOLDS
        ),
    }
    assert_known(KNOWN / "shoulder.json", told_first(verdicts))


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


def _verdict(points: np.ndarray, speed_mps: float = 8.0, start_m: float = 40.0) -> Verdict:
    arc_m = at_speed(start_m, speed_mps, round(150.0 / speed_mps / 0.05))
    return shoulder_turn(hand_made(SIGNAL, {EMV: Driven(points, arc_m)}), THRESHOLDS)


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


def test_an_interval_ends_with_the_step_after_its_last_one():
    rows = hand_made(SIGNAL, {EMV: Driven(ON_SHOULDER, at_speed(0.0, 8.0, 40))}).track(EMV)
    holds = np.zeros(40, dtype=np.bool_)
    holds[4:9] = holds[20:23] = True
    assert times_text(rows, holds) == "0.2 s to 0.5 s, 1.0 s to 1.2 s"
