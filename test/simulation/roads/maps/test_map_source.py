"""Map files of all kinds; maps with counts of no real place are refused, with the evidence."""

import bz2
import gzip

import pytest
from defusedxml.ElementTree import fromstring

from siren_ros.errors import MapError
from siren_ros.simulation.roads.maps import map_source
from siren_ros.simulation.roads.maps.map_source import (
    DEEPEST,
    LONGEST_CURVE_M,
    MOST_LANES,
    MOST_REPEATS,
    MapSource,
    SourceKind,
    read_map_source,
    refuse_unusable_map,
)


@pytest.mark.parametrize(
    ("name", "content", "kind", "stem"),
    [
        ("crossroads.net.xml", b"<net/>", SourceKind.SUMO, "crossroads"),
        ("Town.xodr", b'<?xml version="1.0"?><OpenDRIVE/>', SourceKind.OPENDRIVE, "Town"),
        ("city.centre.osm.xml", b"<osm/>", SourceKind.OPENSTREETMAP, "city.centre"),
        ("misnamed.osm", b"<net/>", SourceKind.SUMO, "misnamed"),
        (".xml", b"<net/>", SourceKind.SUMO, ".xml"),
        ("city.osm.xml.gz", b"<osm/>", SourceKind.OPENSTREETMAP, "city"),
        ("city.osm.bz2", b"<osm/>", SourceKind.OPENSTREETMAP, "city"),
    ],
)
def test_the_root_element_tells_the_kind_also_of_what_is_packed(tmp_path, name, content, kind, stem):
    path = tmp_path / name
    path.write_bytes({".gz": gzip.compress, ".bz2": bz2.compress}.get(path.suffix, bytes)(content))
    source = read_map_source(path)
    assert (source.kind, source.name, source.content) == (kind, stem, content)


@pytest.mark.parametrize(("mark", "prefix"), [("xmlns", ""), ("xmlns:od", "od:")])
def test_names_in_a_namespace_are_plain_names(tmp_path, mark, prefix):
    path = tmp_path / "map.xodr"
    space = "http://code.asam.net/simulation/standard/opendrive_schema"
    path.write_text(f'<{prefix}OpenDRIVE {mark}="{space}"><{prefix}road id="1"/></{prefix}OpenDRIVE>')
    source = read_map_source(path)
    assert source.kind is SourceKind.OPENDRIVE
    assert fromstring(source.content).find("road").attrib == {"id": "1"}
    path.write_text(f'<{prefix}OpenDRIVE {mark}="{space}"><{prefix}road></{prefix}OpenDRIVE>')
    with pytest.raises(MapError, match="not readable XML"):
        read_map_source(path)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        *[(b"", "not readable XML"), (b"plain words", "not readable XML")],
        *[(b"\x89PNG\r\n", "not readable XML"), (b"<html/>", "an XML document <html>")],
        (gzip.compress(b"<net/>", mtime=0)[:-6], "gzip file is damaged"),
        (bz2.compress(b"<net/>")[:-6], "bzip2 file is damaged"),
        (b'<!DOCTYPE n [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><net>&b;</net>', "not readable XML"),
    ],
)
def test_what_is_no_map_is_refused(tmp_path, content, reason):
    path = tmp_path / "map.xml"
    path.write_bytes(content)
    with pytest.raises(MapError) as caught:
        read_map_source(path)
    assert reason in str(caught.value)
    assert "map.xml" in str(caught.value)


def test_missing_files_and_folders_are_refused(tmp_path):
    for path, reason in ((tmp_path / "absent.xodr", "No such file"), (tmp_path, "directory")):
        with pytest.raises(MapError, match=reason):
            read_map_source(path)


@pytest.mark.parametrize("packed", [False, True])
def test_a_map_may_be_as_large_as_the_limit(tmp_path, monkeypatch, packed):
    content = b"<osm/>" + b" " * 94
    path = tmp_path / ("city.osm.gz" if packed else "city.osm")
    path.write_bytes(gzip.compress(content) if packed else content)
    monkeypatch.setattr(map_source, "MAX_MAP_BYTES", 100)
    assert read_map_source(path).content == content
    monkeypatch.setattr(map_source, "MAX_MAP_BYTES", 99)
    with pytest.raises(MapError, match="a file of at most"):
        read_map_source(path)


def refusal(kind, text):
    try:
        refuse_unusable_map(MapSource("m", kind, text.encode()), "mymap")
    except MapError as error:
        return str(error)
    return ""


