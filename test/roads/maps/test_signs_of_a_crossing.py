"""Which edge a sign of OpenStreetMap binds: two streets that cross, in a plane that touches the Earth there."""

import math

import pytest
from defusedxml.ElementTree import fromstring

from siren_ros.roads.maps.openstreetmap import SignedEdges, drives_on, signed_edges

LAT, LON = 52.0, 13.0
NORTH_M = math.radians(1.0) * 6_364_900.0
"""Of a degree of latitude there: the Earth's radius of curvature along the meridian is 6 364.9 km."""
EAST_M = math.radians(1.0) * 6_391_500.0 * math.cos(math.radians(LAT))
"""Of a degree of longitude: the radius across the meridian is 6 391.5 km."""
OFFSET_M = (1000.0, 500.0)
PLACES = {"w": (-150.0, 0.0), "e": (150.0, 0.0), "n": (0.0, 150.0), "s": (0.0, -150.0), "J": (0.0, 0.0)}
ROADS = {
    "from_w": ((-150.0, -1.6), (-10.0, -1.6)),
    "to_w": ((-10.0, 1.6), (-150.0, 1.6)),
    "from_e": ((150.0, 1.6), (10.0, 1.6)),
    "to_e": ((10.0, -1.6), (150.0, -1.6)),
    "from_s": ((1.6, -150.0), (1.6, -10.0)),
    "to_s": ((-1.6, -10.0), (-1.6, -150.0)),
    "from_n": ((-1.6, 150.0), (-1.6, 10.0)),
    "to_n": ((1.6, 10.0), (1.6, 150.0)),
}


PRIMARY = '<tag k="highway" v="primary"/>'


def net(projection: str = f"+proj=tmerc +lat_0={LAT} +lon_0={LON}", more: str = "") -> str:
    edges = "".join(
        f'<edge id="{name}"><lane id="{name}_0" shape="{_text(start)} {_text(end)}"/></edge>'
        for name, (start, end) in ROADS.items()
    )
    place = f"{OFFSET_M[0]},{OFFSET_M[1]}"
    return f'<net><location netOffset="{place}" projParameter="{projection}"/>{edges}{more}</net>'


def _text(place: tuple[float, float]) -> str:
    return f"{place[0] + OFFSET_M[0]},{place[1] + OFFSET_M[1]}"


def sign(at: tuple[float, float] | str, kind: str = "stop", **tags: str) -> str:
    """A node of the street from west to east, or one of its places."""
    east_m, north_m = PLACES[at] if isinstance(at, str) else at
    name = at if isinstance(at, str) else "sign"
    told = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in {"highway": kind, **tags}.items())
    return f'<node id="{name}" lat="{LAT + north_m / NORTH_M}" lon="{LON + east_m / EAST_M}">{told}</node>'


def bound(found: str, way: str = "w sign J e", tags: str = "", projection: str = "") -> SignedEdges:
    """Of an extract with one sign, on a street through some nodes; another street crosses it at J."""
    nodes = "".join(
        f'<node id="{name}" lat="{LAT + y_m / NORTH_M}" lon="{LON + x_m / EAST_M}"/>'
        for name, (x_m, y_m) in PLACES.items()
        if f'id="{name}"' not in found
    )
    streets = "".join(
        f"<way>{''.join(f'<nd ref={chr(34)}{one}{chr(34)}/>' for one in names.split())}{told}</way>"
        for names, told in (
            (way, tags or '<tag k="highway" v="primary"/>'),
            ("s J n", '<tag k="highway" v="primary"/>'),
        )
    )
    extract = f"<osm>{nodes}{found}{streets}</osm>"
    return signed_edges(extract.encode(), fromstring(net(projection) if projection else net()))


def stopped(*names: str) -> SignedEdges:
    return SignedEdges(frozenset(names), frozenset())


def test_a_sign_binds_the_traffic_towards_the_nearer_junction() -> None:
    assert bound(sign((-14.0, 0.0))) == stopped("from_w")
    assert bound(sign((14.0, 0.0)), "w J sign e") == stopped("from_e")
    assert bound(sign((-14.0, 0.0), "give_way")) == SignedEdges(frozenset(), frozenset({"from_w"}))


