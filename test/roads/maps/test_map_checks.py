"""Maps of left-hand traffic and with counts of no real place are refused, with the evidence."""

import pytest

from siren_ros.errors import MapError
from siren_ros.roads.maps.map_checks import DEEPEST, LONGEST_CURVE_M, MOST_LANES, MOST_REPEATS, refuse_unusable_map
from siren_ros.roads.maps.map_source import MapSource, SourceKind


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


def reason_of(source_map, name):
    """Why a map is refused; empty for one that is taken."""
    try:
        refuse_unusable_map(source_map, name)
    except MapError as error:
        return str(error)
    return ""


LEFT = '<way id="8"><tag k="driving_side" v="left"/></way>'
RIGHT = LEFT.replace("left", "right")


@pytest.mark.parametrize(
    ("name", "lat", "lon"),
    [
        *[("London", 51.5, -0.1), ("Dover", 51.13, 1.31), ("Plymouth", 50.4, -4.1), ("Dublin", 53.35, -6.26)],
        *[("Tokyo", 35.7, 139.7), ("Sapporo", 43.06, 141.35), ("Naha", 26.2, 127.7), ("Hong Kong", 22.3, 114.17)],
        *[("Sydney", -33.9, 151.2), ("Auckland", -36.85, 174.8), ("Singapore", 1.35, 103.8), ("Jakarta", -6.2, 106.8)],
        *[("Bangkok", 13.75, 100.5), ("Mumbai", 19.1, 72.9), ("Delhi", 28.6, 77.2), ("Lahore", 31.5, 74.3)],
        *[("Cape Town", -33.9, 18.4), ("Lusaka", -15.4, 28.3), ("Nairobi", -1.3, 36.8), ("Kampala", 0.3, 32.6)],
        *[("Valletta", 35.9, 14.5), ("Nicosia", 35.15, 33.35), ("Kingston", 18.0, -76.8), ("Dhaka", 23.8, 90.4)],
    ],
)
def test_cities_with_left_hand_traffic_are_known(name, lat, lon):
    with pytest.raises(MapError, match=r"town\.osm.*keeps left.*it lies in"):
        refuse_unusable_map(osm(lat, lon), f"{name}/town.osm")


@pytest.mark.parametrize(
    ("name", "lat", "lon"),
    [
        *[("Calais", 50.95, 1.86), ("Boulogne", 50.73, 1.61), ("Dieppe", 49.92, 1.08), ("Cherbourg", 49.63, -1.62)],
        *[("Busan", 35.1, 129.04), ("Vladivostok", 43.1, 131.9), ("Shenzhen", 22.55, 114.06), ("Manila", 14.6, 121.0)],
        *[("Phnom Penh", 11.55, 104.9), ("Vientiane", 17.97, 102.6), ("Yangon", 16.8, 96.15), ("Kabul", 34.5, 69.2)],
        *[("Lhasa", 29.65, 91.1), ("Lubumbashi", -11.66, 27.48), ("Kigali", -1.95, 30.06), ("Luanda", -8.8, 13.2)],
        *[("Mogadishu", 2.05, 45.3), ("Antananarivo", -18.9, 47.5), ("Miami", 25.76, -80.2)],
        *[("Port-au-Prince", 18.5, -72.3), ("Majuro", 7.1, 171.4), ("Nouméa", -22.3, 166.45)],
        *[("Oakland", 37.8, -122.3), ("Berlin", 52.5, 13.4), ("Cairo", 30.0, 31.2), ("Caracas", 10.5, -66.9)],
    ],
)
def test_cities_with_right_hand_traffic_are_taken(name, lat, lon):
    assert reason_of(osm(lat, lon), name) == ""
    assert "driving_side" in reason_of(osm(lat, lon, LEFT), name), "not because of what the map says of itself"


def test_what_the_map_says_counts_more_than_its_place():
    refuse_unusable_map(osm(51.5, -0.1, RIGHT), "m")
    with pytest.raises(MapError, match="driving_side"):
        refuse_unusable_map(osm(52.5, 13.4, LEFT), "m")


def test_roundabouts_are_driven_with_the_traffic():
    refuse_unusable_map(osm(51.5, -0.1, roundabout("12341")), "m")
    for clockwise in (roundabout("14321"), roundabout("12341", '<tag k="oneway" v="-1"/>')):
        with pytest.raises(MapError, match="clockwise"):
            refuse_unusable_map(osm(52.5, 13.4, clockwise), "m")
    refuse_unusable_map(osm(52.5, 13.4, roundabout("1432")), "m")


def test_opendrive_and_sumo_nets_say_it_themselves():
    refuse_unusable_map(source(SourceKind.OPENDRIVE, '<OpenDRIVE><road id="1" rule="RHT"/></OpenDRIVE>'), "m")
    with pytest.raises(MapError, match="LHT"):
        refuse_unusable_map(source(SourceKind.OPENDRIVE, '<OpenDRIVE><road id="1" rule="LHT"/></OpenDRIVE>'), "m")
    refuse_unusable_map(source(SourceKind.SUMO, "<net/>"), "m")
    with pytest.raises(MapError, match="lefthand"):
        refuse_unusable_map(source(SourceKind.SUMO, '<net lefthand="true"/>'), "m")


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
        *[(1e9, 1e-300, False), ("x", "y", True), ("nan", 1, False)],
    ):
        reason = refusal(SourceKind.OPENDRIVE, f"<OpenDRIVE>{repeat.format(length, distance)}</OpenDRIVE>")
        assert (not reason) == allowed
