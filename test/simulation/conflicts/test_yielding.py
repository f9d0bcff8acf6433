"""Ranks of movements, who waits, and how far a vehicle may go into the hand-made crossing."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import BESIDE, EAST, RIGHT, SHOULDER_RIGHT, SOUTH, STRAIGHT, STRAIGHT_LEFT, crossing
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.simulation.conflicts.yielding import (
    Approach,
    Bends,
    JunctionRoom,
    Margins,
    Rank,
    approach_time_s,
    fall_in_brake_mps2,
    later_brake_mps2,
    rank_inside,
    rank_of,
    stop_brake_mps2,
    time_to_go_s,
    wait_for,
)
from siren_ros.simulation.conflicts.zones import STEP_M, Zone
from siren_ros.simulation.roads.road_network import Connection
from siren_ros.simulation.scenario.driver_parameters import ConflictConfig

FREE = Connection(0, 1, (), "s", None, -1, must_stop=False, junction="j")


@pytest.mark.parametrize(
    ("state", "rank"),
    [
        *((state, Rank.PRIORITY) for state in "GO"),
        *((state, Rank.GIVES_WAY) for state in "gso"),
        *((state, Rank.CLEARING) for state in "yY"),
        *((state, Rank.RED) for state in "ru?"),
    ],
)
def test_the_signal_decides_where_there_is_one(state, rank):
    signalled = replace(FREE, signal_id="s", signal_link=1, must_stop=True)
    assert rank_of(signalled, {"s": f"r{state}G"}) is rank


def test_signs_decide_without_a_signal():
    assert rank_of(FREE, {}) is Rank.PRIORITY
    assert rank_of(replace(FREE, gives_way=True), {}) is Rank.GIVES_WAY
    assert rank_of(replace(FREE, must_stop=True, gives_way=True), {}) is Rank.STOP_SIGN


def test_the_junction_is_left_clear_for_who_is_on_it():
    for privileged in (False, True):
        assert rank_inside(int(Rank.RED), privileged) == Rank.PRIORITY
        assert rank_inside(int(Rank.STOP_SIGN), privileged) == Rank.PRIORITY
    assert rank_inside(int(Rank.GIVES_WAY), False) == Rank.GIVES_WAY
    assert rank_inside(int(Rank.GIVES_WAY), True) == Rank.PRIORITY


@pytest.mark.parametrize(
    ("link", "rank"), [(0, Rank.RED), (1, Rank.PRIORITY), (2, Rank.STOP_SIGN), (-1, Rank.STOP_SIGN)]
)
def test_a_link_that_the_signal_does_not_have_leaves_it_to_the_signs(link, rank):
    connection = replace(FREE, signal_id="s", signal_link=link, must_stop=True)
    assert rank_of(connection, {"s": "rG", "t": "GG"}) is rank
    assert rank_of(connection, {"t": "GG"}) is Rank.STOP_SIGN


CONFIG = Margins()
INF = math.inf


@pytest.mark.parametrize(("own_s", "after_s"), [(0.7, 0.7), (0.0, 0.0), (None, 1.3)])
def test_the_presets_time_stands_where_the_driver_has_none(own_s, after_s):
    margins = Margins.of(ConflictConfig(after_s=own_s, standoff_m=1.5), 1.3, 6.0)
    assert margins == Margins()._replace(after_s=after_s, standoff_m=1.5, horizon_s=6.0)


def crossing_zone(own_in, other_in, width=6.0, blocked=INF):
    return Zone(own_in, own_in + width, other_in, other_in + width, 0.0, blocked)


def car(speed, rank=Rank.PRIORITY, accel=0.0):
    return Approach(speed, speed, accel, rank)


def waiting(zone, own, other):
    """The wait that there must be."""
    wait = wait_for(zone, own, other, CONFIG)
    assert wait is not None
    return wait


def test_times_of_uniform_accelerated_and_slowing_motion():
    assert time_to_go_s(20.0, 10.0, 10.0, 0.0) == pytest.approx(2.0)
    assert time_to_go_s(8.0, 0.0, 20.0, 4.0) == pytest.approx(2.0)
    assert time_to_go_s(10.0, 0.0, 4.0, 2.0) == pytest.approx(2.0 + 6.0 / 4.0)
    assert time_to_go_s(16.0, 10.0, 10.0, -2.0) == pytest.approx(2.0)
    assert time_to_go_s(26.0, 10.0, 10.0, -2.0) == INF
    assert time_to_go_s(5.0, 0.0, 10.0, 0.0) == INF
    assert time_to_go_s(5.0, 0.0, 0.0, 1.5) == INF
    assert time_to_go_s(0.0, 0.0, 10.0, 0.0) == 0.0
    assert time_to_go_s(INF, 10.0, 10.0, 1.0) == INF


@pytest.mark.parametrize(
    ("way_m", "time_s"),
    [(0.0, 0.0), (11.0, 1.0), (24.0, 2.0), (24.0 + 14.0, 3.0)],
    ids=["there", "gains", "is as fast as it wishes", "goes on"],
)
def test_the_least_time_is_that_of_an_acceleration_up_to_the_most_speed(way_m, time_s):
    assert time_to_go_s(way_m, 10.0, 14.0, 2.0) == pytest.approx(time_s)
    assert time_to_go_s(way_m, 10.0, 10.0, 2.0) == pytest.approx(way_m / 10.0)


@given(st.floats(0.5, 15.0), st.floats(1.0, 80.0), st.floats(0.3, 8.0))
def test_who_brakes_to_be_later_is_at_the_place_when_the_time_is_over_or_stands_before_it(speed, way, time):
    brake = later_brake_mps2(speed, way, time)
    moving = min(time, speed / brake) if brake > 0.0 else time
    covered = speed * moving - 0.5 * brake * moving**2
    assert covered <= way + 1e-6
    assert covered == pytest.approx(min(way, speed * time))


def test_who_has_no_right_of_way_waits_slowly_enough_to_stop():
    zone = crossing_zone(30.0, 25.0)
    wait = waiting(zone, car(12.0, Rank.RED), car(10.0))
    assert wait.speed_mps >= math.sqrt(2.0 * CONFIG.brake_mps2 * (30.0 - CONFIG.standoff_m)) - 1e-9
    clear_s = 31.0 / 10.0 + CONFIG.after_s
    assert 12.0 * clear_s - 0.5 * wait.brake_mps2 * clear_s**2 == pytest.approx(29.0)
    slow = waiting(crossing_zone(30.0, 5.0), car(12.0, Rank.RED), car(1.5))
    assert slow.brake_mps2 == pytest.approx(stop_brake_mps2(12.0, 29.0))
    assert wait_for(zone, car(12.0), car(10.0, Rank.GIVES_WAY), CONFIG) is None


def test_who_cannot_stop_any_more_is_let_through_whatever_the_right_of_way():
    assert wait_for(crossing_zone(14.0, 6.0), car(10.0), car(9.0, Rank.RED), CONFIG) is not None
    assert wait_for(Zone(6.0, 12.0, 30.0, 36.0, 0.0, INF), car(5.0, Rank.RED), car(14.0), CONFIG) is not None
    assert wait_for(crossing_zone(6.0, 20.0), car(9.0, Rank.RED), car(10.0), CONFIG) is None


def test_who_stands_in_the_zone_leaves_it_unless_the_way_is_blocked():
    other = car(6.0)
    assert wait_for(Zone(0.0, 5.0, 8.0, 14.0, 0.0, INF), car(2.0), other, CONFIG) is None
    wait = waiting(Zone(0.0, 8.0, 0.0, 6.0, 0.0, 4.0), car(2.0), other)
    assert wait.free_m == pytest.approx(4.0 - CONFIG.standoff_m)


@pytest.mark.parametrize(("own_in", "slower"), [(22.0, 0.0), (21.5, 0.5), (21.0, 1.0), (20.5, 1.5)])
def test_who_merges_falls_back_to_the_distance_that_is_kept(own_in, slower):
    """1 m behind the other one, at a metre in 1.5 s for each metre that is missing, also where both are level."""
    wait = waiting(Zone(own_in, INF, 20.0, 60.0, 1.0, INF), car(8.0, Rank.GIVES_WAY), car(8.0))
    assert wait.speed_mps == pytest.approx(8.0 - slower / 1.5)
    assert wait.free_m == pytest.approx(max(own_in - 21.0, 0.0))


@pytest.mark.parametrize(
    ("along", "missing_m"), [(0.0, 4.0), (0.9, 4.0), (0.95, 2.0), (1.0, 0.0)], ids=["turns", "25°", "18°", "in line"]
)
def test_who_merges_falls_in_behind_the_rear_of_the_other_one(along, missing_m):
    """Its front is 6 m nearer to the zone, its rear 4 m behind this until it is in line; 1 m is the search's step."""
    other = car(8.0)._replace(length_m=4.0)
    wait = waiting(Zone(26.0, INF, 20.0, 60.0, 1.0, INF, along), car(8.0, Rank.GIVES_WAY), other)
    assert wait.free_m == pytest.approx(5.0 - missing_m)
    assert wait.speed_mps == pytest.approx(math.sqrt(8.0**2 + 2.0 * CONFIG.brake_mps2 * (4.0 - missing_m)))


