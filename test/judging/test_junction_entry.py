from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import (
    BESIDE,
    EAST,
    EASTBOUND,
    EMV,
    IN_TURN_LANE,
    LEFT_X_M,
    NORTHBOUND,
    PARALLEL,
    RIGHT,
    SOUTH,
    SOUTHBOUND,
    STRAIGHT,
    Driven,
    at_speed,
    crossing,
    hand_made,
    line,
)

from siren_ros.judging.junction_entry import (
    is_same_direction,
    red_crossing,
    red_same_direction,
    stop_crossing,
    stop_same_direction,
)
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.roads.road_network import JunctionKind

SIGNAL, STOP = crossing(), crossing(JunctionKind.PRIORITY_STOP)
STOP_THRESHOLDS = {"speed_min_mps": 2.0}
LEFT_LANE = line((LEFT_X_M, -120.0), (LEFT_X_M, 110.0))
EMV_DRIVE = Driven(NORTHBOUND, at_speed(70.0, 10.0, 200))
"""Front at the line after 2.7 s, rear out of the junction after 6.3 s."""
INSIDE = at_speed(92.0, 5.0, 200)
"""Centre in the junction from 1.6 s to 7.6 s."""
BEFORE = at_speed(114.0, 10.0, 200)
"""Centre out of the junction at 1.6 s."""
AT_THE_LINE = np.full(200, 97.0)
"""Stands at the line."""


def _red(link: int, letter: str = "r") -> Callable[[int], str]:
    """All links green but one."""
    state = "".join(letter if index == link else "G" for index in range(7))
    return lambda _: state


def _with(other: Driven, link: int = STRAIGHT, letter: str = "r") -> EpisodeRecord:
    return hand_made(SIGNAL, {EMV: EMV_DRIVE, 2: other}, _red(link, letter))


def _parts(verdict: object) -> dict[str, tuple[float, bool]]:
    return {part.name: (part.value, part.holds) for part in verdict.parts}  # type: ignore[attr-defined] # a Verdict


def test_red_with_a_vehicle_beside_holds_and_names_it() -> None:
    verdict = red_same_direction(_with(Driven(LEFT_LANE, INSIDE)), {})
    assert verdict.holds
    assert _parts(verdict) == {"against_red": (1.0, True), "same_direction_inside": (1.0, True)}
    line_part, others = verdict.parts
    assert line_part.detail == "EMV 1 in junction J from 2.7 s to 6.3 s on r"
    assert others.detail == "2 from 1.6 s to 7.6 s"
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
def test_same_direction_and_crossing_are_told_apart(points: np.ndarray, same: bool, across: bool) -> None:
    record = _with(Driven(points, INSIDE))
    assert red_same_direction(record, {}).holds == same
    assert red_crossing(record, {}).holds == across


@pytest.mark.parametrize("arc_m", [BEFORE, AT_THE_LINE], ids=["before", "at the line"])
def test_a_vehicle_that_is_not_inside_meanwhile_does_not_count(arc_m: np.ndarray) -> None:
    for points, predicate in ((LEFT_LANE, red_same_direction), (EASTBOUND, red_crossing)):
        verdict = predicate(_with(Driven(points, arc_m)), {})
        assert [part.name for part in verdict.failing] == [verdict.parts[1].name]


def test_the_signal_is_the_one_of_the_emvs_own_link() -> None:
    verdict = red_crossing(_with(Driven(EASTBOUND, INSIDE), link=EAST), {})
    assert _parts(verdict) == {"against_red": (0.0, False), "crossing_inside": (1.0, True)}
    assert verdict.failing[0].detail.endswith("on G")


@pytest.mark.parametrize(("letter", "red"), [("r", True), ("u", True), ("y", False), ("g", False), ("o", False)])
def test_red_and_red_with_yellow_forbid_entering(letter: str, red: bool) -> None:
    assert red_same_direction(_with(Driven(LEFT_LANE, INSIDE), letter=letter), {}).holds == red


def test_the_signal_counts_as_the_front_passes_the_line_not_later() -> None:
    for red_from, holds in ((54, True), (55, False)):
        record = hand_made(
            SIGNAL,
            {EMV: EMV_DRIVE, 2: Driven(LEFT_LANE, INSIDE)},
            lambda step, first=red_from: ("r" if step >= first else "G") * 7,
        )
        assert red_same_direction(record, {}).holds == holds


def test_without_a_signal_or_a_stop_line_the_verdict_says_so() -> None:
    vehicles = {EMV: EMV_DRIVE, 2: Driven(LEFT_LANE, INSIDE)}
    for verdict in (
        red_same_direction(hand_made(STOP, vehicles), {}),
        stop_same_direction(hand_made(SIGNAL, vehicles, _red(STRAIGHT)), STOP_THRESHOLDS),
    ):
        assert not verdict.holds
        assert [part.value for part in verdict.parts] == [0.0, 0.0]
        assert "nowhere" in verdict.parts[0].detail


