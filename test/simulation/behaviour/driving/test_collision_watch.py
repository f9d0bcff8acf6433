"""Who leads on a path, how far away and how fast; on paths that point anywhere."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from siren_ros.simulation.behaviour.driving.collision_watch import CollisionWatch, stricter
from siren_ros.simulation.behaviour.driving.navigator import SpeedLimit
from siren_ros.simulation.behaviour.driving.step_view import Surroundings
from siren_ros.simulation.behaviour.driving.tracked_path import Curve, Navigation, TrackedPath
from siren_ros.simulation.conflicts.course import SPACING_M, Course, Rights
from siren_ros.simulation.conflicts.yielding import Rank
from siren_ros.simulation.conflicts.zones import Way, Ways

CONFIG = Navigation()
TURNS = np.radians([0.0, 30.0, 60.0, -135.0])
HALF_LENGTH, HALF_WIDTH = 2.5, 0.9
LENGTHS = 2.0 * HALF_LENGTH


def scene(turn, speed, *others):
    """The own vehicle at (10, 0) on a path along x, all turned; others are (ahead, left, yaw, speed)."""
    rows = np.array([(0.0, 0.0, 0.0, speed), *others], dtype=float)
    cos, sin = np.cos(turn), np.sin(turn)
    ahead, left = 10.0 + rows[:, 0], rows[:, 1]
    yaw = rows[:, 2] + turn
    n = len(rows)
    poses = (cos * ahead - sin * left, sin * ahead + cos * left, yaw, np.cos(yaw), np.sin(yaw), rows[:, 3])
    sizes = np.full(n, HALF_LENGTH), np.full(n, HALF_WIDTH)
    seen = Surroundings(np.arange(1, n + 1, dtype=np.uint32), *poses, *sizes, np.zeros(n, dtype=bool))
    path = TrackedPath.of(Curve.through(np.array([[0.0, 0.0], [150.0 * cos, 150.0 * sin]])), CONFIG, stop_at_end=False)
    return path, seen


def watch(turn, speed, *others, target=10.0, courses=None):
    """``courses`` are the headings of all vehicles' courses, which are straight, where they are known."""
    path, seen = scene(turn, speed, *others)
    if courses is not None:
        poses = zip(seen.x_m.tolist(), seen.y_m.tolist(), (turn + np.array(courses)).tolist(), strict=True)
        lines = [Course.straight(*pose).points for pose in poses]
        bodies = zip(seen.x_m, seen.y_m, seen.yaw_rad, strict=True)
        size = HALF_LENGTH, HALF_WIDTH, 0.0
        known = [Way(line, SPACING_M, 0.0, 0.0, pose, 0.0, *size) for line, pose in zip(lines, bodies, strict=True)]
        seen = replace(seen, outlook=SimpleNamespace(ways=Ways.of(known)))
    return CollisionWatch(path, 10.0, 0, target, seen, CONFIG)


def watched(turn, speed, *others, target=15.0):
    return watch(turn, speed, *others, target=target).leaders()


def krauss(gap, lead):
    brake, time = CONFIG.comfort_brake_mps2, CONFIG.headway_s
    free = max(gap - CONFIG.standstill_gap_m, 0.0)
    return -brake * time + math.sqrt((brake * time) ** 2 + lead**2 + 2.0 * brake * free)


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(("ahead", "lead"), [(25.0, 0.0), (25.0, 6.0), (12.0, 3.0)])
def test_a_leader_is_followed_at_krausss_speed(turn, ahead, lead):
    threat = watched(turn, 5.0, (ahead, 0.3, 0.0, lead))
    gap = ahead - LENGTHS
    assert (threat.blocker_id, threat.free_m) == (2, pytest.approx(gap, abs=1e-6))
    assert threat.speed_mps == pytest.approx(krauss(gap, lead))


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_vehicle_beside_the_path_is_none_until_it_drifts_towards_it(turn, side):
    """3.5 m aside at 8 m/s: it drifts by 1.5 s of its sideways speed, over the margin at 10°."""
    towards, away = -side * np.radians(10.0), side * np.radians(10.0)
    assert watched(turn, 10.0, (15.0, side * 3.5, 0.0, 8.0)) is None
    assert watched(turn, 10.0, (15.0, side * 3.5, away, 8.0)) is None
    drifting = watched(turn, 10.0, (15.0, side * 3.5, towards, 8.0))
    assert drifting.speed_mps == pytest.approx(krauss(drifting.free_m, 8.0 * np.cos(np.radians(10.0))))
    assert watched(turn, 10.0, (15.0, side * 3.5, -side * np.radians(1.5), 8.0)) is None
    assert watched(turn, 10.0, (4.0, side * 3.5, towards, 8.0)) is None


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_corridor_is_as_wide_as_both_bodies_and_the_margin(turn, side):
    wide = 2.0 * HALF_WIDTH + CONFIG.side_margin_m
    assert watched(turn, 10.0, (20.0, side * (wide - 0.02), 0.0, 0.0)) is not None
    assert watched(turn, 10.0, (20.0, side * (wide + 0.02), 0.0, 0.0)) is None


