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


def test_a_refusal_carries_netconverts_first_error_line(tmp_path):
    with pytest.raises(MapError, match=r"'mymap'.*it said: .*absent\.xodr"):
        run_netconvert(["--opendrive-files", str(tmp_path / "absent.xodr")], tmp_path / "out.net.xml", "mymap")
