"""Direct junctions and incomplete signals of OpenDRIVE maps."""

import math

import numpy as np
import pytest
from defusedxml.ElementTree import fromstring

from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.maps.opendrive_import import importable
from siren_ros.simulation.roads.net_parser import parse_road_network

LINE = "<line/>"
SIGNAL = '<signals><signal s="50" t="-4" id="7" name="" dynamic="no" orientation="+" type="206" {}/></signals>'


def lane(number):
    """A driving lane of 3.5 m."""
    return (
        f'<lane id="{number}" type="driving" level="false"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
        if number
        else '<lane id="0" type="none" level="false"/>'
    )


def road(name, x, y, hdg, link, *, left=0, right=2, length=100.0, shape=LINE, more=""):
    """A road with some lanes on each side."""
    sides = {"left": range(left, 0, -1), "center": (0,), "right": range(-1, -right - 1, -1)}
    lanes = "".join(f"<{side}>{''.join(map(lane, ids))}</{side}>" for side, ids in sides.items() if len(ids))
    return (
        f'<road id="{name}" length="{length}" junction="-1"><link>{link}</link>'
        f'<planView><geometry s="0" x="{x}" y="{y}" hdg="{hdg}" length="{length}">{shape}</geometry></planView>'
        f'<lanes><laneSection s="0">{lanes}</laneSection></lanes>{more}</road>'
    )


def link(which):
    """The link of a road to the junction."""
    return f'<{which} elementType="junction" elementId="9"/>'


def drive(roads, connections=""):
    """A map with a direct junction, unless there are no connections."""
    junction = f'<junction id="9" name="" type="direct">{connections}</junction>' if connections else ""
    return f'<OpenDRIVE><header revMajor="1" revMinor="7"/>{roads}{junction}</OpenDRIVE>'.encode()


def connection(number, incoming, linked, contact, *pairs):
    """A connection of a direct junction with its pairs of lanes."""
    links = "".join(f'<laneLink from="{a}" to="{b}"/>' for a, b in pairs)
    ends = f'incomingRoad="{incoming}" linkedRoad="{linked}" contactPoint="{contact}"'
    return f'<connection id="{number}" {ends}>{links}</connection>'


def movements(xodr, folder):
    """From lane to lane, of the compiled map."""
    file = folder / "map.xodr"
    file.write_bytes(xodr)
    network = parse_road_network(compile_map(file, folder).read_bytes())
    return {(network.lanes[c.from_lane].lane_id, network.lanes[c.to_lane].lane_id) for c in network.connections}


def exit_of_a_motorway(more=""):
    """A carriageway of three lanes; two go on, and the outer one is the exit."""
    roads = road("1", 0, 0, 0, link("successor"), right=3, more=more) + road("2", 100, 0, 0, link("predecessor"))
    roads += road("3", 100, -7, 0, link("predecessor"), right=1)
    stays = connection(0, "1", "2", "start", (-1, -1), (-2, -2))
    return drive(roads, stays + connection(1, "1", "3", "start", (-3, -1)))


def test_lanes_go_on_across_a_direct_junction(tmp_path):
    assert movements(exit_of_a_motorway(), tmp_path) == {("-1_2", "-2_1"), ("-1_1", "-2_0"), ("-1_0", "-3_0")}


def test_where_traffic_keeps_left_the_exit_is_on_the_left(tmp_path):
    mirror = exit_of_a_motorway().replace(b'<road id="', b'<road rule="LHT" id="').replace(b'y="-7"', b'y="7"')
    for side, other in ((b"right>", b"left>"), (b'id="-', b'id="'), (b'from="-', b'from="'), (b'to="-', b'to="')):
        mirror = mirror.replace(side, other)
    assert movements(mirror, tmp_path) == {("-1_2", "-2_1"), ("-1_1", "-2_0"), ("-1_0", "-3_0")}


def test_both_directions_are_linked_and_lanes_of_the_reverse_one_swap_their_ends(tmp_path):
    roads = road("1", 0, 0, 0, link("successor"), left=1, right=1)
    roads += road("2", 100, 0, 0, link("predecessor"), left=1, right=1)
    xodr = drive(roads, connection(0, "1", "2", "start", (1, 1), (-1, -1)))
    assert movements(xodr, tmp_path) == {("-1_0", "-2_0"), ("2_0", "1_0")}


@pytest.mark.parametrize(
    ("shape", "x_m", "y_m", "heading_rad"),
    [
        (LINE, 100.0, 0.0, 0.0),
        ('<arc curvature="0.01"/>', 100.0 * math.sin(1.0), 100.0 * (1.0 - math.cos(1.0)), 1.0),
        ('<spiral curvStart="0.01" curvEnd="0.01"/>', 100.0 * math.sin(1.0), 100.0 * (1.0 - math.cos(1.0)), 1.0),
        ('<spiral curvStart="0" curvEnd="0.01"/>', 97.529, 16.371, 0.5),
        ('<poly3 a="0" b="0" c="0.001" d="0"/>', 100.0, 10.0, math.atan(0.2)),
        ('<paramPoly3 aU="0" bU="99" cU="0" dU="0" aV="0" bV="0" cV="5" dV="1"/>', 99.0, 6.0, math.atan2(13.0, 99.0)),
        (
            '<paramPoly3 pRange="arcLength" aU="0" bU="1" cU="0" dU="0" aV="0" bV="0" cV="0.001" dV="0"/>',
            *(100.0, 10.0, math.atan(0.2)),
        ),
    ],
)
def test_roads_that_meet_with_their_ends_meet_at_the_end_of_their_curves(shape, x_m, y_m, heading_rad):
    """Fresnel's integrals give the end of the clothoid of 100 m that turns by 0.5 rad."""
    roads = road("1", 0, 0, 0, link("successor"), left=2, right=0, shape=shape)
    roads += road("2", 300, 0, 0, link("successor"))
    made = fromstring(importable(drive(roads, connection(0, "1", "2", "end", (1, -1)))))
    place = made.find("road[@junction='9']/planView/geometry")
    there = [float(place.get(name)) for name in ("x", "y", "hdg")]
    assert there[:2] == pytest.approx((x_m, y_m), abs=0.01)
    assert np.cos(there[2] - heading_rad - math.pi) == pytest.approx(1.0)


@pytest.mark.parametrize("lack", ['type=""', 'type="206"', 'dynamic=""', 'dynamic="no"', 'orientation="+"'])
def test_a_signal_that_lacks_an_attribute_does_not_refuse_the_map(tmp_path, lack):
    signal = SIGNAL.format("").replace(lack.partition("=")[0] + "=", f"without_{lack.partition('=')[0]}=")
    signal = signal.replace(" without_type", ' type="" without_type') if lack == 'type=""' else signal
    assert len(movements(exit_of_a_motorway(signal), tmp_path)) == 3
    (kept,) = fromstring(importable(exit_of_a_motorway(signal))).iter("signal")
    assert kept.get("s") == "50"


@pytest.mark.parametrize("name", ["id", "s"])
def test_a_signal_without_name_or_place_is_left_out(tmp_path, name):
    signal = SIGNAL.format("").replace(f" {name}=", f" without_{name}=")
    assert len(movements(exit_of_a_motorway(signal), tmp_path)) == 3
    assert not list(fromstring(importable(exit_of_a_motorway(signal))).iter("signal"))


def test_a_map_without_these_stays_as_it_is():
    plain = drive(road("1", 0, 0, 0, "", more=SIGNAL.format("")))
    assert importable(plain) is plain
