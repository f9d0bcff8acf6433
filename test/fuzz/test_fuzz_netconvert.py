"""Maps from strangers as a user gives them: through netconvert and our own reading of what it writes."""

import re
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from siren_ros.errors import MapError
from siren_ros.roads.maps.map_compiler import compile_map
from siren_ros.roads.net_parser import parse_road_network

OSM = """<?xml version="1.0"?><osm version="0.6">
<node id="1" version="1" lat="52.0" lon="9.0"/><node id="2" version="1" lat="52.001" lon="9.0"/>
<node id="3" version="1" lat="52.002" lon="9.0"/><node id="4" version="1" lat="52.001" lon="9.002"/>
<way id="10" version="1"><nd ref="1"/><nd ref="2"/><nd ref="3"/><tag k="highway" v="primary"/>
<tag k="lanes" v="4"/></way>
<way id="11" version="1"><nd ref="2"/><nd ref="4"/><tag k="highway" v="residential"/></way></osm>"""
XODR = """<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="4"/>
<road id="1" length="100" junction="-1"><planView>
<geometry s="0" x="0" y="0" hdg="0" length="100"><line/></geometry></planView>
<lanes><laneSection s="0"><center><lane id="0" type="none" level="false"/></center>
<right><lane id="-1" type="driving" level="false"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right>
</laneSection></lanes></road></OpenDRIVE>"""
SPECIAL = ("", "0", "-1", "1e400", "nan", "inf", "-inf", "9" * 20, "1", "52.001", "1e-9", "ä", "' -c x", "../x", "%n%s")
FUZZED = settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@st.composite
def changed(draw: st.DrawFn, text: str) -> bytes:
    """The document with a few attributes replaced, removed or repeated elsewhere."""
    for _ in range(draw(st.integers(1, 3))):
        one = draw(st.sampled_from(list(re.finditer(r' (\w+)="[^"]*"', text))))
        new = f' {one.group(1)}="{draw(st.sampled_from(SPECIAL))}"' if draw(st.integers(0, 3)) else ""
        text = text[: one.start()] + new + text[one.end() :]
    return text.encode()


def refusal(name: str, data: bytes) -> str:
    """What is said of it; empty where it becomes a network. Any other exception is a mistake of ours."""
    with TemporaryDirectory() as folder:
        source = Path(folder) / name
        source.write_bytes(data)
        try:
            parse_road_network(compile_map(source, Path(folder) / "cache").read_bytes())
        except MapError as error:
            return str(error)
    return ""


def is_one_line_about_the_map(text: str) -> bool:
    return not text or (text.startswith("map: ") and "\n" not in text)


@pytest.mark.parametrize(("name", "text"), [("city.osm", OSM), ("town.xodr", XODR)])
def test_the_documents_are_sound(name: str, text: str) -> None:
    assert not refusal(name, text.encode())


@FUZZED
@given(data=changed(OSM))
def test_any_openstreetmap_file(data: bytes) -> None:
    assert is_one_line_about_the_map(refusal("city.osm", data))


@FUZZED
@given(data=changed(XODR))
def test_any_opendrive_file(data: bytes) -> None:
    assert is_one_line_about_the_map(refusal("town.xodr", data))


@pytest.mark.parametrize("name", ["--help.osm", "-c.xodr", "a b.osm", "ä'\".osm"])
def test_a_file_name_is_no_option(name: str) -> None:
    assert not refusal(name, OSM.encode())