@pytest.mark.parametrize(("own_m", "waits"), [(0.0, False), (4.0, True)])
def test_a_long_vehicle_does_not_merge_ahead_where_the_other_one_would_have_to_brake_hard(own_m, waits):
    """6 m behind it, at 14 m/s instead of 8, brakes with 3.0 m/s2 in 2.5 s; behind its rear it would need more."""
    own, other = car(8.0, Rank.PRIORITY)._replace(length_m=own_m), car(14.0, Rank.GIVES_WAY)
    zone = Zone(20.0, INF, 20.0 + 9.0, 60.0, 1.0, INF)
    assert (wait_for(zone, own, other, CONFIG) is not None) is waits


@pytest.mark.parametrize(
    ("own_in", "own_mps", "brake"),
    [
        *[(40.0, 11.0, 3.0**2 / (2.0 * 19.0)), (24.5, 11.0, 2.0 * (3.0 * 2.5 - 3.5) / 2.5**2)],
        *[(20.5, 11.0, 2.0 * (3.0 * 2.5 + 0.5) / 2.5**2), (20.5, 7.0, 0.0)],
    ],
    ids=["far", "near", "beside", "slower"],
)
def test_who_has_to_fall_in_brakes_until_the_other_one_merges(own_in, own_mps, brake):
    """The other one, at 8 m/s, is 20 m from the zone: 2.5 s."""
    wait = waiting(Zone(own_in, INF, 20.0, 60.0, 1.0, INF), car(own_mps, Rank.RED), car(8.0))
    assert wait.brake_mps2 == pytest.approx(brake)