@pytest.mark.parametrize("turn", TURNS)
def test_who_stands_across_the_path_is_as_long_as_its_body_is_wide(turn):
    threat = watched(turn, 5.0, (20.0, 0.0, np.pi / 2.0, 0.0))
    assert threat.free_m == pytest.approx(20.0 - HALF_WIDTH - HALF_LENGTH, abs=1e-6)
    reach = HALF_LENGTH + HALF_WIDTH + CONFIG.side_margin_m
    assert watched(turn, 5.0, (20.0, reach - 0.02, np.pi / 2.0, 0.0)) is not None
    assert watched(turn, 5.0, (20.0, reach + 0.02, np.pi / 2.0, 0.0)) is None


@pytest.mark.parametrize("turn", TURNS)
def test_who_crosses_or_is_behind_does_not_lead(turn):
    assert watched(turn, 10.0, (20.0, 0.0, np.pi / 2.0, 5.0)) is None
    assert watched(turn, 10.0, (20.0, 0.0, np.pi / 2.0, 0.9)) is not None
    assert watched(turn, 10.0, (-15.0, 0.0, 0.0, 0.0)) is None


@pytest.mark.parametrize("turn", TURNS)
def test_towards_who_comes_along_the_path_the_gap_shrinks_by_their_way_in_one_and_a_half_seconds(turn):
    threat = watched(turn, 5.0, (40.0, 0.0, np.pi, 6.0))
    assert threat.free_m == pytest.approx(40.0 - LENGTHS - 1.5 * 6.0, abs=1e-6)
    assert threat.speed_mps == pytest.approx(krauss(threat.free_m, 0.0))


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_who_comes_on_turning_is_left_to_the_outlook_where_there_is_one(turn, side):
    """15° to the path and 2.2 m aside: it goes on across. At 5°, or without its route, it is taken to come along."""
    for degrees, leads in ((15.0, False), (5.0, True)):
        other = (16.0, side * 2.2, np.pi + side * np.radians(degrees), 5.0)
        assert watch(turn, 8.0, other).leaders() is not None
        assert (watch(turn, 8.0, other, courses=(0.0, other[2])).leaders() is not None) is leads
    other = (16.0, side * 2.2, np.pi + side * np.radians(15.0), 0.5)
    assert watch(turn, 8.0, other, courses=(0.0, other[2])).leaders() is not None


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("degrees", "course", "speed", "leads"),
    [(20.0, 20.0, 5.0, False), (20.0, 15.0, 5.0, False), (20.0, 10.0, 5.0, True), (8.0, 8.0, 11.0, True)],
    ids=["along its bend", "nearly", "out of its lane", "hardly"],
)
def test_who_turns_along_its_course_does_not_drift_and_who_leaves_it_does(turn, side, degrees, course, speed, leads):
    """4 m aside and 8 m ahead, a vehicle points into the path: in the bend that leads it beside the path, or not."""
    other = (8.0, side * 4.0, -side * np.radians(degrees), speed)
    assert watch(turn, 8.0, other).leaders() is not None
    known = watch(turn, 8.0, other, courses=(0.0, -side * np.radians(course)))
    assert (known.leaders() is not None) is leads


