"""Compiled maps: their cache, what they are made of, and on which side traffic keeps."""

import gzip
import hashlib
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from defusedxml.ElementTree import fromstring
from made_district import HALF_M, LAT_LON_DEG, MIDDLES_M, SIGNALS, place_m

from siren_ros.errors import InputError, MapError
from siren_ros.simulation.roads.maps import map_compiler
from siren_ros.simulation.roads.maps.map_compiler import (
    BUILT_IN_MAPS,
    compile_map,
    keeps_left,
    lowered_limits,
    name_of_map,
    source_sha256_of,
    with_shoulders_in_use,
    with_sides_exchanged,
    with_speed_limit,
)
from siren_ros.simulation.roads.maps.map_source import MapSource, SourceKind
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import LaneKind
from siren_ros.simulation.roads.routing import driving_lanes


@pytest.fixture(scope="module")
def town(cache):
    return compile_map(None, cache)


def test_the_hash_is_that_of_the_file_and_the_second_time_is_the_cache(town, cache, monkeypatch):
    assert hashlib.sha256(town.net_path.read_bytes()).hexdigest() == town.sha256
    assert (town.name, town.kind) == ("town", SourceKind.BUILT_IN)

    def no_compilation(*_):
        pytest.fail("compiled again")

    monkeypatch.setattr(map_compiler, "run_netconvert", no_compilation)
    assert compile_map(None, cache) == town


def test_concurrent_compilations_agree_and_leave_one_file(tmp_path):
    with ThreadPoolExecutor(2) as pool:
        results = list(pool.map(lambda _: compile_map(None, tmp_path), range(2)))
    assert len({result.sha256 for result in results}) == 1
    assert [path.name for path in tmp_path.iterdir()] == [results[0].net_path.name]


def test_a_compiled_net_is_a_map_itself(town, tmp_path):
    plain, packed = tmp_path / "mine.net.xml", tmp_path / "packed.net.xml.gz"
    plain.write_bytes(town.read_bytes().replace(b"<net ", b"<!-- generated on <net> day -->\n<net ", 1))
    packed.write_bytes(gzip.compress(town.read_bytes()))
    first, second = (compile_map(path, tmp_path / "cache") for path in (plain, packed))
    assert first.read_bytes() == second.read_bytes()
    assert (first.name, second.name) == ("mine", "packed")
    assert first.kind is SourceKind.SUMO
    assert parse_road_network(first.read_bytes()).edges


def test_opendrive_keeps_its_coordinates(district):
    """The first street leads from its first junction ahead: its inner lane is 1.75 m to the right of its middle."""
    assert district.sumo_offset_m == (0.0, 0.0)
    assert district.origin_lat_lon_deg == pytest.approx(LAT_LON_DEG, abs=1e-6)
    inner = driving_lanes(district, district.edge_by_id["-1"].index)[-1].centre.points
    assert inner[0] == pytest.approx(place_m(HALF_M, -1.75), abs=0.01)
    assert inner[-1] == pytest.approx(place_m(300.0 - HALF_M, -1.75), abs=0.01)
    for name, middle in MIDDLES_M.items():
        away_m = np.hypot(*(district.junctions[name].outline - place_m(*middle)).T)
        assert 19.9 < away_m.min() < away_m.max() < 24.0


def test_opendrive_signals_give_green_to_one_approach_at_a_time(district, cache):
    net = fromstring(compile_map(cache / "district.xodr", cache).read_bytes())
    programs = list(net.iterfind("tlLogic"))
    assert len(programs) == len(SIGNALS)
    for program in programs:
        links = [link for link in district.connections if link.signal_id == program.get("id")]
        links = [link for link in links if district.lanes[link.from_lane].kind is LaneKind.DRIVING]
        greens = [phase.get("state") for phase in program.iterfind("phase") if "G" in phase.get("state")]
        served = [
            {district.lanes[link.from_lane].edge for link in links if state[link.signal_link] in "Gg"}
            for state in greens
        ]
        assert all(len(edges) == 1 for edges in served)
        assert {min(edges) for edges in served} == {district.lanes[link.from_lane].edge for link in links}


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        *[("empty.xodr", b"<OpenDRIVE/>", "netconvert"), ("empty.osm", b'<osm version="0.6"/>', "netconvert")],
        ("broken.osm", b'<osm version="0.6"><node id="1"></osm>', "netconvert"),
        *[("empty.net.xml", b"<net/>", "lane"), ("page.xml", b"<html/>", "OpenDRIVE map")],
    ],
)
def test_unusable_maps_are_refused_and_leave_nothing_behind(tmp_path, name, content, reason):
    path = tmp_path / name
    path.write_bytes(content)
    cache = tmp_path / "cache"
    with pytest.raises(MapError, match=reason):
        compile_map(path, cache)
    assert not cache.exists()


