from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import BESIDE, SHOULDER_RIGHT, crossing
from made_streets import (
    A_LEFT,
    B_LEFT,
    B_RIGHT,
    CROSSING,
    NEAR,
    SOUTH,
    STRAIGHT,
    STRAIGHT_LEFT,
    A,
    B,
    C,
    D,
    M,
    N,
    streets,
)

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import MapError
from siren_ros.simulation.roads import site_finder
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import Connection, Edge, JunctionKind, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import EdgeGraph
from siren_ros.simulation.roads.sites import (
    REQUIREMENTS,
    Control,
    Site,
    SiteKind,
    is_reversal,
    lanes_through,
    route_through,
    turn_of,
)

LONELY_ROAD = b"""<net><edge id="e" from="a" to="b">
<lane id="e_0" index="0" disallow="pedestrian" speed="13.89" length="500" shape="0,0 500,0"/></edge>
<junction id="a" type="dead_end" x="0" y="0" shape=""/>
<junction id="b" type="dead_end" x="500" y="0" shape=""/></net>"""


IN_TOWN = [kind for kind in SiteKind if kind is not SiteKind.MOTORWAY_STRETCH]


@pytest.mark.parametrize("kind", IN_TOWN)
def test_a_map_without_such_a_place_says_what_it_lacks(kind):
    network = parse_road_network(LONELY_ROAD)
    assert site_finder.find_sites(network, kind) == ()
    with pytest.raises(MapError) as caught:
        site_finder.require_site(network, kind, "road.net.xml")
    assert REQUIREMENTS[kind] in str(caught.value)
    assert "road.net.xml" in str(caught.value)


def sites_by(find):
    """A finder without the places that are no site."""
    return lambda graph: [place for place in find(graph) if isinstance(place, Site)]


multi_lane_roads = sites_by(site_finder.multi_lane_roads)
queued_approaches = sites_by(site_finder.queued_approaches)
signal_junctions = sites_by(site_finder.signal_junctions)
stop_junctions = sites_by(site_finder.stop_junctions)
shoulder_turns = sites_by(site_finder.shoulder_turns)


@pytest.mark.parametrize("kind", [SiteKind.QUEUED_APPROACH, SiteKind.SIGNAL_JUNCTION])
def test_a_signal_that_is_always_green_is_no_site(town, kind):
    """As at corners of a grid: nobody waits there, and no EMV enters on red."""
    steady = replace(town, connections=tuple(replace(way, alternates=False) for way in town.connections))
    assert site_finder.find_sites(town, kind)
    assert not site_finder.find_sites(steady, kind)


def test_a_road_that_is_too_short_says_so(town):
    """The town's roads, cut to 10 m."""
    lanes = [replace(lane, centre=lane.centre.cut(0.0, min(lane.length_m, 10.0))) for lane in town.lanes]
    short = replace(town, lanes=tuple(lanes))
    queues = {place.lacking for place in site_finder.places_without_site(short, SiteKind.QUEUED_APPROACH)}
    assert queues >= {"no signal that is both red and green", "less than 30 m of room for queues"}
    wide = {place.lacking for place in site_finder.places_without_site(short, SiteKind.MULTI_LANE_ROAD)}
    assert "less than 60 m with two lanes" in wide


NETWORK = streets()
GRAPH = EdgeGraph.of(NETWORK)
WHOLE_M = 200.0 + 10.0 + 100.0 + 20.0 + 200.0


NO_SIGNAL, ONE_LANE = "no signal that is both red and green", "one driving lane"
NO_SIGN = "no stop sign, and nobody to give way to"


@pytest.mark.parametrize(
    ("kind", "lacking"),
    [
        (SiteKind.MULTI_LANE_ROAD, dict.fromkeys((D, M, N), ONE_LANE)),
        (SiteKind.QUEUED_APPROACH, {A: NO_SIGNAL, M: NO_SIGNAL, N: "one lane leads on"}),
        (SiteKind.SIGNAL_JUNCTION, {A: NO_SIGNAL, B: "nobody crosses", M: NO_SIGNAL}),
        (SiteKind.STOP_JUNCTION, dict.fromkeys((A, B, M, N), NO_SIGN)),
        (SiteKind.SHOULDER_RIGHT_TURN, {B: "no shoulder along its right turn"}),
        (SiteKind.MOTORWAY_STRETCH, dict.fromkeys((A, B, C), "a limit of a town") | dict.fromkeys((D, M, N), ONE_LANE)),
    ],
)
def test_a_place_without_a_site_says_what_it_lacks(kind, lacking):
    """Where junctions are looked at, nobody comes from the side street."""
    ways = tuple(way for way in NETWORK.connections if way.from_lane != NEAR)
    network = replace(NETWORK, connections=ways) if kind is SiteKind.SIGNAL_JUNCTION else NETWORK
    assert {place.edge: place.lacking for place in site_finder.places_without_site(network, kind)} == lacking