@pytest.mark.parametrize(
    ("asked", "others"),
    [
        ("leaders", [(14.0, 0.0, 0.0, 0.0), (40.0, 0.0, 0.0, 0.0)]),
        ("leaders", [(14.0, 0.0, 0.0, 0.0), (13.0, 2.0 * HALF_WIDTH + 0.05, 0.0, 0.0)]),
        ("leaders", [(20.0, 0.5, 0.0, 8.9), (30.0, 0.0, 0.0, 0.0)]),
        ("meetings", [(20.0, 14.0, -0.5 * np.pi, 8.0), (13.5, 9.0, -0.5 * np.pi, 8.0), (12.0, 7.5, -0.5 * np.pi, 8.0)]),
    ],
    ids=["the nearer", "brakes for the farther", "the slower", "who crosses"],
)
@pytest.mark.parametrize("order", [1, -1])
def test_of_several_the_lowest_speed_with_its_gap_and_the_hardest_braking_count(asked, others, order):
    alone = [getattr(watch(0.6, 8.0, other, target=15.0), asked)() for other in others]
    strictest = min(alone, key=lambda limit: limit.speed_mps)
    found = getattr(watch(0.6, 8.0, *others[::order], target=15.0), asked)()
    place = 2 + [limit is strictest for limit in alone[::order]].index(True)
    hardest = max(limit.brake_mps2 for limit in alone)
    assert found == strictest._replace(blocker_id=place, brake_mps2=hardest)
    assert len({limit.speed_mps for limit in alone}) == len(others)


def test_a_fast_leader_is_no_threat():
    assert watched(0.0, 10.0, (60.0, 0.0, 0.0, 14.0)) is None
    assert watched(0.0, 10.0, (30.0, 0.0, 0.0, 0.0), target=3.0) is None


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_for_a_long_vehicle_whose_rear_alone_is_in_the_way_one_brakes_hard(side):
    """A bus that points a little outwards: its rear is in the way of the body, its front within the margin."""
    path, seen = scene(0.0, 9.0, (17.5, side * 1.945, side * 0.03, 0.0))
    seen = replace(seen, half_length_m=np.array([HALF_LENGTH, 6.0]))
    limit = CollisionWatch(path, 10.0, 0, 15.0, seen, CONFIG).leaders()
    assert limit.free_m == pytest.approx(17.5 - 6.0 - HALF_LENGTH, abs=0.05)
    assert limit.brake_mps2 == pytest.approx(9.0**2 / (2.0 * (17.5 - 6.0 - HALF_LENGTH - 1.0)), rel=0.02)


@pytest.mark.parametrize(("ahead", "hard"), [(30.0, False), (14.0, True)])
def test_braking_that_is_needed_avoids_contact_by_a_metre(ahead, hard):
    threat = watched(0.6, 9.0, (ahead, 0.0, 0.0, 0.0))
    needed = 9.0**2 / (2.0 * (ahead - LENGTHS - 1.0))
    assert (needed > CONFIG.comfort_brake_mps2) is hard
    assert threat.brake_mps2 == pytest.approx(needed if hard else 0.0)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("aside", "hard"), [(-0.05, True), (0.05, False)])
def test_who_is_only_within_the_margin_is_slowed_for_but_not_braked_for_hard(side, aside, hard):
    threat = watched(0.6, 9.0, (14.0, side * (2.0 * HALF_WIDTH + aside), 0.0, 0.0))
    assert threat.speed_mps == pytest.approx(krauss(14.0 - LENGTHS, 0.0))
    assert (threat.brake_mps2 > 0.0) is hard


@pytest.mark.parametrize(
    ("speed", "target", "reach"),
    [(0.0, 0.0, 20.0), (9.0, 10.0, 81.0 / 6.0 + 25.0), (17.0, 17.0, 70.0), (30.0, 30.0, 900.0 / 6.0 + 20.0)],
)
def test_looks_ahead_by_the_way_of_a_stop_and_one_and_a_half_seconds(speed, target, reach):
    assert watch(0.6, speed, target=target).reach_m == pytest.approx(reach)


def test_of_two_threats_the_lower_speed_and_the_harder_braking_count():
    first, second = (
        SpeedLimit(speed, brake, actor, gap) for actor, gap, speed, brake in ((2, 5.0, 4.0, 0.0), (3, 9.0, 6.0, 5.0))
    )
    assert stricter(first, second) == stricter(second, first) == first._replace(brake_mps2=5.0)
    assert stricter(None, second) is second
    assert stricter(first, None) is first
    assert stricter(None, None) is None


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_who_crosses_from_either_side_is_waited_for_and_who_has_crossed_is_not(turn, side):
    threat = watch(turn, 8.0, (30.0, side * 25.0, -side * np.pi / 2.0, 8.0)).meetings()
    assert threat.blocker_id == 2
    reach = HALF_LENGTH + HALF_WIDTH + CONFIG.side_margin_m
    assert threat.free_m == pytest.approx(30.0 - reach - CONFIG.conflicts.standoff_m, abs=1.0)
    assert watch(turn, 8.0, (30.0, side * 25.0, side * np.pi / 2.0, 8.0)).meetings() is None


