"""The paper's trajectory.csv, and NGSIM files read by the rules of the published loaders."""

import csv
import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import pytest
from datasets.made_bag import BUS, CAR, EMV
from evaluation.made_records import moving, record_with
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_streets import A_LEFT, A_RIGHT, B_LEFT, B_RIGHT, NEAR, streets
from reader_environments import read_with
from scipy.io import loadmat

from siren_ros.data.datasets import trajectory_tables
from siren_ros.data.datasets.files import FileWriter
from siren_ros.data.datasets.formats import EpisodePart
from siren_ros.data.datasets.trajectory_tables import CSV_COLUMNS, CSV_HEAD, LOG_PERIOD_STEPS, lines_of_step, type_id_of
from siren_ros.data.episode_source import EpisodeSource
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.simulation.scenario.scenario import region_members
from siren_ros.simulation.world.actors import TWO_WHEELED, ActorClass


def trajectory_csv(record: EpisodeRecord) -> str:
    """The whole file of a recorded episode: rows in the order of steps and, within a step, of actor ids."""
    logged = [states for states in record.states if states.step % LOG_PERIOD_STEPS == 0]
    return CSV_HEAD + "".join(lines_of_step(states, record.actors) for states in logged)


@pytest.fixture(scope="module")
def short_record(record_of: Callable[..., EpisodeRecord]) -> EpisodeRecord:
    return record_of(duration_s=4.0)


def _rows(short_record: EpisodeRecord) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(trajectory_csv(short_record))))


def test_the_columns_are_the_papers():
    expected = "step,timestamp,actor_id,type_id,x,y,z,yaw,vx,vy,speed_mps,is_emv"
    assert ",".join(CSV_COLUMNS) == expected


def test_one_row_per_actor_at_10_hz(short_record):
    rows = _rows(short_record)
    assert len(rows) == 40 * 5
    assert sorted({float(row["timestamp"]) for row in rows})[:3] == [0.0, 0.1, 0.2]
    assert [row["actor_id"] for row in rows[:5]] == ["1", "2", "3", "4", "5"]
    assert [row["is_emv"] for row in rows[:2]] == ["1", "0"]
    assert rows[0]["type_id"] == "vehicle.siren.ambulance"


def test_the_frame_is_carlas(short_record):
    track = short_record.track(2)
    rows = [row for row in _rows(short_record) if row["actor_id"] == "2"]
    for row in rows:
        step = int(row["step"])
        assert float(row["x"]) == pytest.approx(track.x_m[step], abs=1e-4)
        assert float(row["y"]) == pytest.approx(-track.y_m[step], abs=1e-4)
        assert float(row["vy"]) == pytest.approx(-track.vy_mps[step], abs=1e-4)
        assert float(row["yaw"]) == pytest.approx(-np.degrees(track.yaw_rad[step]), abs=1e-3)
        assert float(row["speed_mps"]) == pytest.approx(np.hypot(float(row["vx"]), float(row["vy"])), abs=2e-4)


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(yaw_rad=st.floats(-20.0, 20.0))
def test_yaw_stays_within_half_a_turn(short_record, yaw_rad):
    state = replace(short_record.states[0], yaw_rad=np.full(5, yaw_rad))
    yaw = float(_rows(replace(short_record, states=(state,)))[0]["yaw"])
    assert -180.0 <= yaw <= 180.0
    assert np.cos(np.radians(yaw)) == pytest.approx(np.cos(yaw_rad), abs=1e-5)
    assert np.sin(np.radians(yaw)) == pytest.approx(-np.sin(yaw_rad), abs=1e-5)


@pytest.mark.parametrize("beyond_rad", [0.0, 1e-12, -1e-12, 4e-7, -4e-7])
@pytest.mark.parametrize("turns_rad", [-3.0 * np.pi, -np.pi, np.pi, 3.0 * np.pi])
def test_half_a_turn_is_plus_180_degrees(short_record, turns_rad, beyond_rad):
    state = replace(short_record.states[0], yaw_rad=np.full(5, turns_rad + beyond_rad))
    assert _rows(replace(short_record, states=(state,)))[0]["yaw"] == "180.0000"


