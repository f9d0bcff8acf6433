"""Maps from strangers as a user gives them: through netconvert and our own reading of what it writes."""

import re

import pytest
from fuzz.bounded_compilation import bounded_compilation
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from siren_ros.simulation.roads.maps.map_source import DEEPEST, MOST_LANES

OSM = """<?xml version="1.0"?><osm version="0.6">
<node id="1" version="1" lat="52.0" lon="9.0"/><node id="2" version="1" lat="52.001" lon="9.0"/>
<node id="3" version="1" lat="52.002" lon="9.0"/><node id="4" version="1" lat="52.001" lon="9.002"/>
<node id="5" version="1" lat="52.0009" lon="9.0"><tag k="highway" v="stop"/><tag k="direction" v="forward"/></node>
<way id="10" version="1"><nd ref="1"/><nd ref="5"/><nd ref="2"/><nd ref="3"/><tag k="highway" v="primary"/>
<tag k="lanes" v="4"/><tag k="lanes:forward" v="2"/><tag k="lanes:backward" v="2"/><tag k="maxspeed" v="50"/>
<tag k="width" v="14"/><tag k="turn:lanes:forward" v="left|through"/><tag k="sidewalk" v="both"/></way>
<way id="11" version="1"><nd ref="2"/><nd ref="4"/><tag k="highway" v="residential"/></way></osm>"""
XODR = """<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="4"/>
<road id="1" length="100" junction="-1"><link><successor elementType="road" elementId="2" contactPoint="start"/></link>
<type s="0" type="town"><speed max="50" unit="km/h"/></type><planView>
<geometry s="0" x="0" y="0" hdg="0" length="60"><line/></geometry>
<geometry s="60" x="60" y="0" hdg="0" length="40"><arc curvature="0.01"/></geometry></planView>
<elevationProfile><elevation s="0" a="0" b="0.01" c="0" d="0"/></elevationProfile>
<lanes><laneOffset s="0" a="0" b="0" c="0" d="0"/>
<laneSection s="0"><center><lane id="0" type="none" level="false"/></center>
<right><lane id="-1" type="driving" level="false"><width sOffset="0" a="3.5" b="0" c="0" d="0"/>
<speed sOffset="0" max="14" unit="m/s"/></lane>
<lane id="-2" type="shoulder" level="false"><width sOffset="0" a="2.5" b="0" c="0" d="0"/></lane></right>
</laneSection></lanes><objects><object id="1" type="pole" s="1" t="5" length="1" width="1">
<repeat s="0" length="100" distance="10" tStart="5" tEnd="5"/></object></objects>
<signals><signal id="5" type="206" s="95" t="-4" orientation="+" dynamic="no"/></signals></road>
<road id="2" length="50" junction="-1"><link><predecessor elementType="road" elementId="1" contactPoint="end"/></link>
<planView>
<geometry s="0" x="99" y="8" hdg="0.4" length="50"><spiral curvStart="0.01" curvEnd="0"/></geometry></planView>
<lanes><laneSection s="0"><center><lane id="0" type="none" level="false"/></center>
<right><lane id="-1" type="driving" level="false"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right>
</laneSection></lanes></road></OpenDRIVE>"""
NET = """<net><location netOffset="0,0" convBoundary="0,0,200,10" projParameter="!"/>
<edge id=":B_0" function="internal"><lane id=":B_0_0" index="0" speed="9" shape="100.0,-1.6 103.0,-1.6"/></edge>
<edge id=":B_1" function="internal"><lane id=":B_1_0" index="0" speed="9" shape="103.0,-1.6 104.0,-1 105,-1.6"/></edge>
<edge id="in" from="A" to="B"><lane id="in_0" index="0" speed="13.89" shape="0,-1.6,0 50,3,1 100,-1.6,2"/></edge>
<edge id="out" from="B" to="C"><lane id="out_0" index="0" speed="13.89" shape="105.0,-1.6 150,9 200.0,-1.6"/></edge>
<junction id="B" type="priority" x="102.00" y="0.00" shape="100.00,3.2 105.0,3.2 105.0,-3.2"/>
<connection from="in" to="out" fromLane="0" toLane="0" via=":B_0_0" dir="s" state="M"/>
<connection from=":B_0" to="out" fromLane="0" toLane="0" via=":B_1_0" dir="s" state="M"/>
<connection from=":B_1" to="out" fromLane="0" toLane="0" dir="s" state="M"/></net>"""
SPECIAL = ("", *f"0 -1 1e400 nan inf -inf {'9' * 20} 1 52.001 1e-9 ä ../x %n%s 1e9 1000000".split(), "' -c x", "\u009b")
FUZZED = settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@pytest.fixture(scope="module")
def refusal():
    with bounded_compilation() as compilation:
        yield compilation


