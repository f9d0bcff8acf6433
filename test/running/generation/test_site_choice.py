"""Which sites are good enough, which one a seed draws, and what happens where a template finds no room."""

import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_crossing import ARMS, CROSSING, made_net
from map_networks import network_of_map, plain_net

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import InputError, MapError
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.running.generation.site_choice import (
    WEAKER,
    count_lacks,
    good_sites,
    has_shoulder,
    needed_m,
    plan_at_site,
    proposed,
    ranked_sites,
    shortcomings,
    sites_to_try,
)
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.roads.maps.amended_map import amended_map
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import Connection, Edge, RoadNetwork
from siren_ros.simulation.roads.routing import driving_lanes, has_right_of_way
from siren_ros.simulation.roads.site_finder import find_sites, places_without_site
from siren_ros.simulation.roads.sites import Control, Lack, Site
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import TEMPLATES
from siren_ros.simulation.scenario.scenario import Placement, Template
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.traffic.demand.plan import TrafficPlan, load_drivers
from siren_ros.simulation.world.actors import ActorClass

DIMENSIONS = {
    kind: (vehicle.length_m, vehicle.width_m, vehicle.height_m) for kind, vehicle in load_vehicle_parameters().items()
}


@pytest.fixture(scope="module")
def town() -> RoadNetwork:
    return network_of_map()


def with_group(template: Template, **values: float) -> Template:
    first, *rest = template.demand.groups
    groups = (replace(first, **values), *rest)
    return replace(template, demand=replace(template.demand, groups=groups))


def shortened(
    town: RoadNetwork, lanes: set[int], length_m: float, signal_at: Callable[[Connection], bool]
) -> RoadNetwork:
    """The town with shorter lanes, and with a signal at some connections."""
    kept = [
        replace(lane, centre=lane.centre.cut(0.0, length_m)) if lane.index in lanes else lane for lane in town.lanes
    ]
    ways = [replace(way, signal_id="S", signal_link=0) if signal_at(way) else way for way in town.connections]
    return replace(town, lanes=tuple(kept), connections=tuple(ways))


def lacks_of(network: RoadNetwork, template: Template, name: str) -> tuple[Lack, ...]:
    """What the site of a name lacks."""
    return next(texts for site, texts in shortcomings(network, template).items() if site.name == name)


def choose(town: RoadNetwork, template: Template, pinned: str = "", seed: int = 0) -> tuple[Site, TrafficPlan]:
    sites = sites_to_try(town, template, seed, pinned, "town.net.xml")
    return plan_at_site(town, sites, template, seed, load_drivers(), DIMENSIONS)


@pytest.mark.parametrize("name", TEMPLATES)
def test_the_town_has_at_least_three_good_sites(town: RoadNetwork, name: str) -> None:
    template = load_template(name)
    good = good_sites(town, template)
    assert len({site.name for site in good}) == len(good) >= 3
    for site in good:
        after = site.route[site.route.index(site.stretch[-1]) + 1 :]
        assert sum(driving_lanes(town, edge)[-1].length_m for edge in after) >= 90.0, "the map does not end there"
        assert choose(town, template, site.name)[0] == site


@pytest.mark.parametrize("name", TEMPLATES)
def test_every_site_that_no_seed_draws_says_what_it_lacks(town: RoadNetwork, name: str) -> None:
    template = load_template(name)
    lacking = shortcomings(town, template)
    assert [*lacking] == [site for site, _ in ranked_sites(town, template)]
    assert {site for site, texts in lacking.items() if not texts} == set(good_sites(town, template))
    for site, texts in lacking.items():
        assert len(set(texts)) == len(texts)
        assert (Lack("a shoulder, and others have none") in texts) <= has_shoulder(town, site)
        turns = any(town.connections[index].direction != "s" for index in site.connections)
        assert (Lack("a turn, where the EMV has to go straight on") in texts) == (turns and name in {"S3", "S4"})


