import os
import re
import signal
import subprocess
import sys
import time
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest
from defusedxml.ElementTree import fromstring

from siren_ros.errors import MapError
from siren_ros.simulation.roads.maps import netconvert
from siren_ros.simulation.roads.maps.netconvert import (
    control_patches,
    document,
    netconvert_path,
    netconvert_version,
    normal_edges,
    run_netconvert,
    without_header,
)


def test_the_dated_header_goes_and_the_net_stays():
    declaration, header = b'<?xml version="1.0"?>\n', b"\n<!-- on 2026-01-02\n<netconvert/> --><!-- -->\n"
    net = b'<net version="1">\n<!-- kept --></net>\n'
    assert without_header(declaration + header + net) == declaration + net


def test_a_net_without_header_is_left_alone():
    assert without_header(b"<net><!-- x --></net>") == b"<net><!-- x --></net>"


def test_netconvert_is_the_installed_sumos():
    assert netconvert_path().is_file()
    netconvert_version.cache_clear()
    assert netconvert_version()


def test_where_sumo_is_no_package_it_says_its_version_itself(monkeypatch):
    def unknown(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr("siren_ros.simulation.roads.maps.netconvert.version", unknown)
    netconvert_version.cache_clear()
    assert re.fullmatch(r"Eclipse SUMO netconvert .*\d+\.\d+.*", netconvert_version())
    netconvert_version.cache_clear()


NODES = '<nodes><node id="a" x="0" y="0"/><node id="b" x="100" y="0"/></nodes>'


def test_a_net_comes_back_without_its_dated_header(tmp_path):
    (tmp_path / "nodes.xml").write_text(NODES)
    (tmp_path / "edges.xml").write_text('<edges><edge id="e" from="a" to="b" numLanes="2"/></edges>')
    options = ["--node-files", str(tmp_path / "nodes.xml"), "--edge-files", str(tmp_path / "edges.xml")]
    net = run_netconvert(options, tmp_path / "out.net.xml", "mymap")
    assert net == without_header((tmp_path / "out.net.xml").read_bytes())
    assert net.startswith(b'<?xml version="1.0" encoding="UTF-8"?>\n<net ')
    assert net.count(b'<lane id="e_') == 2


def test_what_is_no_utf8_in_netconverts_words_is_shown_all_the_same(tmp_path):
    folder = os.fsencode(tmp_path) + b"/\xe4"
    with pytest.raises(MapError, match="it said: "):
        run_netconvert(["--opendrive-files", os.fsdecode(folder)], tmp_path / "out.net.xml", "mymap")


def test_a_refusal_without_words_tells_the_exit_code(tmp_path, monkeypatch):
    false = tmp_path / "netconvert"
    false.write_text("#!/bin/sh\nexit 3\n")
    false.chmod(0o755)
    monkeypatch.setattr("siren_ros.simulation.roads.maps.netconvert.netconvert_path", lambda: false)
    with pytest.raises(MapError, match=r"it said: exit code 3\)"):
        run_netconvert([], tmp_path / "out.net.xml", "mymap")


def test_a_refusal_carries_netconverts_first_error_line(tmp_path):
    with pytest.raises(MapError, match=r"'mymap'.*it said: .*absent\.xodr"):
        run_netconvert(["--opendrive-files", str(tmp_path / "absent.xodr")], tmp_path / "out.net.xml", "mymap")


def in_place_of_netconvert(path, lines):
    """A shell script that runs as netconvert would."""
    path.write_text(f"#!/bin/sh\n{lines}\n")
    path.chmod(0o755)
    return path


TELLS_LIMITS = 'echo "Error: $(ulimit -v) $(ulimit -t) $(ulimit -f)"; exit 1'


def test_netconvert_has_limits(tmp_path, monkeypatch):
    tells = in_place_of_netconvert(tmp_path / "tells", TELLS_LIMITS)
    monkeypatch.setattr(netconvert, "netconvert_path", lambda: tells)
    with pytest.raises(MapError, match=f"it said: {8 * 2**20} 900 {400_000_000 // 512}"):
        run_netconvert([], tmp_path / "out.net.xml", "mymap")


def test_lower_limits_of_the_user_hold(tmp_path):
    tells = in_place_of_netconvert(tmp_path / "tells", TELLS_LIMITS)
    program = f"""
import resource
from pathlib import Path
from siren_ros.simulation.roads.maps import netconvert
netconvert.netconvert_path = lambda: Path({str(tells)!r})
resource.setrlimit(resource.RLIMIT_AS, (5 * 2**30, 5 * 2**30))
resource.setrlimit(resource.RLIMIT_CPU, (300, 300))
resource.setrlimit(resource.RLIMIT_FSIZE, (100 * 512, 100 * 512))
try:
    netconvert.run_netconvert([], Path({str(tmp_path)!r}) / "out", "mymap")
except netconvert.MapError as error:
    print(error)
"""
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert f"it said: {5 * 2**20} 300 100)" in answer.stdout


def test_a_map_that_takes_too_much_memory_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(netconvert, "MOST_MEMORY_BYTES", 2**30)
    geometry = '<geometry s="0" x="0" y="0" hdg="0" length="1e9"><arc curvature="0.01"/></geometry>'
    road = f'<road id="1" length="1e9" junction="-1"><planView>{geometry}</planView></road>'
    (tmp_path / "long.xodr").write_text(f'<OpenDRIVE><header revMajor="1" revMinor="4"/>{road}</OpenDRIVE>')
    with pytest.raises(MapError, match="it said: more than 1 GB of memory are needed"):
        run_netconvert(["--opendrive-files", str(tmp_path / "long.xodr")], tmp_path / "out.net.xml", "mymap")


def test_a_net_that_is_larger_than_what_is_read_is_refused(tmp_path, monkeypatch):
    writes = in_place_of_netconvert(tmp_path / "writes", f"head -c 1000001 /dev/zero > {tmp_path}/out.net.xml")
    monkeypatch.setattr(netconvert, "netconvert_path", lambda: writes)
    monkeypatch.setattr(netconvert, "MAX_MAP_BYTES", 1_000_000)
    with pytest.raises(MapError, match="a map whose net has at most 1 MB"):
        run_netconvert([], tmp_path / "out.net.xml", "mymap")


def test_what_netconvert_says_is_one_short_line_of_plain_characters(tmp_path, monkeypatch):
    says = in_place_of_netconvert(
        tmp_path / "says", "printf 'Error: \\033[2J'; head -c 100000 /dev/zero | tr '\\0' x; exit 1"
    )
    monkeypatch.setattr(netconvert, "netconvert_path", lambda: says)
    with pytest.raises(MapError, match=r"it said: \?\[2Jxxx") as caught:
        run_netconvert([], tmp_path / "out.net.xml", "mymap")
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_netconvert_does_not_outlive_who_waits_for_it(tmp_path, number):
    note = tmp_path / "number"
    lines = f"echo $$ > {note}.new; mv {note}.new {note}; exec sleep 300"
    hangs = in_place_of_netconvert(tmp_path / "hangs", lines)
    program = f"""
from pathlib import Path
from siren_ros.simulation.roads.maps import netconvert
netconvert.netconvert_path = lambda: Path({str(hangs)!r})
netconvert.run_netconvert([], Path({str(tmp_path)!r}) / "out", "mymap")
"""
    with subprocess.Popen([sys.executable, "-c", program]) as waits:
        while not note.exists():
            assert waits.poll() is None
            time.sleep(0.01)
        waits.send_signal(number)
        assert waits.wait() == -number
    child = int(note.read_text())
    while is_running(child):
        time.sleep(0.01)


def is_running(process):
    """Whether a process is there and no zombie."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


NET = """<net>
<edge id=":J_0" function="internal"/><edge id=":J_w" function="walkingarea"/>
<edge id="n" to="J" priority="5"/><edge id="e" to="J" priority="3"/><edge id="s" to="J"/>
<edge id="w" to="J" priority="4"/>
<edge id="path" to="J" priority="-7"/><edge id="away" to="K" priority="9"/>
<junction id="J" type="{kind}"/><junction id="K" type="priority"/></net>"""


def patched(stopping, yielding="", kind="priority"):
    """Types of nodes and priorities of edges; nobody drives on the path."""
    net = fromstring(NET.format(kind=kind))
    signs = stopping.split(), yielding.split()
    nodes, priorities = control_patches(net, *signs, lambda edge: edge.attrib["id"] != "path")
    return {node.attrib["id"]: node.attrib["type"] for node in nodes}, dict(priorities)


def test_edges_outside_junctions_are_the_normal_ones():
    net = fromstring(NET.format(kind="priority"))
    assert [edge.attrib["id"] for edge in normal_edges(net)] == ["n", "e", "s", "w", "path", "away"]


@pytest.mark.parametrize(
    ("stopping", "yielding", "nodes", "priorities"),
    [
        *[("", "", {}, {}), ("n", "", {"J": "priority_stop"}, {"n": 0})],
        ("n e s w", "", {"J": "allway_stop"}, {"n": 4, "e": 2, "s": 0, "w": 3}),
        *[("n e w", "", {"J": "priority_stop"}, {"n": 0, "e": 0, "w": 0}), ("", "s", {}, {"s": 0})],
        *[("", "n", {}, {"n": 0}), ("n", "s", {"J": "priority_stop"}, {"n": 2, "s": 0})],
        ("path away", "", {"K": "allway_stop"}, {"away": 8}),
    ],
)
def test_signs_lower_their_approaches_below_the_others(stopping, yielding, nodes, priorities):
    """One less than the least of the approaches without a sign and the own one; 1 where nothing is stated."""
    assert patched(stopping, yielding) == (nodes, priorities)


@pytest.mark.parametrize("kind", ["traffic_light", "traffic_light_right_on_red"])
def test_a_signal_outranks_signs(kind):
    assert patched("n", "e", kind) == ({}, {})


def test_a_plain_file_holds_the_elements():
    nodes, _ = control_patches(fromstring(NET.format(kind="priority")), ["n"], [], lambda _: True)
    root = fromstring(document("nodes", nodes))
    assert root.tag == "nodes"
    assert [dict(node.attrib) for node in root] == [{"id": "J", "type": "priority_stop"}]