@pytest.mark.parametrize(("yaw_rad", "text"), [(-np.pi / 2, "90.0000"), (3.1, "-177.6169"), (-3.1, "177.6169")])
def test_yaw_is_clockwise(short_record, yaw_rad, text):
    state = replace(short_record.states[0], yaw_rad=np.full(5, yaw_rad))
    assert _rows(replace(short_record, states=(state,)))[0]["yaw"] == text


def test_no_negative_zeros(short_record):
    assert "-0.0000" not in trajectory_csv(short_record)


def test_every_class_has_a_type_id():
    assert len({type_id_of(member) for member in ActorClass}) == len(ActorClass)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    """The bag of the record."""
    return write_bag(tmp_path_factory.mktemp("csv") / "bag", duration_s=4.0)


def test_the_export_is_the_record(exported, bag, short_record):
    assert (exported("csv", bag) / "trajectory.csv").read_text(encoding="utf-8") == trajectory_csv(short_record)


def test_the_region_holds_whoever_is_near_the_emv(exported, bag, short_record):
    lines = (exported("csv", bag, "--region") / "trajectory.csv").read_text(encoding="utf-8").splitlines()[1:]
    there = {(int(row[0]), int(row[2])) for row in (line.split(",") for line in lines)}
    members, expected = np.empty(0, dtype=np.uint32), set()
    for state in short_record.states:
        members = region_members(members, state, short_record.emv_ids)
        expected |= {(state.step, key) for key in members.tolist() if state.step % 2 == 0}
    assert there == expected
    assert len(lines) < 40 * 5


def test_pandas_reads_numbers_and_tracks(exported, bag, short_record):
    read = read_with("av2", "read_csv.py", exported("csv", bag) / "trajectory.csv")
    kinds = dict.fromkeys(CSV_COLUMNS, "f") | {"step": "i", "actor_id": "i", "is_emv": "i", "type_id": "O"}
    assert read["types"] == kinds
    assert (read["missing"], read["speed_error_mps"]) == (0, pytest.approx(0.0, abs=2e-4))
    assert list(read["tracks"]) == [str(actor_id) for actor_id in sorted(short_record.actors)]
    for name, read_track in read["tracks"].items():
        track = short_record.track(int(name))
        assert read_track["period_s"] == [0.1]
        assert read_track["is_emv"] == (int(name) in short_record.emv_ids)
        assert read_track["steps"] == track.step[::2].tolist()
        assert read_track["x"] == pytest.approx(track.x_m[::2].tolist(), abs=1e-4)
        assert read_track["y"] == pytest.approx((-track.y_m[::2]).tolist(), abs=1e-4)


DATASET = ("ngsim", "tracked_bag", "--population", "all")
MADE_DATASET = ("ngsim", "made_drive", "--population", "all")
METRES = st.floats(-1e3, 1e3)
Set = tuple[npt.NDArray[np.float64], Any]
STEPS = 2 * 80 + 1
"""81 frames: one whole window, whose present is frame 30."""
RIGHT_Y_M, LEFT_Y_M = -5.25, -1.75
WINDOWS = {EMV: 131 - 80, CAR: 126 - 80, BUS: 129 - 80}
"""Whole windows of 81 frames of each vehicle."""
ROADS = streets()
PRESENT = 50


@pytest.fixture(scope="module")
def stdan(dataset: Path) -> Set:
    content = loadmat(dataset / "stdan" / "TrainSet.mat")
    return content["traj"], content["tracks"]


