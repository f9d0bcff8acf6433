import os
import re
from importlib.metadata import PackageNotFoundError

import pytest

from siren_ros.errors import MapError
from siren_ros.roads.maps.netconvert import netconvert_path, netconvert_version, run_netconvert, without_header


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

    monkeypatch.setattr("siren_ros.roads.maps.netconvert.version", unknown)
    netconvert_version.cache_clear()
    assert re.fullmatch(r"Eclipse SUMO netconvert .*\d+\.\d+.*", netconvert_version())
    netconvert_version.cache_clear()


NODES = '<nodes><node id="a" x="0" y="0"/><node id="b" x="100" y="0"/></nodes>'


def test_a_net_comes_back_without_its_dated_header(tmp_path):
    (tmp_path / "nodes.xml").write_text(NODES)
    (tmp_path / "edges.xml").write_text('<edges><edge id="e" from="a" to="b" numLanes="2"/></edges>')
    options = ["--node-files", str(tmp_path / "nodes.xml"), "--edge-files", str(tmp_path / "edges.xml")]
    made = run_netconvert(options, tmp_path / "out.net.xml", "mymap")
    assert made == without_header((tmp_path / "out.net.xml").read_bytes())
    assert made.startswith(b'<?xml version="1.0" encoding="UTF-8"?>\n<net ')
    assert made.count(b'<lane id="e_') == 2


def test_what_is_no_utf8_in_netconverts_words_is_shown_all_the_same(tmp_path):
    folder = os.fsencode(tmp_path) + b"/\xe4"
    with pytest.raises(MapError, match="it said: "):
        run_netconvert(["--opendrive-files", os.fsdecode(folder)], tmp_path / "out.net.xml", "mymap")


def test_a_refusal_without_words_tells_the_exit_code(tmp_path, monkeypatch):
    false = tmp_path / "netconvert"
    false.write_text("#!/bin/sh\nexit 3\n")
    false.chmod(0o755)
    monkeypatch.setattr("siren_ros.roads.maps.netconvert.netconvert_path", lambda: false)
    with pytest.raises(MapError, match=r"it said: exit code 3\)"):
        run_netconvert([], tmp_path / "out.net.xml", "mymap")


def test_a_refusal_carries_netconverts_first_error_line(tmp_path):
    with pytest.raises(MapError, match=r"'mymap'.*it said: .*absent\.xodr"):
        run_netconvert(["--opendrive-files", str(tmp_path / "absent.xodr")], tmp_path / "out.net.xml", "mymap")