def crossing_watches(turn, side, rank, emvs, *, before_m=20.0, mps=8.0, angle=0.5 * np.pi):
    """What two drivers see who come to the middle of a crossing from 20 m at 8 m/s, both with the same right of way.

    The second one may be at another place, with another speed, and come at another angle.
    """
    yaw = turn + np.array([0.0, side * angle])
    cos, sin, speed, before = np.cos(yaw), np.sin(yaw), np.array([8.0, mps]), np.array([20.0, before_m])
    poses = -before * cos, -before * sin, yaw, cos, sin, speed
    sizes = np.full(2, HALF_LENGTH), np.full(2, HALF_WIDTH)
    lines = [np.outer(np.arange(-60.0, 91.0), (np.cos(angle), np.sin(angle))) for angle in yaw]
    bodies = zip(poses[0].tolist(), poses[1].tolist(), yaw.tolist(), strict=True)
    size = HALF_LENGTH, HALF_WIDTH, 0.0
    ways = Ways.of(
        [
            Way(line, SPACING_M, 60.0 - way_m, 0.0, pose, 0.0, *size)
            for line, pose, way_m in zip(lines, bodies, before.tolist(), strict=True)
        ]
    )
    at = np.arange(2)
    rights = Rights(np.full(len(ways.points), 8.0), at, at + 1, np.full(2, 50.0), np.full(2, int(rank)))
    outlook = SimpleNamespace(ways=ways, rights=rights)
    seen = Surroundings(np.array([1, 2], dtype=np.uint32), *poses, *sizes, np.array(emvs), outlook=outlook)
    paths = (TrackedPath.of(Curve.through(line[[0, -1]]), CONFIG, stop_at_end=False) for line in lines)
    return [CollisionWatch(path, 40.0, row, 10.0, seen, CONFIG) for row, path in enumerate(paths)]


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("rank", [Rank.RED, Rank.STOP_SIGN, Rank.PRIORITY])
def test_of_two_emvs_whose_ways_cross_with_equal_rights_the_second_waits_and_the_first_goes(turn, side, rank):
    """No red light stops them, so that neither can count on the other one's stop."""
    first, second = (watch.meetings() for watch in crossing_watches(turn, side, rank, (True, True)))
    assert first is None
    assert second.blocker_id == 1
    assert second.speed_mps < 8.0


@pytest.mark.parametrize("emvs", [(False, False), (True, False), (False, True)])
def test_who_is_no_emv_is_expected_to_stop_at_red(emvs):
    assert [watch.meetings() for watch in crossing_watches(0.6, 1.0, Rank.RED, emvs)] == [None, None]


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_for_who_stands_in_the_way_at_an_angle_the_way_that_it_clears_by_stays_free(turn, side):
    """Its front is in the way and points back: what it sweeps comes nearer than its body is."""
    first, _ = crossing_watches(turn, side, Rank.PRIORITY, (True, False), before_m=2.0, mps=0.0, angle=0.75 * np.pi)
    threat, leader = first.meetings(), first.leaders()
    assert (threat.blocker_id, leader.blocker_id) == (2, 2)
    assert threat.free_m < leader.free_m - CONFIG.conflicts.standoff_m
    assert threat.speed_mps == pytest.approx(math.sqrt(2.0 * CONFIG.conflicts.brake_mps2 * threat.free_m))
    beside, _ = crossing_watches(turn, side, Rank.PRIORITY, (True, False), before_m=9.0, mps=0.0, angle=0.75 * np.pi)
    assert beside.meetings() is None