def with_connections(network, numbers, **changed):
    numbered = enumerate(network.connections)
    return replace(
        network, connections=tuple(replace(c, **changed) if number in numbers else c for number, c in numbered)
    )


def with_lane(network, lane, **changed):
    lanes = list(network.lanes)
    lanes[lane] = replace(lanes[lane], **changed)
    return replace(network, lanes=tuple(lanes))


def between(sites, edge, way):
    return next(site for site in sites if site.site_edge == edge and way in site.route)


def test_a_crossed_junction_is_scored_by_what_it_offers():
    site = between(list(signal_junctions(GRAPH)), B, C)
    assert (site.junction, site.route, site.site_position, site.stretch) == ("J", (A, B, C), 1, (B,))
    assert (site.approach_lane, site.length_m) == (B_LEFT, pytest.approx(100.0))
    assert (site.connections, site.crossing) == ((STRAIGHT, STRAIGHT_LEFT), (CROSSING,))
    # Approach and way on are long enough; the route has 530 of 700 m.
    route = 2.0 + 1.0 + WHOLE_M / 700.0
    # Straight on; two lanes; one of three approaches; two movements; a long edge; a quiet way to it and beside it; one
    # street from the side; no loop.
    quality = 2.0 + 4.0 + 1.0 / 3.0 + 1.0 + 2.0 + 1.0 + 1.0 + 1.0
    assert site.score == pytest.approx(route + quality)


def test_a_side_street_without_road_lets_all_crossing_movements_count():
    """20 m are no queue; the turn from the side street's own street would count, too."""
    short = with_lane(NETWORK, NEAR, centre=Polyline.through([(10.0, 30.0), (10.0, 10.0)]))
    short = with_connections(short, [6], must_stop=True)
    site = between(list(signal_junctions(EdgeGraph.of(short))), B, C)
    long = between(list(signal_junctions(GRAPH)), B, C)
    assert (site.crossing, long.score - site.score) == ((CROSSING,), pytest.approx(1.0 - 20.0 / 60.0))


def with_oncoming_turners(network):
    """A road from the east whose vehicles turn left to the south, across the way of those who go straight on."""
    lanes, edges, connections = network.lanes, network.edges, network.connections
    centre = Polyline.through([(220.0, 1.75), (20.0, 1.75)])
    lane = replace(lanes[B_LEFT], index=len(lanes), lane_id="o_0", edge=len(edges), position=0, centre=centre)
    edge = Edge(lane.edge, "o", (lane.index,), "from", "to", internal=False)
    turn = Connection(lane.index, SOUTH, (), "l", "J", 9, must_stop=False, junction="J")
    return replace(network, lanes=(*lanes, lane), edges=(*edges, edge), connections=(*connections, turn))


@pytest.mark.parametrize(("side_m", "turners_count"), [(29.0, True), (31.0, False)])
def test_oncoming_turners_count_where_the_side_street_has_no_queue(side_m, turners_count):
    """Where the side street has 30 m of road, its vehicles cross, and nobody else."""
    centre = Polyline.through([(10.0, 10.0 + side_m), (10.0, 10.0)])
    network = with_lane(with_oncoming_turners(NETWORK), NEAR, centre=centre)
    network = with_connections(network, [6], must_stop=True)
    site = between(list(signal_junctions(EdgeGraph.of(network))), B, C)
    assert site.crossing == ((CROSSING, len(NETWORK.connections)) if turners_count else (CROSSING,))