@pytest.mark.parametrize(("name", "least_m"), [("S1", 120.0), ("S2", 150.0)])
def test_where_others_make_way_there_is_no_shoulder(town: RoadNetwork, name: str, least_m: float) -> None:
    """Shorter roads and those with a shoulder are there; the seed does not draw them."""
    template = load_template(name)
    good = good_sites(town, template)
    assert min(site.length_m for site in good) >= least_m
    assert not any(has_shoulder(town, site) for site in good)
    others = [site for site, _ in ranked_sites(town, template) if site not in good]
    assert min(site.length_m for site in others) < least_m
    assert any(has_shoulder(town, site) and site.length_m > least_m for site in others)


def test_a_stream_next_to_the_emv_needs_a_lane_there(town: RoadNetwork) -> None:
    """A template whose stream is optional also happens where one lane leads on: the stop junctions have such."""
    template = load_template("S5")
    stream = replace(template.demand.groups[0], placement=Placement.SAME_DIRECTION)
    with_stream = replace(template, demand=replace(template.demand, groups=(stream,)))
    optional = replace(with_stream, demand=replace(template.demand, groups=(replace(stream, optional=True),)))
    assert {len(site.connections) for site in good_sites(town, with_stream)} == {2}
    assert {len(site.connections) for site in good_sites(town, optional)} == {1, 2}
    beside = replace(
        template, demand=replace(template.demand, groups=(replace(stream, placement=Placement.ADJACENT_LANE),))
    )
    alone = Lack("no second lane that leads on beside the EMV's")
    assert all((alone in texts) == (len(site.connections) < 2) for site, texts in shortcomings(town, beside).items())


def test_the_strongest_control_of_a_map_is_taken(town: RoadNetwork) -> None:
    for template in map(load_template, ("S5", "S6")):
        lacking = shortcomings(town, template)
        good = [site for site, texts in lacking.items() if not texts]
        assert {(site.junction, site.control) for site in good} == {
            ("north_centre", Control.ALL_WAY_STOP),
            ("mill", Control.ALL_WAY_STOP),
        }
        weaker = {site for site, texts in lacking.items() if texts == (Lack(WEAKER),)}
        assert {site.junction for site in weaker if site.control is Control.TWO_WAY_STOP} == {"oak_east", "oak_west"}


CONTROLS = {
    "priority_stop": Control.TWO_WAY_STOP,
    "priority": Control.GIVE_WAY,
    "right_before_left": Control.UNCONTROLLED,
}


@pytest.mark.parametrize("junction_type", CONTROLS)
def test_a_grid_without_all_way_stops_has_sites_of_its_own_control(tmp_path: Path, junction_type: str) -> None:
    """Nobody stops for S5 where no sign says it, and the template brings no traffic to give way to."""
    size = ("--grid", "--grid.number", "3", "--grid.length", "200", "--grid.attach-length", "200")
    net = tmp_path / "grid.net.xml"
    make = ("netgenerate", *size, "--default-junction-type", junction_type, "--no-turnarounds", "-o", str(net))
    subprocess.run(make, check=True, capture_output=True)
    network, control = parse_road_network(net.read_bytes()), CONTROLS[junction_type]
    crossed = good_sites(network, load_template("S6"))
    assert {site.control for site in crossed} == {control}
    for site in crossed:
        emv = network.connections[site.connections[-1]]
        assert all(has_right_of_way(network, emv, network.connections[index]) for index in site.crossing)
    assert bool(good_sites(network, load_template("S5"))) == (control is Control.TWO_WAY_STOP)


@pytest.mark.parametrize(("name", "length_m", "held_up"), [("S3", 14.0, True), ("S4", 14.0, True), ("S4", 16.0, False)])
def test_a_signal_right_behind_a_site_holds_up_those_who_pass(
    town: RoadNetwork, name: str, length_m: float, held_up: bool
) -> None:
    site = good_sites(town, load_template(name))[0]
    lanes = set(town.edges[site.beyond[0]].lanes)
    changed = shortened(town, lanes, length_m, lambda way: way.from_lane in lanes)
    text = Lack("a signal or stop sign less than 15 m behind it, and others have none")
    assert lacks_of(changed, load_template(name), site.name) == ((text,) if held_up else ())