def history(dataset: Set, row: int, vehicle: int) -> npt.NDArray[np.float64]:
    """Sixteen points relative to the target's present, every second frame."""
    data, cells = dataset
    rows_of_car = cells[int(data[row, 0]) - 1][int(data[row, 1]) - 1].T
    other = cells[int(data[row, 0]) - 1][vehicle - 1].T
    reference = rows_of_car[rows_of_car[:, 0] == data[row, 2]][0, 1:3]
    present = int(np.argwhere(other[:, 0] == data[row, 2]).item())
    points: npt.NDArray[np.float64] = other[present - 30 : present + 1 : 2, 1:3] - reference
    return points


def test_every_whole_window_is_a_sample(stdan, tracked_tracks):
    assert stdan[0].shape == (sum(max(0, len(track) - 80) for track in tracked_tracks), 50)
    assert len(stdan[0]) > 300


def test_histories_are_the_tracks_turned_onto_the_lane(stdan, tracked_tracks):
    emv = tracked_tracks[0]
    row = 10
    points = history(stdan, row, 1) * trajectory_tables.FOOT_M
    assert points.shape == (16, 2)
    present = int(stdan[0][row, 2])
    there = emv.window(present - 30, 31)
    length = np.hypot(there.x_m[-1] - there.x_m[::2], there.y_m[-1] - there.y_m[::2])
    assert np.hypot(*points.T) == pytest.approx(length, abs=1e-6)
    assert abs(points[0, 0]) < 1.0, "the EMV came along its lane"
    assert points[0, 1] < -1.0, "from behind"
    assert stdan[0][row, 5] * trajectory_tables.FOOT_M == pytest.approx(there.speed_mps[-1])


def test_neighbours_stand_in_their_cells(stdan):
    data, _ = stdan
    seen = 0
    for row in range(0, len(data), 7):
        for cell in np.flatnonzero(data[row, 11:]).tolist():
            points = history(stdan, row, int(data[row, 11 + cell]))
            assert points.shape == (16, 2), "a neighbour without all points is left out"
            column, along = divmod(cell, 13)
            assert abs(points[-1, 1]) < 90.0
            assert along == min(12, int(np.floor((points[-1, 1] + 90.0) / 15.0 + 0.5)))
            assert round(points[-1, 0] * trajectory_tables.FOOT_M / 3.5) in {column - 2, column - 1, column}
            seen += 1
    assert seen > 50


def test_the_layout_of_csp_is_the_shorter_one(dataset, stdan):
    content = loadmat(dataset / "csp" / "TrainSet.mat")
    data = content["traj"]
    assert data.shape == (len(stdan[0]), 47)
    assert np.array_equal(data[:, :5], stdan[0][:, :5])
    assert np.array_equal(data[:, 8:], stdan[0][:, 11:])
    assert set(np.unique(data[:, 6])) <= {1.0, 2.0, 3.0}
    assert set(np.unique(data[:, 7])) <= {1.0, 2.0}
    assert content["tracks"][0][0].shape[0] == 3


def test_classes_are_ngsims(stdan):
    kinds = {int(value) for row in stdan[1] for cell in row if cell.size for value in np.unique(cell[6])}
    assert kinds <= {2, 3}


def test_neighbours_are_found_by_lane_distance_and_direction():
    right_m = np.array([3.2, -3.2, 0.4, 0.4, 3.2, 7.0])
    ahead_m = np.array([0.0, 0.0, 30.0 * trajectory_tables.FOOT_M, -30.0 * trajectory_tables.FOOT_M, 0.0, 0.0])
    turned_rad = np.array([0.1, -0.1, 0.0, 0.0, np.pi, 0.0])
    cells = trajectory_tables.neighbour_cells(right_m, ahead_m, turned_rad, np.full(6, 3.2))
    assert cells.tolist() == [26 + 6, 6, 13 + 8, 13 + 4, trajectory_tables.OUTSIDE, trajectory_tables.OUTSIDE]


