"""Maps with counts of no real place are refused, with the evidence."""

import pytest

from siren_ros.errors import MapError
from siren_ros.simulation.roads.maps.map_checks import (
    DEEPEST,
    LONGEST_CURVE_M,
    MOST_LANES,
    MOST_REPEATS,
    refuse_unusable_map,
)
from siren_ros.simulation.roads.maps.map_source import MapSource, SourceKind


def source(kind, text):
    return MapSource("map", kind, text.encode())


def refusal(kind, text):
    try:
        refuse_unusable_map(MapSource("m", kind, text.encode()), "mymap")
    except MapError as error:
        return str(error)
    return ""


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
    assert allowed or (f"{key}='" in reason and "way '7'" in reason and len(reason) < 300)


def test_other_numbers_of_a_way_may_be_large():
    tags = '<tag k="width" v="1000"/><tag k="ref" v="12345"/>'
    assert not refusal(SourceKind.OPENSTREETMAP, f'<osm><way id="7">{tags}</way></osm>')


def road(shape, length, lanes=1):
    sections = f"<lanes><laneSection>{'<lane/>' * lanes}</laneSection></lanes>"
    return f'<road id="7"><planView><geometry length="{length}"><{shape}/></geometry></planView>{sections}</road>'


@pytest.mark.parametrize("shape", ["arc", "spiral", "poly3", "paramPoly3"])
def test_length_of_a_curve(shape):
    assert not refusal(SourceKind.OPENDRIVE, f"<OpenDRIVE>{road(shape, LONGEST_CURVE_M)}</OpenDRIVE>")
    for length in (LONGEST_CURVE_M + 1.0, "1e9", "inf", "nan", "1e400"):
        assert "road '7'" in refusal(SourceKind.OPENDRIVE, f"<OpenDRIVE>{road(shape, length)}</OpenDRIVE>")


def test_straight_lines_have_two_points_however_long():
    assert not refusal(SourceKind.OPENDRIVE, f"<OpenDRIVE>{road('line', 1e9)}</OpenDRIVE>")


def test_all_curves_and_their_lanes_together():
    assert not refusal(SourceKind.OPENDRIVE, f"<OpenDRIVE>{road('arc', 100_000, 20) * 10}</OpenDRIVE>")
    assert "20000 km of lanes" in refusal(
        SourceKind.OPENDRIVE, f"<OpenDRIVE>{road('arc', 100_000, 20) * 11}</OpenDRIVE>"
    )


def test_copies_of_objects():
    repeat = '<road><objects><object><repeat length="{}" distance="{}"/></object></objects></road>'
    for length, distance, allowed in (
        *[(MOST_REPEATS, 1, True), (MOST_REPEATS, 0.5, False), (1, 0, True)],
        *[(1e9, 1e-300, False), ("x", 1, True), ("nan", 1, False)],
    ):
        reason = refusal(SourceKind.OPENDRIVE, f"<OpenDRIVE>{repeat.format(length, distance)}</OpenDRIVE>")
        assert (not reason) == allowed


@pytest.mark.parametrize("distance", ["", 'distance=""', 'distance="y"', 'distance="-1"', 'distance="1e400"'])
def test_copies_without_a_distance(distance):
    """netconvert would make them without end."""
    repeat = f'<road id="7"><objects><object><repeat length="1" {distance}/></object></objects></road>'
    assert "a distance in metres (road '7')" in refusal(SourceKind.OPENDRIVE, f"<OpenDRIVE>{repeat}</OpenDRIVE>")
