import gzip

import pytest

from siren_ros.errors import MapError
from siren_ros.simulation.roads.maps import map_source
from siren_ros.simulation.roads.maps.map_source import SourceKind, read_map_source


@pytest.mark.parametrize(
    ("name", "content", "kind", "stem"),
    [
        ("crossroads.net.xml", b"<net/>", SourceKind.SUMO, "crossroads"),
        ("Town.xodr", b'<?xml version="1.0"?><OpenDRIVE/>', SourceKind.OPENDRIVE, "Town"),
        ("city.centre.osm.xml", b"<osm/>", SourceKind.OPENSTREETMAP, "city.centre"),
        ("misnamed.osm", b"<net/>", SourceKind.SUMO, "misnamed"),
        (".xml", b"<net/>", SourceKind.SUMO, ".xml"),
    ],
)
def test_the_root_element_tells_the_kind(tmp_path, name, content, kind, stem):
    path = tmp_path / name
    path.write_bytes(content)
    source = read_map_source(path)
    assert (source.kind, source.name, source.content) == (kind, stem, content)


def test_gzip_is_seen_through(tmp_path):
    path = tmp_path / "city.osm.xml.gz"
    path.write_bytes(gzip.compress(b"<osm/>"))
    source = read_map_source(path)
    assert (source.kind, source.name, source.content) == (SourceKind.OPENSTREETMAP, "city", b"<osm/>")


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        *[(b"", "not readable XML"), (b"plain words", "not readable XML")],
        *[(b"\x89PNG\r\n", "not readable XML"), (b"<html/>", "an XML document <html>")],
        (gzip.compress(b"<net/>", mtime=0)[:-6], "gzip file is damaged"),
        (b'<!DOCTYPE n [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><net>&b;</net>', "not readable XML"),
    ],
)
def test_what_is_no_map_is_refused(tmp_path, content, reason):
    path = tmp_path / "map.xml"
    path.write_bytes(content)
    with pytest.raises(MapError) as caught:
        read_map_source(path)
    assert reason in str(caught.value)
    assert "map.xml" in str(caught.value)


def test_missing_files_and_folders_are_refused(tmp_path):
    with pytest.raises(MapError, match="No such file"):
        read_map_source(tmp_path / "absent.xodr")
    with pytest.raises(MapError, match="directory"):
        read_map_source(tmp_path)


@pytest.mark.parametrize("packed", [False, True])
def test_a_map_may_be_as_large_as_the_limit(tmp_path, monkeypatch, packed):
    content = b"<osm/>" + b" " * 94
    path = tmp_path / ("city.osm.gz" if packed else "city.osm")
    path.write_bytes(gzip.compress(content) if packed else content)
    monkeypatch.setattr(map_source, "MAX_MAP_BYTES", 100)
    assert read_map_source(path).content == content
    monkeypatch.setattr(map_source, "MAX_MAP_BYTES", 99)
    with pytest.raises(MapError, match="a map of at most"):
        read_map_source(path)
