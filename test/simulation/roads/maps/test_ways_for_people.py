import numpy as np
import pytest
import shapely
from defusedxml.ElementTree import fromstring
from made_district import write_district
from repository import shared_file

from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.maps.map_source import MapSource, SourceKind
from siren_ros.simulation.roads.maps.ways_for_people import (
    crossing_places,
    crosswalk_junctions,
    has_corners,
    real_junctions,
    with_sidewalks_on_streets,
    without_outlines,
)
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import LaneKind

NET = """<net><edge id="1" from="a" to="x"/><edge id="-1" from="x" to="a"/><edge id="2" from="x" to="b"/>
<edge id="3" from="x" to="c"/><edge id="4" from="c" to="d"/><edge id=":d_c0" function="crossing"/>
<junction id="a" type="dead_end"/><junction id="x" type="priority"/><junction id="c" type="priority"/>
<junction id="d" type="priority"/><junction id=":x_0_0" type="internal"/></net>"""
OSM = """<osm version="0.6"><node id="1" lat="52.5" lon="13.400"/><node id="2" lat="52.5" lon="13.405"/>
<node id="3" lat="52.5" lon="13.410"/><node id="4" lat="52.503" lon="13.405"/><node id="5" lat="52.497" lon="13.405"/>
<way id="10"><nd ref="1"/><nd ref="2"/><nd ref="3"/><tag k="highway" v="secondary"/><tag k="lanes" v="4"/>
<tag k="maxspeed" v="50"/><tag k="sidewalk" v="both"/><tag k="cycleway" v="lane"/></way>
<way id="11"><nd ref="4"/><nd ref="2"/><nd ref="5"/><tag k="highway" v="tertiary"/><tag k="lanes" v="2"/>
<tag k="maxspeed" v="50"/><tag k="sidewalk" v="separate"/></way></osm>"""


def kinds(path, cache, *, for_people):
    network = parse_road_network(compile_map(path, cache, for_people=for_people).read_bytes())
    found = {kind: sum(lane.kind is kind for lane in network.lanes) for kind in LaneKind}
    return {kind: number for kind, number in found.items() if number and kind is not LaneKind.INTERNAL}


def road(junction, length_m, s_m):
    return (
        f'<road id="1" junction="{junction}" length="{length_m}"><link>'
        '<predecessor elementType="junction" elementId="7"/><successor elementType="junction" elementId="8"/></link>'
        f'<objects><object id="1" type="crosswalk" s="{s_m}"/><object id="2" type="pole" s="0"/></objects></road>'
    )


@pytest.mark.parametrize(("junction", "s_m", "found"), [("9", 1.0, "9"), ("-1", 49.0, "7"), ("-1", 51.0, "8")])
def test_a_crosswalk_belongs_to_its_junction_or_to_the_nearer_one(junction, s_m, found):
    assert crosswalk_junctions(fromstring(f"<OpenDRIVE>{road(junction, 100, s_m)}</OpenDRIVE>")) == {found}


def test_three_streets_make_a_junction_and_a_crossing_stays():
    assert real_junctions(fromstring(NET)) == {"x", "d"}


@pytest.mark.parametrize(
    ("kind", "content", "expected"),
    [
        (SourceKind.SUMO, "", {"a", "c"}),
        (SourceKind.OPENDRIVE, f"<OpenDRIVE>{road('c', 9, 1)}</OpenDRIVE>", {"a", "d", "x"}),
    ],
)
def test_nothing_crosses_elsewhere(kind, content, expected):
    elements = list(crossing_places(MapSource("m", kind, content.encode()), fromstring(NET)))
    assert {element.get("node") for element in elements} == expected
    assert {element.get("discard") for element in elements} == {"true"}


@pytest.mark.parametrize(
    ("tag", "expected"),
    [
        (b'k="sidewalk" v="separate"', b'k="sidewalk" v="both"'),
        (b"k='sidewalk:left' v='separate'", b"k='sidewalk:left' v='yes'"),
        (b'k="sidewalk:right" v="no"', b'k="sidewalk:right" v="no"'),
        (b'k="cycleway" v="separate"', b'k="cycleway" v="separate"'),
    ],
)
def test_separate_sidewalks_lie_on_their_street(tag, expected):
    assert with_sidewalks_on_streets(tag) == expected


def test_an_extract_has_ways_for_people_only_where_they_are_asked_for(tmp_path):
    path = tmp_path / "mini.osm"
    path.write_text(OSM, encoding="utf-8")
    assert kinds(path, tmp_path, for_people=False) == {LaneKind.DRIVING: 12, LaneKind.SIDEWALK: 4}
    assert kinds(path, tmp_path, for_people=True) == {
        LaneKind.DRIVING: 12,
        LaneKind.SIDEWALK: 8,
        LaneKind.CYCLE: 4,
        LaneKind.CROSSING: 4,
    }


def test_a_net_with_corners_keeps_them_and_loses_the_outlines_of_crossings(tmp_path):
    town = compile_map(None, tmp_path)
    path = tmp_path / "copy.net.xml"
    path.write_bytes(town.read_bytes())
    assert has_corners(town.read_bytes())
    plain, peopled = (compile_map(path, tmp_path, for_people=asked).read_bytes() for asked in (False, True))
    assert b"outlineShape" in plain
    assert peopled == without_outlines(plain)
    assert b"outlineShape" not in peopled
    assert compile_map(None, tmp_path, for_people=True) == town


def test_opendrives_crosswalks_are_the_crossings(tmp_path):
    """One in each street of the two junctions that have some: four and three."""
    path = write_district(tmp_path)
    plain, peopled = (kinds(path, tmp_path, for_people=asked) for asked in (False, True))
    assert LaneKind.CROSSING not in plain
    assert peopled.pop(LaneKind.CROSSING) == path.read_text(encoding="utf-8").count('type="crosswalk"') == 7
    assert peopled == plain


def test_crossings_are_as_wide_as_their_lanes(tmp_path):
    network = parse_road_network(compile_map(write_district(tmp_path), tmp_path, for_people=True).read_bytes())
    lengths_m = [lane.length_m for lane in network.lanes if lane.kind is LaneKind.CROSSING]
    areas_m2 = [shapely.Polygon(outline).area for outline in network.crossings]
    assert len(areas_m2) == 7
    assert areas_m2 == pytest.approx([4.0 * length_m for length_m in lengths_m], rel=0.02)


def test_the_papers_maps_crosswalks_are_its_crossings_and_its_sidewalks_do_not_go_back(tmp_path):
    """netconvert's sidewalk of a bend of this map does, by 5 cm."""
    source = shared_file("maps", "Town10HD_Opt.xodr")
    network = parse_road_network(compile_map(source, tmp_path, for_people=True).read_bytes())
    assert len(network.crossings) == source.read_text(encoding="utf-8").count('type="crosswalk"') == 16
    for lane in network.lanes:
        if lane.kind is LaneKind.SIDEWALK:
            side = np.diff(lane.centre.points, axis=0)
            assert ((side[1:] * side[:-1]).sum(axis=1) > 0.0).all()