@pytest.mark.parametrize(
    ("end", "length_m", "lacks"),
    [
        ("to_lane", 7.0, "a signal or stop sign right behind it, before which a car would stand inside"),
        ("to_lane", 8.0, ""),
        ("from_lane", 30.0, "less than 30 m of road from which others come across, and others have more"),
        ("from_lane", 31.0, ""),
    ],
)
def test_who_crosses_has_road_to_come_from_and_to_leave_to(
    town: RoadNetwork, end: str, length_m: float, lacks: str
) -> None:
    site = good_sites(town, load_template("S4"))[0]
    short = {getattr(town.connections[index], end) for index in site.crossing}
    changed = shortened(town, short, length_m, lambda way: bool(short & {way.from_lane, way.to_lane}))
    assert lacks_of(changed, load_template("S4"), site.name) == ((Lack(lacks),) if lacks else ())


@pytest.mark.parametrize(
    ("length_m", "behind", "name", "stays"),
    [
        *((20.0, {"green_phases": frozenset(green)}, "S3", False) for green in ((), {3}, {3, 4}, {2, 4})),
        *((20.0, {"green_phases": frozenset(green)}, "S3", True) for green in ({5}, {4, 5})),
        (20.0, {"green_phases": frozenset({3})}, "S4", True),
        (31.0, {"green_phases": frozenset({3})}, "S3", True),
        (20.0, {"green_phases": frozenset({3}), "alternates": False}, "S3", True),
        (20.0, {"green_phases": frozenset({3}), "signal_id": "other"}, "S3", True),
    ],
)
def test_at_a_line_close_behind_of_the_same_signal_a_stream_needs_green_for_longer(
    town: RoadNetwork, length_m: float, behind: dict[str, Any], name: str, stays: bool
) -> None:
    """The EMV's way has green in phases 3 and 4. A stream of four cars has room on 30 m."""
    site = good_sites(town, load_template("S3"))[0]
    own = {town.connections[index] for index in site.connections}
    lanes = set(town.edges[site.beyond[0]].lanes)
    signal = next(iter(own)).signal_id
    short = shortened(town, lanes, length_m, lambda way: way.from_lane in lanes)
    lit = [
        replace(new, green_phases=frozenset({3, 4}))
        if old in own
        else replace(new, **{"signal_id": signal, **behind})
        if new.from_lane in lanes
        else new
        for old, new in zip(town.connections, short.connections, strict=True)
    ]
    lacks = lacks_of(replace(short, connections=tuple(lit)), load_template(name), site.name)
    assert (Lack("a line of its signal close behind it that does not stay green for longer") not in lacks) is stays


@pytest.mark.parametrize(
    ("ways", "name", "crossed"),
    [(("s e 0 1",), "S4", False), (("s e 0 1", "s n 0 0"), "S4", True), (("s e 0 1",), "S3", True)],
)
def test_somebody_comes_across_the_lane_that_the_emv_takes(
    tmp_path: Path, ways: tuple[str, ...], name: str, crossed: bool
) -> None:
    """A side road joins a road of three lanes in the middle one, or leads across, too; the EMV takes the left lane."""
    nodes = {"A": (-500, 0), "C": (0, 0), "E": (400, 0), "N": (0, 300), "S": (0, -300)}
    net = plain_net(
        tmp_path,
        "".join(
            f'<node id="{name}" x="{x}" y="{y}" type="{"traffic_light" if name == "C" else "priority"}"/>'
            for name, (x, y) in nodes.items()
        ),
        '<edge id="a" from="A" to="C" numLanes="3"/><edge id="e" from="C" to="E" numLanes="3"/>'
        '<edge id="s" from="S" to="C"/><edge id="n" from="C" to="N"/>',
        "".join(
            '<connection from="{}" to="{}" fromLane="{}" toLane="{}"/>'.format(*way.split())
            for way in ("a e 0 0", "a e 1 1", "a e 2 2", *ways)
        ),
    )
    lacks = lacks_of(network_of_map(net), load_template(name), "a..e")
    assert (Lack("nobody who comes across the lane that the EMV takes") not in lacks) is crossed