@pytest.mark.parametrize("turn", TURNS)
def test_who_merely_follows_or_stands_is_no_conflict_and_who_joins_from_behind_at_an_angle_is(turn):
    for other in ((-8.0, 0.0, 0.0, 9.0), (30.0, 0.0, 0.3, 0.5)):
        assert watch(turn, 8.0, other).meetings() is None
    # The own vehicle cannot stop before the crossing; the other one can from 13 m/s, by an emergency brake.
    for speed_mps, conflict in ((13.0, False), (17.0, True)):
        meeting = watch(turn, 6.0, (-6.0, -12.0, np.radians(40.0), speed_mps)).meetings()
        assert (meeting is not None) == conflict


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_who_turns_in_beside_the_own_front_counts_unless_the_leaders_are_watched_otherwise(side):
    """Its rear is 0.6 m behind the own front, 1 cm beside the body, and it points 15° into the path."""
    turned = -side * np.radians(15.0)
    extent = HALF_LENGTH * np.cos(turned) + HALF_WIDTH * abs(np.sin(turned))
    reach = HALF_LENGTH * abs(np.sin(turned)) + HALF_WIDTH * np.cos(turned)
    other = (HALF_LENGTH + extent - 0.6, side * (HALF_WIDTH + reach + 0.01), turned, 5.0)
    driver = watch(0.6, 6.0, other, target=15.0)
    assert driver.leaders() is None
    threat = driver.meetings()
    assert threat.blocker_id == 2
    assert 4.0 < threat.speed_mps < 6.0
    assert driver.meetings(leaders=False) is None


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_before_a_bend_one_reckons_with_the_time_that_it_takes(side):
    """40 m at 12 m/s take 3.4 s: who crosses after 2.7 s is still there. The bend takes so long that it is gone."""
    a = np.linspace(0.0, np.pi / 2.0, 60)
    bend = np.stack((20.0 + 8.0 * np.sin(a), side * 8.0 * (1.0 - np.cos(a))), axis=-1)
    curve = Curve.through(np.concatenate(([[0.0, 0.0]], bend, bend[-1] + np.array([[0.0, side * 30.0]]))))
    _, seen = scene(0.0, 12.0, (18.0 + 40.0, side * 20.0, np.pi, 10.0))
    seen = replace(seen, x_m=seen.x_m - 10.0)
    path = TrackedPath.of(curve, CONFIG, stop_at_end=False)
    quick = TrackedPath.of(curve, replace(CONFIG, lateral_accel_mps2=40.0, curvature_rate_1pms=9.0), stop_at_end=False)
    assert CollisionWatch(path, 0.0, 0, 12.0, seen, CONFIG).meetings() is None
    assert CollisionWatch(quick, 0.0, 0, 12.0, seen, CONFIG).meetings() is not None


