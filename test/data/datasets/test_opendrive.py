"""OpenDRIVE as CARLA reads it."""

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from defusedxml.ElementTree import parse
from reader_environments import read_with
from synthetic_episode import NET_XML

from siren_ros.cli.main import main
from siren_ros.data.datasets.opendrive import opendrive_of
from siren_ros.data.record.episode_source import open_source
from siren_ros.simulation.roads.road_network import LaneKind

DATASET = ("opendrive", "tracked_bag")


def test_carla_finds_the_lanes_where_they_are(dataset, tracked_bag):
    with open_source(tracked_bag) as source:
        lanes = [lane for lane in source.network.lanes if lane.kind is LaneKind.DRIVING and lane.length_m > 20.0]
    middles = np.array([lane.centre.at(np.array([lane.length_m / 2.0]))[0] for lane in lanes])
    (file,) = dataset.glob("*.xodr")
    read = read_with("carla", "read_opendrive.py", file, json.dumps(middles.tolist()))
    on_road = np.array([place[:2] for place in read["places"]])
    assert len(lanes) > 30
    off = [abs(lane.centre.project(on_road[row : row + 1])[1][0]) for row, lane in enumerate(lanes)]
    assert np.median(off) < 0.001
    assert max(off) < 0.2, "the corners of bends are cut differently"
    turned = [
        np.cos(np.radians(place[2]) - lane.centre.heading_rad(lane.length_m / 2.0))
        for place, lane in zip(read["places"], lanes, strict=True)
    ]
    assert min(turned) > 0.9, "lanes run in their direction"
    assert read["topology"] > len(lanes)


def checked(file: Path) -> list[str]:
    """What ASAM's checker has against a map."""
    read = read_with("asam", "read_asam_checks.py", "qc_opendrive", file)
    assert read["statuses"]["check_asam_xodr_xml_valid_schema"] == "completed"
    assert "error" not in read["statuses"].values()
    return [f"{check}: {text}" for check, _, text in read["issues"]]


def test_asams_checker_finds_nothing_in_a_map_with_crossings(dataset, tmp_path):
    (file,) = dataset.glob("*.xodr")
    text = file.read_text(encoding="utf-8")
    assert text.count("<outline ") > 10
    assert checked(file) == []
    earlier = tmp_path / "earlier.xodr"
    earlier.write_text(text.replace('revMinor="5"', 'revMinor="4"'), encoding="utf-8")
    assert any("'outline', attribute 'id'" in issue for issue in checked(earlier)), "what netconvert writes is not 1.4"
    bare = tmp_path / "bare.xodr"
    bare.write_text(re.sub(r' (dynamic|zOffset)="[^"]*"', "", text), encoding="utf-8")
    assert any("'zOffset' is required but missing" in issue for issue in checked(bare)), "nor 1.5"


def test_a_map_with_a_place_on_earth_keeps_it(tmp_path):
    """The header's offset leads from the map frame to the projection's coordinates."""
    place = 'netOffset="-561653.57,-4185149.03" convBoundary="0.00,-7.00,320.00,7.00"'
    utm = "+proj=utm +zone=10 +ellps=WGS84 +datum=WGS84 +units=m +no_defs"
    net = re.sub(r"<location [^>]*>", f'<location {place} origBoundary="0,0,1,1" projParameter="{utm}"/>', NET_XML)
    network = SimpleNamespace(sumo_offset_m=(100.0, 20.0), left_hand=False)
    source: Any = SimpleNamespace(net_xml=net, network=network, description=SimpleNamespace(map_name="far"))
    file = tmp_path / "far.xodr"
    file.write_bytes(opendrive_of(source))
    header = parse(file).getroot().find("header")
    assert (header.attrib["revMajor"], header.attrib["revMinor"]) == ("1", "5")
    assert str(header.findtext("geoReference")).strip() == utm
    offset = header.find("offset")
    assert [float(offset.attrib[axis]) for axis in "xy"] == [561753.57, 4185169.03]
    assert checked(file) == []


def test_the_same_map_gives_the_same_file(dataset, tracked_bag, tmp_path):
    assert main(["export", "opendrive", str(tracked_bag), "--out", str(tmp_path / "out")]) == 0
    (first,), (second,) = dataset.glob("*.xodr"), (tmp_path / "out").glob("*.xodr")
    assert (first.name, first.read_bytes()) == (second.name, second.read_bytes())
    assert b"netconvertConfiguration" not in first.read_bytes()