@pytest.mark.parametrize(
    ("length_m", "one_leaves", "held_up"),
    [(14.0, False, True), (8.0, False, True), (16.0, False, False), (14.0, True, False)],
)
def test_all_who_come_across_are_held_up_by_lines_close_behind_unless_one_leaves_the_map(
    town: RoadNetwork, length_m: float, one_leaves: bool, held_up: bool
) -> None:
    name, template = "main_w_0..main_w_1", load_template("S4")
    site = next(site for site in good_sites(town, template) if site.name == name)
    roads = {town.lanes[town.connections[index].to_lane].edge for index in site.crossing}
    lanes = {lane for road in roads for lane in town.edges[road].lanes}
    assert not lanes <= town.connections_from.keys()
    kept = (way for way in town.connections if one_leaves or way.to_lane in town.connections_from)
    changed = shortened(replace(town, connections=tuple(kept)), lanes, length_m, lambda way: way.from_lane in lanes)
    text = Lack("a signal or stop sign less than 15 m behind it for all who come across, and others have none")
    assert lacks_of(changed, template, name) == ((text,) if held_up else ())


def test_a_road_that_ends_at_a_stop_sign_is_no_place_to_clear_a_lane(town: RoadNetwork) -> None:
    template = load_template("S2")
    good, ranked = good_sites(town, template), [site for site, _ in ranked_sites(town, template)]
    stopping = [site for site in ranked if any(town.connections[index].must_stop for index in site.connections)]
    assert max(site.length_m for site in stopping) > 300.0
    assert not set(stopping) & set(good)


@pytest.mark.parametrize(("apart_m", "alone"), [(2.0, False), (9.0, True)])
def test_a_site_says_that_another_road_lies_over_it(tmp_path: Path, apart_m: float, alone: bool) -> None:
    near = f"-400,-60 -120,{-3.2 - apart_m} 120,{-3.2 - apart_m} 400,-60"
    net = plain_net(
        tmp_path,
        '<node id="A" x="-400" y="0"/><node id="B" x="400" y="0"/><node id="C" x="-400" y="-60"/>'
        '<node id="D" x="400" y="-60"/>',
        f'<edge id="a" from="A" to="B" numLanes="2"/><edge id="b" from="C" to="D" shape="{near}"/>',
    )
    (lacking,) = shortcomings(network_of_map(net), load_template("S2")).values()
    assert (Lack("a road that lies over it, without a junction") not in lacking) is alone


BEFORE_IT = ("b c 0 0", "b c 0 1", "b c 1 3", "c s 0 0", "c e 1 0", "c e 2 1", "c n 3 0")


@pytest.mark.parametrize(
    ("ways", "good"),
    [
        *[((*BEFORE_IT, "b c 1 2"), True), ((*BEFORE_IT, "b c 0 2"), False), (("a s 0 0", "a e 1 0", "a e 2 1"), True)],
        (("a e 0 0", "a e 1 1", "a n 2 0"), False),
    ],
    ids=["two lanes widen", "two queues grow out of one lane", "the right lane turns", "the left lane turns"],
)
def test_two_queues_have_lanes_of_their_own_without_one_that_turns_left(
    tmp_path: Path, ways: tuple[str, ...], good: bool
) -> None:
    """A road of two lanes up to 45 m before the line and then four, the middle ones straight on; and one of three."""
    nodes = {"A": (-500, 0), "B": (-45, 0), "C": (0, 0), "E": (400, 0), "N": (0, 300), "S": (0, -300)}
    edges = {"b": ("AB", 2), "c": ("BC", 4), "a": ("AC", 3), "e": ("CE", 2), "n": ("CN", 1), "s": ("CS", 1)}
    used = {"n", "s", *(name for way in ways for name in way.split()[:2])}
    net = plain_net(
        tmp_path,
        "".join(
            f'<node id="{name}" x="{x}" y="{y}" type="{"traffic_light" if name == "C" else "priority"}"/>'
            for name, (x, y) in nodes.items()
        ),
        "".join(
            f'<edge id="{name}" from="{ends[0]}" to="{ends[1]}" numLanes="{lanes}" speed="13.9"/>'
            for name, (ends, lanes) in edges.items()
            if name in used
        ),
        "".join('<connection from="{}" to="{}" fromLane="{}" toLane="{}"/>'.format(*way.split()) for way in ways),
    )
    (lacking,) = shortcomings(network_of_map(net), load_template("S1")).values()
    lack = "less than 162 m of road without a junction or a turning lane on the left"
    assert (Lack(lack) not in lacking) is good


