"""Argoverse 2: its map of a small crossing, its scenarios of a drive of formulas, and what av2 reads of them."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from datasets.made_bag import BUS, CAR, EMV, Export
from datasets.made_tracks import made_tracks
from hand_made_record import STRAIGHT, crossing, line
from reader_environments import read_with
from shapely import Polygon, unary_union
from synthetic_episode import NET_XML

from siren_ros.cli.main import main
from siren_ros.data.datasets import argoverse2
from siren_ros.data.datasets.lane_graph import lane_graph
from siren_ros.data.tracks import Track
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import mirrored_network

MADE_DATASET = ("argoverse2", "made_drive", "--population", "all", "--stride", "4", "--split", "val")
MAP = argoverse2.map_json(crossing())
PATHS = 12
FRAMES = {EMV: (0, 131), CAR: (5, 131), BUS: (0, 129)}
"""First frame and the one after the last: 262 steps; the car comes at step 10, the bus is last seen at step 256."""
NAME = "S2-L2-seed0-straight-v{}-f{:06d}"


def xy(points: list[dict[str, float]]) -> np.ndarray:
    return np.array([(point["x"], point["y"]) for point in points])


def test_lanes_have_their_kind_marks_and_neighbours():
    shoulder, right, left = (MAP["lane_segments"][str(index)] for index in range(3))
    assert [lane["lane_type"] for lane in (shoulder, right, left)] == ["BUS", "VEHICLE", "VEHICLE"]
    assert (right["left_neighbor_id"], right["right_neighbor_id"]) == (2, 0)
    assert (right["left_lane_mark_type"], right["right_lane_mark_type"]) == ("DASHED_WHITE", "DASHED_WHITE")
    assert (left["left_lane_mark_type"], shoulder["right_lane_mark_type"]) == ("SOLID_YELLOW", "SOLID_WHITE")
    path = MAP["lane_segments"][str(PATHS + STRAIGHT)]
    assert (path["is_intersection"], right["is_intersection"]) == (True, False)
    assert (path["left_lane_mark_type"], path["right_lane_mark_type"]) == ("NONE", "NONE")
    assert (path["predecessors"], path["successors"]) == ([1], [3])


def test_lines_are_in_the_lanes_direction_to_the_millimetre():
    right = MAP["lane_segments"]["1"]
    for name, x_m in (("centerline", 5.25), ("left_lane_boundary", 3.5), ("right_lane_boundary", 7.0)):
        points = xy(right[name])
        assert set(points[:, 0].tolist()) == {x_m}
        assert (points[0, 1], points[-1, 1]) == (-120.0, -20.0)
        assert np.ptp(np.diff(points[:, 1])) < 0.0021, "rounded to a millimetre"
    third = argoverse2.map_json(crossing())["lane_segments"][str(PATHS + 3)]["centerline"]
    assert all(round(point[axis], 3) == point[axis] for point in third for axis in ("x", "y"))
    assert all(any(round(point[axis], 2) != point[axis] for point in third) for axis in ("x", "y"))
    assert {point["z"] for point in third} == {0.0}


def test_lines_have_points_at_equal_distances():
    points = argoverse2.resampled(line((0.0, 0.0), (3.0, 0.0), (3.0, 3.0)), 5)
    assert points == pytest.approx(np.array([(0.0, 0.0), (1.5, 0.0), (3.0, 0.0), (3.0, 1.5), (3.0, 3.0)]))


def test_the_drivable_area_covers_lanes_and_junctions_and_ends_there():
    """All outlines are made 0.05 m wider, so that neighbours join, and simplified by as much."""
    network = crossing()
    shapes = [Polygon(np.vstack((lane.left, lane.right[::-1]))) for lane in lane_graph(network).values()]
    shapes += [Polygon(junction.outline) for junction in network.junctions.values()]
    whole = unary_union([Polygon(xy(area["area_boundary"])) for area in MAP["drivable_areas"].values()])
    assert all(whole.buffer(0.05).contains(shape) for shape in shapes)
    assert unary_union(shapes).buffer(0.15).contains(whole)
    assert [area["id"] for area in MAP["drivable_areas"].values()] == list(range(len(MAP["drivable_areas"])))


@pytest.mark.parametrize("first", range(4))
def test_a_crossing_has_its_long_edges_in_one_direction(first):
    """4 m wide, 12 m long, its outline from any corner on."""
    outline = np.roll(np.array([(0.0, 0.0), (12.0, 0.0), (12.0, 4.0), (0.0, 4.0)]), -first, axis=0)
    walked = replace(crossing(), crossings=(*[outline] * 7, outline, outline))
    crossing_json = argoverse2.map_json(walked)["pedestrian_crossings"]["7"]
    edges = [xy(crossing_json[name]) for name in ("edge1", "edge2")]
    assert crossing_json["id"] == 7
    assert [float(np.hypot(*(edge[1] - edge[0]))) for edge in edges] == [12.0, 12.0]
    assert (edges[0][1] - edges[0][0]).tolist() == (edges[1][1] - edges[1][0]).tolist()
    assert {edges[0][0][1], edges[1][0][1]} == {0.0, 4.0}


def lasting(track: Track, first: int, count: int) -> Track:
    """The same vehicle over other frames."""
    place = np.resize(np.arange(len(track)), count)
    arrays = {name: values[place] for name, values in vars(track).items() if isinstance(values, np.ndarray)}
    return replace(track, **{**arrays, "frame": np.arange(first, first + count)})


def test_a_vehicle_is_focal_or_there_all_the_time_or_at_the_present_or_later():
    emv, car, bus = made_tracks()
    first, steps = 40, argoverse2.STEPS
    windows = [
        lasting(emv, first, steps),
        lasting(car, first, steps),
        lasting(bus, first + 47, 3),
        lasting(replace(bus, actor=replace(bus.actor, actor_id=11)), first + 50, 5),
    ]
    table = argoverse2.scenario_table(windows, 5, 1, first, "name", "town")
    counts = [steps, steps, 3, 5]
    assert table["track_id"].tolist() == np.repeat(["AV", "5", "9", "11"], counts).tolist()
    assert table["object_category"].tolist() == np.repeat([2, 3, 1, 0], counts).tolist()
    assert table["timestep"].tolist() == [*range(steps), *range(steps), *range(47, 50), *range(50, 55)]
    assert set(table["end_timestamp"].tolist()) == {4_000_000_000 + (steps - 1) * 100_000_000}
    assert set(table["num_timestamps"].tolist()) == {steps} == {110}


def scenario(made_dataset: Path, name: str) -> dict[str, np.ndarray]:
    table: Any = pq.read_table(made_dataset / "val" / name / f"scenario_{name}.parquet")
    return {column: np.array(table[column].to_pylist()) for column in table.column_names}


def test_every_fourth_whole_window_of_each_vehicle_is_a_scenario(made_dataset):
    """The name has the frame of the present, the 50th of its 110."""
    expected = {
        NAME.format(actor, start + 49) for actor, (first, end) in FRAMES.items() for start in range(first, end - 109, 4)
    }
    assert {path.name for path in (made_dataset / "val").iterdir()} == expected
    assert list((made_dataset / "train").iterdir()) == list((made_dataset / "test").iterdir()) == []
    card = json.loads((made_dataset / "dataset.json").read_text())
    assert card["counts"] == {"scenarios": len(expected)}
    assert card["classes"] == {"ambulance": 6, "bus": 5, "sedan": 5}


def test_each_scenario_has_the_map_of_its_episode(made_dataset):
    for folder in (made_dataset / "val").iterdir():
        assert sorted(path.name for path in folder.iterdir()) == [
            f"log_map_archive_{folder.name}.json",
            f"scenario_{folder.name}.parquet",
        ]
    name = NAME.format(EMV, 49)
    archive = json.loads((made_dataset / "val" / name / f"log_map_archive_{name}.json").read_text())
    assert archive == json.loads(json.dumps(argoverse2.map_json(parse_road_network(NET_XML.encode()))))


def test_where_traffic_keeps_left_the_yellow_line_is_on_the_right():
    network = parse_road_network(NET_XML.encode())
    kinds = [
        {
            side: [lane[f"{side}_lane_mark_type"] for lane in argoverse2.map_json(one)["lane_segments"].values()]
            for side in ("left", "right")
        }
        for one in (network, mirrored_network(network))
    ]
    assert kinds[0]["left"] == kinds[1]["right"] == ["DASHED_WHITE", "SOLID_YELLOW"] * 2
    assert kinds[0]["right"] == kinds[1]["left"] == ["SOLID_WHITE", "DASHED_WHITE"] * 2


@pytest.mark.parametrize(("focal", "start"), [(EMV, 0), (CAR, 9), (BUS, 16)])
def test_a_scenario_holds_everybodys_states(made_dataset, focal, start):
    name = NAME.format(focal, start + 49)
    table = scenario(made_dataset, name)
    assert set(table["scenario_id"]) == {name}
    assert set(table["city"]) == {"straight"}
    assert set(table["focal_track_id"]) == {"AV" if focal == EMV else str(focal)}
    assert set(table["start_timestamp"]) == {start * 100_000_000}
    for actor, (first, end) in FRAMES.items():
        states = table["track_id"] == ("AV" if actor == EMV else str(actor))
        frames = np.arange(max(first, start), min(end, start + 110))
        assert table["timestep"][states].tolist() == (frames - start).tolist()
        assert table["observed"][states].tolist() == (frames - start < 50).tolist()
        assert set(table["object_type"][states]) == {"bus" if actor == BUS else "vehicle"}
        whole = len(frames) == 110
        assert set(table["object_category"][states]) == {3 if actor == focal else 2 if whole else 1}
        time = 0.1 * (frames - first)
        way = {EMV: 10.0 * time, CAR: 6.0 * time + 0.1 * time**2, BUS: 9.0 * time}[actor]
        assert table["position_x"][states] == pytest.approx({EMV: 20.0, CAR: 60.0, BUS: 40.0}[actor] + way)
        assert set(table["position_y"][states]) == {-1.75 if actor == BUS else -5.25}
        speed = {EMV: 10.0 + 0.0 * time, CAR: 6.0 + 0.2 * time, BUS: 9.0 + 0.0 * time}[actor]
        assert table["velocity_x"][states] == pytest.approx(speed)
        assert set(table["velocity_y"][states]) == set(table["heading"][states]) == {0.0}


def test_of_the_region_only_whole_windows_near_the_emv_count(exported, made_drive):
    """The car is 40 m ahead at frame 5 and falls back by 4 m a second and less; the bus is 20 m ahead."""
    folder = exported("argoverse2", made_drive) / "train"
    assert {path.name.rsplit("-", 2)[1] for path in folder.iterdir()} == {"v1", "v5", "v9"}
    starts = sorted(int(path.name[-6:]) - 49 for path in folder.glob("*-v5-*"))
    entered = next(frame for frame in range(5, 131) if abs(_gap_m(frame)) <= 40.0)
    assert starts == list(range(entered, 131 - 109))


def _gap_m(frame: int) -> float:
    time = 0.1 * (frame - 5)
    return (60.0 + 6.0 * time + 0.1 * time**2) - (20.0 + 1.0 * frame)


def test_av2_reads_the_scenario_and_the_map_of_an_episode(exported: Export, tracked_bag: Path, tracked_tracks):
    folder = exported("argoverse2", tracked_bag, "--stride", "10") / "train"
    name = min(path.name for path in folder.glob("S3-L1-seed0-town-v1-*"))
    assert len({path.stat().st_ino for path in folder.rglob("log_map_archive_*.json")}) == 1, "stored once"
    read = read_with("av2", "read_argoverse2.py", folder / name)
    first = int(name[-6:]) - 49
    states = tracked_tracks[0].window(first, 110)
    assert (read["id"], read["focal"]) == (name, "AV")
    assert (read["observed"], read["period_s"], read["timesteps"]) == (50, pytest.approx(0.1), list(range(110)))
    assert np.array(read["places"]) == pytest.approx(np.stack((states.x_m, states.y_m), axis=-1))
    assert read["headings"] == pytest.approx(states.yaw_rad.tolist())
    there = {track.actor.actor_id: len(track.window(first, 110)) for track in tracked_tracks}
    categories = {1 if key == "AV" else int(key): value for key, value in read["categories"].items()}
    assert set(categories) == {key for key, count in there.items() if count}, "nobody is dropped"
    assert categories[1] == 3
    assert all((categories[key] == 2) == (count == 110) for key, count in there.items() if count and key != 1)
    assert read["lanes"] > 100
    assert read["links_both_ways"] == read["links"] > 100
    assert read["neighbours_both_ways"] == read["neighbours"] > 10
    assert read["junction_lanes"] > 10
    assert min(read["crossings"], read["near"]) > 0
    assert read["driven_inside"] == 110, "the EMV drives on the drivable area"


@pytest.mark.parametrize("stride", ["0", "two", "-1", "x", "1.5"])
def test_a_stride_is_a_whole_number_of_frames(made_drive, tmp_path, stride, capsys):
    assert main(["export", "argoverse2", str(made_drive), "--out", str(tmp_path / "out"), f"--stride={stride}"]) == 2
    assert "stride" in capsys.readouterr().err