def test_an_unwritable_cache_is_named(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(InputError, match="SIREN_CACHE_DIR"):
        compile_map(None, blocked / "cache")


def test_another_process_gets_the_same_bytes(town, tmp_path):
    program = (
        "import sys, pathlib; from siren_ros.simulation.roads.maps.map_compiler import compile_map; "
        "print(compile_map(None, pathlib.Path(sys.argv[1])).sha256)"
    )
    folder = str(Path(map_compiler.__file__).parents[2])
    environment = {"PYTHONPATH": folder, "PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo"}
    command = [sys.executable, "-c", program, str(tmp_path)]
    answer = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert answer.stdout.strip() == town.sha256
    assert b"generated on" not in town.read_bytes()


NET = (
    b'<net><edge id="a"><lane id="a_0" speed="13.89" length="10.00"/>'
    b'<lane id="a_1" speed="5.00" length="10.00"/></edge></net>'
)


def test_only_higher_limits_are_lowered():
    lowered = lowered_limits(NET, 8.333)
    assert b'id="a_0" speed="8.33" length="10.00"' in lowered
    assert b'id="a_1" speed="5.00" length="10.00"' in lowered
    assert (lowered_limits(lowered, 8.333), lowered_limits(NET, 14.0)) == (lowered, NET)


def test_changed_maps_are_found_again_in_the_cache(town, monkeypatch):
    slow, taken = with_speed_limit(town, 8.333), with_shoulders_in_use(town)
    assert len({town.sha256, slow.sha256, taken.sha256}) == 3
    assert with_shoulders_in_use(taken) == with_shoulders_in_use(town) == taken
    monkeypatch.setattr(map_compiler, "lowered_limits", lambda net, _: net)
    assert (with_speed_limit(town, 8.333), with_speed_limit(town, 50.0)) == (slow, town)


@pytest.mark.parametrize("name", BUILT_IN_MAPS)
def test_built_in_maps_have_names(name, cache):
    compiled = compile_map(Path(name), cache)
    assert (compiled.name, compiled.kind, name_of_map(Path(name))) == (name, SourceKind.BUILT_IN, name)
    assert compiled.source_sha256 == source_sha256_of(Path(name))
    with pytest.raises(MapError, match="city or motorway for a built-in map"):
        compile_map(Path(f"{name}s"))
    assert (compiled == compile_map(None, cache)) == (name == "town")


def source(kind, text):
    return MapSource("map", kind, text.encode())


def osm(lat, lon, more=""):
    places = "".join(
        f'<node id="{number}" lat="{lat + dlat}" lon="{lon + dlon}"/>'
        for number, (dlat, dlon) in enumerate([(0.0, 0.0), (0.0, 1e-4), (1e-4, 1e-4), (1e-4, 0.0)], start=1)
    )
    return source(SourceKind.OPENSTREETMAP, f"<osm>{places}{more}</osm>")


def roundabout(nodes, tags=""):
    refs = "".join(f'<nd ref="{node}"/>' for node in nodes)
    return f'<way id="9">{refs}<tag k="junction" v="roundabout"/>{tags}</way>'


LEFT = '<way id="8"><tag k="driving_side" v="left"/></way>'
RIGHT = LEFT.replace("left", "right")


@pytest.mark.parametrize(
    ("name", "lat", "lon"),
    [
        *[("London", 51.5, -0.1), ("Dover", 51.13, 1.31), ("Plymouth", 50.4, -4.1), ("Dublin", 53.35, -6.26)],
        *[("Tokyo", 35.7, 139.7), ("Sapporo", 43.06, 141.35), ("Naha", 26.2, 127.7), ("Hong Kong", 22.3, 114.17)],
        *[("Sydney", -33.9, 151.2), ("Auckland", -36.85, 174.8), ("Singapore", 1.35, 103.8), ("Jakarta", -6.2, 106.8)],
        *[("Bangkok", 13.75, 100.5), ("Mumbai", 19.1, 72.9), ("Delhi", 28.6, 77.2), ("Lahore", 31.5, 74.3)],
        *[("Valletta", 35.9, 14.5), ("Nicosia", 35.15, 33.35), ("Kingston", 18.0, -76.8), ("Dhaka", 23.8, 90.4)],
        *[("Lusaka", -15.4, 28.3), ("Macau", 22.19, 113.54), ("Nong Khai", 17.87, 102.74), ("Suva", -18.14, 178.44)],
        *[("Peshawar", 34.01, 71.54), ("Paramaribo", 5.85, -55.2), ("Malé", 4.175, 73.51), ("Mae Sot", 16.71, 98.57)],
    ],
)
def test_cities_with_left_hand_traffic(name, lat, lon):
    assert keeps_left(osm(lat, lon)), name
    assert not keeps_left(osm(lat, lon, RIGHT)), "what the map says counts more"


@pytest.mark.parametrize(
    ("name", "lat", "lon"),
    [
        *[("Calais", 50.95, 1.86), ("Boulogne", 50.73, 1.61), ("Dieppe", 49.92, 1.08), ("Cherbourg", 49.63, -1.62)],
        *[("Busan", 35.1, 129.04), ("Vladivostok", 43.1, 131.9), ("Shenzhen", 22.55, 114.06), ("Manila", 14.6, 121.0)],
        *[("Phnom Penh", 11.55, 104.9), ("Vientiane", 17.97, 102.6), ("Yangon", 16.8, 96.15), ("Kabul", 34.5, 69.2)],
        *[("Lubumbashi", -11.66, 27.48), ("Kigali", -1.95, 30.06), ("Miami", 25.76, -80.2)],
        *[("Port-au-Prince", 18.5, -72.3), ("Majuro", 7.1, 171.4), ("Nouméa", -22.3, 166.45)],
        *[("Berlin", 52.5, 13.4), ("Cairo", 30.0, 31.2), ("Caracas", 10.5, -66.9)],
        *[("Zhuhai", 22.27, 113.57), ("Cayenne", 4.92, -52.3), ("Goma", -1.68, 29.22), ("Gibraltar", 36.14, -5.35)],
    ],
)
def test_cities_with_right_hand_traffic(name, lat, lon):
    assert not keeps_left(osm(lat, lon)), name
    assert keeps_left(osm(lat, lon, LEFT)), "what the map says counts more"


def test_roundabouts_are_driven_with_the_traffic():
    assert not keeps_left(osm(51.5, -0.1, roundabout("12341")))
    assert keeps_left(osm(52.5, 13.4, roundabout("14321")))
    assert keeps_left(osm(52.5, 13.4, roundabout("143921"))), "also one of which the extract lacks a node"
    assert keeps_left(osm(52.5, 13.4, roundabout("12341", '<tag k="oneway" v="-1"/>')))
    assert not keeps_left(osm(52.5, 13.4, roundabout("1432"))), "a way that is not closed has no direction"


def test_opendrive_and_sumo_nets_say_it_themselves():
    for kind, text, is_left in (
        (SourceKind.OPENDRIVE, '<OpenDRIVE><road id="1" rule="RHT"/></OpenDRIVE>', False),
        (SourceKind.OPENDRIVE, '<OpenDRIVE><road id="1"/></OpenDRIVE>', False),
        (SourceKind.OPENDRIVE, '<OpenDRIVE><road id="1" rule="LHT"/></OpenDRIVE>', True),
        (SourceKind.SUMO, "<net/>", False),
        (SourceKind.SUMO, '<net lefthand="true"/>', True),
        (SourceKind.BUILT_IN, "", False),
        (SourceKind.OPENSTREETMAP, "<osm>", False),
        (SourceKind.OPENSTREETMAP, "<osm/>", False),
    ):
        assert keeps_left(source(kind, text)) is is_left, text


def test_sidewalks_and_cycle_lanes_change_sides():
    tags = {"sidewalk": "left", "cycleway:right": "lane", "busway": "right", "turn:lanes": "left|through", "x": "left"}
    text = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
    root = fromstring(with_sides_exchanged(f"<osm><way>{text}</way></osm>".encode()))
    assert {tag.get("k"): tag.get("v") for tag in root.iter("tag")} == {
        "sidewalk": "right",
        "cycleway:left": "lane",
        "busway": "left",
        "turn:lanes": "left|through",
        "x": "left",
    }