def test_the_needed_length_follows_from_the_rows_of_a_template() -> None:
    """Queues of S1 start up to the EMV, 28 m before it; a jam of S8 starts ahead of it, with its own spacing."""
    queues, jam = load_template("S1"), load_template("S8")
    assert needed_m(queues) == -queues.emv.start_m - 28.0
    (group,) = jam.demand.groups
    shorter = with_group(jam, vehicles=group.vehicles - 10)
    car_m = (needed_m(jam) - needed_m(shorter)) / 10.0 - group.spacing_m
    assert 4.5 < car_m < 5.5
    assert needed_m(jam) == pytest.approx(
        jam.emv.start_m + group.first_gap_m + group.vehicles * (group.spacing_m + car_m)
    )


def test_a_road_is_long_enough_to_pass_the_vehicles_that_the_predicate_asks_for() -> None:
    """The EMV at 12 m/s comes past the second of vehicles at 8 m/s, whose front is 30 m ahead, after 90 m."""
    template = load_template("S2")
    emv = replace(template.emv, start_m=10.0, speed_mps=12.0)
    sedan_m = load_vehicle_parameters()[ActorClass.SEDAN].length_m
    row = replace(template.demand.groups[0], first_gap_m=30.0 - 2.0 * sedan_m - 9.0, spacing_m=9.0, vehicles=3)
    demand = replace(template.demand, groups=(row,), classes=((ActorClass.SEDAN, 1.0),), speed_limit_mps=8.0)
    passed = replace(template.predicate, thresholds={"lane_changes_min": 2, "passed_min": 2})
    template = replace(template, emv=emv, demand=demand, predicate=passed)
    assert needed_m(template) == pytest.approx(10.0 + 90.0)
    slow = replace(template, emv=replace(emv, speed_mps=8.0))
    assert needed_m(slow) == pytest.approx(10.0 + row.first_gap_m + 3 * (9.0 + sedan_m))


def test_the_seed_draws_each_good_site_and_every_site_is_tried_once_the_good_ones_first(town: RoadNetwork) -> None:
    template = load_template("S5")
    good, ranked = good_sites(town, template), [site for site, _ in ranked_sites(town, template)]
    tries = [sites_to_try(town, template, seed, "", "town").sites for seed in range(40)]
    assert {sites[0] for sites in tries} == set(good)
    assert set(tries[3][: len(good)]) == set(good)
    assert list(tries[3][len(good) :]) == [site for site in ranked if site not in good]


def test_a_pinned_site_is_taken_and_recorded(town: RoadNetwork) -> None:
    pinned = good_sites(town, load_template("S3"))[-1].name
    setup = set_up_episode(EpisodeRequest("S3", site=pinned, sensors="none"))
    assert setup.site.name == setup.description.site["name"] == setup.description.asked["site"] == pinned
    drawn = set_up_episode(EpisodeRequest("S3", sensors="none"))
    assert "site" not in drawn.description.asked
    assert drawn.description.site["name"] == drawn.site.name


def test_an_unknown_site_is_refused_with_the_names_that_there_are(town: RoadNetwork) -> None:
    template = load_template("S7")
    with pytest.raises(InputError) as caught:
        sites_to_try(town, template, 0, "main_street", "town.net.xml")
    assert (caught.value.parameter, caught.value.value) == ("site", "main_street")
    assert all(site.name in caught.value.allowed for site in find_sites(town, template.site_kind))


def test_another_site_is_tried_where_one_is_too_short(town: RoadNetwork) -> None:
    """A platoon that begins 200 m ahead of the EMV fits into two of the roads."""
    template = with_group(load_template("S2"), vehicles=1, first_gap_m=500.0)
    assert {choose(town, template, seed=seed)[0].name for seed in range(3)}
    with pytest.raises(MapError):
        choose(town, with_group(template, vehicles=40, spacing_m=60.0))