def test_a_lanelet2_map_is_called_so():
    lanelet = '<osm><relation id="1"><tag k="type" v="{}"/></relation></osm>'
    street = '<osm><way id="2"><tag k="highway" v="residential"/></way></osm>'
    assert "Lanelet2 map: convert it first" in refusal(SourceKind.OPENSTREETMAP, lanelet.format("lanelet"))
    assert not any(refusal(SourceKind.OPENSTREETMAP, text) for text in (lanelet.format("route"), street))


@pytest.mark.parametrize("kind", [SourceKind.SUMO, SourceKind.OPENDRIVE, SourceKind.OPENSTREETMAP])
def test_elements_inside_each_other(kind):
    assert not refusal(kind, "<a>" * DEEPEST + "</a>" * DEEPEST)
    assert f"'mymap' cannot be used; allowed: a map with at most {DEEPEST}" in refusal(
        kind, "<a>" * (DEEPEST + 1) + "</a>" * (DEEPEST + 1)
    )


def test_what_cannot_be_read_is_left_to_who_compiles_it():
    assert not refusal(SourceKind.OPENSTREETMAP, "<osm><way>")
    assert not refusal(SourceKind.BUILT_IN, "a\0b")


@pytest.mark.parametrize("key", ["lanes", "lanes:forward", "lanes:backward", "lanes:both_ways"])
@pytest.mark.parametrize(
    ("value", "allowed"),
    [
        *[(f"{MOST_LANES}", True), (f"{MOST_LANES + 1}", False), (f"2;{MOST_LANES + 1}", False)],
        *[("9" * 5000, False), ("many", True), ("-1", True)],
    ],
)
def test_lanes_of_a_way(key, value, allowed):
    reason = refusal(SourceKind.OPENSTREETMAP, f'<osm><way id="7"><tag k="{key}" v="{value}"/></way></osm>')
    assert (not reason) == allowed
    assert not refusal(SourceKind.OPENSTREETMAP, '<osm><way id="7"><tag k="width" v="1000"/></way></osm>')
    assert allowed or (f"{key}='" in reason and "way '7'" in reason and len(reason) < 300)


def road(shape, length, lanes=1):
    sections = f"<lanes><laneSection>{'<lane/>' * lanes}</laneSection></lanes>"
    return f'<road id="7"><planView><geometry length="{length}"><{shape}/></geometry></planView>{sections}</road>'


@pytest.mark.parametrize("shape", ["arc", "spiral", "poly3", "paramPoly3"])
def test_length_of_a_curve(shape):
    assert not refusal(SourceKind.OPENDRIVE, f"<OpenDRIVE>{road(shape, LONGEST_CURVE_M)}</OpenDRIVE>")
    assert not refusal(SourceKind.OPENDRIVE, f"<OpenDRIVE>{road('line', 1e9)}</OpenDRIVE>"), "it has two points"
    for length in (LONGEST_CURVE_M + 1.0, "1e9", "inf", "nan", "1e400"):
        assert "road '7'" in refusal(SourceKind.OPENDRIVE, f"<OpenDRIVE>{road(shape, length)}</OpenDRIVE>")


def test_all_curves_and_their_lanes_together():
    assert not refusal(SourceKind.OPENDRIVE, f"<OpenDRIVE>{road('arc', 100_000, 20) * 10}</OpenDRIVE>")
    assert "20000 km of lanes" in refusal(
        SourceKind.OPENDRIVE, f"<OpenDRIVE>{road('arc', 100_000, 20) * 11}</OpenDRIVE>"
    )


def test_copies_of_objects():
    """Without a distance netconvert would make them without end."""
    repeat = '<road><objects><object><repeat length="{}" distance="{}"/></object></objects></road>'
    for length, distance, allowed in (
        *[(MOST_REPEATS, 1, True), (MOST_REPEATS, 0.5, False), (1, 0, True)],
        *[(1e9, 1e-300, False), ("x", 1, True), ("nan", 1, False)],
        *[(1, "", False), (1, "y", False), (1, "-1", False), (1, "1e400", False)],
    ):
        reason = refusal(SourceKind.OPENDRIVE, f"<OpenDRIVE>{repeat.format(length, distance)}</OpenDRIVE>")
        assert (not reason) == allowed
    halves = repeat.format(0.6 * MOST_REPEATS, 1)
    assert not refusal(SourceKind.OPENDRIVE, f"<OpenDRIVE>{halves}</OpenDRIVE>")
    assert "copies of objects" in refusal(SourceKind.OPENDRIVE, f"<OpenDRIVE>{2 * halves}</OpenDRIVE>"), "on two roads"
    without = '<road id="7"><objects><object><repeat length="1"/></object></objects></road>'
    assert "a distance in metres (road '7')" in refusal(SourceKind.OPENDRIVE, f"<OpenDRIVE>{without}</OpenDRIVE>")