@pytest.mark.parametrize(
    ("own_m", "other_m", "waits"), [(4.0, 12.0, False), (12.0, 4.0, True), (4.0, 4.0, True)], ids=str
)
def test_of_two_long_vehicles_that_merge_side_by_side_the_one_that_needs_less_braking_falls_in(own_m, other_m, waits):
    """Both would have to brake with more than 3 m/s2 to fall in: the longer the other one is, the harder."""
    own, other = (car(12.0)._replace(length_m=length_m) for length_m in (own_m, other_m))
    zone = Zone(15.0, INF, 15.0, 60.0, 1.0, INF)
    assert (wait_for(zone, own, other, CONFIG) is not None) is waits
    assert wait_for(Zone(15.0, INF, 0.0, 60.0, 1.0, INF), own, other, CONFIG) is not None, "it is there"


def test_who_merges_brakes_to_the_other_ones_speed_and_need_not_be_able_to_stop():
    """From 10 to 8 m/s within 1 m: 2 m/s². A stop before the zone would take 3.6 m/s²."""
    own, other = car(10.0, Rank.GIVES_WAY), car(8.0)
    assert wait_for(Zone(15.0, INF, 12.0, 60.0, 1.0, INF), own, other, CONFIG) is not None
    assert wait_for(Zone(15.0, 21.0, 12.0, 18.0, 0.0, INF), own, other, CONFIG) is None


def mirrored(zone):
    return Zone(zone.other_in_m, zone.other_out_m, zone.own_in_m, zone.own_out_m, zone.along, INF)


