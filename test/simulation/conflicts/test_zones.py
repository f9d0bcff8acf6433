"""Where two ways meet, against ways whose crossing is known; every case also turned in the plane."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_episode import rotate

from siren_ros.simulation.conflicts.zones import (
    STEP_M,
    Way,
    Ways,
    Zone,
    next_touch,
    off_course,
    pose_after,
    pose_at,
    way_bounds,
    way_poses,
    zones_of,
)

TURNS = [0.0, np.radians(30.0), np.radians(45.0), np.radians(60.0)]
LENGTH, WIDTH = 2.25, 0.9


def meeting_zones(own, others, pairs, leads=True):
    """The zone of each pair, None where they do not meet."""
    return [Zone(*row[1:]) if row[0] > 0.0 else None for row in zones_of(own, others, pairs, leads).tolist()]


def way(start, heading, reach=60.0, turn=0.0, left=0.0, length=120.0, look=0.0):
    s = np.arange(0.0, length, 1.0)
    points = np.asarray(start, dtype=float) + s[:, None] * np.array([np.cos(heading), np.sin(heading)])
    x, y = points[0] + left * np.array([-np.sin(heading), np.cos(heading)])
    pose = (*rotate(np.array([x, y]), turn), heading + turn + look)
    return Way(rotate(points, turn), 1.0, 0.0, left, pose, reach, LENGTH, WIDTH)


def zones(own, others, margin=0.0):
    wide = own._replace(half_width_m=own.half_width_m + margin)
    pairs = np.array([(0, number) for number in range(len(others))])
    return meeting_zones(Ways.of([wide]), Ways.of(others), pairs)


def only(own, other, margin=0.0):
    (zone,) = zones(own, [other], margin)
    return zone


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("heading", [np.pi / 2.0, -np.pi / 2.0])
def test_straight_ways_that_cross_at_a_right_angle(turn, heading):
    own = way((0.0, 0.0), 0.0, turn=turn)
    other = way((30.0, -20.0 * np.sign(heading)), heading, turn=turn)
    zone = only(own, other)
    reach = LENGTH + WIDTH
    assert zone[:4] == pytest.approx((30.0 - reach, 30.0 + reach, 20.0 - reach, 20.0 + reach), abs=STEP_M)
    assert zone.along == pytest.approx(0.0, abs=1e-6)
    assert np.isinf(zone.blocked_m)
    assert not zone.merges


@pytest.mark.parametrize("turn", TURNS)
def test_ways_side_by_side_meet_only_within_the_margin(turn):
    own, other = way((0.0, 0.0), 0.0, turn=turn), way((0.0, 2.0), 0.0, turn=turn)
    assert only(own, other, margin=0.1) is None
    assert only(own, other, margin=0.3) is not None
    assert only(way((0.0, 0.0), 0.0, turn=turn, left=0.3), other, margin=0.0) is not None


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("reach", [10.0, 60.0])
def test_who_is_ahead_on_the_same_way_leads(turn, reach):
    zone = only(way((0.0, 0.0), 0.0, turn=turn), way((20.0, 0.3), 0.0, reach=reach, turn=turn))
    assert zone.leads
    assert zone.merges
    assert not only(way((20.0, 0.0), 0.0, turn=turn), way((0.0, 0.0), 0.0, turn=turn)).leads
    assert not only(way((0.0, 0.0), 0.0, turn=turn), way((20.0, -1.0), np.pi / 2.0, turn=turn)).leads


def test_nobody_is_met_by_nobody():
    own = Ways.of([way((0.0, 0.0), 0.0)])
    assert meeting_zones(own, own, np.empty((0, 2), dtype=np.intp)) == []


def test_of_several_bodies_the_asked_pairs_are_looked_at():
    """Of three ways the first and the second cross the third; each pair is asked alone and all are asked together."""
    ways = [way((0.0, 0.0), 0.0), way((0.0, 30.0), 0.0), way((30.0, -20.0), np.pi / 2.0)]
    together = meeting_zones(Ways.of(ways), Ways.of(ways), np.array([(0, 2), (1, 2), (2, 0), (0, 1)]))
    assert together == [only(ways[0], ways[2]), only(ways[1], ways[2]), only(ways[2], ways[0]), None]
    assert together[0] is not None


@pytest.mark.parametrize("turn", TURNS)
def test_a_body_that_stands_at_an_angle_reaches_into_the_next_way(turn):
    own = way((0.0, 0.0), 0.0, turn=turn)
    assert only(own, way((15.0, 2.0), 0.0, turn=turn, reach=0.0)) is None
    zone = only(own, way((15.0, 2.0), 0.0, turn=turn, reach=0.0, look=np.radians(-15.0)))
    assert zone.blocked_m == pytest.approx(15.0 - LENGTH, abs=3.0)


@pytest.mark.parametrize("turn", TURNS)
def test_bodies_of_different_sizes_each_count_with_their_own(turn):
    """The own body is 4.5 m by 1.8 m, the other one 8 m by 2.4 m."""
    own = way((0.0, 0.0), 0.0, turn=turn)
    other = way((30.0, -20.0), np.pi / 2.0, turn=turn)._replace(half_length_m=4.0, half_width_m=1.2)
    zone = only(own, other, margin=0.5)
    own_reach, other_reach = LENGTH + 1.2, 4.0 + WIDTH + 0.5
    expected = (30.0 - own_reach, 30.0 + own_reach, 20.0 - other_reach, 20.0 + other_reach)
    assert zone[:4] == pytest.approx(expected, abs=STEP_M)
    narrow = way((0.0, 2.2), 0.0, turn=turn)._replace(half_width_m=1.2)
    assert only(own, narrow) is None
    assert only(own, narrow, margin=-0.2) is None
    assert only(own, way((0.0, 2.0), 0.0, turn=turn)._replace(half_width_m=1.2)) is not None
    assert only(own._replace(half_width_m=1.2), way((0.0, 2.0), 0.0, turn=turn)) is not None


@pytest.mark.parametrize("turn", TURNS)
def test_a_course_is_followed_from_its_first_segment_on(turn):
    """It leads 1 m to the left and then on ahead; a body at its start and before it stands across."""
    points = rotate(np.array([[0.0, 0.0], [0.0, 1.0], *([float(x), 1.0] for x in range(1, 60))]), turn)
    pose = (*rotate(np.zeros(2), turn), np.pi / 2.0 + turn)
    bent = Way(points, 1.0, -3.0, 0.0, (*rotate(np.array([0.0, -3.0]), turn), pose[2]), 0.0, LENGTH, WIDTH)
    beside = way((1.9, -3.0), np.pi / 2.0, reach=0.0, turn=turn)
    assert only(bent, beside) is None
    assert only(bent, way((1.7, -3.0), np.pi / 2.0, reach=0.0, turn=turn)) is not None
    assert only(bent, way((0.0, 1.7), np.pi / 2.0, reach=0.0, turn=turn)) is None
    assert only(bent, way((0.0, 1.3), np.pi / 2.0, reach=0.0, turn=turn)) is not None


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("ahead", [0.0, 0.3, 0.6])
def test_entries_are_found_to_an_eighth_of_a_step(turn, ahead):
    """The other body crosses 30 m ahead, or stands there already."""
    own = way((0.0, 0.0), 0.0, turn=turn)
    touch = 30.0 + ahead - LENGTH - WIDTH
    for other in (way((30.0 + ahead, -20.0), np.pi / 2.0, turn=turn), way((30.0 + ahead, 1.0), 0.5 * np.pi, turn=turn)):
        assert touch - STEP_M / 8.0 - 1e-6 <= only(own, other).own_in_m <= touch + 1e-6
    assert touch - STEP_M / 8.0 - 1e-6 <= only(own, other).blocked_m <= touch + 1e-6


def test_an_oncoming_body_does_not_merge_and_blocks_where_it_is_now_and_not_where_it_drives():
    zone = only(way((0.0, 0.0), 0.0), way((50.3, 0.0), np.pi))
    assert not zone.merges
    assert zone.along == pytest.approx(-1.0)
    assert 45.8 - STEP_M / 8.0 - 1e-6 <= zone.blocked_m <= 45.8 + 1e-6


def test_who_is_touched_now_is_blocked_at_once():
    zone = only(way((0.0, 0.0), 0.0), way((2.0, 1.0), 0.0, reach=0.0))
    assert (zone.own_in_m, zone.blocked_m) == (pytest.approx(0.0), pytest.approx(0.0))


def test_a_body_that_drives_into_the_way_later_does_not_block_it_now():
    """The standing body and the place where it blocks count alone; its way leads away along the own one."""
    own = way((0.0, 0.0), 0.0)
    s = np.arange(0.0, 80.0, 1.0)
    points = np.stack((20.0 + np.maximum(s - 10.0, 0.0), np.maximum(10.0 - s, 0.0)), axis=-1)
    zone = only(own, Way(points, 1.0, 0.0, 0.0, (20.0, 10.0, -0.5 * np.pi), 60.0, LENGTH, WIDTH))
    assert np.isinf(zone.blocked_m)
    assert not zone.leads
    assert zone.merges


@pytest.mark.parametrize(
    ("heading", "cosine"), [(0.0, 1.0), (np.radians(30.0), np.cos(np.radians(30.0))), (np.pi, -1.0)]
)
def test_the_cosine_of_a_block_is_that_of_the_two_bodies_there(heading, cosine):
    standing = way((20.0, 0.0), heading, reach=0.0)
    assert only(way((0.0, 0.0), 0.0), standing).blocked_along == pytest.approx(cosine, abs=1e-6)


@pytest.mark.parametrize("turn", TURNS)
def test_ways_of_two_others_do_not_mix(turn):
    """Each other body has its own course and its own row."""
    own = way((0.0, 0.0), 0.0, turn=turn)
    others = [
        way((30.0, -20.0), np.pi / 2.0, turn=turn, length=60.0),
        way((0.0, 10.0), 0.0, turn=turn),
        way((15.0, 25.0), -np.pi / 2.0, turn=turn, length=50.0),
    ]
    first, none, last = zones(own, others)
    assert none is None
    assert (first, last) == (only(own, others[0]), only(own, others[2]))
    assert last.own_in_m == pytest.approx(15.0 - LENGTH - WIDTH, abs=STEP_M / 4.0)
    assert last.other_in_m == pytest.approx(25.0 - LENGTH - WIDTH, abs=STEP_M)


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("beyond", [15.0, 15.4])
def test_behind_a_bend_entries_are_as_exact_as_before_it(turn, side, beyond):
    """20 m ahead and then 45° to one side; another one stands across the second leg."""
    angle = side * np.radians(45.0)
    leg = np.array([np.cos(angle), np.sin(angle)])
    points = np.concatenate(
        (np.stack((np.arange(20.0), np.zeros(20)), axis=-1), [20.0, 0.0] + np.arange(41.0)[:, None] * leg)
    )
    own = Way(rotate(points, turn), 1.0, 0.0, 0.0, (*rotate(np.zeros(2), turn), turn), 55.0, LENGTH, WIDTH)
    standing = way(np.array([20.0, 0.0]) + beyond * leg, angle + np.pi / 2.0, reach=0.0, turn=turn)
    touch = 20.0 + beyond - LENGTH - WIDTH
    zone = only(own, standing)
    for entry in (zone.own_in_m, zone.blocked_m):
        assert touch - STEP_M / 8.0 - 1e-6 <= entry <= touch + 1e-6


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("left", [0.0, 0.8, -0.8])
@pytest.mark.parametrize("spacing", [1.0, 0.5])
@pytest.mark.parametrize("cut", [2.5, 0.0])
def test_a_body_turns_into_a_corner_late_and_cuts_it_or_not(turn, left, spacing, cut):
    """At a right angle to the left after 20 m: a body points along a chord of 5 m whose middle is 1.25 m behind its
    own; that is in the middle of another one, or on the course.
    """
    legs = np.arange(0.0, 20.0, spacing)
    points = np.concatenate((np.stack((legs, 0.0 * legs), -1), np.stack((20.0 + 0.0 * legs, legs), -1)))
    points = rotate(points, turn)
    for s, cutting, on_course, heading in (
        (10.0, (10.0, 0.0), (10.0, 0.0), 0.0),
        (20.0, (18.75, 1.25), (20.0, 0.0), np.arctan2(1.25, 3.75)),
        (21.5, (19.5, 2.0), (20.0, 1.5), np.arctan2(2.75, 2.25)),
        (30.0, (20.0, 10.0), (20.0, 10.0), np.pi / 2.0),
        (-5.0, (-5.0, 0.0), (-5.0, 0.0), 0.0),
        (45.0, (20.0, 25.0), (20.0, 25.0), np.pi / 2.0),
    ):
        x, y, cos, sin = pose_at(points, 0, len(points), spacing, s, left, cut)
        expected = np.array(cutting if cut > 0.0 else on_course) + left * np.array([-np.sin(heading), np.cos(heading)])
        assert rotate(np.array([x, y]), -turn) == pytest.approx(expected, abs=1e-6)
        assert np.arctan2(sin, cos) == pytest.approx(
            np.arctan2(np.sin(heading + turn), np.cos(heading + turn)), abs=1e-6
        )


@pytest.mark.parametrize("half_m", [2.2, 6.0])
def test_a_body_whose_ends_are_on_a_circle_is_within_it_by_the_height_of_the_arc(half_m):
    """SUMO's buses: the middle of one of 12 m is 1.2 m within a circle of 15 m."""
    arc = np.arange(0.0, 40.0, 0.25) / 15.0
    points = 15.0 * np.stack((np.sin(arc), 1.0 - np.cos(arc)), axis=-1)
    x, y, *_ = pose_at(points, 0, len(points), 0.25, 20.0, 0.0, half_m)
    assert 15.0 - np.hypot(x, y - 15.0) == pytest.approx(15.0 * (1.0 - np.cos(half_m / 15.0)), abs=0.01)


