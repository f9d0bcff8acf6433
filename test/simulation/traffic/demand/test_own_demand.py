"""The user's own traffic: which of it an episode takes over, what it says of the rest, and which files it refuses."""

import gzip
from pathlib import Path

import pytest
from defusedxml.ElementTree import fromstring
from made_crossing import ARMS, CROSSING, made_net

from siren_ros.errors import BagError, InputError
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.traffic.demand.own_demand import OwnDemand, body_of, read_demand, sha256_of_demand
from siren_ros.simulation.world.actors import ActorClass


@pytest.fixture(scope="module", name="network")
def _network(tmp_path_factory):
    return parse_road_network(made_net(tmp_path_factory.mktemp("net"), CROSSING, ARMS))


def written(folder: Path, *elements: str, name: str = "own.rou.xml", root: str = "routes") -> Path:
    file = folder / name
    file.write_text(f"<{root}>{''.join(elements)}</{root}>")
    return file


def trip(name: str, depart: object = 0, **more: str) -> str:
    words = " ".join(f'{key}="{value}"' for key, value in {"from": "n_c", "to": "c_s", **more}.items())
    return f'<trip id="{name}" depart="{depart}" {words}/>'


def vehicle(name: str, edges: str, *parts: str, **more: str) -> str:
    words = " ".join(f'{key}="{value}"' for key, value in more.items())
    return f'<vehicle id="{name}" depart="0" {words}><route edges="{edges}"/>{"".join(parts)}</vehicle>'


def names(demand: OwnDemand) -> list[str]:
    root = fromstring(f"<additional>{demand.xml}</additional>")
    return [one.attrib["id"] for one in root if one.tag in {"vehicle", "trip", "flow"}]


def test_departures_of_the_time_are_taken_and_others_counted(network, tmp_path):
    flows = '<flow id="old" begin="0" end="90" number="3" from="n_c" to="c_s"/>'
    flows += '<flow id="long" begin="0:00:10" end="1:00:00" period="5" from="n_c" to="c_s"/>'
    file = written(tmp_path, trip("a", 99), trip("b", "0:01:40"), flows, trip("c", 129.9), trip("d", 130))
    packed = tmp_path / "own.rou.xml.gz"
    packed.write_bytes(gzip.compress(file.read_bytes()))
    demand = read_demand(packed, network, lasting_s=30.0, begin_s=100.0)
    assert demand.sha256 == read_demand(file, network, lasting_s=30.0).sha256
    assert names(demand) == ["demand.b", "demand.long", "demand.c"]
    assert demand.left_out == ("3 × departure at another time: a, old, d",)
    assert demand.begin_s == 100.0


def test_it_begins_as_asked_or_as_the_configuration_says_or_with_the_first_departure(network, tmp_path):
    file = written(tmp_path, trip("a", 7200.5), trip("b", 7300))
    options = (
        '<input><route-files value="own.rou.xml"/></input><time><begin value="2:00:10"/><end value="9999"/></time>'
    )
    named = written(tmp_path, options, name="own.sumocfg", root="configuration")
    assert read_demand(file, network, 200.0).begin_s == 7200.5
    assert read_demand(named, network, 200.0).begin_s == 7210.0
    assert read_demand(named, network, 200.0, begin_s=7150.0).begin_s == 7150.0
    assert "1 × options of the configuration: end" in read_demand(named, network, 200.0).left_out


def test_a_configuration_brings_stops_detectors_and_programmes_that_write_nothing(network, tmp_path):
    things = '<busStop id="stop" lane="n_c_0" startPos="5" endPos="25"/>'
    things += (
        '<e1Detector id="loop" lane="n_c_0" pos="9" period="60" file="loop.xml"/><parkingArea id="p" lane="n_c_0"/>'
    )
    written(tmp_path, things, name="things.xml", root="additional")
    stops = (
        '<stop busStop="stop" duration="9"/>',
        '<stop parkingArea="p" duration="9"/>',
        '<stop lane="n_c_0" triggered="1"/>',
    )
    written(tmp_path, vehicle("a", "n_c c_s", *stops), name="a.rou.xml")
    options = '<input><additional-files value="things.xml"/><route-files value="a.rou.xml"/></input>'
    named = written(tmp_path, options, name="own.sumocfg", root="configuration")
    demand = read_demand(named, network, 60.0)
    root = fromstring(f"<additional>{demand.xml}</additional>")
    assert [one.tag for one in root] == ["busStop", "e1Detector", "vehicle"]
    assert root.find("e1Detector").attrib["file"] == "NUL"
    assert [stop.attrib for stop in root.iter("stop")] == [{"busStop": "stop", "duration": "9"}]
    assert demand.left_out == ("1 × <parkingArea>: p", "2 × stops off the road, or for somebody: a, a")
    before = demand.sha256
    written(tmp_path, vehicle("a", "n_c c_w"), name="a.rou.xml")
    assert sha256_of_demand(named) != before