def test_only_signals_and_only_stop_signs():
    assert list(stop_junctions(GRAPH)) == []
    signs = with_connections(NETWORK, [STRAIGHT, STRAIGHT_LEFT], signal_id=None, must_stop=True)
    (site,) = stop_junctions(EdgeGraph.of(signs))
    assert (site.site_edge, site.route, site.control) == (B, (A, B, C), Control.TWO_WAY_STOP)
    every = with_connections(signs, [CROSSING], signal_id=None, must_stop=True)
    stronger = between(list(stop_junctions(EdgeGraph.of(every))), B, C)
    assert (stronger.control, stronger.score - site.score) == (Control.ALL_WAY_STOP, pytest.approx(30.0))
    free = replace(every.connections[CROSSING], must_stop=False)
    some = replace(every, connections=(*every.connections, free))
    assert between(list(stop_junctions(EdgeGraph.of(some))), B, C).control is Control.TWO_WAY_STOP, "not all stop"
    mixed = with_connections(signs, [STRAIGHT], must_stop=False, gives_way=True)
    (weaker,) = stop_junctions(EdgeGraph.of(mixed))
    assert (weaker.control, site.score - weaker.score) == (Control.GIVE_WAY, pytest.approx(30.0))
    yielding = with_connections(signs, [CROSSING], gives_way=True)
    assert [one.site_edge for one in stop_junctions(EdgeGraph.of(yielding))] == [N], "who comes from there waits"
    one_lane = with_connections(signs, [STRAIGHT], must_stop=False)
    assert list(stop_junctions(EdgeGraph.of(one_lane))) == [], "a stop sign for one of the lanes is none"
    priority = replace(NETWORK, junctions={"J": replace(NETWORK.junctions["J"], kind=JunctionKind.PRIORITY)})
    assert list(signal_junctions(EdgeGraph.of(priority))) == []


def test_a_queued_approach_reaches_back_over_plain_junctions():
    (site,) = queued_approaches(GRAPH)
    assert (site.stretch, site.route, site.site_position) == ((A, B), (A, B, C), 1)
    assert site.length_m == pytest.approx(310.0)
    # 310 m of approach and 200 m of way on; the whole stretch has as many lanes as lead on.
    assert site.score == pytest.approx(2.0 + 1.0 + WHOLE_M / 700.0 + 4.0 + 2.0 + 2.0)


def test_turning_lanes_are_no_plain_road():
    """A third lane joins on the second edge; 75 m of road before it are plain."""
    lanes, edges = list(NETWORK.lanes), list(NETWORK.edges)
    for lane, y_m in ((0, -5.25), (A_LEFT, -1.75)):
        lanes[lane] = replace(lanes[lane], centre=Polyline.through([(-185.0, y_m), (-110.0, y_m)]))
    extra = replace(lanes[B_LEFT], index=len(lanes), lane_id="b_2", position=2)
    edges[B] = replace(edges[B], lanes=(*edges[B].lanes, extra.index))
    (site,) = queued_approaches(EdgeGraph.of(replace(NETWORK, lanes=(*lanes, extra), edges=tuple(edges))))
    route = 2.0 + 1.0 + (WHOLE_M - 125.0) / 700.0
    assert site.score == pytest.approx(route + 4.0 * 185.0 / 250.0 + 2.0 + 2.0 * 75.0 / 150.0)


def test_a_short_queue_is_no_site():
    for length_m, count in ((29.0, 0), (31.0, 1)):
        ends = [with_connections(NETWORK, [0, 1], must_stop=True)]
        for lane, y_m in ((B_RIGHT, -5.25), (B_LEFT, -1.75)):
            ends.append(with_lane(ends[-1], lane, centre=Polyline.through([(-length_m, y_m), (0.0, y_m)])))
        assert len(list(queued_approaches(EdgeGraph.of(ends[-1])))) == count


def test_on_a_road_the_emv_takes_the_leftmost_lane_that_leads_on():
    """The left lane only turns off at the end, or nowhere."""
    turns = replace(NETWORK, connections=tuple(way for way in NETWORK.connections if way.from_lane != B_LEFT))
    assert [site.approach_lane for site in multi_lane_roads(EdgeGraph.of(turns))][:1] == [0]


def test_bends_cost_points():
    """A quarter turn in the middle of the first road: a whole point."""
    corner = [(-310.0, 94.75), (-310.0, -5.25), (-110.0, -5.25)]
    left = Polyline.through([(-306.5, 98.25), (-306.5, -1.75), (-110.0, -1.75)])
    bent = with_lane(with_lane(NETWORK, 0, centre=Polyline.through(corner)), A_LEFT, centre=left)
    site = next(iter(multi_lane_roads(EdgeGraph.of(bent))))
    longer = WHOLE_M + 100.0
    assert site.score == pytest.approx(4.0 + longer / 700.0 + 2.0 * longer / 700.0 - 1.0, abs=0.01)


def test_the_wide_part_of_a_route():
    assert site_finder.wide_length_m(GRAPH, (A, B, C), 0) == pytest.approx(WHOLE_M)
    assert site_finder.wide_length_m(GRAPH, (A, B, C), 2) == pytest.approx(WHOLE_M)
    # From the stop line's right lane to the south: 100 m and the junction, whose ends are 17.8 m apart.
    assert site_finder.wide_length_m(GRAPH, (A, B, D), 0) == pytest.approx(310.0)
    assert site_finder.wide_length_m(GRAPH, (A, B, D), 2) == pytest.approx(100.0)
    assert site_finder.wide_length_m(GRAPH, (M, N, D), 1) == pytest.approx(100.0)


