"""ScenarioNet's description of three vehicles at a signal, and its summary."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from datasets.made_bag import Export
from datasets.made_tracks import FRAMES, LANE, made_record, made_tracks
from hand_made_record import crossing
from reader_environments import read_with

from siren_ros.data.datasets.scenarionet import description, map_features, summary_of
from siren_ros.simulation.roads.mirror_image import mirrored_network

FOUND = description(made_record(), made_tracks(), "one", 1)
PATHS = 12


def test_tracks_fill_the_frames_at_which_they_are_there():
    assert FOUND["length"] == FRAMES
    car, bus = FOUND["tracks"]["5"]["state"], FOUND["tracks"]["9"]["state"]
    assert np.flatnonzero(car["valid"]).tolist() == list(range(5, 21))
    assert np.flatnonzero(bus["valid"]).tolist() == list(range(10))
    time = 0.1 * np.arange(16)
    way = 8.0 * time + 0.25 * time**2
    assert car["position"][5:, :2] == pytest.approx(
        np.stack((20.0 + way * np.cos(1.0), 3.0 + way * np.sin(1.0)), axis=-1), abs=1e-4
    )
    assert car["velocity"][5] == pytest.approx([8.0 * np.cos(1.0), 8.0 * np.sin(1.0)], abs=1e-5)
    assert not car["position"][:5].any()
    assert (car["length"][5], car["width"][5], car["height"][5]) == pytest.approx((4.0, 1.8, 1.5))
    assert set(car["heading"][5:].tolist()) == {1.0}
    assert FOUND["tracks"]["1"]["metadata"]["is_emv"] is True
    assert FOUND["tracks"]["9"]["metadata"]["class"] == "bus"
    assert FOUND["metadata"]["ts"] == pytest.approx(0.1 * np.arange(FRAMES))
    assert FOUND["metadata"]["sdc_id"] == "1"


def test_a_light_shows_the_friendliest_movement_of_its_lane():
    """Straight on is yellow, and green from step 20 on, which is frame 10; to the right is red."""
    light = FOUND["dynamic_map_states"][str(LANE)]
    states = light["state"]["object_state"]
    assert states[:10] == ["LANE_STATE_CAUTION"] * 10
    assert states[10:] == ["LANE_STATE_GO"] * 11
    assert light["stop_point"].tolist() == [5.25, -20.0, 0.0]
    assert FOUND["dynamic_map_states"]["2"]["state"]["object_state"] == ["LANE_STATE_STOP"] * FRAMES


def test_lanes_have_their_lines_and_neighbours():
    features = map_features(crossing())
    lane = features[str(LANE)]
    assert lane["type"] == "LANE_SURFACE_STREET"
    assert (lane["left_neighbor"], lane["right_neighbor"]) == (["2"], ["0"])
    assert lane["polygon"].tolist() == [[3.5, -120.0], [3.5, -20.0], [7.0, -20.0], [7.0, -120.0]]
    assert lane["speed_limit_kmh"] == pytest.approx(13.9 * 3.6)
    assert features["1_left"]["type"] == "ROAD_LINE_BROKEN_SINGLE_WHITE"
    assert features["2_left"]["type"] == "ROAD_LINE_SOLID_SINGLE_YELLOW"
    assert "1_right" not in features
    assert features["0_right"]["polyline"].tolist() == [[9.5, -120.0, 0.0], [9.5, -20.0, 0.0]]
    assert features[str(PATHS)]["type"] == "LANE_SURFACE_UNSTRUCTURE"
    assert f"{PATHS}_left" not in features
    assert features[str(PATHS)]["entry_lanes"] == ["1"]
    assert features[str(PATHS)]["exit_lanes"] == ["3"]


def test_where_traffic_keeps_left_the_middle_of_the_road_is_on_the_right():
    features = map_features(mirrored_network(crossing()))
    assert features["2_right"]["type"] == "ROAD_LINE_SOLID_SINGLE_YELLOW"
    assert features["1_right"]["type"] == "ROAD_LINE_BROKEN_SINGLE_WHITE"
    assert "1_left" not in features
    assert features["0_left"]["polyline"].tolist() == [[9.5, 120.0, 0.0], [9.5, 20.0, 0.0]]
    lane = features[str(LANE)]
    assert (lane["left_neighbor"], lane["right_neighbor"]) == (["0"], ["2"])


def test_the_summary_counts_ways_and_vehicles():
    summary = summary_of(FOUND)
    moved = {name: summary_row["moving_distance"] for name, summary_row in summary["object_summary"].items()}
    assert moved == pytest.approx({"1": 20.0, "5": 8.0 * 1.5 + 0.25 * 1.5**2, "9": 4.5}, abs=1e-3)
    assert {name: summary_row["valid_length"] for name, summary_row in summary["object_summary"].items()} == {
        "1": 21,
        "5": 16,
        "9": 10,
    }
    assert summary["number_summary"]["num_objects"] == summary["number_summary"]["num_moving_objects"] == 3
    assert summary["number_summary"]["num_traffic_lights"] == len(FOUND["dynamic_map_states"])
    assert summary["ts"] == pytest.approx((0.1 * np.arange(FRAMES)).tolist())


def test_who_moves_less_than_a_metre_stands():
    still = description(made_record(), [track.window(0, 2) for track in made_tracks() if track.frame[0] == 0], "x", 1)
    summary = summary_of(still)["number_summary"]
    assert (summary["num_objects"], summary["num_moving_objects"]) == (2, 0)


@pytest.fixture(scope="module")
def read(exported: Export, tracked_bag: Path) -> dict[str, Any]:
    reading: dict[str, Any] = read_with(
        "metadrive", "read_scenarionet.py", exported("scenarionet", tracked_bag) / "train"
    )
    return reading


def test_metadrives_sanity_check_passes(read, tracked_tracks):
    assert (read["scenarios"], read["length"]) == (1, 140)
    assert read["tracks"] == len(tracked_tracks)
    assert read["features"] > 200
    assert read["lights"] > 10


def test_metadrive_replays_the_episode(read):
    assert read["steps"] > 100
    assert read["travelled"] == pytest.approx(read["recorded"], rel=0.02)
    assert read["others"] > 5