def test_right_is_positive():
    right, ahead = trajectory_tables.across_and_ahead(1.0, 0.0, np.pi / 2)
    assert (right, ahead) == pytest.approx((1.0, 0.0))
    right, ahead = trajectory_tables.across_and_ahead(1.0, 0.0, 0.0)
    assert (right, ahead) == pytest.approx((0.0, 1.0))


@given(x_m=METRES, y_m=METRES, tangent_rad=st.floats(-10.0, 10.0))
def test_turning_there_and_back_changes_nothing(x_m, y_m, tangent_rad):
    there = trajectory_tables.across_and_ahead(x_m, y_m, tangent_rad)
    assert np.hypot(*there) == pytest.approx(np.hypot(x_m, y_m))
    assert trajectory_tables.from_across_and_ahead(*there, tangent_rad) == pytest.approx((x_m, y_m), abs=1e-9)


def test_off_the_road_a_lane_has_ngsims_width(straight_road_of_two_lanes):
    lanes = straight_road_of_two_lanes.lanes
    widths = trajectory_tables.lane_widths_m(straight_road_of_two_lanes, np.array([0, NO_LANE], dtype=np.int32))
    assert widths.tolist() == [lanes[0].width_m, 3.5]


def test_the_same_content_gives_the_same_file():
    content = {"traj": np.eye(3)}
    assert trajectory_tables.mat_bytes(content) == trajectory_tables.mat_bytes(content)
    assert trajectory_tables.mat_bytes(content).startswith(b"MATLAB 5.0 MAT-file, written by SIREN")


def record(network: RoadNetwork, accel_mps2: float = 0.0) -> EpisodeRecord:
    """The target in the right lane, a bus 20 m ahead of it, a car to its left, one that comes late, one far away."""
    return record_with(
        {
            3: moving(40.0, RIGHT_Y_M, 10.0, accel_mps2=accel_mps2, steps=STEPS),
            4: moving(60.0, RIGHT_Y_M, 10.0, steps=STEPS, actor_class=ActorClass.BUS),
            5: moving(30.0, LEFT_Y_M, 10.0, steps=STEPS),
            6: moving(45.0, LEFT_Y_M, 10.0, steps=STEPS - 20, first_step=20),
            7: moving(240.0, RIGHT_Y_M, 10.0, steps=STEPS),
        },
        network,
    )


def exported(folder: Path, *records: EpisodeRecord) -> Path:
    """The data sets of episodes that train, in a folder."""
    exporter, parts = trajectory_tables.NgsimExporter("all"), []
    for number, episode in enumerate(records):
        source = cast("EpisodeSource", SimpleNamespace(record=lambda episode=episode: episode))
        part = folder / f"part{number}"
        part.mkdir()
        with FileWriter(part) as files:
            report = exporter.write_episode(source, f"episode{number}", files)
        parts.append(EpisodePart(f"episode{number}", number, "train", part, report))
    exporter.assemble(parts, folder)
    return folder


def sample(folder: Path, network: RoadNetwork, accel_mps2: float = 0.0) -> tuple[np.ndarray, list[np.ndarray]]:
    """Row and tracks of the first sample, without the number of its data set."""
    data, tracks = read(exported(folder, record(network, accel_mps2)), "stdan", "TrainSet.mat")
    return data[0, 1:], [track for track in tracks[0] if track.size]


def test_the_row_has_the_target_at_its_origin(straight_road_of_two_lanes, tmp_path):
    row, _ = sample(tmp_path, straight_road_of_two_lanes)
    vehicle, frame, x, y, speed, accel, lane, kind, lateral, longitudinal = row[:10]
    assert (vehicle, frame, x, y) == (1.0, 30.0, 0.0, 0.0)
    assert speed == pytest.approx(10.0 / trajectory_tables.FOOT_M)
    assert (accel, lane, kind) == (0.0, 2.0, 2.0)
    assert (lateral, longitudinal) == (trajectory_tables.KEEP, trajectory_tables.NORMAL)


