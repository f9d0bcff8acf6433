"""EMVs besides the first: behind it, and across its way."""

from dataclasses import replace

import numpy as np
import pytest
from made_streets import signal_site, start_at, streets
from traffic_helpers import MAPS, load_map, named_map

from siren_ros.errors import InputError, MapError
from siren_ros.running.generation.episode_setup import EpisodeSetup, set_up_episode
from siren_ros.simulation.roads.movements import comes_from_the_side
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import EdgeGraph, civilian_movements
from siren_ros.simulation.roads.site_finder import find_sites, require_site
from siren_ros.simulation.roads.sites import SiteKind
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import TEMPLATES
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.traffic.demand.emv_start import emv_start, start_m_of, unhindered_arrival_s
from siren_ros.simulation.traffic.demand.further_emvs import (
    arrival_s,
    crossing_start,
    crossing_ways,
    following_starts,
    prolonged,
)
from siren_ros.simulation.traffic.demand.plan import chain_along


def set_up(template: str, values: str, seed: int = 0) -> EpisodeSetup:
    return set_up_episode(EpisodeRequest(template, seed=seed, sensors="none", values=values))


def test_a_jam_on_a_motorway_takes_more_emvs_and_none_that_crosses() -> None:
    setup = set_up("S8", "emv.count=2,emv.headway_s=20")
    assert [emv.name for emv in setup.plan.emvs] == ["emv0", "emv1"]
    with pytest.raises(InputError, match=r"emv\.crossing"):
        set_up("S8", "emv.crossing=1")


@pytest.mark.parametrize("name", TEMPLATES)
def test_every_template_takes_more_emvs_and_one_that_crosses(name: str) -> None:
    setup = set_up(name, "emv.count=3,emv.crossing=1,emv.headway_s=4")
    assert [emv.name for emv in setup.plan.emvs] == ["emv0", "emv1", "emv2", "crossing_emv0"]
    assert setup.description.emv_ids == (1, 2, 3, 4)
    first, second, third, across = (emv.route for emv in setup.plan.emvs)
    assert second[-len(first) :] == third[-len(first) :] == first
    assert across[-len(first) :] != first
    assert setup.description.crossed_junctions == {4: setup.plan.crossed}
    alone = set_up(name, "")
    assert len(alone.plan.emvs) == 1
    assert alone.description.crossed_junctions == {}
    assert "crossing" not in alone.description.parameters


@pytest.mark.parametrize("name", ["S1", "S2", "S4", "S6"])
@pytest.mark.parametrize("after_s", [-2.0, 0.0, 5.0])
def test_the_crossing_emv_comes_from_the_side_to_the_first_ones_junction_in_time(name: str, after_s: float) -> None:
    setup = set_up(name, f"emv.crossing=1,emv.crossing_after_s={after_s}")
    network, site, template = setup.network, setup.site, setup.template
    start = emv_start(network, site, start_m_of(network, site, template.emv))
    ways, edge = crossing_ways(network, site, start)
    wanted_s = arrival_s(network, site, start, edge, template.emv) + after_s
    others = [vehicle for vehicle in setup.plan.groups if not vehicle.name.startswith("crossing")]
    way, across = crossing_start(network, ways, template.emv, wanted_s, (*setup.plan.emvs[:-1], *others))
    # It starts a run-up of 20 m before junctions on the way.
    assert abs(unhindered_arrival_s(network, across, template.emv) - wanted_s) < 5.0
    assert network.edges[edge].to_junction == way.junction == setup.plan.crossed
    own = civilian_movements(network, edge, start.route[start.route.index(edge) + 1])[-1]
    assert comes_from_the_side(network, own, network.connections[way.connections[-1]])
    assert setup.plan.emvs[-1].spot.lane == across.lane
    assert setup.plan.emvs[-1].spot.front_m == across.front_m
    assert any(area.lane == across.lane and area.from_m < across.front_m < area.to_m for area in setup.plan.stage)