@pytest.mark.parametrize("turn", [*TURNS, 3.0, -2.0])
@pytest.mark.parametrize(("aside", "look"), [(0.9, 0.4), (-0.9, -0.4), (0.5, -0.3)])
def test_what_a_body_differs_from_its_course_fades_within_6_m(turn, aside, look):
    """Evenly with the way, aside and in yaw, also for a yaw that is given within half a turn."""
    points = rotate(np.stack((np.arange(60.0), np.zeros(60)), axis=-1), turn)
    place = rotate(np.array([10.0, aside]), turn)
    yaw = np.arctan2(np.sin(turn + look), np.cos(turn + look))
    ways = Ways.of([Way(points, 1.0, 10.0, 0.0, (*place, yaw), 30.0, LENGTH, WIDTH)])
    for way_m, left in ((0.0, 1.0), (1.5, 0.75), (3.0, 0.5), (5.99, 0.01 / 6.0), (6.01, 0.0), (20.0, 0.0)):
        x, y, cos, sin = pose_after(ways, 0, off_course(ways, 0), way_m)
        assert rotate(np.array([x, y]), -turn) == pytest.approx((10.0 + way_m, left * aside), abs=1e-5)
        turned = np.arctan2(sin, cos) - turn
        assert np.arctan2(np.sin(turned), np.cos(turned)) == pytest.approx(left * look, abs=1e-5)