@given(
    ways=st.tuples(st.floats(1.0, 60.0), st.floats(1.0, 60.0)),
    speeds=st.tuples(st.floats(0.5, 15.0), st.floats(0.5, 15.0)),
    ranks=st.tuples(st.sampled_from(Rank), st.sampled_from(Rank)),
)
def test_of_two_that_would_meet_at_least_one_waits(ways, speeds, ranks):
    zone = crossing_zone(*ways)
    first, second = car(speeds[0], ranks[0]), car(speeds[1], ranks[1])
    arrivals = [(way / speed, (way + 6.0) / speed) for way, speed in zip(ways, speeds, strict=True)]
    meet = arrivals[0][0] < arrivals[1][1] and arrivals[1][0] < arrivals[0][1]
    soon = max(arrival for arrival, _ in arrivals) < CONFIG.horizon_s
    both_red = ranks == (Rank.RED, Rank.RED)
    if meet and soon and not both_red and ways[0] / speeds[0] != ways[1] / speeds[1]:
        waits = [wait_for(zone, first, second, CONFIG), wait_for(mirrored(zone), second, first, CONFIG)]
        assert any(wait is not None for wait in waits)


@pytest.mark.parametrize(
    ("closing", "gap", "time", "brake"),
    [
        *[(4.0, 8.0, 8.0, 1.0), (4.0, 8.0, INF, 1.0), (-1.0, -2.0, INF, 0.0), (4.0, 20.0, 8.0, 0.375)],
        *[(0.0, -2.0, 2.0, 1.0), (-3.0, -4.0, 2.0, 0.0), (5.0, 30.0, 2.0, 0.0)],
    ],
)
def test_braking_to_fall_in_behind(closing, gap, time, brake):
    assert fall_in_brake_mps2(closing, gap, time) == pytest.approx(brake)


@pytest.mark.parametrize(("own_in", "waits"), [(4.8, False), (7.1, True)])
def test_at_a_merge_who_is_ahead_goes_first_where_the_other_one_can_fall_in(own_in, waits):
    """The other one, with 8 m to go at 5.8 m/s, cannot stop gently, but is behind already; or it is level."""
    other = car(5.8)
    assert stop_brake_mps2(5.8, 8.0 - CONFIG.standoff_m) > CONFIG.brake_mps2
    wait = wait_for(Zone(own_in, 16.0, 8.0, 22.0, 0.96, INF), car(5.0), other, CONFIG)
    assert (wait is not None) is waits


@pytest.mark.parametrize(("bend_s", "waits"), [(1.0, False), (4.0, True)])
def test_who_has_a_bend_ahead_arrives_later_than_its_speed_says(bend_s, waits):
    """30 m at 10 m/s and 35 m at 10 m/s, of equal rank: without the bend the own vehicle is first."""
    own = Approach(10.0, 10.0, 0.0, Rank.PRIORITY, Bends(np.array([0.0, bend_s / 30.0]), 1.0, 0.0))
    assert approach_time_s(own, 30.0) == pytest.approx(max(3.0, bend_s))
    assert (wait_for(crossing_zone(30.0, 35.0), own, car(10.0), CONFIG) is not None) is waits


def test_waiting_speeds_in_closed_form():
    """The larger of a gentle stop's speed and of arriving when the other one has left."""
    zone = crossing_zone(30.0, 5.0)
    wait = wait_for(zone, car(12.0, Rank.RED), car(4.0), CONFIG)
    free, free_s = 30.0 - CONFIG.standoff_m, 11.0 / 4.0 + CONFIG.after_s
    assert wait.free_m == pytest.approx(free)
    assert wait.speed_mps == pytest.approx(max(free / free_s, math.sqrt(2.0 * CONFIG.brake_mps2 * free)))
    merging = wait_for(Zone(40.0, INF, 20.0, 60.0, 1.0, INF), car(12.0, Rank.GIVES_WAY), car(8.0), CONFIG)
    gap = 40.0 - 20.0 - STEP_M
    assert merging.free_m == pytest.approx(gap)
    spare = gap - CONFIG.standoff_m
    assert merging.speed_mps == pytest.approx(math.sqrt(8.0**2 + 2.0 * CONFIG.brake_mps2 * spare))
    assert merging.brake_mps2 == pytest.approx(stop_brake_mps2(4.0, gap))


def test_more_room_is_kept_by_gentle_braking_alone():
    """The speed is that of a wait farther before the zone; how hard one must brake, and what is free, stay."""
    zone = crossing_zone(30.0, 5.0)
    near, far = (wait_for(zone, car(12.0, Rank.RED), car(4.0), CONFIG._replace(room_m=room)) for room in (0.0, 2.0))
    wanted, free_s = 28.0 - CONFIG.standoff_m, 11.0 / 4.0 + CONFIG.after_s
    assert far.speed_mps == pytest.approx(max(wanted / free_s, math.sqrt(2.0 * CONFIG.brake_mps2 * wanted)))
    assert (far.brake_mps2, far.free_m) == (near.brake_mps2, near.free_m)


