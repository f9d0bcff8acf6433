"""Our compiled maps next to CARLA's own map code: lanes lie where CARLA's lie, lights belong to our movements."""

from pathlib import Path

import pytest
from made_district import district_xodr, write_district
from repository import shared_file

from siren_ros.running.carla.server_map import MOST_M, is_same, lane_distances, signal_heads
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.net_parser import parse_road_network

carla = pytest.importorskip("carla", reason="CARLA's client has no wheel for this machine")


@pytest.mark.parametrize("town", ["Town10HD_Opt", "Town04", "Town07"])
def test_the_towns_of_carla_are_the_same_in_both(town):
    file = shared_file("maps", f"{town}.xodr")
    theirs, ours = carla.Map(town, file.read_text()), parse_road_network(compile_map(file).read_bytes())
    found = lane_distances(carla, theirs, ours)
    assert found["places"] > 300
    assert found["median_m"] < 0.05
    assert found["share_m"] < MOST_M
    assert found["share_deg"] < 1.0
    heads = signal_heads(theirs, ours)
    lights = {mark.id for mark in theirs.get_all_landmarks_of_type("1000001")}
    assert heads.keys() >= lights
    shown = [movement for light in lights for movement in heads[light]]
    assert len(shown) == len(set(shown)), "a movement has one light"


def test_a_made_map_is_the_same_and_another_is_not(tmp_path):
    ours = parse_road_network(compile_map(write_district(tmp_path)).read_bytes())
    found = lane_distances(carla, carla.Map("district", district_xodr()), ours)
    assert is_same(found)
    assert found["median_m"] < 0.01
    bends = Path(__file__).parents[2] / "maps" / "bends.xodr"
    other = lane_distances(carla, carla.Map("bends", bends.read_text()), ours)
    assert not is_same(other)
    assert not is_same({"places": 0.0})
