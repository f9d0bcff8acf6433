"""Courses along lanes and across junctions."""

from dataclasses import replace

import hand_made_record
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_episode import rotate

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.simulation.conflicts.course import SPACING_M, Course, CourseBook, Entry, Outlook
from siren_ros.simulation.conflicts.yielding import Rank
from siren_ros.simulation.roads.road_network import NO_LANE, Connection, Edge, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import NO_ACTOR, EmvAdvice, Owner, SignalState


def lane(index, edge, points, limit=13.89, position=0, kind=LaneKind.DRIVING):
    centre = Polyline.through(np.asarray(points, dtype=float))
    return Lane(index, f"l{index}", edge, position, kind, centre, 3.3, limit, True, True)


def edges(*indices):
    return np.array(indices, dtype=np.int32)


def road(index, name, lanes, internal=False):
    return Edge(index, name, lanes, "from", "to", internal=internal)


def movement(source, target, via=(), direction="s", junction="J"):
    return Connection(source, target, via, direction, None, -1, must_stop=False, junction=junction)


def roads(lanes, edges, *connections):
    return RoadNetwork(tuple(lanes), tuple(edges), connections, {}, (0.0, 0.0), "!")


@pytest.fixture
def network():
    """Two lanes east, then a turn to the north from the left one and straight on from both."""
    a = np.linspace(0.0, np.pi / 2.0, 16)
    arc = np.stack((100.0 + 15.0 * np.sin(a), 3.3 + 15.0 * (1.0 - np.cos(a))), axis=-1)
    lanes = (
        lane(0, 0, [[0, 0], [100, 0]]),
        lane(1, 0, [[0, 3.3], [100, 3.3]], position=1),
        lane(2, 1, arc, limit=6.0, kind=LaneKind.INTERNAL),
        lane(3, 2, [[115, 18.3], [115, 150]]),
        lane(4, 3, [[100, 0], [130, 0]], kind=LaneKind.INTERNAL),
        lane(5, 4, [[130, 0], [300, 0]]),
    )
    edges = (
        road(0, "west", (0, 1)),
        road(1, ":J_0", (2,), internal=True),
        road(2, "north", (3,)),
        road(3, ":J_1", (4,), internal=True),
        road(4, "east", (5,)),
    )
    return roads(lanes, edges, movement(1, 3, (2,), "l"), movement(0, 5, (4,)))


def test_a_turner_is_expected_along_its_turn(network):
    course = CourseBook(network).along(1, edges(0, 2))
    at = course.points[round((100.0 + 15.0 * np.pi / 2.0 + 20.0) / course.spacing_m)]
    assert at == pytest.approx([115.0, 38.3], abs=1.5)
    assert (course.entries[0].start_m, course.entries[0].connection.direction) == (pytest.approx(100.0), "l")
    assert course.limit_at(50.0) == pytest.approx(13.89)
    assert course.limit_at(110.0) == pytest.approx(6.0)


def test_the_same_lane_with_another_route_goes_straight_on(network):
    course = CourseBook(network).along(0, edges(0, 4))
    assert np.abs(course.points[:, 1]).max() == 0.0
    assert course.length_m == pytest.approx(180.0)


def test_points_have_one_distance(network):
    course = CourseBook(network).along(1, edges(0, 2))
    steps = np.hypot(*np.diff(course.points, axis=0).T)
    assert steps.max() <= SPACING_M + 1e-9
    assert np.abs(steps - course.spacing_m).max() < 0.02


def test_on_the_junction_the_course_begins_with_the_movement(network):
    course = CourseBook(network).along(2, edges(0, 2))
    assert course.entries[0].start_m == 0.0
    assert course.entry_at(-1.0) is None
    assert course.entry_at(5.0) is course.entries[0]


def test_without_a_next_edge_the_course_ends_with_the_lane(network):
    assert CourseBook(network).along(3, edges(2)).length_m == pytest.approx(131.7)


@pytest.mark.parametrize("yaw", np.radians([0.0, 30.0, 60.0, -135.0]))
def test_off_the_road_everybody_goes_straight_on(yaw):
    course = Course.straight(3.0, 4.0, yaw)
    assert course.points[10] == pytest.approx([3.0 + 10.0 * np.cos(yaw), 4.0 + 10.0 * np.sin(yaw)])