@pytest.mark.parametrize("pinned", ["", "north_e_0..north_e_1"])
def test_an_error_names_the_map_and_what_the_best_site_lacks(town: RoadNetwork, pinned: str) -> None:
    template = with_group(load_template("S6"), vehicles=60, first_gap_m=400.0)
    with pytest.raises(MapError) as caught:
        choose(town, template, pinned)
    assert caught.value.value == "town.net.xml"
    assert "has to stop" in caught.value.allowed
    assert "60 vehicles on crossing roads" in caught.value.allowed
    assert (pinned or find_sites(town, template.site_kind)[0].name) in caught.value.allowed


@pytest.mark.parametrize("seed", [6, 7])
def test_the_green_that_counts_is_that_of_the_traffic_straight_on(town: RoadNetwork, seed: int) -> None:
    """Main Street's left turns are green first; its queues go 12 s later, and the EMV from the avenue comes then."""
    _, plan = choose(town, load_template("S4"), "east_n_0..east_n_1", seed)
    assert plan.signal is not None
    links = {c.signal_link: c.direction for c in town.connections if c.signal_id == plan.signal.signal_id}
    assert {links[link] for link in plan.signal.crossing} == {"s"}
    waiting = {vehicle.route[1] for vehicle in plan.groups if vehicle.name.startswith("crossing")}
    assert {"main_w_1", "main_e_3"} <= waiting


def test_the_motorway_has_good_sites_of_two_three_and_four_lanes() -> None:
    motorway = network_of_map(Path("motorway"))
    template = load_template("S8")
    good = good_sites(motorway, template)
    assert {len(driving_lanes(motorway, site.site_edge)) for site in good} == {2, 3, 4}
    assert len(good) == 8
    for site in {len(driving_lanes(motorway, site.site_edge)): site for site in good}.values():
        chosen, plan = choose(motorway, template, site.name)
        assert chosen == site
        lanes = len(driving_lanes(motorway, site.site_edge))
        assert len(plan.groups) == lanes * template.demand.groups[0].vehicles
        assert plan.jam is not None
        assert len(plan.jam.names) == lanes
        assert plan.duty
        rows = {motorway.lanes[vehicle.spot.lane].position for vehicle in plan.groups if vehicle.length_m > 8.0}
        assert len(rows) <= 1, "long vehicles are in one lane"
    lacking = shortcomings(motorway, template)
    assert {lacks[0] for site, lacks in lacking.items() if site not in good} == {Lack("hardly any road behind it")}


def test_a_template_happens_on_its_own_map_unless_another_one_is_named() -> None:
    assert set_up_episode(EpisodeRequest("S8", sensors="none")).compiled_map.name == "motorway"
    assert set_up_episode(EpisodeRequest("S2", sensors="none")).compiled_map.name == "town"
    assert set_up_episode(EpisodeRequest("S2", sensors="none", map="town")).compiled_map.name == "town"
    with pytest.raises(MapError, match="a road out of town, above 61 km/h"):
        set_up_episode(EpisodeRequest("S8", sensors="none", map="town"))


def with_bridge(network: RoadNetwork, over: int) -> RoadNetwork:
    """The network with a road of 100 m that crosses an edge in the middle of its length, at a right angle."""
    lane = driving_lanes(network, over)[-1]
    across_rad = float(lane.centre.heading_rad(lane.length_m / 2.0)) + np.pi / 2.0
    aside = 50.0 * np.array([np.cos(across_rad), np.sin(across_rad)])
    middle = np.asarray(lane.centre.at(lane.length_m / 2.0))
    edge = Edge(len(network.edges), "bridge", (len(network.lanes),), "from", "to", internal=False)
    centre = Polyline.through([middle - aside, middle + aside])
    road = replace(lane, index=edge.lanes[0], lane_id="bridge_0", edge=edge.index, position=0, centre=centre)
    return replace(network, lanes=(*network.lanes, road), edges=(*network.edges, edge))


def test_no_road_crosses_a_good_motorway_on_a_bridge() -> None:
    """A bridge in the middle of a stretch crosses the other direction, too; all others are more than 300 m away."""
    motorway, template = network_of_map(Path("motorway")), load_template("S8")
    good = {site.name: site for site in good_sites(motorway, template)}
    bridged = with_bridge(motorway, good["e_d"].site_edge)
    lacking = {site.name: texts for site, texts in shortcomings(bridged, template).items()}
    crossed = {name for name in good if lacking[name]}
    assert crossed == {"e_d", "w_d"}
    assert all("bridge" in lacking[name][0].text for name in crossed)