def test_neighbours_are_in_the_cells_where_they_are(straight_road_of_two_lanes, tmp_path):
    """20 m are 65.6 ft: the cell of 155.6 / 15 from behind; 10 m behind in the lane to the left: that of 57.2 / 15."""
    cells = sample(tmp_path, straight_road_of_two_lanes)[0][10:]
    taken = {int(cell): int(cells[cell]) for cell in np.flatnonzero(cells)}
    ahead, behind = (
        trajectory_tables.CELLS_ALONG + round((20.0 / trajectory_tables.FOOT_M + 90.0) / 15.0),
        round((-10.0 / trajectory_tables.FOOT_M + 90.0) / 15.0),
    )
    assert taken == {ahead: 2, behind: 3}


def test_tracks_are_turned_so_that_ahead_is_y(straight_road_of_two_lanes, tmp_path):
    """Frames 0 to 80; the target is at the origin at frame 30."""
    _, (target, bus, left) = sample(tmp_path, straight_road_of_two_lanes)
    frames = np.arange(81)
    assert target[0].tolist() == bus[0].tolist() == frames.tolist()
    assert target[1] == pytest.approx(np.zeros(81), abs=1e-9)
    assert target[2] == pytest.approx((frames - 30) * 1.0 / trajectory_tables.FOOT_M)
    assert bus[2] == pytest.approx(((frames - 30) * 1.0 + 20.0) / trajectory_tables.FOOT_M)
    assert left[1] == pytest.approx(np.full(81, -3.5 / trajectory_tables.FOOT_M)), "to the left is negative"
    assert left[2] == pytest.approx(((frames - 30) * 1.0 - 10.0) / trajectory_tables.FOOT_M)
    assert (set(bus[6].tolist()), set(left[6].tolist())) == ({3.0}, {2.0})
    assert (set(target[5].tolist()), set(left[5].tolist())) == ({2.0}, {1.0})
    assert bus[3] == pytest.approx(np.full(81, 10.0 / trajectory_tables.FOOT_M))


def test_who_gains_speed_accelerates(straight_road_of_two_lanes, tmp_path):
    row, _ = sample(tmp_path, straight_road_of_two_lanes, accel_mps2=1.0)
    assert row[9] == trajectory_tables.ACCELERATE
    assert row[5] == pytest.approx(1.0 / trajectory_tables.FOOT_M)
    assert row[4] == pytest.approx(13.0 / trajectory_tables.FOOT_M)


def test_cells_of_vehicles_that_are_not_there_are_empty(straight_road_of_two_lanes, tmp_path):
    """The bus and the car beside are 30 m apart, so each has one neighbour; the vehicle far ahead has none."""
    dataset = exported(tmp_path, record(straight_road_of_two_lanes))
    whole, tracks = (read(dataset, layout, "TrainSet.mat")[1] for layout in ("stdan", "csp"))
    assert whole.shape == tracks.shape == (4, 3)
    there = [[True, True, True], [True, True, False], [True, True, False], [True, False, False]]
    for layout, height in ((whole, 7), (tracks, 3)):
        assert [[track.shape == (height, 81) for track in row] for row in layout] == there
        assert [[track.shape != (0, 0) for track in row] for row in layout] == there
    assert tracks[0, 1].tolist() == whole[0, 1][:3].tolist()
    assert read(dataset, "csp", "ValSet.mat")[1].shape == (0, 0)


def read(dataset: Path, layout: str, name: str) -> tuple[Any, Any]:
    content = loadmat(dataset / layout / name)
    return content["traj"], content["tracks"]