@pytest.mark.parametrize(("ahead", "aside", "touches"), [(3.99, 2.59, True), (3.99, -2.59, True), (4.01, 2.59, False)])
def test_wide_bodies_touch_with_their_corners(ahead, aside, touches):
    """Two of 4 m by 2.6 m; nearer than their outer circles they are looked at as boxes."""
    theirs = np.array([[ahead, aside, 1.0, 0.0], [ahead + 30.0, aside, 1.0, 0.0]])
    own, sizes = (0.0, 0.0, 1.0, 0.0), (2.0, 1.3, 2.0, 1.3)
    assert next_touch(own, theirs, sizes, 0) == (0 if touches else 2)
    assert next_touch(own, theirs, sizes, 1) == 2


@pytest.mark.parametrize("aside", [0.0, 1.5, 40.0])
def test_of_one_who_leads_only_the_place_counts_where_no_more_is_asked(aside):
    """One ahead on the same way, one that crosses it, one far away: ``leads`` changes only what the first one's has."""
    own = Ways.of([way((0.0, 0.0), 0.0)])
    others = Ways.of([way((20.0, aside), 0.0), way((30.0, -30.0), np.pi / 2.0), way((200.0, 200.0), 0.0)])
    pairs = np.array([[0, 0], [0, 1], [0, 2]])
    full, short = meeting_zones(own, others, pairs), meeting_zones(own, others, pairs, leads=False)
    assert full[1:] == short[1:]
    assert (full[0] is None) == (short[0] is None) == (aside > 2.0)
    if full[0] is not None:
        assert full[0].leads
        assert short[0][5:] == full[0][5:]
        assert short[0].other_out_m != full[0].other_out_m


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_who_is_ahead_leads_although_it_will_turn_off(turn, side):
    """20 m ahead on the same way, and 10 m farther it turns to one side: what counts is how it points now."""
    first = np.stack((np.arange(20.0, 30.0), np.zeros(10)), axis=-1)
    then = np.stack((np.full(50, 30.0), side * np.arange(50.0)), axis=-1)
    points = rotate(np.concatenate((first, then)), turn)
    other = Way(points, 1.0, 0.0, 0.0, (*rotate(np.array([20.0, 0.0]), turn), turn), 50.0, LENGTH, WIDTH)
    zone = only(way((0.0, 0.0), 0.0, turn=turn), other)
    assert zone.blocked_along == pytest.approx(1.0, abs=1e-6)
    assert zone.leads
    assert zone.other_in_m == 0.0
    assert zone.blocked_m == pytest.approx(20.0 - 2.0 * LENGTH, abs=STEP_M / 4.0)