def test_a_sign_binds_the_end_of_its_edge() -> None:
    """Up to 60 m before the end, which lies 10 m before the middle of the crossing."""
    assert bound(sign((-68.0, 0.0))) == stopped("from_w")
    assert bound(sign((-72.0, 0.0))) == stopped()
    assert bound(sign((-60.0, 13.0))) == stopped("from_w"), "14.6 m to the side"
    assert bound(sign((-60.0, 14.0))) == stopped()


@pytest.mark.parametrize(
    ("way", "direction", "edges"),
    [
        ("w sign J e", "forward", ("from_w",)),
        ("e J sign w", "backward", ("from_w",)),
        ("w sign J e", "backward", ()),
        ("w sign J e", "sideways", ("from_w",)),
    ],
)
def test_a_direction_is_that_of_the_way(way: str, direction: str, edges: tuple[str, ...]) -> None:
    """Away from the crossing the edge ends far away; up to 25 m behind it, a sign may be that of the edge before."""
    assert bound(sign((-16.0, 0.0), direction=direction), way) == stopped(*edges)
    behind = bound(sign((-14.0, 0.0), direction=direction), way)
    assert behind == (stopped(*edges) if edges else stopped("from_e"))


@pytest.mark.parametrize(
    ("oneway", "edges"),
    [("yes", ("from_w",)), ("true", ("from_w",)), ("1", ("from_w",)), ("-1", ()), ("no", ("from_w",))],
)
def test_nobody_stops_where_nobody_may_drive(oneway: str, edges: tuple[str, ...]) -> None:
    tags = f'<tag k="highway" v="primary"/><tag k="oneway" v="{oneway}"/>'
    assert bound(sign((-14.0, 0.0)), tags=tags) == stopped(*edges)


def test_at_the_junctions_own_node_it_binds_all_approaches() -> None:
    everybody = ("from_w", "from_e", "from_s", "from_n")
    assert bound(sign("J"), "w J e") == stopped(*everybody)
    assert bound(sign("J", stop="all"), "w J e") == stopped(*everybody)
    assert bound(sign("J", stop="minor"), "w J e") == stopped()
    assert bound(sign("J", "give_way"), "w J e") == stopped()
    one_way = '<tag k="highway" v="primary"/><tag k="oneway" v="yes"/>'
    assert bound(sign("J"), "w J e", one_way) == stopped("from_w", "from_s", "from_n")


@pytest.mark.parametrize("tags", ['<tag k="highway" v="footway"/>', '<tag k="waterway" v="river"/>'])
def test_signs_on_what_is_no_road_bind_nobody(tags: str) -> None:
    assert bound(sign((-14.0, 0.0)), tags=tags) == stopped()
    assert bound(sign((-14.0, 0.0)), "w J e") == stopped(), "of no way at all"


def test_without_a_junction_ahead_a_sign_binds_nobody() -> None:
    assert bound(sign((-14.0, 0.0)), "w sign e") == stopped(), "the other street is another one"


def test_where_the_projection_is_not_known_nobody_is_bound() -> None:
    assert bound(sign((-14.0, 0.0)), projection="!") == stopped()


def test_a_roundabout_is_a_one_way_street() -> None:
    tags = '<tag k="highway" v="primary"/><tag k="junction" v="roundabout"/>'
    assert bound(sign((14.0, 0.0)), "w J sign e", tags) == stopped()
    assert bound(sign((-14.0, 0.0)), tags=tags) == stopped("from_w")


def test_cars_drive_where_one_lane_allows_it() -> None:
    def edge(*lanes: str) -> bool:
        return drives_on(fromstring(f"<edge>{''.join(f'<lane {lane}/>' for lane in lanes)}</edge>"))

    assert edge('allow="pedestrian"', 'disallow="tram"')
    assert not edge('allow="pedestrian"', 'allow="bicycle"')
    assert not edge()
