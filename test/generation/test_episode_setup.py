"""The best site at which the whole template finds its place."""

from dataclasses import replace

import pytest

from siren_ros.dynamics.parameters import load_vehicle_parameters
from siren_ros.errors import MapError
from siren_ros.generation.episode_setup import plan_at_best_site, set_up_episode
from siren_ros.roads.maps.map_compiler import compile_map
from siren_ros.roads.net_parser import parse_road_network
from siren_ros.roads.road_network import LaneKind, RoadNetwork
from siren_ros.roads.site_finder import find_sites
from siren_ros.roads.sites import Site
from siren_ros.scenario.episode import EpisodeRequest
from siren_ros.scenario.scenario import Template
from siren_ros.scenario.templates import load_template
from siren_ros.traffic.demand.plan import TrafficPlan, load_drivers

DIMENSIONS = {
    kind: (vehicle.length_m, vehicle.width_m, vehicle.height_m) for kind, vehicle in load_vehicle_parameters().items()
}


@pytest.fixture(scope="module")
def town() -> RoadNetwork:
    return parse_road_network(compile_map(None).read_bytes())


def with_group(template: Template, **values: float) -> Template:
    first, *rest = template.demand.groups
    groups = (replace(first, **values), *rest)
    return replace(template, demand=replace(template.demand, groups=groups))


def choose(town: RoadNetwork, template: Template) -> tuple[Site, TrafficPlan]:
    return plan_at_best_site(town, template, 0, load_drivers(), DIMENSIONS, "town.net.xml")


def test_the_best_site_is_taken_where_everything_fits(town: RoadNetwork) -> None:
    template = load_template("S2")
    site, plan = choose(town, template)
    assert site == find_sites(town, template.site_kind)[0]
    assert plan.groups


def test_the_next_site_is_tried_where_one_is_too_short(town: RoadNetwork) -> None:
    template = load_template("S2")
    sites = find_sites(town, template.site_kind)
    best = sites[0]
    crowded = with_group(template, vehicles=1, first_gap_m=500.0)
    chosen, _ = choose(town, crowded)
    assert chosen in sites[1:] or chosen == best
    with pytest.raises(MapError):
        choose(town, with_group(template, vehicles=40, spacing_m=60.0))


def test_an_error_names_the_map_and_what_the_best_site_lacks(town: RoadNetwork) -> None:
    template = with_group(load_template("S6"), vehicles=60, first_gap_m=400.0)
    with pytest.raises(MapError) as caught:
        choose(town, template)
    assert caught.value.value == "town.net.xml"
    assert "stop sign" in caught.value.allowed
    assert "60 vehicles on crossing roads" in caught.value.allowed
    assert find_sites(town, template.site_kind)[0].name in caught.value.allowed


def test_nobody_drives_on_shoulders_where_the_template_says_that_they_are_in_use() -> None:
    for name, free in (("S2", False), ("S7", True)):
        network = set_up_episode(EpisodeRequest(name, "", 0, sensors="none")).network
        assert any(lane.kind is LaneKind.SHOULDER and lane.emergency_allowed for lane in network.lanes) is free