def test_on_the_second_of_two_lanes_across_a_junction_only_the_rest_of_the_way_follows():
    lanes = (
        lane(0, 0, [[0, 0], [50, 0]]),
        lane(1, 1, [[50, 0], [60, 0]], limit=7.0, kind=LaneKind.INTERNAL),
        lane(2, 2, [[60, 0], [75, 0]], limit=5.0, kind=LaneKind.INTERNAL),
        lane(3, 3, [[75, 0], [200, 0]]),
        lane(4, 4, [[75, 0], [75, 100]]),
    )
    parts = [road(i, f"e{i}", (i,), internal=i in {1, 2}) for i in range(5)]
    book = CourseBook(roads(lanes, parts, movement(0, 4, (1, 2), "l"), movement(0, 3, (1, 2))))
    course = book.along(2, edges(0, 3))
    assert course.points[0] == pytest.approx([60.0, 0.0])
    assert course.points[-1] == pytest.approx([155.0, 0.0], abs=1.0)
    assert course.limit_at(10.0) == pytest.approx(5.0)
    assert course.limit_at(20.0) == pytest.approx(13.89)
    assert book.along(2, edges(4)).points[-1] == pytest.approx([75.0, 80.0], abs=1.0)
    assert book.along(1, edges(0, 9)).entries[0].connection.to_lane == 4, "the first one where none is on the route"


def test_the_last_movement_that_has_begun_counts():
    first, second = Entry(10.0, movement(0, 1, junction="A")), Entry(40.0, movement(0, 1, junction="B"))
    course = Course(np.zeros((61, 2)), 1.0, np.full(61, 9.0), (first, second))
    assert [course.entry_at(s) for s in (9.9, 10.0, 39.9, 40.0, 60.0)] == [None, first, first, second, second]


def test_the_limit_is_that_of_the_nearest_point_whatever_the_points_distance():
    course = Course(np.zeros((5, 2)), 0.5, np.array([10.0, 11.0, 12.0, 13.0, 14.0]))
    assert [course.limit_at(s) for s in (-3.0, 0.0, 0.3, 0.6, 1.0, 2.0, 9.0)] == [10, 10, 11, 11, 12, 14, 14]


def test_the_next_edge_of_a_route_is_the_one_after_the_present_one(network):
    """A route that goes on to the north somewhere behind the road to the east."""
    east = CourseBook(network).along(0, edges(0, 4, 2))
    assert [entry.connection.to_lane for entry in east.entries] == [5]
    assert east.points[-1] == pytest.approx((180.0, 0.0))
    north = CourseBook(network).along(0, edges(0, 2, 4))
    assert [entry.connection.to_lane for entry in north.entries] == [3]


@pytest.mark.parametrize(
    ("leading", "present", "taken"), [((0, 1), 2, 1), ((1, 2), 0, 1), ((0, 2), 2, 2), ((2,), 0, 2)]
)
def test_of_several_lanes_that_lead_on_the_nearest_is_taken(leading, present, taken):
    """Whatever the order of the movements."""
    lanes = [lane(place, 0, [[0, 3.3 * place], [100, 3.3 * place]], position=place) for place in range(3)]
    lanes += [lane(3 + place, 1, [[100, 3.3 * place], [300, 3.3 * place]], position=place) for place in range(3)]
    parts = road(0, "a", (0, 1, 2)), road(1, "b", (3, 4, 5))
    movements = [movement(source, 3 + source) for source in leading]
    for connections in (movements, movements[::-1]):
        three = roads(lanes, parts, *connections)
        (entry,) = CourseBook(three).along(present, edges(0, 1)).entries
        assert entry.connection.from_lane == taken


def test_the_limit_of_a_lane_begins_with_the_lane():
    lanes = (lane(0, 0, [[0, 0], [40, 0]], limit=10.0), lane(1, 1, [[40, 0], [80, 0]], limit=5.0))
    network = roads(lanes, (road(0, "a", (0,)), road(1, "b", (1,))), movement(0, 1))
    course = CourseBook(network).along(0, edges(0, 1))
    assert course.spacing_m == 1.0
    assert course.limit_mps.tolist() == [10.0] * 40 + [5.0] * 41


HALF_LENGTH, HALF_WIDTH = np.array([2.5, 4.0]), np.array([0.9, 1.2])
TURNS = np.radians([0.0, 35.0, -120.0])


def network_of_outlook(turn=0.0, **control):
    """100 m, a junction of 20 m with a limit of 6 m/s, and 100 m; all straight on."""
    ways = ([[0.0, 0.0], [100.0, 0.0]], [[100.0, 0.0], [120.0, 0.0]], [[120.0, 0.0], [220.0, 0.0]])
    kinds = (LaneKind.DRIVING, LaneKind.INTERNAL, LaneKind.DRIVING)
    lanes = [
        lane(i, i, rotate(np.array(way), turn), limit, kind=kind)
        for i, (way, kind, limit) in enumerate(zip(ways, kinds, (14.0, 6.0, 9.0), strict=True))
    ]
    parts = [road(i, f"e{i}", (i,), internal=i == 1) for i in range(3)]
    return roads(lanes, parts, replace(movement(0, 2, (1,)), **control))