def test_routes_off_the_map_back_the_way_or_without_a_time_are_left_out_and_named(network, tmp_path):
    routes = '<route id="r" edges="n_c c_e"/><route id="q" edges="e_c"/><routeDistribution id="all" routes="r off"/>'
    routes += '<route id="off" edges="n_c gone"/>'
    ways = [vehicle("back", "n_c c_n"), vehicle("jump", "n_c e_c"), trip("far", to="nowhere"), trip("t", "triggered")]
    ways += ['<flow id="some" begin="0" route="all"/>', '<vehicle id="good" depart="1" route="r"/>']
    file = written(tmp_path, routes, *ways, '<person id="p" depart="0"/>', '<containerFlow id="c"/>')
    demand = read_demand(file, network, 60.0)
    assert names(demand) == ["demand.good"]
    assert demand.left_out == (
        "1 × <person>: p",
        "1 × <containerFlow>: c",
        "4 × route that the map lacks, or that turns back: back (n_c to c_n), jump (n_c to e_c), far (nowhere), …",
        "1 × departure on a trigger: t",
    )
    assert 'id="q"' not in demand.xml


def test_types_keep_their_parameters_except_what_has_no_sublanes(network, tmp_path):
    types = '<vType id="cab" vClass="taxi" tau="0.7" carFollowModel="IDM"/>'
    types += (
        '<vType id="old" laneChangeModel="LC2013" sigma="0.3"><param key="has.rerouting.device" value="1"/></vType>'
    )
    mix = '<vTypeDistribution id="mix"><vType id="in" vClass="truck" accel="1"/></vTypeDistribution>'
    demand = read_demand(written(tmp_path, types, mix, trip("a", type="cab"), trip("b", type="in")), network, 60.0)
    kinds = {one.attrib["id"]: one.attrib for one in fromstring(f"<a>{demand.xml}</a>").iter("vType")}
    assert kinds["cab"] == {"id": "cab", "vClass": "taxi", "tau": "0.7", "carFollowModel": "IDM"}
    assert kinds["old"] == {"id": "old", "sigma": "0.3"}
    assert demand.left_out == (
        "1 × class taxi, with the body of class passenger: cab",
        "1 × lane-change model LC2013, now SL2015: old",
        "1 × devices: old",
    )
    assert [body_of(kind) for kind in ("coach", "taxi", "bicycle")] == [
        ActorClass.BUS,
        ActorClass.SEDAN,
        ActorClass.BICYCLE,
    ]


@pytest.mark.parametrize(
    ("content", "wrong"),
    [
        ("<routes><trip", "not readable XML"),
        ('<!DOCTYPE r [<!ENTITY e "x">]><routes>&e;</routes>', "not readable XML"),
        (f"<routes>{trip('a', type='none')}</routes>", "type none of trip a"),
        ('<routes><vehicle id="a" depart="0" route="none"/></routes>', "route none of vehicle a"),
        (f"<routes>{trip('a', to='nowhere')}</routes>", r"a vehicle that departs .*a \(nowhere\)"),
        ("<routes/>", "a vehicle that departs"),
        ('<configuration><route-files value="missing.xml"/></configuration>', "missing.xml"),
    ],
)
def test_refuses_what_cannot_be_used_and_says_why(network, tmp_path, content, wrong):
    file = tmp_path / "own.rou.xml"
    file.write_text(content)
    with pytest.raises(InputError, match=wrong) as refused:
        read_demand(file, network, 60.0)
    assert refused.value.parameter == "demand"


def test_a_record_gives_it_back(network, tmp_path):
    demand = read_demand(written(tmp_path, trip("a"), trip("b", 999)), network, 60.0)
    assert OwnDemand.of_json({**vars(demand), "left_out": [*demand.left_out]}) == demand
    assert OwnDemand.of_json(None) is None
    for damaged in ({"source": "x"}, {"left_out": []}, ["x"], "x"):
        with pytest.raises(BagError):
            OwnDemand.of_json(damaged)