def test_lacks_are_counted_once_for_each_place(town: RoadNetwork) -> None:
    template = load_template("S5")
    places, alone = count_lacks(town, template, shortcomings(town, template))
    lacking = [lacks for lacks in shortcomings(town, template).values() if lacks]
    assert lacking
    for text in {lack.text for lacks in lacking for lack in lacks}:
        assert places[text] == sum(text in [lack.text for lack in lacks] for lacks in lacking)
        assert alone[text] == sum([lack.text for lack in lacks] == [text] for lacks in lacking)
    assert places["no stop sign"] == sum(
        place.lacking == "no stop sign" for place in places_without_site(town, template.site_kind)
    )
    assert alone["no stop sign"] == 0


@pytest.mark.parametrize(("narrow", "good"), [("nesw", 4), ("ns", 2)])
def test_one_lane_is_enough_for_traffic_of_the_same_direction_unless_others_have_two(
    tmp_path: Path, narrow: str, good: int
) -> None:
    file = tmp_path / "arms.net.xml"
    file.write_bytes(made_net(tmp_path, CROSSING, ARMS, narrow=narrow))
    found = shortcomings(parse_road_network(compile_map(file, tmp_path / "cache").read_bytes()), load_template("S3"))
    assert sum(not lacking for lacking in found.values()) == good
    only = (Lack("one lane leads on, and others have a second one"),)
    assert [site.name for site, lacking in found.items() if lacking == only] == (
        [] if good == 4 else ["n_c..c_s", "s_c..c_n"]
    )


CORNER = {"n": (0, 300), "s": (0, -300), "w": (-300, 0), "e": (300, 0)}


def corner_net(folder: Path, middle: str) -> bytes:
    """A crossing of wide roads; the middle ``c`` has a signal, others have no control."""
    return made_net(folder, {middle: (0, 0), **CORNER}, tuple(f"{middle} {end}" for end in CORNER))


@pytest.mark.parametrize(
    ("name", "middle", "addition"),
    [("S1", "a", "signal:a"), ("S3", "a", "signal:a"), ("S5", "a", "all_way_stop:a"), ("S7", "c", "shoulder:")],
)
def test_what_is_proposed_gives_a_map_a_good_site(tmp_path: Path, name: str, middle: str, addition: str) -> None:
    """The ends of the roads are prolonged. No queue waits beside a shoulder at a crossing without control."""
    file = tmp_path / "corner.net.xml"
    file.write_bytes(corner_net(tmp_path, middle))
    net, template = compile_map(file, tmp_path / "cache").read_bytes(), load_template(name)
    assert good_sites(parse_road_network(net), template) == ()
    site, lacks, additions = proposed(net, template, "it")
    assert all(text.startswith(addition) for text in additions)
    network = parse_road_network(net)
    known = {place.lacking for place in places_without_site(network, template.site_kind)}
    assert lacks in known | {"; ".join(map(str, texts)) for texts in shortcomings(network, template).values()}
    amended = parse_road_network(amended_map(net, additions, "it"))
    assert site in {good.name for good in good_sites(amended, template)}
    plan_at_site(amended, sites_to_try(amended, template, 0, site, "it"), template, 0, load_drivers(), DIMENSIONS)


def test_a_shoulder_without_a_queue_beside_it_is_no_good_site(tmp_path: Path) -> None:
    file = tmp_path / "corner.net.xml"
    file.write_bytes(corner_net(tmp_path, "a"))
    net = compile_map(file, tmp_path / "cache").read_bytes()
    for name in ("S7", "S8"):  # nothing turns a town's streets into a motorway
        assert proposed(net, load_template(name), "it") == ("", "", ())
    network = parse_road_network(amended_map(net, ["shoulder:n_a", "shoulder:a_w"], "it"))
    found = shortcomings(network, load_template("S7"))
    lacking = Lack("no signal or stop sign, at which a queue would wait beside the shoulder")
    assert found
    assert all(lacking in texts for texts in found.values())