def test_a_row_for_each_window_and_a_data_set_for_each_row(made_dataset):
    data, tracks = read(made_dataset, "stdan", "TrainSet.mat")
    assert data.shape == (sum(WINDOWS.values()), 50)
    assert data[:, 0].tolist() == list(range(1, len(data) + 1))
    assert len(tracks) == len(data)
    assert set(data[:, 1].tolist()) == {1.0}
    for name in ("ValSet.mat", "TestSet.mat"):
        assert read(made_dataset, "stdan", name)[0].shape == (0, 50)
        assert read(made_dataset, "csp", name)[0].shape == (0, 47)
    card = json.loads((made_dataset / "dataset.json").read_text())
    assert card["counts"] == {"samples": len(data)}
    assert card["classes"]["keep"] == len(data)


def test_columns_of_both_layouts(made_dataset):
    """The EMV's third window: its present is frame 32, the bus is 20 m − 3.2 m ahead in the lane to the left."""
    data, tracks = read(made_dataset, "stdan", "TrainSet.mat")
    row = data[2]
    assert row[2] == 32.0
    assert row[3:7] == pytest.approx([0.0, 0.0, 10.0 / trajectory_tables.FOOT_M, 0.0])
    assert row[7:11].tolist() == [2.0, 2.0, 1.0, 1.0], "right lane, a car, keeps lane and speed"
    ahead_ft = {
        BUS: (20.0 - 3.2) / trajectory_tables.FOOT_M,
        CAR: (60.0 + 6.0 * 2.7 + 0.1 * 2.7**2 - 52.0) / trajectory_tables.FOOT_M,
    }
    cells = {int(cell): int(row[11 + cell]) for cell in np.flatnonzero(row[11:]).tolist()}
    column = {BUS: 0, CAR: 1}
    near = {key for key, value in ahead_ft.items() if value < 90.0 and key != CAR}
    assert cells == {13 * column[key] + round((ahead_ft[key] + 90.0) / 15.0): 2 for key in near}
    bus = tracks[2][1]
    assert bus[0].tolist() == list(range(2, 83))
    assert bus[1] == pytest.approx(np.full(81, -3.5 / trajectory_tables.FOOT_M)), "to the left is negative"
    assert bus[2] == pytest.approx((20.0 + 0.9 * bus[0] - 1.0 * 32.0) / trajectory_tables.FOOT_M)
    assert set(bus[6].tolist()) == {3.0}
    short, short_tracks = read(made_dataset, "csp", "TrainSet.mat")
    assert np.array_equal(short, np.delete(data, [5, 6, 8], axis=1))
    assert np.array_equal(short_tracks[2][1], bus[:3])


def test_who_gains_speed_is_no_class_of_the_shorter_layout(made_dataset):
    """The car's mean speed of the next 5 s is at most 1.12 times that of the last 3 s."""
    data, _ = read(made_dataset, "stdan", "TrainSet.mat")
    rows_of_car = slice(WINDOWS[EMV], WINDOWS[EMV] + WINDOWS[CAR])
    assert data[rows_of_car, 2].tolist() == list(range(35, 35 + WINDOWS[CAR]))
    assert data[rows_of_car, 6] == pytest.approx(np.full(WINDOWS[CAR], 0.2 / trajectory_tables.FOOT_M))
    assert set(data[rows_of_car, 10].tolist()) == {1.0}


def test_lanes_are_numbered_from_the_left():
    numbers = trajectory_tables.lane_numbers(ROADS)
    assert [numbers[lane] for lane in (A_LEFT, A_RIGHT, B_LEFT, B_RIGHT, NEAR)] == [1, 2, 1, 2, 1]


@pytest.mark.parametrize(
    ("lanes", "to_the_right"),
    [
        ((A_LEFT, A_RIGHT, A_RIGHT, A_LEFT), [0, 1, 1, 0]),
        ((A_RIGHT, A_LEFT, A_LEFT), [0, -1, -1]),
        ((A_RIGHT, B_LEFT, B_LEFT), [0, 0, 0]),
        ((A_LEFT, NO_LANE, A_RIGHT, A_LEFT), [0, 0, 0, -1]),
        ((A_LEFT, A_RIGHT, B_RIGHT, B_LEFT), [0, 1, 1, 0]),
    ],
)
def test_changes_of_one_road_count_to_the_right(lanes, to_the_right):
    numbers = {**trajectory_tables.lane_numbers(ROADS), NO_LANE: 0}
    there = np.array([numbers[lane] for lane in lanes], dtype=np.int64)
    assert trajectory_tables.lanes_to_the_right(ROADS, np.array(lanes, dtype=np.int32), there).tolist() == to_the_right


