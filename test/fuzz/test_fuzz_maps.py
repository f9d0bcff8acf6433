"""Maps from strangers: any bytes give a network or a MapError, soon and in little memory."""

import gzip
import re
import tracemalloc
import warnings
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from siren_ros.errors import MapError
from siren_ros.simulation.roads.maps.map_formats import opendrive_patches
from siren_ros.simulation.roads.maps.map_source import read_map_source
from siren_ros.simulation.roads.net_parser import MAX_MAP_BYTES, MAX_TAGS, parse_road_network

NET = b"""<net version="1.20">
<location netOffset="10.00,20.00" convBoundary="0.00,0.00,200.00,10.00" projParameter="!"/>
<edge id=":B_0" function="internal">
<lane id=":B_0_0" index="0" speed="13.89" length="5.0" shape="100.0,-1.6 105.0,-1.6"/></edge>
<edge id="1" from="A" to="B"><lane id="1_0" index="0" type="driving" speed="13.89" shape="0.0,-1.6 100.0,-1.6"/>
<lane id="1_1" index="1" allow="emergency" speed="13.89" length="100.00" shape="0.0,1.6 100.0,1.6"/></edge>
<edge id="out" from="B" to="C"><lane id="out_0" index="0" speed="13.89" shape="105.0,-1.6 200.0,-1.6"/></edge>
<edge id=":B_c0" function="crossing">
<lane id=":B_c0_0" index="0" allow="pedestrian" speed="1" width="4" shape="1,1 2,9"/></edge>
<junction id="B" type="priority" x="102.00" y="0.00" shape="100.00,3.2 105.0,3.2 105.0,-3.2"/>
<connection from="1" to="out" fromLane="0" toLane="0" via=":B_0_0" tl="B" linkIndex="0" dir="s" state="O"/>
<connection from=":B_0" to="out" fromLane="0" toLane="0" dir="s" state="M"/></net>"""
XODR = b"""<OpenDRIVE><header/><road id="1" length="50" junction="-1">
<link><successor elementType="junction" elementId="B"/></link>
<signals><signal id="5" type="206" s="45" orientation="+"/>
<signalReference id="5" s="45" orientation="-"/></signals></road>
<road id="2" junction="B"><link><predecessor elementType="road" elementId="1"/></link>
<signals><signal id="6" type="205" s="1"/></signals></road></OpenDRIVE>"""
BOMB = b"""<!DOCTYPE net [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">
<!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;">]><net>&c;</net>"""
FILE_ENTITY = b'<!DOCTYPE net [<!ENTITY a SYSTEM "file:///etc/passwd">]><net>&a;</net>'
FAR_DTD = b'<!DOCTYPE net SYSTEM "http://127.0.0.1:9/x.dtd"><net/>'
fuzzed = settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
SPECIAL = ("", "0", "-1", "1e400", "nan", "inf", "9" * 20, "1", ":B_0", ":B_0_0", "1_0", "1,2", "1,2 1,2", ",", "ä")
VALUES = st.one_of(
    st.sampled_from(SPECIAL),
    st.text(st.characters(exclude_characters='"<&', exclude_categories=["Cs", "Cc"]), max_size=10),
)


@st.composite
def changed(draw, document):
    """The document with attributes replaced or removed, or bytes changed."""
    text = document.decode()
    for _ in range(draw(st.integers(1, 4))):
        attributes = list(re.finditer(r' (\w+)="[^"]*"', text))
        if not attributes:
            break
        attribute = draw(st.sampled_from(attributes))
        new = f' {attribute.group(1)}="{draw(VALUES)}"' if draw(st.booleans()) else ""
        text = text[: attribute.start()] + new + text[attribute.end() :]
    data = bytearray(text.encode())
    for place, value in draw(st.lists(st.tuples(st.integers(0, len(data) - 1), st.integers(0, 255)), max_size=2)):
        data[place % len(data)] = value
    return bytes(data)


def test_the_documents_are_sound():
    assert len(parse_road_network(NET).lanes) == 5
    assert b"allway_stop" in opendrive_patches(NET, XODR, "map")["--node-files"]


@fuzzed
@given(data=st.one_of(changed(NET), st.binary(max_size=100)))
def test_any_net(data):
    with suppress(MapError), warnings.catch_warnings():
        warnings.simplefilter("error")
        parse_road_network(data)


@fuzzed
@given(data=st.one_of(changed(XODR), st.binary(max_size=100)))
def test_any_opendrive_map(data):
    with suppress(MapError):
        opendrive_patches(NET, data, "map")


@fuzzed
@given(data=st.one_of(changed(NET), changed(XODR), st.binary(max_size=60), st.binary(max_size=60).map(gzip.compress)))
def test_any_map_file(data, tmp_path):
    file = tmp_path / "map.xml"
    file.write_bytes(data)
    with suppress(MapError):
        read_map_source(file)


@pytest.mark.parametrize("data", [BOMB, FILE_ENTITY, FAR_DTD], ids=["bomb", "file", "dtd"])
def test_entities_are_refused(data, tmp_path):
    file = tmp_path / "map.xml"
    file.write_bytes(data)
    for read in (
        lambda: read_map_source(file),
        lambda: parse_road_network(data),
        lambda: opendrive_patches(NET, data, "m"),
    ):
        with pytest.raises(MapError):
            read()


def test_a_gzip_bomb_is_refused_in_little_memory(tmp_path):
    file = tmp_path / "map.net.xml.gz"
    with gzip.open(file, "wb", compresslevel=1) as packed:
        for _ in range(MAX_MAP_BYTES // 1_000_000 + 20):
            packed.write(b"<net>" + bytes(999_995))
    tracemalloc.start()
    with pytest.raises(MapError, match="at most 200 MB"):
        read_map_source(file)
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak_bytes < 1_000_000_000


@pytest.mark.parametrize(
    ("net", "words"),
    [
        (b"<net>" + b"<a/>" * MAX_TAGS + b"</net>", "XML tags"),
        *[(b"<net>" * 100_000 + b"</net>" * 100_000, None), (b"<net>" * 100_000, None)],
    ],
    ids=["more elements than a city has", "deep", "deep without end"],
)
def test_large_and_deep_documents_are_refused(net, words):
    with pytest.raises(MapError, match=words):
        parse_road_network(net)


def test_devices_are_refused():
    with pytest.raises(MapError, match="no file"):
        read_map_source(Path("/dev/zero"))