@pytest.mark.parametrize("name", ["S4", "S6"])
def test_no_crossing_queue_stands_in_the_lane_of_an_emv_that_crosses(name: str) -> None:
    """The other lanes keep theirs, and the volume stays."""
    setup, alone = set_up(name, "emv.crossing=1"), set_up(name, "")
    crossing = setup.plan.emvs[-1]
    edges = [setup.network.edge_by_id[edge].index for edge in crossing.route]
    chain = chain_along(setup.network, setup.network.lanes[crossing.spot.lane], edges).lanes
    before = chain[: next(at for at, lane in enumerate(chain) if setup.network.lanes[lane].kind is LaneKind.INTERNAL)]
    queue = [vehicle for vehicle in setup.plan.groups if vehicle.name.startswith("crossing")]
    assert queue
    assert len(queue) < sum(vehicle.name.startswith("crossing") for vehicle in alone.plan.groups)
    assert not {vehicle.spot.lane for vehicle in queue} & set(before)
    assert setup.plan.civilians == alone.plan.civilians


def test_at_a_junction_only_its_own_side_streets_count_and_on_a_road_those_of_the_first_behind_it() -> None:
    at_signal, on_road = set_up("S4", "emv.crossing=1"), set_up("S2", "emv.crossing=1")
    assert at_signal.plan.crossed == at_signal.site.junction
    last = on_road.site.stretch[-1]
    assert on_road.plan.crossed == on_road.network.edges[last].to_junction


def test_without_a_side_street_a_crossing_emv_is_refused() -> None:
    """The turn on the shoulder of a street without others: nobody comes from the side."""
    network, site = streets(), signal_site()
    side = [way for _, way in network.connections_at["J"] if network.lanes[way.from_lane].edge not in site.route]
    kept = tuple(way for way in network.connections if way not in side)
    lonely = replace(network, connections=kept)
    with pytest.raises(InputError, match=r"emv\.crossing is above 0"):
        crossing_ways(lonely, replace(site, connections=site.connections[:1]), start_at(110.0))


def test_where_the_side_street_is_too_short_or_full_no_emv_starts() -> None:
    network = load_map(None)[1]
    site, emv = require_site(network, SiteKind.SIGNAL_JUNCTION), load_template("S4").emv
    start = emv_start(network, site, start_m_of(network, site, emv))
    ways, _ = crossing_ways(network, site, start)
    with pytest.raises(MapError, match="enough road"):
        crossing_start(network, ways, emv, 1e4, ())


@pytest.mark.parametrize("name", MAPS)
def test_followers_keep_the_headway_where_the_approach_has_to_be_prolonged(name: str) -> None:
    network: RoadNetwork = named_map(name)[1]
    template = load_template("S2")
    graph, pair = EdgeGraph.of(network), replace(template.emv, count=2)
    for site in find_sites(network, template.site_kind):
        before_m = graph.route_length_m(site.route[: site.site_position])
        longer = prolonged(network, site, before_m + 60.0)
        if len(longer.route) > len(site.route):
            break
    else:
        pytest.fail("no road leads to any approach")
    assert longer.route[longer.site_position] == site.site_edge
    headway_m = before_m + 30.0
    with pytest.raises(MapError):
        emv_start(network, site, start_m_of(network, site, pair) - headway_m - 60.0)
    first, second = following_starts(network, site, pair, headway_m)
    assert second.route[-len(first.route) :] == first.route
    assert len(second.route) > len(first.route)
    points = [np.array(network.lanes[start.lane].centre.at(start.front_m)) for start in (first, second)]
    assert np.linalg.norm(points[0] - points[1]) < headway_m + 60.0


def test_an_emv_that_starts_behind_the_sites_edge_arrives_once_although_its_way_comes_back() -> None:
    network: RoadNetwork = named_map("town")[1]
    template = load_template("S2")
    site = next(
        one
        for one in find_sites(network, template.site_kind)
        if len(one.stretch) > 1 and one.stretch[0] == one.site_edge
    )
    length_m = network.lanes[network.edges[site.site_edge].lanes[0]].length_m
    start = emv_start(network, site, length_m + 5.0)
    assert start.route[0] == site.stretch[1]
    back = replace(start, route=(*start.route, site.site_edge))
    once, again = (arrival_s(network, site, one, site.stretch[-1], template.emv) for one in (start, back))
    assert again == once > 0.0