@pytest.mark.parametrize(("way", "speed", "stops"), [(16.1, 9.0, True), (13.9, 9.0, False)])
def test_who_would_have_to_brake_harder_than_3_mps2_goes_on(way, speed, stops):
    """From 9 m/s a stop at 3 m/s² takes 13.5 m, and a metre is kept."""
    zone = crossing_zone(way, way - 1.0)
    other = wait_for(mirrored(zone), car(speed, Rank.PRIORITY), car(speed, Rank.RED), CONFIG)
    assert (other is None) is stops


@pytest.mark.parametrize(
    ("own_m", "other_m", "other_mps", "waits"),
    [
        *[(0.9, 6.0, 8.0, False), (1.1, 6.0, 8.0, True), (0.9, 4.1, 8.0, False), (0.9, 3.9, 8.0, True)],
        (0.9, -CONFIG.standoff_m, 2.0, True),
    ],
    ids=["the other one can", "both can", "the other one just can", "nobody can", "the other one is there"],
)
def test_of_two_who_cross_who_cannot_stop_by_an_emergency_brake_goes_on_where_the_other_one_can(
    own_m, other_m, other_mps, waits
):
    """At 8 m/s² a stop takes 1 m from 4 m/s and 4 m from 8 m/s; a metre more is kept, and 3 m/s² would not do."""
    zone = crossing_zone(own_m + CONFIG.standoff_m, other_m + CONFIG.standoff_m)
    assert (wait_for(zone, car(4.0, Rank.RED), car(other_mps), CONFIG) is not None) is waits
    wait = wait_for(mirrored(zone), car(other_mps), car(4.0, Rank.RED), CONFIG)
    assert (wait is not None) is (other_m > 0.0)


@pytest.mark.parametrize(
    ("own", "other", "own_in", "waits"),
    [
        *[(Rank.GIVES_WAY, Rank.PRIORITY, 30.0, True), (Rank.PRIORITY, Rank.GIVES_WAY, 30.0, False)],
        *[(Rank.PRIORITY, Rank.PRIORITY, 29.0, False), (Rank.PRIORITY, Rank.PRIORITY, 31.0, True)],
        *[(Rank.RED, Rank.RED, 31.0, False), (Rank.STOP_SIGN, Rank.CLEARING, 29.0, True)],
        (Rank.CLEARING, Rank.STOP_SIGN, 31.0, False),
    ],
)
def test_the_rank_decides_and_among_equals_who_comes_first(own, other, own_in, waits):
    """Both at 10 m/s and able to stop; the other one has 30 m to the zone."""
    assert (wait_for(crossing_zone(own_in, 30.0), car(10.0, own), car(10.0, other), CONFIG) is not None) is waits


def test_who_merges_stays_behind_however_late_it_comes():
    """The other one leaves the place where the ways meet, but not the way."""
    for own_in in (30.0, 60.0, 100.0):
        zone = Zone(own_in, INF, 5.0, 11.0, 1.0, INF)
        assert wait_for(zone, car(10.0, Rank.GIVES_WAY), car(8.0), CONFIG) is not None
        assert wait_for(zone._replace(along=0.0), car(10.0, Rank.GIVES_WAY), car(8.0), CONFIG) is None


@pytest.mark.parametrize("own_in", [0.2, 0.9, 1.0])
def test_nearer_than_the_distance_that_is_kept_one_waits_where_one_is(own_in):
    wait = waiting(crossing_zone(own_in, 10.0), car(0.5, Rank.RED), car(8.0))
    assert (wait.speed_mps, wait.free_m) == (0.0, 0.0)
    assert wait.brake_mps2 == stop_brake_mps2(0.5, 0.0)


