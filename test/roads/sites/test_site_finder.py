from itertools import pairwise

import pytest
from repository import SHARED

from siren_ros.errors import MapError
from siren_ros.roads.maps.map_compiler import compile_map
from siren_ros.roads.net_parser import parse_road_network
from siren_ros.roads.road_network import JunctionKind, LaneKind
from siren_ros.roads.routing import EdgeGraph, driving_lanes, route_path
from siren_ros.roads.sites.site_finder import REQUIREMENTS, SiteKind, find_sites, require_site

TOWN10 = SHARED / "maps" / "Town10HD_Opt.xodr"
LONELY_ROAD = b"""<net><edge id="e" from="a" to="b">
<lane id="e_0" index="0" disallow="pedestrian" speed="13.89" length="500" shape="0,0 500,0"/></edge>
<junction id="a" type="dead_end" x="0" y="0" shape=""/>
<junction id="b" type="dead_end" x="500" y="0" shape=""/></net>"""


@pytest.fixture(scope="module", params=["town", "town10"])
def network(request, tmp_path_factory):
    if request.param == "town10" and not TOWN10.exists():
        pytest.skip(f"the OpenDRIVE map {TOWN10.name} is not beside this checkout")
    source = TOWN10 if request.param == "town10" else None
    return parse_road_network(compile_map(source, tmp_path_factory.mktemp("maps")).read_bytes())


@pytest.mark.parametrize("kind", list(SiteKind))
def test_every_kind_is_found_best_first(network, kind):
    sites = find_sites(network, kind)
    assert sites
    assert all(site.kind is kind for site in sites)
    assert [site.score for site in sites] == sorted((site.score for site in sites), reverse=True)
    assert sites == find_sites(network, kind)
    assert require_site(network, kind) == sites[0]


@pytest.mark.parametrize("kind", list(SiteKind))
def test_the_best_place_has_a_route_for_a_whole_episode(network, kind):
    graph = EdgeGraph.of(network)
    site = require_site(network, kind)
    assert site.route[site.site_position] == site.site_edge
    assert network.lanes[site.approach_lane].edge == site.site_edge
    lanes = route_path(network, site.route, driving_lanes(network, site.route[0])[0].index)
    assert network.lanes[lanes[-1]].edge == site.route[-1]
    for edge, ahead in pairwise(site.route):
        assert ahead in graph.successors[edge]
    assert graph.route_length_m(site.route) >= 500.0
    before = site.route[: site.site_position + (0 if kind is SiteKind.MULTI_LANE_ROAD else 1)]
    assert graph.route_length_m([*before, site.route[len(before)]]) - graph.length_m[site.route[len(before)]] >= 150.0
    assert graph.route_length_m(site.route[site.site_position + 1 :]) >= 100.0


def test_a_wide_road_has_two_lanes_all_along_and_no_control_inside(network):
    for site in find_sites(network, SiteKind.MULTI_LANE_ROAD):
        assert all(len(driving_lanes(network, edge)) >= 2 for edge in site.stretch)
        assert site.route[site.site_position :][: len(site.stretch)] == site.stretch
        assert site.length_m >= 60.0
        for edge in site.stretch[:-1]:
            assert network.junctions[network.edges[edge].to_junction].kind is not JunctionKind.SIGNAL
    assert require_site(network, SiteKind.MULTI_LANE_ROAD).length_m >= 200.0


def test_a_queued_approach_ends_at_a_signal_with_two_lanes_side_by_side(network):
    for site in find_sites(network, SiteKind.QUEUED_APPROACH):
        assert network.junctions[site.junction].kind is JunctionKind.SIGNAL
        lanes = [network.lanes[network.connections[index].from_lane].position for index in site.connections]
        assert len(set(lanes)) >= 2
        assert max(lanes) - min(lanes) == len(set(lanes)) - 1
        assert site.stretch[-1] == site.site_edge


@pytest.mark.parametrize("kind", [SiteKind.SIGNAL_JUNCTION, SiteKind.STOP_JUNCTION])
def test_a_crossed_junction_has_traffic_from_other_approaches(network, kind):
    for site in find_sites(network, kind):
        assert site.crossing
        for index in site.crossing:
            other = network.connections[index]
            assert other.junction == site.junction
            assert network.lanes[other.from_lane].edge != site.site_edge
        movements = [network.connections[index] for index in site.connections]
        if kind is SiteKind.STOP_JUNCTION:
            assert all(movement.must_stop for movement in movements)
        else:
            assert all(movement.signal_id is not None for movement in movements)


def test_a_signalised_junction_has_flow_beside_the_emv(network):
    assert len(require_site(network, SiteKind.SIGNAL_JUNCTION).connections) >= 2


def test_a_shoulder_runs_on_round_the_right_turn(network):
    for site in find_sites(network, SiteKind.SHOULDER_RIGHT_TURN):
        (index,) = site.connections
        turn = network.connections[index]
        lanes = [
            network.lanes[turn.from_lane],
            *(network.lanes[lane] for lane in turn.via),
            network.lanes[turn.to_lane],
        ]
        assert (lanes[0].kind, lanes[-1].kind) == (LaneKind.SHOULDER, LaneKind.SHOULDER)
        assert turn.direction == "r"
        assert all(lane.emergency_allowed and not lane.civilian_allowed for lane in lanes)
        assert turn.from_lane == site.approach_lane
        path = route_path(network, site.route[site.site_position :][:2], site.approach_lane)
        assert path == (turn.from_lane, *turn.via, turn.to_lane)


@pytest.mark.parametrize("kind", list(SiteKind))
def test_a_map_without_such_a_place_says_what_it_lacks(kind):
    network = parse_road_network(LONELY_ROAD)
    assert find_sites(network, kind) == ()
    with pytest.raises(MapError) as caught:
        require_site(network, kind, "road.net.xml")
    assert REQUIREMENTS[kind] in str(caught.value)
    assert "road.net.xml" in str(caught.value)


def test_the_town_has_the_straight_that_s1_and_s2_need(tmp_path_factory):
    network = parse_road_network(compile_map(None, tmp_path_factory.mktemp("maps")).read_bytes())
    site = require_site(network, SiteKind.MULTI_LANE_ROAD)
    assert "Main Street" in site.name
    assert site.length_m >= 250.0
    y = {round(float(point[1]), 2) for edge in site.stretch for point in driving_lanes(network, edge)[0].centre.points}
    assert len(y) == 1
