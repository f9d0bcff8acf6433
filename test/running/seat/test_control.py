"""Closed forms of target speeds; free gaps; pedals and steering."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import NORTHBOUND, Driven, at_speed, line
from hypothesis import given
from hypothesis import strategies as st
from made_sights import LENGTH_M, LIMIT_MPS, ROWS, car, sight, siren, straight_way, to_the_right
from seen_on_crossing import sight_at

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.running.seat.control import (
    change_ahead_m,
    emv_waits,
    indicators,
    is_free,
    speed_to_crossing,
    speed_to_entry,
    speed_to_junction,
    speed_to_leader,
    speed_to_limit,
    speed_to_merge,
    speed_to_passing_emv,
    speed_to_red,
    steered,
)
from siren_ros.running.seat.sight import Line
from siren_ros.simulation.roads.road_network import Connection
from siren_ros.simulation.world.actors import Lights


def test_the_speed_limit_on_a_straight_way_and_a_stop_before_its_end():
    assert speed_to_limit(sight()) == LIMIT_MPS
    assert speed_to_limit(sight(LENGTH_M - 3.0)) == 0.0
    assert speed_to_limit(sight(LENGTH_M - 3.0 - 4.0)) == pytest.approx(4.0)  # v² = 2 · 2 m/s² · 4 m


def test_slower_before_a_bend():
    angle = np.linspace(0.0, 0.5 * np.pi, 60)
    arc = np.stack((50.0 + 8.0 * np.sin(angle), 8.0 - 8.0 * np.cos(angle)), axis=1)
    bent = straight_way(curve=Polyline.through(np.concatenate(([[0.0, 0.0]], arc, [[58.0, 200.0]]))))
    assert speed_to_limit(sight(52.0, way=bent)) == pytest.approx(
        math.sqrt(2.0 * 8.0), rel=0.05
    )  # 2 m/s² at 8 m radius
    assert speed_to_limit(sight(5.0, way=bent)) == LIMIT_MPS


@given(free_m=st.floats(0.0, 50.0), speed_mps=st.floats(0.0, 20.0))
def test_behind_a_leader_it_can_stop_with_gentle_braking_after_its_headway(free_m, speed_mps):
    wanted = speed_to_leader(sight(others=(car(free_m + 2.5, speed_mps=speed_mps),)), 0.0)
    # v · 1.4 s + v² / (2 · 2 m/s²) = free + v_leader² / (2 · 2 m/s²)
    assert wanted * 1.4 + wanted**2 / 4.0 == pytest.approx(free_m + speed_mps**2 / 4.0, abs=1e-6)


def test_the_worst_of_several_counts_whatever_their_order():
    near, far = car(12.0, speed_mps=2.0), car(40.0, speed_mps=9.0)
    slow, fast = siren(-3.0, left_m=-2.9, speed_mps=6.0), siren(-4.0, left_m=2.9, speed_mps=9.0)
    waits = siren(4.0, speed_mps=0.2)
    for order in (1, -1):
        assert speed_to_leader(sight(others=(near, far)[::order]), 0.0) == speed_to_leader(sight(others=(near,)), 0.0)
        assert speed_to_passing_emv(sight(sirens=(slow, fast)[::order])) == 5.0
        assert emv_waits(sight(sirens=(waits, fast)[::order]))


def test_who_is_beside_the_way_is_no_leader():
    assert speed_to_leader(sight(others=(car(5.0, left_m=-3.5),)), 0.0) == math.inf
    assert speed_to_leader(sight(others=(car(5.0, left_m=-3.5),)), -3.0) < 5.0  # it is where the driver goes
    assert speed_to_leader(sight(others=(car(-8.0),)), 0.0) == math.inf


def test_an_emv_that_is_beside_gets_ahead():
    beside, creeping = siren(-3.0, left_m=-2.6, speed_mps=6.0), siren(-9.0, left_m=2.6, speed_mps=1.4)
    assert speed_to_passing_emv(sight(sirens=(beside,))) == 5.0
    assert speed_to_passing_emv(sight(sirens=(beside, creeping))) == 0.0
    assert speed_to_passing_emv(sight(sirens=(siren(-3.0, left_m=-2.6, speed_mps=0.0),))) == math.inf
    assert speed_to_passing_emv(sight(sirens=(siren(-3.0, left_m=-2.1, speed_mps=0.0),))) == 0.0  # 0.1 m between them
    for elsewhere in (siren(5.0), siren(-25.0, left_m=-2.6), siren(-3.0, left_m=-4.5)):
        assert speed_to_passing_emv(sight(sirens=(elsewhere,))) == math.inf


def test_a_red_line_that_is_too_near_is_crossed():
    assert speed_to_red(sight()) == math.inf
    assert speed_to_red(sight(red_m=17.0)) == pytest.approx(8.0)
    assert speed_to_red(sight(red_m=8.0)) == math.inf  # it would have to brake at more than 5 m/s²
    assert speed_to_red(sight(red_m=0.5, speed_mps=0.0)) == 0.0


def test_a_junction_that_cannot_be_left_is_not_entered():
    entry_m = 80.0 - 2.25
    queue = (car(entry_m + 30.0, speed_mps=0.0),)
    assert speed_to_junction(sight()) == math.inf
    assert speed_to_junction(sight(others=queue)) == math.inf  # from 20 m the junction is not seen yet
    near = sight(70.0, others=(car(59.0, speed_mps=0.0),))
    assert speed_to_junction(near) == pytest.approx(math.sqrt(4.0 * (30.0 - 2.25 - 1.0)))
    assert speed_to_junction(sight(70.0, others=(car(59.0, speed_mps=8.0),))) == math.inf
    assert speed_to_junction(sight(70.0, others=(car(75.0),))) == math.inf  # there is room behind the junction
    assert speed_to_junction(sight(110.0, others=(car(5.0),))) == math.inf  # inside, it is cleared


def test_the_indicator_of_a_lane_change_shows_before_it():
    changes = np.zeros(ROWS)
    changes[40:60] = -1.0
    way = straight_way(changes=changes)
    shown = [indicators(sight(s_m, way=way)) for s_m in (10.0, 25.0, 45.0, 70.0)]
    assert shown == [0, Lights.INDICATOR_RIGHT, Lights.INDICATOR_RIGHT, 0]
    assert indicators(sight(105.0, way=straight_way(changes=np.ones(ROWS)))) == 0


@pytest.mark.parametrize(
    ("direction", "light"), [("l", Lights.INDICATOR_LEFT), ("r", Lights.INDICATOR_RIGHT), ("s", 0)]
)
def test_the_indicator_of_a_turn_shows_100_feet_before_it(direction, light):
    movement = Connection(0, 1, (2,), direction, None, -1, must_stop=False, junction="J")
    way = straight_way(lines=(Line(100.0, movement),))
    shown = [indicators(sight(100.0 + s_m, way=way)) for s_m in (-40.0, -30.5, -0.6)]
    assert shown == [0, light, light]


@pytest.mark.parametrize(
    ("gap_m", "left_m", "speed_mps", "free"),
    [
        (-3.0, -3.5, LIMIT_MPS, False),  # beside it, where it goes
        (-3.0, 3.5, LIMIT_MPS, True),  # on the other side
        (-3.0, -7.0, LIMIT_MPS, True),  # farther away than it goes
        (-3.0, -1.8, LIMIT_MPS, False),  # on the way there
        (-12.0, -3.5, LIMIT_MPS, True),  # behind, as fast
        (-12.0, -3.5, LIMIT_MPS + 4.0, False),  # comes
        (5.0, -3.5, LIMIT_MPS, True),  # ahead, as fast
        (5.0, -3.5, LIMIT_MPS - 4.0, False),  # is caught up with
    ],
)
def test_a_move_to_the_right_needs_a_gap(gap_m, left_m, speed_mps, free) -> None:
    seen = sight(others=(car(gap_m, left_m, speed_mps),))
    assert is_free(-3.5, seen) is free
    assert is_free(0.0, seen), "nobody is in the own place"


def test_a_long_vehicle_is_beside_until_its_front_is_behind() -> None:
    behind = car(-12.0, -3.5, LIMIT_MPS)
    assert is_free(-3.5, sight(others=(behind,)))
    assert not is_free(-3.5, sight(others=(replace(behind, length_m=8.4),)))  # its front is 0.9 m before the own rear
    changes = np.zeros(ROWS)
    changes[60:80] = -1.0
    seen = sight(50.0, way=straight_way(changes=changes), speed_mps=8.0)
    beside = car(-9.7, -3.0, 7.0)
    assert speed_to_merge(replace(seen, others=(beside,))) == math.inf
    assert speed_to_merge(replace(seen, others=(replace(beside, length_m=8.4),))) < 8.0


@pytest.mark.parametrize(("s_m", "expected_m"), [(10.0, 0.0), (55.0, -0.525), (65.0, -1.4), (74.0, -1.05), (90.0, 0.0)])
def test_how_far_the_path_changes_lanes_on_the_way_that_the_steering_looks_ahead(s_m, expected_m) -> None:
    seen = sight(s_m, way=straight_way(**to_the_right()), speed_mps=8.0)
    assert change_ahead_m(seen) == pytest.approx(expected_m)


def test_somebody_who_is_too_near_already_does_not_keep_it_from_going_away() -> None:
    seen = sight(left_m=-2.5, others=(car(-3.0, -3.5, LIMIT_MPS),))
    assert is_free(0.0, seen)
    assert not is_free(-3.0, seen)


def test_who_is_as_fast_as_wanted_in_the_middle_does_nothing():
    answer = steered(sight(), LIMIT_MPS, 0.0)
    assert (answer.throttle, answer.brake, answer.steer_rad, answer.step) == (0.0, 0.0, 0.0, 100)


@given(
    wanted_mps=st.floats(0.0, 40.0),
    speed_mps=st.floats(0.0, 30.0),
    offset_m=st.floats(-8.0, 8.0),
    turn_rad=st.floats(-1.5, 1.5),
)
def test_every_answer_can_be_asked_of_a_vehicle(wanted_mps, speed_mps, offset_m, turn_rad):
    steered(sight(speed_mps=speed_mps, turn_rad=turn_rad), wanted_mps, offset_m).check()


def test_the_hardest_braking_is_that_of_the_limit():
    assert steered(sight(), 0.0, 0.0).brake == pytest.approx(3.5 / 9.0)
    assert steered(sight(), 0.0, 0.0, hardest_mps2=8.5).brake == pytest.approx(8.5 / 9.0)


@given(offset_m=st.floats(0.2, 3.0))
def test_the_wheel_turns_to_the_wanted_place_by_pure_pursuit(offset_m):
    # The target lies 10 m ahead, as far as it drives in a second.
    expected = math.atan(2.0 * 2.7 * offset_m / (10.0**2 + offset_m**2))
    assert steered(sight(), LIMIT_MPS, offset_m).steer_rad == pytest.approx(expected)
    assert steered(sight(), LIMIT_MPS, -offset_m).steer_rad == pytest.approx(-expected)
    assert steered(sight(left_m=offset_m), LIMIT_MPS, offset_m).steer_rad == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("side", "gap_m", "left_m", "falls_in"),
    [
        (-1.0, 5.0, -3.4, True), (-1.0, -3.0, -3.4, True), (-1.0, -12.0, -3.4, False), (-1.0, 5.0, 3.4, False),
        (1.0, 5.0, 3.4, True), (1.0, 5.0, -3.4, False), (0.0, 5.0, -3.4, False), (-1.0, 5.0, -6.8, False),
    ],
)  # fmt: skip
def test_before_its_path_changes_lanes_a_driver_falls_in_behind_those_of_that_lane(side, gap_m, left_m, falls_in):
    changes = np.zeros(ROWS)
    changes[60:80] = side
    seen = sight(
        50.0, way=straight_way(changes=changes), others=(car(gap_m, left_m=left_m, speed_mps=7.0),), speed_mps=8.0
    )
    assert (speed_to_merge(seen) < 8.5) is falls_in
    assert (speed_to_merge(seen) == math.inf) is not falls_in
    assert speed_to_merge(replace(seen, s_m=1.0)) == math.inf, "too far ahead"


AT_THE_LINE_M = 97.0
"""The own front is 1.7 m before the line, at y = -19 m on the crossing."""
COMES_DOWN = line((-1.75, 110.0), (-1.75, -120.0))
CROSSES = line((60.0, 5.25), (-60.0, 5.25))


@pytest.mark.parametrize(
    ("way", "start_m", "speed_mps", "lights", "control", "waits"),
    [
        (COMES_DOWN, 95.0, 4.0, Lights.INDICATOR_LEFT, {"must_stop": True}, True),
        (COMES_DOWN, 95.0, 4.0, Lights.INDICATOR_LEFT, {"gives_way": True}, True),
        (COMES_DOWN, 95.0, 4.0, Lights.INDICATOR_LEFT, {}, False),
        (COMES_DOWN, 95.0, 4.0, Lights.INDICATOR_LEFT, {"must_stop": True, "signal_id": "J"}, False),
        (COMES_DOWN, 95.0, 4.0, Lights.NONE, {"must_stop": True}, False),
        (COMES_DOWN, 95.0, 4.0, Lights.INDICATOR_RIGHT, {"must_stop": True}, False),
        (COMES_DOWN, 95.0, 0.0, Lights.INDICATOR_LEFT, {"must_stop": True}, False),
        (CROSSES, 45.0, 5.0, Lights.NONE, {"must_stop": True}, True),
        (CROSSES, 65.0, 5.0, Lights.NONE, {"must_stop": True}, False),
        (NORTHBOUND, 110.0, 3.0, Lights.NONE, {"must_stop": True}, False),
    ],
)
def test_at_its_line_a_driver_waits_for_those_whose_way_leads_over_its_own(
    way, start_m, speed_mps, lights, control, waits
):
    other = {3: Driven(way, at_speed(start_m, speed_mps, 2))}
    seen = sight_at(AT_THE_LINE_M, 0.5, emv_m=10.0, others=other, lights=int(lights))
    (before,) = seen.way.lines
    connection = replace(before.connection, **{"signal_id": None, **control})
    seen = replace(seen, way=replace(seen.way, lines=(replace(before, connection=connection),)))
    assert (speed_to_crossing(seen) == speed_to_entry(seen)) is waits
    assert (speed_to_crossing(seen) == math.inf) is not waits