@given(
    turn=st.floats(-np.pi, np.pi),
    left=st.floats(-3.0, 3.0),
    look=st.floats(-1.0, 1.0),
    place=st.floats(-10.0, 150.0),
    bend_1pm=st.floats(-0.1, 0.1),
)
def test_no_edge_of_a_body_comes_beyond_the_bounds_of_its_way(turn, left, look, place, bend_1pm):
    """On circles, also before their beginning and after their end, and beside them."""
    angles = bend_1pm * np.arange(100.0)
    points = np.cumsum(np.stack((np.cos(angles), np.sin(angles)), axis=-1), axis=0)
    pose = *rotate(points[min(max(int(place), 0), 99)] + left, turn), look + turn
    ways = Ways.of([Way(rotate(points, turn), 1.0, place, left, pose, 40.0, LENGTH, WIDTH)])
    used = np.array([0])
    (x, y, *_), (low_x, high_x, low_y, high_y) = way_poses(ways, used)[0].T, way_bounds(ways, used)[0]
    radius = np.hypot(LENGTH, WIDTH)
    assert low_x <= x.min() - radius
    assert x.max() + radius <= high_x
    assert low_y <= y.min() - radius
    assert y.max() + radius <= high_y
    aside = np.hypot(x[0] - x, y[0] - y).max() + 20.0
    assert max(high_x - low_x, high_y - low_y) < 2.0 * aside + 60.0