def traffic_of(lanes, routes, **told):
    """A step whose actors are numbered from 1 on."""
    told = {"actor_id": range(1, len(lanes) + 1), "lane": lanes, "route_edges": np.concatenate(routes), **told}
    return hand_made_record.traffic_of(0, route_offset=np.cumsum([0, *map(len, routes)]), **told)


def outlook_of(lane, front_m, turn=0.0, state="", left=0.4, owner=Owner.SUMO, emvs=(), **control):
    """The second of two vehicles is the one looked at; the first stands elsewhere. ``emvs`` are ids."""
    x, y = rotate(np.array([front_m - 4.0, left]), turn)
    signals = (SignalState("S", state),) if state else ()
    advised = tuple(EmvAdvice(emv, 0, NO_ACTOR, 0.0, 0.0, 0) for emv in emvs)
    poses = {"x_m": [0.0, x], "y_m": [0.0, y], "yaw_rad": [0.0, turn], "lateral_offset_m": [0.0, left]}
    places = {**poses, "lane_position_m": [50.0, front_m], "owner": [Owner.SUMO, owner]}
    traffic = traffic_of([2, lane], [(0, 2)] * 2, signals=signals, emvs=advised, **places)
    return Outlook(traffic, CourseBook(network_of_outlook(turn, **control)), HALF_LENGTH, HALF_WIDTH)


def way_of(outlook):
    """Points and body of the second vehicle."""
    ways = outlook.ways
    return ways.points[ways.first[1] : ways.last[1]], ways.bodies[1]


@pytest.mark.parametrize("turn", TURNS)
def test_a_way_begins_at_the_bodys_centre_on_its_course(turn):
    outlook = outlook_of(0, 60.0, turn)
    assert outlook.centre_m(1) == pytest.approx(56.0)
    points, body = way_of(outlook)
    assert body[:3] == pytest.approx((*rotate(np.array([56.0, 0.4]), turn), turn))
    assert body[4:] == pytest.approx((56.0, 0.4, 0.0, 4.0, 1.2, 4.0))
    np.testing.assert_allclose(points[round(150.0 / body[3])], rotate(np.array([150.0, 0.0]), turn), atol=0.6)


@pytest.mark.parametrize("turn", TURNS)
def test_off_the_road_the_way_is_straight_ahead_from_the_pose(turn):
    outlook = outlook_of(NO_LANE, 60.0, turn)
    assert outlook.centre_m(1) == 0.0
    points, body = way_of(outlook)
    np.testing.assert_allclose(points[0], body[:2])
    np.testing.assert_allclose(points[5], body[:2] + 5.0 * np.array([np.cos(turn), np.sin(turn)]))
    assert outlook.rank(1, 20.0) is Rank.PRIORITY
    assert np.isinf(outlook.limit_mps(1, 20.0))


@pytest.mark.parametrize(("way", "limit"), [(0.0, 14.0), (42.0, 14.0), (46.0, 6.0), (62.0, 6.0), (66.0, 9.0)])
def test_the_limit_is_that_of_the_lane_at_the_end_of_the_way(way, limit):
    assert outlook_of(0, 60.0).limit_mps(1, way) == limit


@pytest.mark.parametrize(("way", "rank"), [(39.9, Rank.PRIORITY), (40.1, Rank.STOP_SIGN), (70.0, Rank.STOP_SIGN)])
def test_the_movement_counts_from_where_the_front_reaches_the_junction(way, rank):
    assert outlook_of(0, 60.0, must_stop=True).rank(1, way) is rank


@pytest.mark.parametrize(("front", "rank"), [(99.9, Rank.RED), (100.0, Rank.RED), (100.1, Rank.PRIORITY)])
def test_whose_front_is_on_the_junction_already_is_let_off_it(front, rank):
    outlook = outlook_of(0, front, state="Gr", signal_id="S", signal_link=1)
    assert outlook.rank(1, 5.0) is rank
    assert outlook_of(0, front, state="GG", signal_id="S", signal_link=1).rank(1, 5.0) is Rank.PRIORITY


