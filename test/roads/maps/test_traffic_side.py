"""Maps of left-hand traffic are refused, with the evidence; all others are taken."""

import pytest

from siren_ros.errors import MapError
from siren_ros.roads.maps.map_source import MapSource, SourceKind
from siren_ros.roads.maps.traffic_side import refuse_left_hand_traffic


def source(kind: SourceKind, text: str) -> MapSource:
    return MapSource("map", kind, text.encode())


def osm(lat: float, lon: float, more: str = "") -> MapSource:
    places = "".join(
        f'<node id="{number}" lat="{lat + dlat}" lon="{lon + dlon}"/>'
        for number, (dlat, dlon) in enumerate([(0.0, 0.0), (0.0, 1e-4), (1e-4, 1e-4), (1e-4, 0.0)], start=1)
    )
    return source(SourceKind.OPENSTREETMAP, f"<osm>{places}{more}</osm>")


def roundabout(nodes: str, tags: str = "") -> str:
    refs = "".join(f'<nd ref="{node}"/>' for node in nodes)
    return f'<way id="9">{refs}<tag k="junction" v="roundabout"/>{tags}</way>'


def reason_of(found: MapSource, name: str) -> str:
    """Why a map is refused; empty for one that is taken."""
    try:
        refuse_left_hand_traffic(found, name)
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
def test_cities_with_left_hand_traffic_are_known(name: str, lat: float, lon: float) -> None:
    with pytest.raises(MapError, match=r"town\.osm.*keeps left.*it lies in"):
        refuse_left_hand_traffic(osm(lat, lon), f"{name}/town.osm")


@pytest.mark.parametrize(
    ("name", "lat", "lon"),
    [
        *[("Calais", 50.95, 1.86), ("Boulogne", 50.73, 1.61), ("Dieppe", 49.92, 1.08), ("Cherbourg", 49.63, -1.62)],
        *[("Busan", 35.1, 129.04), ("Vladivostok", 43.1, 131.9), ("Shenzhen", 22.55, 114.06), ("Manila", 14.6, 121.0)],
        *[("Phnom Penh", 11.55, 104.9), ("Vientiane", 17.97, 102.6), ("Yangon", 16.8, 96.15), ("Kabul", 34.5, 69.2)],
        *[("Lhasa", 29.65, 91.1), ("Lubumbashi", -11.66, 27.48), ("Kigali", -1.95, 30.06), ("Luanda", -8.8, 13.2)],
        *[
            ("Mogadishu", 2.05, 45.3),
            ("Antananarivo", -18.9, 47.5),
            ("Miami", 25.76, -80.2),
            ("Port-au-Prince", 18.5, -72.3),
        ],
        *[("Majuro", 7.1, 171.4), ("Nouméa", -22.3, 166.45)],
        *[("Oakland", 37.8, -122.3), ("Berlin", 52.5, 13.4), ("Cairo", 30.0, 31.2), ("Caracas", 10.5, -66.9)],
    ],
)
def test_cities_with_right_hand_traffic_are_taken(name: str, lat: float, lon: float) -> None:
    assert reason_of(osm(lat, lon), name) == ""
    assert "driving_side" in reason_of(osm(lat, lon, LEFT), name), "not because of what the map says of itself"


def test_what_the_map_says_counts_more_than_its_place() -> None:
    refuse_left_hand_traffic(osm(51.5, -0.1, RIGHT), "m")
    with pytest.raises(MapError, match="driving_side"):
        refuse_left_hand_traffic(osm(52.5, 13.4, LEFT), "m")


def test_roundabouts_are_driven_with_the_traffic() -> None:
    refuse_left_hand_traffic(osm(51.5, -0.1, roundabout("12341")), "m")
    for clockwise in (roundabout("14321"), roundabout("12341", '<tag k="oneway" v="-1"/>')):
        with pytest.raises(MapError, match="clockwise"):
            refuse_left_hand_traffic(osm(52.5, 13.4, clockwise), "m")
    refuse_left_hand_traffic(osm(52.5, 13.4, roundabout("1432")), "m")


def test_opendrive_and_sumo_nets_say_it_themselves() -> None:
    refuse_left_hand_traffic(source(SourceKind.OPENDRIVE, '<OpenDRIVE><road id="1" rule="RHT"/></OpenDRIVE>'), "m")
    with pytest.raises(MapError, match="LHT"):
        refuse_left_hand_traffic(source(SourceKind.OPENDRIVE, '<OpenDRIVE><road id="1" rule="LHT"/></OpenDRIVE>'), "m")
    refuse_left_hand_traffic(source(SourceKind.SUMO, "<net/>"), "m")
    with pytest.raises(MapError, match="lefthand"):
        refuse_left_hand_traffic(source(SourceKind.SUMO, '<net lefthand="true"/>'), "m")