@st.composite
def changed(draw, text):
    """The document with a few attributes replaced, removed or repeated elsewhere."""
    for _ in range(draw(st.integers(1, 3))):
        attribute = draw(st.sampled_from(list(re.finditer(r' ([\w:]+)="([^"]*)"', text))))
        values = [element.group(2) for element in re.finditer(r' ([\w:]+)="([^"]*)"', text)]
        value = draw(st.sampled_from(SPECIAL) | st.sampled_from(values))
        new = f' {attribute.group(1)}="{value}"' if draw(st.integers(0, 3)) else ""
        text = text[: attribute.start()] + new + text[attribute.end() :]
    return text.encode()


def is_one_line_about_the_map(text, name):
    return not text or (text.startswith(f"map: '{name}' ") and text.isprintable() and len(text) < 1000)


MAPS = {"city.osm": OSM, "town.xodr": XODR, "town.net.xml": NET}


@pytest.mark.parametrize("name", MAPS)
def test_the_documents_are_sound(name, refusal):
    assert not refusal(name, MAPS[name].encode())


@pytest.mark.parametrize("name", ["city.osm", "town.xodr"])
@FUZZED
@given(data=st.data())
def test_any_openstreetmap_or_opendrive_file(name, data, refusal):
    assert is_one_line_about_the_map(refusal(name, data.draw(changed(MAPS[name]))), name)


@pytest.mark.parametrize("name", ["--help.osm", "-c.xodr", "a b.osm", "ä'\".osm"])
def test_a_file_name_is_no_option(name, refusal):
    assert not refusal(name, OSM.encode())


LOOP = '<connection from=":B_1" to="out" fromLane="0" toLane="0" via=":B_0_0" dir="s" state="M"/>'
ONE_LANE = '<tag k="lanes" v="4"/>'
ARC, REPEAT = 'length="40"><arc', 'length="100" distance="10"'
CIRCLE_OF_NOBODY = """<connection from="x" to="out" fromLane="0" toLane="0" via=":x_0"/>
<connection from=":x" to="out" fromLane="0" toLane="0" via=":x_0"/></net>"""
LONG = " ".join(f"{x},{x % 2}" for x in range(60_000))
HOSTILE = {
    "a way without end": ("town.net.xml", NET.replace('via=":B_1_0"', 'via=":B_0_0"'), "does not end"),
    "a circle": ("town.net.xml", NET.replace(NET[NET.index('<connection from=":B_1"') :], LOOP + "</net>"), "not end"),
    "a circle of nobody": ("town.net.xml", NET.replace("</net>", CIRCLE_OF_NOBODY), "does not end"),
    "a long shape": ("town.net.xml", NET.replace("100.0,-1.6 103.0,-1.6", LONG), "more than 50000 points"),
    "a million lanes": ("city.osm", OSM.replace(ONE_LANE, ONE_LANE.replace("4", "1000000")), f"{MOST_LANES} lanes"),
    "lanes of an odd number": ("city.osm", OSM.replace(ONE_LANE, ONE_LANE.replace("4", "9" * 5000)), "lanes='999"),
    "a deep extract": ("city.osm", "<osm>" + "<a>" * 200_000 + "</a>" * 200_000 + "</osm>", f"{DEEPEST} elements"),
    "a deep town": ("town.xodr", XODR.replace("</road>", "<a>" * 200_000 + "</a>" * 200_000 + "</road>"), "elements"),
    "a deep net": ("town.net.xml", NET.replace("</net>", "<a>" * 200_000 + "</a>" * 200_000 + "</net>"), "elements"),
    "an arc around the world": ("town.xodr", XODR.replace(ARC, ARC.replace("40", "1e9")), "curves .* 100 km"),
    "an arc without end": ("town.xodr", XODR.replace(ARC, ARC.replace("40", "inf")), "curves .* 100 km"),
    "an arc of no length": ("town.xodr", XODR.replace(ARC, ARC.replace("40", "nan")), "curves .* 100 km"),
    "a wall of poles": ("town.xodr", XODR.replace(REPEAT, REPEAT.replace('10"', '1e-9"')), "1000000 copies"),
}


@pytest.mark.parametrize(("name", "text", "said"), HOSTILE.values(), ids=HOSTILE)
def test_what_would_take_much_memory_is_refused(name, text, said, refusal):
    reason = refusal(name, text.encode())
    assert is_one_line_about_the_map(reason, name)
    assert re.search(said, reason)