def test_a_wide_stretch_ends_at_signals_stop_signs_turns_and_narrow_places():
    assert (site_finder.wide_stretch_back(GRAPH, B), site_finder.wide_stretch_back(GRAPH, C)) == ((A, B), (C,))
    for changed in ({"must_stop": True}, {"signal_id": "K"}, {"direction": "r"}):
        assert site_finder.wide_stretch_back(EdgeGraph.of(with_connections(NETWORK, [0, 1], **changed)), B) == (B,)
    assert site_finder.wide_stretch_back(EdgeGraph.of(replace(NETWORK, connections=NETWORK.connections[1:])), B) == (B,)


def test_lanes_and_letters_between_edges():
    assert lanes_through(NETWORK, A, B) == lanes_through(NETWORK, B, C) == 2
    assert (lanes_through(NETWORK, B, D), lanes_through(NETWORK, A, C)) == (1, 0)
    assert (turn_of(NETWORK, B, C), turn_of(NETWORK, B, D), turn_of(NETWORK, A, C)) == ("s", "r", "t")
    assert turn_of(with_connections(NETWORK, [STRAIGHT], direction="R"), B, C) == "s", "the straightest"
    into_one = with_connections(NETWORK, [STRAIGHT], to_lane=NETWORK.connections[STRAIGHT_LEFT].to_lane)
    assert lanes_through(into_one, B, C) == 1


def test_a_turn_along_a_shoulder():
    (site,) = shoulder_turns(EdgeGraph.of(crossing()))
    assert (site.approach_lane, site.connections, site.crossing) == (0, (SHOULDER_RIGHT,), (BESIDE,))
    assert site.length_m == pytest.approx(200.0)
    across_m = np.hypot(14.75, 14.75)
    assert site.score == pytest.approx((2.0 * 100.0 / 150.0 + 1.0 + (200.0 + across_m) / 700.0) + 2.0 + 2.0)