@pytest.mark.parametrize(("change", "turn"), [(1.0, trajectory_tables.RIGHT), (-1.0, trajectory_tables.LEFT)])
@pytest.mark.parametrize(
    ("at", "seen"), [(PRESENT - 40, False), (PRESENT - 39, True), (PRESENT + 40, True), (PRESENT + 41, False)]
)
def test_a_change_within_4_s_before_or_after_is_a_manoeuvre(change, turn, at, seen):
    lanes = np.where(np.arange(120) >= at, 5.0 + change, 5.0)
    assert trajectory_tables.lateral_class(lanes, PRESENT) == (turn if seen else trajectory_tables.KEEP)


@pytest.mark.parametrize(
    ("past", "coming", "kind"),
    [
        (10.0, 7.9, trajectory_tables.BRAKE),
        (10.0, 8.1, trajectory_tables.NORMAL),
        (10.0, 10.0, trajectory_tables.NORMAL),
        (10.0, 12.4, trajectory_tables.NORMAL),
        (10.0, 12.6, trajectory_tables.ACCELERATE),
        (0.0, 1.0, trajectory_tables.ACCELERATE),
        (0.0, 0.0, trajectory_tables.NORMAL),
    ],
)
def test_who_is_slower_or_faster_by_a_fifth_brakes_or_accelerates(past, coming, kind):
    """Mean speeds in feet a frame of the 3 s before and the 5 s after, which differ in length."""
    frame = np.arange(-30.0, 51.0)
    assert trajectory_tables.longitudinal_class(np.where(frame < 0.0, past * frame, coming * frame), 30) == kind
    assert (
        trajectory_tables.longitudinal_class(np.where(frame < 0.0, past * frame, coming * frame)[30:], 0)
        == trajectory_tables.NORMAL
    )


@pytest.mark.parametrize(
    ("lane", "ahead_ft", "cell"),
    [
        (0.0, 10.0, 13 + 7),
        (0.0, -10.0, 13 + 5),
        (0.0, 7.0, 13 + 6),
        (0.0, 7.4, 13 + 6),
        (0.0, 7.5, 13 + 7),
        (-1.0, -89.0, 0),
        (-1.0, 0.0, 6),
        (1.0, 0.0, 26 + 6),
        (1.0, 89.9, 26 + 12),
        (1.0, -89.9, 26),
        (1.0, 90.0, trajectory_tables.OUTSIDE),
        (1.0, -90.0, trajectory_tables.OUTSIDE),
        (2.0, 0.0, trajectory_tables.OUTSIDE),
        (-2.0, 0.0, trajectory_tables.OUTSIDE),
        (0.0, 0.0, trajectory_tables.OUTSIDE),
    ],
)
def test_cells_are_15_feet_long_and_a_lane_wide(lane, ahead_ft, cell):
    assert trajectory_tables.grid_cells(np.array([lane]), np.array([ahead_ft])).tolist() == [cell]


def test_trucks_are_those_that_are_as_long():
    trucks = {kind for kind in ActorClass if trajectory_tables.vehicle_class(kind) == 3}
    assert trucks == {ActorClass.TRUCK, ActorClass.BUS, ActorClass.FIRE_TRUCK}
    assert {kind for kind in ActorClass if trajectory_tables.vehicle_class(kind) == 1} == TWO_WHEELED
    assert {trajectory_tables.vehicle_class(kind) for kind in ActorClass} == {1, 2, 3}