@pytest.mark.parametrize(
    ("zone", "own", "other", "waits"),
    [
        # Nobody waits for a vehicle that stands, comes late, is gone in time or can stop at a red signal.
        (crossing_zone(35.0, 25.0), car(12.0, Rank.RED), car(0.0), False),
        (crossing_zone(35.0, 80.0), car(12.0, Rank.RED), car(8.0), False),
        (crossing_zone(35.0, 5.0), car(12.0, Rank.RED), car(14.0), False),
        (crossing_zone(35.0, 30.0), car(12.0, Rank.RED), car(10.0, Rank.RED), False),
        # From 6 m/s with 2 m/s² a vehicle stands after 9 m: out of touch in each case, a metre away only in the last.
        (crossing_zone(9.1, 16.0), car(6.0, Rank.GIVES_WAY, accel=-2.0), car(8.0), True),
        (crossing_zone(9.9, 16.0), car(6.0, Rank.GIVES_WAY, accel=-2.0), car(8.0), True),
        (crossing_zone(10.1, 16.0), car(6.0, Rank.GIVES_WAY, accel=-2.0), car(8.0), False),
        # At 5 m/s the zone of 6 m is left after 5.98 s or 6.02 s; the other vehicle comes after 7 s, a second is kept.
        (crossing_zone(23.9, 70.0), car(5.0, Rank.RED), car(10.0), False),
        (crossing_zone(24.1, 70.0), car(5.0, Rank.RED), car(10.0), True),
        # The other vehicle leaves after (20 + 6) / 10 = 2.6 s; 0.4 s later nobody waits for it.
        (crossing_zone(29.9, 20.0), car(10.0, Rank.RED), car(10.0), True),
        (crossing_zone(30.1, 20.0), car(10.0, Rank.RED), car(10.0), False),
        # A vehicle that stands in the zone leaves it at 0.5 m/s at the earliest, the own one comes after 2.5 s.
        # One that stands before the zone stays there.
        (Zone(25.0, 31.0, 0.0, 6.0, 0.0, INF), car(10.0, Rank.RED), car(0.0), True),
        (Zone(25.0, 31.0, 0.1, 6.0, 0.0, INF), car(10.0, Rank.RED), car(0.0), False),
        (Zone(25.0, 31.0, 5.0, 6.0, 0.0, INF), car(10.0, Rank.RED), car(0.0), False),
        # Faster than the limit: 20 m and 6 m at the limit of 8 m/s take 3.25 s, and 0.4 s more; at 12 m/s 2.2 s.
        (crossing_zone(36.0, 20.0), car(10.0, Rank.RED), Approach(12.0, 8.0, 0.0, Rank.PRIORITY), True),
        (crossing_zone(37.0, 20.0), car(10.0, Rank.RED), Approach(12.0, 8.0, 0.0, Rank.PRIORITY), False),
        # A vehicle that comes later than in 8 s does not count yet.
        (Zone(78.0, 86.0, 79.0, 85.0, 0.0, INF), car(10.0, Rank.RED), car(10.0), True),
        (Zone(78.0, 86.0, 81.0, 87.0, 0.0, INF), car(10.0, Rank.RED), car(10.0), False),
        # A creeping vehicle leaves the zone at 0.5 m/s, though it rolls at 0.1 m/s: 0.75 m take 1.5 s, and 0.4 s more.
        (Zone(18.0, 24.0, -1.0, 0.75, 0.0, INF), car(10.0, Rank.RED), car(0.1), True),
        (Zone(20.0, 26.0, -1.0, 0.75, 0.0, INF), car(10.0, Rank.RED), car(0.1), False),
        # Both merge at 10 m/s, the other vehicle has the right of way and 10 m to go. It goes first where it would
        # have to brake harder than 3 m/s² to fall in: in 1 s a gap of 1.5 m can be opened.
        (Zone(9.0, 30.0, 10.0, 30.0, 1.0, INF), car(10.0, Rank.GIVES_WAY), car(10.0), False),
        (Zone(10.5, 30.0, 10.0, 30.0, 1.0, INF), car(10.0, Rank.GIVES_WAY), car(10.0), True),
        # Who brakes and stands after 9 m comes to a merge in 8.5 m before the other vehicle, and not to one in 9.5 m.
        (Zone(8.5, 30.0, 70.0, 90.0, 1.0, INF), car(6.0, Rank.GIVES_WAY, accel=-2.0), car(10.0), False),
        (Zone(9.5, 30.0, 70.0, 90.0, 1.0, INF), car(6.0, Rank.GIVES_WAY, accel=-2.0), car(10.0), True),
    ],
)
def test_waiting_in_time_and_space(zone, own, other, waits):
    assert (wait_for(zone, own, other, CONFIG) is not None) is waits


