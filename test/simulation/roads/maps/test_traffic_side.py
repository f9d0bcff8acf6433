"""On which side traffic keeps: as the map says it, by its roundabouts, or by its place on Earth."""

import pytest
from defusedxml.ElementTree import fromstring

from siren_ros.simulation.roads.maps.map_source import MapSource, SourceKind
from siren_ros.simulation.roads.maps.traffic_side import keeps_left, with_sides_exchanged


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
        *[("Cape Town", -33.9, 18.4), ("Lusaka", -15.4, 28.3), ("Nairobi", -1.3, 36.8), ("Kampala", 0.3, 32.6)],
        *[("Valletta", 35.9, 14.5), ("Nicosia", 35.15, 33.35), ("Kingston", 18.0, -76.8), ("Dhaka", 23.8, 90.4)],
        *[("Kathmandu", 27.7, 85.3), ("Macau", 22.19, 113.54), ("Nong Khai", 17.87, 102.74), ("Suva", -18.14, 178.44)],
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
        *[("Lhasa", 29.65, 91.1), ("Lubumbashi", -11.66, 27.48), ("Kigali", -1.95, 30.06), ("Luanda", -8.8, 13.2)],
        *[("Mogadishu", 2.05, 45.3), ("Antananarivo", -18.9, 47.5), ("Miami", 25.76, -80.2)],
        *[("Port-au-Prince", 18.5, -72.3), ("Majuro", 7.1, 171.4), ("Nouméa", -22.3, 166.45)],
        *[("Oakland", 37.8, -122.3), ("Berlin", 52.5, 13.4), ("Cairo", 30.0, 31.2), ("Caracas", 10.5, -66.9)],
        *[("Zhuhai", 22.27, 113.57), ("Cayenne", 4.92, -52.3), ("Goma", -1.68, 29.22), ("Gibraltar", 36.14, -5.35)],
    ],
)
def test_cities_with_right_hand_traffic(name, lat, lon):
    assert not keeps_left(osm(lat, lon)), name
    assert keeps_left(osm(lat, lon, LEFT)), "what the map says counts more"


def test_roundabouts_are_driven_with_the_traffic():
    assert not keeps_left(osm(51.5, -0.1, roundabout("12341")))
    assert keeps_left(osm(52.5, 13.4, roundabout("14321")))
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