@pytest.mark.parametrize(
    ("front", "owner", "emvs", "rank"),
    [
        *[(99.9, Owner.ROS, (2,), Rank.GIVES_WAY), (100.1, Owner.ROS, (2,), Rank.PRIORITY)],
        *[(100.1, Owner.SUMO, (2,), Rank.GIVES_WAY), (100.1, Owner.ROS, (1,), Rank.GIVES_WAY)],
        (100.1, Owner.ROS, (), Rank.GIVES_WAY),
    ],
)
def test_only_an_emv_with_privilege_is_let_off_a_junction_where_it_gives_way(front, owner, emvs, rank):
    """SUMO drives the EMV without privilege; no civilian has any."""
    assert outlook_of(0, front, owner=owner, emvs=emvs, gives_way=True).rank(1, 5.0) is rank


def test_on_the_junctions_own_lane_the_movement_is_known():
    outlook = outlook_of(1, 5.0, must_stop=True)
    assert outlook.centre_m(1) == pytest.approx(1.0)
    assert outlook.rank(1, 3.0) is Rank.PRIORITY
    assert outlook.limit_mps(1, 3.0) == 6.0


def test_a_book_keeps_the_points_of_many_courses(network):
    """More than there is room for at first."""
    asked = [(lane, edges(edge, *[2] * more)) for more in range(60) for lane, edge in ((0, 0), (1, 0), (3, 2))]
    courses = CourseBook(network).courses_of(traffic_of(*zip(*asked, strict=True)))
    begins, ends, *_ = courses.ends
    assert begins.tolist() == [0, *ends[:-1].tolist()]
    assert ends[-1] > 4096
    for (lane, route), begin, end in zip(asked, begins, ends, strict=True):
        np.testing.assert_array_equal(courses.points[begin:end], CourseBook(network).along(lane, route).points)


def test_a_course_is_worked_out_once_of_outlook():
    outlook = outlook_of(0, 60.0)
    assert outlook.course(1) is outlook.course(1)
    assert outlook.signals == {}
    assert outlook_of(0, 60.0, state="rG").signals == {"S": "rG"}


def step_of(rows):
    """A step with vehicles given by id, lane and route, 10 m apart."""
    ids, lanes, routes = zip(*rows, strict=True)
    place = 10.0 * np.arange(len(rows))
    poses = {"lane_position_m": place, "x_m": place, "y_m": place, "yaw_rad": 0.01 * place}
    return traffic_of(lanes, routes, actor_id=ids, **poses)


LANES_AND_ROUTES = st.sampled_from([(0, (0, 2)), (0, (0,)), (1, (0, 2)), (2, (2,)), (2, (2, 0)), (NO_LANE, (0, 2))])
STEPS = st.lists(st.dictionaries(st.integers(1, 6), LANES_AND_ROUTES, min_size=1), min_size=1, max_size=5)


@given(STEPS)
def test_a_book_that_remembers_the_last_step_gives_the_courses_of_a_new_one(steps):
    network = network_of_outlook()
    book = CourseBook(network)
    for step in steps:
        traffic = step_of([(actor_id, *step[actor_id]) for actor_id in sorted(step)])
        fresh = CourseBook(network)
        kept, new = book.courses_of(traffic), fresh.courses_of(traffic)
        assert book.courses_of(traffic) is kept
        for row in range(len(traffic)):
            ours, theirs = (each.points[each.ends[0][row] : each.ends[1][row]] for each in (kept, new))
            np.testing.assert_array_equal(ours, theirs)
            course = book.course_of(traffic, row)
            np.testing.assert_array_equal(ours, course.points)
            assert kept.spacing_m[row] == new.spacing_m[row]
            starts = [entry.start_m for entry in course.entries]
            for each, of_book in ((kept, book), (new, fresh)):
                rights = of_book.rights_of(each, {})
                assert rights.start_m[rights.first[row] : rights.last[row]].tolist() == starts


def test_where_nobody_has_another_course_the_privilege_is_still_that_of_the_step():
    network, emv = network_of_outlook(), EmvAdvice(1, 0, 0, 0.0, 0.0, 0)
    book = CourseBook(network)
    for owner in (Owner.SUMO, Owner.ROS, Owner.SUMO):
        traffic = traffic_of([0], [(0, 2)], emvs=(emv,), owner=[owner])
        assert book.rights_of(book.courses_of(traffic), {}).privileged.tolist() == [0] * (owner is Owner.ROS)