NETWORK = crossing()
ROOM = JunctionRoom(NETWORK)
EDGE_M = 14.75 - 0.5 * 3.5 - 1.0
"""A metre before the way of those who go east."""


def lights(east):
    state = ["r"] * 7
    state[EAST] = east
    return {"J": "".join(state)}


@pytest.mark.parametrize("movement", [STRAIGHT, STRAIGHT_LEFT])
@pytest.mark.parametrize("east", "Ggy")
def test_the_room_ends_a_metre_before_the_way_of_those_who_may_come(movement, east):
    room_m = ROOM.beyond_line_m(NETWORK.connections[movement], lights(east), frozenset())
    assert EDGE_M < room_m <= EDGE_M + 0.5, "the ways are looked at each half a metre"


@pytest.mark.parametrize("order", [(STRAIGHT, RIGHT), (RIGHT, STRAIGHT)])
def test_each_movement_from_a_lane_has_a_room_of_its_own(order):
    room, on_junction = JunctionRoom(NETWORK), frozenset(NETWORK.connections[EAST].via)
    found = [room.beyond_line_m(NETWORK.connections[one], lights("r"), on_junction) for one in order]
    alone = [JunctionRoom(NETWORK).beyond_line_m(NETWORK.connections[one], lights("r"), on_junction) for one in order]
    assert found == alone
    assert found[0] != found[1]


def test_nobody_comes_where_all_others_have_red_and_nobody_is_on_the_junction():
    assert ROOM.beyond_line_m(NETWORK.connections[STRAIGHT], lights("r"), frozenset()) == math.inf
    inside = frozenset(NETWORK.connections[EAST].via)
    assert EDGE_M < ROOM.beyond_line_m(NETWORK.connections[STRAIGHT], lights("r"), inside) <= EDGE_M + 0.5


def test_at_the_left_of_its_lane_a_turning_vehicle_is_sooner_in_the_way_of_those_who_are_on_the_junction():
    right, inside = NETWORK.connections[RIGHT], frozenset(NETWORK.connections[EAST].via)
    room = JunctionRoom(NETWORK)
    left, middle, edge = (room.beyond_line_m(right, lights("r"), inside, side=side) for side in (1, 0, -1))
    assert left < middle - 0.5 < edge - 1.0
    assert {room.beyond_line_m(right, lights("G"), frozenset(), side=side) for side in (1, 0, -1)} == {middle}


def test_the_same_approach_and_ways_that_do_not_meet_leave_room():
    own = frozenset(NETWORK.connections[STRAIGHT_LEFT].via)
    assert ROOM.beyond_line_m(NETWORK.connections[STRAIGHT], lights("r"), own) == math.inf
    beside = {"J": "rrrrrGG"}
    assert ROOM.beyond_line_m(NETWORK.connections[STRAIGHT], beside, frozenset()) == math.inf


def test_of_those_who_may_come_the_first_one_on_the_way_counts():
    """On the way east: SOUTH at 6 m, STRAIGHT_LEFT at 9.5 m, STRAIGHT at 13 m. Nobody comes from a quiet lane."""
    east, lane_of = NETWORK.connections[EAST], [one.from_lane for one in NETWORK.connections]
    south, left = lane_of[SOUTH], lane_of[STRAIGHT_LEFT]
    on_junction = frozenset(NETWORK.connections[SOUTH].via)
    for quiet, occupied, room_m in (
        *[((), (), 6.0), ((south,), (), 9.5), ((south, left), (), 13.0)],
        *[((south,), on_junction, 6.0), ((south, left, lane_of[STRAIGHT]), (), 21.5)],
    ):
        assert ROOM.beyond_line_m(east, {"J": "G" * 7}, frozenset(occupied), frozenset(quiet)) == pytest.approx(room_m)


def test_lanes_for_emvs_alone_ask_for_no_room():
    on_shoulder = frozenset(NETWORK.connections[SHOULDER_RIGHT].via)
    for state, room_m in (("r", math.inf), ("G", 10.5)):
        room = ROOM.beyond_line_m(NETWORK.connections[BESIDE], {"J": state * 7}, on_shoulder)
        assert room == pytest.approx(room_m)