def graph_of(shapes, ways, width=1):
    """Edges of one or two driving lanes by the line of the right one, and the ways from edge to edge."""
    sides = range(width)
    lines = [np.add(shape, (0.0, 3.5 * side)) for shape in shapes for side in sides]
    lanes = tuple(
        Lane(k, f"{k}", k // width, k % width, LaneKind.DRIVING, Polyline.through(line), 3.5, 14.0, True, True)
        for k, line in enumerate(lines)
    )
    edges = tuple(
        Edge(k, str(k), tuple(width * k + side for side in sides), f"j{k}", f"j{k + 1}", internal=False)
        for k in range(len(shapes))
    )
    connections = tuple(
        Connection(width * a + side, width * b + side, (), letter, None, -1, False, "j")
        for a, b, letter in ways
        for side in sides
    )
    return EdgeGraph.of(RoadNetwork(lanes, edges, connections, {}, (0.0, 0.0), "!"))


def ring(count, dead_end_m=0.0):
    """Edges of 100 m round a polygon, all left turns; from the first one a straight way may lead out of the map."""
    angle = 2.0 * np.pi * np.arange(count + 1) / count
    corners = 50.0 / np.sin(np.pi / count) * np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    shapes = [corners[number : number + 2] for number in range(count)]
    ways = [(number, (number + 1) % count, "l") for number in range(count)]
    if dead_end_m:
        shapes.append(np.array([corners[1], corners[1] + (0.0, dead_end_m)]))
        ways.append((0, count, "s"))
    return graph_of(shapes, ways)


def test_a_route_has_an_approach_of_150_m_and_goes_on_in_a_loop():
    """Edges of 100 m: two edges before, and on until 700 m are full, edges twice among them."""
    route = route_through(ring(4), (0,))
    assert (route.edges, route.start, route.approach_m) == ((2, 3, 0, 1, 2, 3, 0), 2, pytest.approx(200.0))
    assert route.exit_m == pytest.approx(400.0)


def test_a_route_takes_the_ways_in_turn():
    """Two loops of 200 m begin with the same edge. The approach came over the straighter one: the other is next."""
    corners = [[(0.0, 0.0), (100.0, 0.0)], [(100.0, 0.0), (0.0, 0.1)], [(100.0, 0.0), (0.0, -0.1)]]
    route = route_through(graph_of(corners, ((0, 1, "s"), (0, 2, "l"), (1, 0, "s"), (2, 0, "s"))), (0,))
    after = route.edges[route.start :]
    assert route.edges[: route.start] == (1,)
    assert after[:6] == (0, 2, 0, 1, 0, 2)


def test_the_wide_part_of_a_loop_ends_where_the_route_does():
    """All edges of a loop have two lanes, also from the route's last edge to its first."""
    shapes = [((0.0, 0.0), (100.0, 0.0)), ((100.0, 0.0), (100.0, 100.0)), ((100.0, 100.0), (0.0, 0.0))]
    graph = graph_of(shapes, ((0, 1, "s"), (1, 2, "s"), (2, 0, "s")), width=2)
    whole_m = 200.0 + np.hypot(100.0, 100.0)
    for position in range(3):
        assert site_finder.wide_length_m(graph, (0, 1, 2), position) == pytest.approx(whole_m)
    assert site_finder.wide_length_m(graph, (1, 2), 0) == pytest.approx(whole_m - 100.0)


def test_a_shoulder_turn_without_a_lane_beside_it_hides_no_other():
    """Two edges of a shoulder alone, whose turn comes first in the list of movements."""
    network = crossing()
    lanes, edges = list(network.lanes), list(network.edges)
    first = len(lanes)
    for name, shape in (("x", [(500.0, -60.0), (500.0, 0.0)]), ("y", [(505.0, 5.0), (565.0, 5.0)])):
        index = len(lanes)
        lanes.append(replace(lanes[0], index=index, edge=len(edges), centre=Polyline.through(shape)))
        edges.append(Edge(len(edges), name, (index,), f"{name}0", f"{name}1", internal=False))
    lonely = Connection(first, first + 1, (), "r", None, -1, must_stop=False, junction="x")
    more = replace(network, lanes=tuple(lanes), edges=tuple(edges), connections=(lonely, *network.connections))
    (site,) = shoulder_turns(EdgeGraph.of(more))
    assert site.connections == (1 + SHOULDER_RIGHT,)


def test_a_straight_way_out_of_the_map_is_taken_only_where_it_completes_the_route():
    """300 m are behind the vehicle: 400 m are missing."""
    short = route_through(ring(4, dead_end_m=150.0), (0,))
    assert 4 not in short.edges
    assert short.edges[3] == 1
    assert route_through(ring(4, dead_end_m=450.0), (0,)).edges == (2, 3, 0, 4)


def test_where_the_way_on_is_short_the_approach_grows():
    """Behind the third edge the map ends: then 500 m are filled from before."""
    graph = ring(8)
    ending = EdgeGraph.of(replace(graph.network, connections=graph.network.connections[:-1]))
    route = route_through(ending, (7,))
    assert (route.edges, route.start) == ((3, 4, 5, 6, 7), 4)
    assert (route.approach_m, route.exit_m) == (pytest.approx(400.0), 0.0)
    assert route_through(ending, (5,)).edges == (3, 4, 5, 6, 7)
    assert route_through(ending, (3,)).edges == (1, 2, 3, 4, 5, 6, 7)


def test_two_directions_of_a_street_are_a_reversal():
    ends = (("there", "a", "b"), ("back", "b", "a"), ("on", "b", "c"), ("same way", "a", "b"))
    edges = tuple(Edge(k, name, (k,), start, end, internal=False) for k, (name, start, end) in enumerate(ends))
    network = replace(NETWORK, edges=edges)
    assert [is_reversal(network, 0, other) for other in (1, 2, 3)] == [True, False, False]


@pytest.mark.parametrize("length_m", [440.0, 460.0])
def test_a_motorway_stretch_has_room_for_a_jam(length_m):
    lanes = "".join(
        f'<lane id="m_{k}" index="{k}" disallow="pedestrian" speed="36" length="{length_m}" '
        f'shape="0,{3.5 * k} {length_m},{3.5 * k}"/>'
        for k in range(2)
    )
    net = f"""<net><edge id="m" from="a" to="b">{lanes}</edge>
<junction id="a" type="dead_end" x="0" y="0" shape=""/>
<junction id="b" type="dead_end" x="{length_m}" y="0" shape=""/></net>"""
    network = parse_road_network(net.encode())
    assert len(site_finder.find_sites(network, SiteKind.MOTORWAY_STRETCH)) == (length_m > 450.0)
    slow = parse_road_network(net.replace('speed="36"', 'speed="16.67"').encode())
    assert not site_finder.find_sites(slow, SiteKind.MOTORWAY_STRETCH)