def test_a_cyclist_crosses_the_junction_on_the_way_of_the_cycle_lane():
    """Beside the cars' way, which is what the course would follow otherwise."""
    lanes = (
        lane(0, 0, [[0, -3], [100, -3]], kind=LaneKind.CYCLE),
        lane(1, 0, [[0, 0], [100, 0]], position=1),
        lane(2, 1, [[100, -3], [120, -3]], kind=LaneKind.INTERNAL),
        lane(3, 2, [[100, 0], [120, 0]], kind=LaneKind.INTERNAL),
        lane(4, 3, [[120, -3], [200, -3]], kind=LaneKind.CYCLE),
        lane(5, 3, [[120, 0], [200, 0]], position=1),
    )
    ways = road(1, ":J_0", (2,), internal=True), road(2, ":J_1", (3,), internal=True)
    network = roads(lanes, (road(0, "west", (0, 1)), *ways, road(3, "east", (4, 5))), movement(1, 5, (3,)))
    network = replace(network, cycle_connections=(movement(0, 4, (2,)),))
    book = CourseBook(network)
    assert book.along(0, edges(0, 3)).points[:, 1] == pytest.approx(-3.0)
    assert book.along(2, edges(0, 3)).points[:, 1] == pytest.approx(-3.0)
    assert book.along(1, edges(0, 3)).points[:, 1] == pytest.approx(0.0)


def test_who_has_no_route_walks_ten_metres_straight_on(network):
    """Vehicles off the road go on for sixty; the courses of a step are those that are made one by one."""
    poses = {"x_m": [3.0, 50.0, 20.0], "y_m": [9.0, 8.0, 0.0], "yaw_rad": [1.1, -2.0, 0.0]}
    traffic = traffic_of([NO_LANE, NO_LANE, 0], [(), (0, 4), (0, 4)], lane_position_m=[0.0, 0.0, 22.0], **poses)
    book = CourseBook(network)
    found = book.courses_of(traffic)
    for row, count in ((0, 10), (1, 60)):
        begin, end = found.ends[0][row], found.ends[1][row]
        one = book.course_of(traffic, row)
        assert len(one.points) == end - begin == count
        np.testing.assert_array_equal(found.points[begin:end], one.points)
        np.testing.assert_array_equal(found.limit_mps[begin:end], one.limit_mps)
        reach = one.points[-1] - one.points[0]
        assert np.arctan2(reach[1], reach[0]) == pytest.approx(traffic.yaw_rad[row])
    assert found.number[2] >= 0


@pytest.fixture
def in_a_row():
    """Two signals 40 m apart, A and B; behind the second one the way goes on or turns."""
    ways = ([[0, 0], [100, 0]], [[100, 0], [140, 0]], [[140, 0], [240, 0]], [[140, 0], [140, 100]])
    lanes = [lane(at, at, way) for at, way in enumerate(ways)]
    signals = (("A", 0), ("B", 0), ("B", 1))
    pairs = zip(((0, 1), (1, 2), (1, 3)), signals, strict=True)
    movements = [replace(movement(*pair), signal_id=name, signal_link=link) for pair, (name, link) in pairs]
    return roads(lanes, [road(at, f"e{at}", (at,)) for at in range(4)], *movements)


def test_each_of_two_signals_has_its_own_state_at_every_step_on_each_course(in_a_row):
    """What a step was given stays; a course that comes later has the states of then."""
    book = CourseBook(in_a_row)
    on, turns = (traffic_of([0], [(0, 1, last)], lane_position_m=[60.0]) for last in (2, 3))

    def ranks(traffic, a, b):
        rights = book.rights_of(book.courses_of(traffic), {"A": a, "B": b})
        return rights.rank[rights.first[0] : rights.last[0]]

    red, green, yellow = Rank.RED, Rank.PRIORITY, Rank.CLEARING
    steps = {("r", "rG"): [red, red], ("G", "Gr"): [green, green], ("r", "Gr"): [red, green]}
    steps |= {("G", "yG"): [green, yellow]}
    given = [ranks(on, *states) for states in steps]
    assert [each.tolist() for each in given] == list(steps.values())
    assert ranks(turns, "G", "yG").tolist() == [green, green]


def test_the_signal_counts_that_the_front_has_come_to_last(in_a_row):
    signals = SignalState("A", "r"), SignalState("B", "Gr")
    traffic = traffic_of([0], [(0, 1, 2)], signals=signals, lane_position_m=[60.0])
    outlook = Outlook(traffic, CourseBook(in_a_row), HALF_LENGTH[:1], HALF_WIDTH[:1])
    found = [outlook.rank(0, way) for way in (39.9, 40.1, 79.9, 80.1)]
    assert found == [Rank.PRIORITY, Rank.RED, Rank.RED, Rank.PRIORITY]


def test_each_route_from_a_lane_has_a_course_of_its_own(network):
    """From the left lane to the north, and straight on to the east."""
    book, routes = CourseBook(network), (edges(0, 2), edges(0, 4))
    north, east = (book.along(1, route).points.tolist() for route in routes)
    assert [north, east] == [CourseBook(network).along(1, route).points.tolist() for route in routes]
    assert north != east
