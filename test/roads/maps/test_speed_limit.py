from dataclasses import replace
from pathlib import Path

import pytest

from siren_ros.roads.maps.map_compiler import compile_map
from siren_ros.roads.maps.speed_limit import lowered_limits, with_speed_limit
from siren_ros.roads.net_parser import parse_road_network

NET = (
    b'<net><edge id="a"><lane id="a_0" speed="13.89" length="10.00"/>'
    b'<lane id="a_1" speed="5.00" length="10.00"/></edge></net>'
)


def test_only_higher_limits_are_lowered() -> None:
    lowered = lowered_limits(NET, 8.333)
    assert b'id="a_0" speed="8.33" length="10.00"' in lowered
    assert b'id="a_1" speed="5.00" length="10.00"' in lowered
    assert lowered_limits(lowered, 8.333) == lowered
    assert lowered_limits(NET, 14.0) == NET


def test_a_map_keeps_everything_but_its_limits(tmp_path: Path) -> None:
    town = compile_map(None, tmp_path)
    slow = with_speed_limit(town, 8.333)
    before, after = (parse_road_network(one.read_bytes()) for one in (town, slow))
    assert max(lane.speed_limit_mps for lane in before.lanes) > 13.0
    assert max(lane.speed_limit_mps for lane in after.lanes) == pytest.approx(8.33)
    assert [lane.lane_id for lane in before.lanes] == [lane.lane_id for lane in after.lanes]
    assert all(a.length_m == b.length_m for a, b in zip(before.lanes, after.lanes, strict=True))
    assert slow.sha256 != town.sha256
    assert with_speed_limit(town, 8.333) == slow
    assert with_speed_limit(town, 50.0) == replace(town)


def test_a_lowered_map_is_found_again_in_the_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    town = compile_map(None, tmp_path)
    slow = with_speed_limit(town, 8.333)
    monkeypatch.setattr("siren_ros.roads.maps.speed_limit.lowered_limits", None)
    assert with_speed_limit(town, 8.333) == slow