def test_a_stop_line_passed_at_speed_with_others_inside() -> None:
    beside = hand_made(STOP, {EMV: EMV_DRIVE, 2: Driven(LEFT_LANE, INSIDE)})
    across = hand_made(STOP, {EMV: EMV_DRIVE, 2: Driven(EASTBOUND, INSIDE)})
    assert [stop_same_direction(item, STOP_THRESHOLDS).holds for item in (beside, across)] == [True, False]
    assert [stop_crossing(item, STOP_THRESHOLDS).holds for item in (beside, across)] == [False, True]


@pytest.mark.parametrize(("speed_mps", "holds"), [(1.9, False), (2.1, True)])
def test_the_speed_is_the_least_on_the_approach(speed_mps: float, holds: bool) -> None:
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


def _stopping_at(stop_m: float, steps: int = 300) -> np.ndarray:
    """Arc lengths of an EMV that stands for a second with its centre at a place and then goes on at 8 m/s."""
    coming = np.arange(stop_m - 30.0, stop_m, 0.4)
    going = stop_m + 0.4 * np.arange(steps)
    return np.concatenate((coming, np.full(20, stop_m), going))[:steps]


def test_who_stops_short_of_the_line_has_stopped_for_it() -> None:
    """The front is 5 m before the line; then the EMV crosses it at 8 m/s."""
    stepping_in = np.concatenate((np.linspace(90.0, 110.0, 60), np.full(240, 110.0)))
    record = hand_made(STOP, {EMV: Driven(NORTHBOUND, _stopping_at(92.0)), 2: Driven(EASTBOUND, stepping_in)})
    verdict = stop_crossing(record, STOP_THRESHOLDS)
    assert not verdict.holds
    assert verdict.parts[0].value == pytest.approx(0.0, abs=0.01)
    assert verdict.parts[1].holds


def test_who_stands_behind_another_one_at_the_line_has_not_stopped_for_it() -> None:
    """The vehicle ahead stands at the line and leaves just before the EMV does."""
    leader = np.concatenate((np.full(90, 98.0), 98.0 + 0.6 * np.arange(210)))
    emv = np.concatenate((np.arange(62.0, 90.0, 0.4), np.full(22, 90.0), 90.0 + 0.4 * np.arange(300)))[:300]
    vehicles = {EMV: Driven(NORTHBOUND, emv), 2: Driven(EASTBOUND, np.full(300, 100.0)), 3: Driven(NORTHBOUND, leader)}
    assert stop_crossing(hand_made(STOP, vehicles), STOP_THRESHOLDS).parts[0].value == pytest.approx(8.0, abs=0.2)
    del vehicles[3]
    assert stop_crossing(hand_made(STOP, vehicles), STOP_THRESHOLDS).parts[0].value == pytest.approx(0.0, abs=0.01)


def test_the_other_way_has_no_stop_line() -> None:
    record = hand_made(STOP, {EMV: Driven(EASTBOUND, at_speed(70.0, 10.0, 200)), 2: Driven(NORTHBOUND, INSIDE)})
    assert stop_crossing(record, STOP_THRESHOLDS).parts[0].value == 0.0


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
def test_both_ends_of_two_movements_have_to_point_the_same_way(first: int, second: int, same: bool) -> None:
    """From different edges: equal at the entry alone, or at the exit alone, is another direction."""
    assert is_same_direction(SIGNAL, first, second) == same


def test_the_relation_of_movements_is_symmetric() -> None:
    count = len(SIGNAL.connections)
    same = np.array([[is_same_direction(SIGNAL, a, b) for b in range(count)] for a in range(count)])
    assert np.array_equal(same, same.T)
    assert same.diagonal().all()


def test_who_crosses_another_junction_meanwhile_is_not_inside() -> None:
    """The road of its own beside the EMV's crosses a junction K."""
    record = _with(Driven(PARALLEL, INSIDE))
    assert red_same_direction(record, {}).holds
    connections = tuple(
        replace(one, junction="K") if index == BESIDE else one for index, one in enumerate(record.network.connections)
    )
    other = replace(record, network=replace(record.network, connections=connections))
    verdict = red_same_direction(other, {})
    assert [part.name for part in verdict.failing] == ["same_direction_inside"]


def test_other_emvs_are_neither_inside_nor_forgotten() -> None:
    """Two EMVs pass together: neither counts for the other, and either one's entry counts."""
    record = _with(Driven(LEFT_LANE, EMV_DRIVE.arc_m))
    actors = {key: replace(actor, is_emv=True) for key, actor in record.actors.items()}
    both = replace(record, actors=actors, description=replace(record.description, emv_ids=(EMV, 2)))
    assert [part.name for part in red_same_direction(both, {}).failing] == ["same_direction_inside"]
    swapped = replace(record, description=replace(record.description, emv_ids=(2,)))
    assert [part.name for part in red_same_direction(swapped, {}).failing] == ["against_red"], "its own link is green"