@pytest.mark.parametrize("bend", [1.0, -1.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_in_a_bend_the_corridor_is_wider_by_what_the_body_cuts(bend, side):
    """On a circle of 20 m the ends of a body of 5 m reach 0.5 · κ · (2.5 m)² = 16 cm beyond its middle."""
    radius = 20.0
    a = np.linspace(0.0, 2.0, 600)
    circle = np.stack((radius * np.sin(a), bend * radius * (1.0 - np.cos(a))), axis=-1)
    path = TrackedPath.of(Curve.through(circle), CONFIG, stop_at_end=False)
    wide = 2.0 * HALF_WIDTH + CONFIG.side_margin_m + 0.5 / radius * HALF_LENGTH**2
    for left, leads in ((side * (wide - 0.03), True), (side * (wide + 0.03), False)):
        angle = 15.0 / radius
        at = np.array([radius * np.sin(angle), bend * radius * (1.0 - np.cos(angle))])
        at += left * np.array([-np.sin(bend * angle), np.cos(bend * angle)])
        _, plain = scene(0.0, 5.0, (0.0, 0.0, 0.0, 0.0))
        yaw = np.array([0.0, bend * angle])
        seen = replace(
            plain, x_m=np.array([0.0, at[0]]), y_m=np.array([0.0, at[1]]), yaw_rad=yaw, cos=np.cos(yaw), sin=np.sin(yaw)
        )
        assert (CollisionWatch(path, 0.0, 0, 10.0, seen, CONFIG).leaders() is not None) is leads


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_oncoming_vehicle_that_ends_its_turn_is_no_leader(turn, side):
    """20° from straight, 3.5 m aside at 5.4 m/s: its turn takes it along the other lane, its straight line does not."""
    ending = np.pi + side * np.radians(20.0)
    assert watched(turn, 8.0, (15.0, side * 3.5, ending, 5.4)) is None
    on_the_path = watched(turn, 8.0, (15.0, side * 1.5, ending, 5.4))
    assert on_the_path.speed_mps == pytest.approx(krauss(0.0, 0.0), abs=2.0)


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("gap", "aside", "leads"), [(-0.4, 0.1, True), (-0.6, 0.1, False), (-0.6, -0.1, True)])
def test_who_is_alongside_leads_only_where_the_bodies_would_meet(turn, side, gap, aside, leads):
    """Half a metre behind the own front bumper it is no matter of the margin any more, but of the body itself."""
    assert (watched(turn, 5.0, (LENGTHS + gap, side * (2.0 * HALF_WIDTH + aside), 0.0, 0.0)) is not None) is leads


@pytest.mark.parametrize("degrees", [15.0, -15.0])
def test_who_drives_ahead_at_an_angle_leads_although_its_way_is_known(degrees):
    """The outlook is for those who come on."""
    known = watch(0.6, 8.0, (16.0, 0.3, np.radians(degrees), 5.0), courses=(0.0, np.radians(degrees))).leaders()
    assert known.blocker_id == 2
    assert known.speed_mps == pytest.approx(krauss(known.free_m, 5.0 * np.cos(np.radians(degrees))))


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("gap", "leads"), [(0.5, True), (0.1, True), (-0.1, False)])
def test_who_drifts_towards_the_path_counts_where_its_rear_is_ahead(side, gap, leads):
    turned = -side * np.radians(10.0)
    extent = HALF_LENGTH * np.cos(turned) + HALF_WIDTH * abs(np.sin(turned))
    assert (watched(0.6, 10.0, (HALF_LENGTH + extent + gap, side * 3.5, turned, 8.0)) is not None) is leads


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_who_has_time_to_wait_for_who_crosses_needs_no_hard_braking_and_who_is_late_does(side):
    """From 30 m ahead a gentle stop is enough; from 13 m ahead it is not."""
    early, late = (
        watch(0.6, 8.0, (ahead, side * other, -side * np.pi / 2.0, 8.0)).meetings().brake_mps2
        for ahead, other in ((30.0, 25.0), (13.5, 9.0))
    )
    assert early == 0.0
    assert late > CONFIG.comfort_brake_mps2


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("half_length_m", "leads"), [(6.0, True), (2.5, False)])
def test_the_rear_of_a_long_vehicle_leads_where_the_path_has_not_left_its_lane_yet(side, half_length_m, leads):
    """The path changes lanes from 6 to 18 m ahead; there the middle of the other one is beside it."""
    _, seen = scene(0.0, 5.0, (18.0, 0.0, 0.0, 0.0))
    line = np.array([[0.0, 0.0], [16.0, 0.0], [28.0, -3.4 * side], [150.0, -3.4 * side]])
    path = TrackedPath.of(Curve.through(line, 1.5), CONFIG, stop_at_end=False)
    seen = replace(seen, half_length_m=np.array([HALF_LENGTH, half_length_m]))
    limit = CollisionWatch(path, 10.0, 0, 10.0, seen, CONFIG).leaders()
    assert (limit is not None) is leads
    if limit is not None:
        assert limit.free_m == pytest.approx(18.0 - half_length_m - HALF_LENGTH, abs=1.0)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("gap_m", "leads"), [(0.5, False), (0.1, True)])
def test_who_moves_aside_next_to_a_long_vehicle_is_stopped_only_where_they_would_come_too_near(side, gap_m, leads):
    """The path moves 0.8 m towards a bus: turned with the path there, its body of 12 m would reach across the path."""
    left = -side * (0.8 + 2.0 * HALF_WIDTH + gap_m)
    _, seen = scene(0.0, 0.0, (3.0, left, 0.0, 0.0))
    line = np.array([[0.0, 0.0], [10.0, 0.0], [15.0, -0.8 * side], [150.0, -0.8 * side]])
    path = TrackedPath.of(Curve.through(line, 1.5), CONFIG, stop_at_end=False)
    seen = replace(seen, half_length_m=np.array([HALF_LENGTH, 6.0]))
    assert (CollisionWatch(path, 10.0, 0, 4.0, seen, CONFIG).leaders() is not None) is leads
