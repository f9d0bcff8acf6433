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
from scipy.io import loadmat

from siren_ros.data.datasets import trajectory_tables
from siren_ros.data.datasets.files import FileWriter
from siren_ros.data.datasets.formats import EpisodePart
from siren_ros.data.datasets.trajectory_tables import CSV_HEAD, FOOT_M, LOG_PERIOD_STEPS, lines_of_step
from siren_ros.data.episode_source import EpisodeSource
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.simulation.roads.road_network import NO_LANE
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


def test_one_row_per_actor_at_10_hz_in_carlas_frame(short_record):
    text = trajectory_csv(short_record)
    assert text.startswith("step,timestamp,actor_id,type_id,x,y,z,yaw,vx,vy,speed_mps,is_emv\n")
    assert "-0.0000" not in text, "no negative zeros"
    rows, track = _rows(short_record), short_record.track(2)
    assert len(rows) == 40 * 5
    assert sorted({float(row["timestamp"]) for row in rows})[:3] == [0.0, 0.1, 0.2]
    assert [row["actor_id"] for row in rows[:5]] == ["1", "2", "3", "4", "5"]
    assert [row["is_emv"] for row in rows[:2]] == ["1", "0"]
    assert rows[0]["type_id"] == "vehicle.siren.ambulance"
    for row in rows[1::5]:
        step = int(row["step"])
        assert float(row["x"]) == pytest.approx(track.x_m[step], abs=1e-4)
        assert float(row["y"]) == pytest.approx(-track.y_m[step], abs=1e-4)
        assert float(row["vy"]) == pytest.approx(-track.vy_mps[step], abs=1e-4)
        assert float(row["yaw"]) == pytest.approx(-np.degrees(track.yaw_rad[step]), abs=1e-3)
        assert float(row["speed_mps"]) == pytest.approx(np.hypot(float(row["vx"]), float(row["vy"])), abs=2e-4)


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(yaw_rad=st.floats(-20.0, 20.0))
def test_yaw_stays_within_half_a_turn(short_record, yaw_rad):
    state = replace(short_record.states[0], yaw_rad=np.full(5, yaw_rad))
    yaw = float(_rows(replace(short_record, states=(state,)))[0]["yaw"])
    assert -180.0 <= yaw <= 180.0
    assert np.cos(np.radians(yaw)) == pytest.approx(np.cos(yaw_rad), abs=1e-5)
    assert np.sin(np.radians(yaw)) == pytest.approx(-np.sin(yaw_rad), abs=1e-5)


@pytest.mark.parametrize("beyond_rad", [0.0, 1e-12, -1e-12, 4e-7, -4e-7])
def test_half_a_turn_is_plus_180_degrees(short_record, beyond_rad):
    for turns_rad in (-3.0 * np.pi, -np.pi, np.pi, 3.0 * np.pi):
        state = replace(short_record.states[0], yaw_rad=np.full(5, turns_rad + beyond_rad))
        assert _rows(replace(short_record, states=(state,)))[0]["yaw"] == "180.0000"


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


def test_histories_are_the_tracks_turned_onto_the_lane(stdan, tracked_tracks):
    emv = tracked_tracks[0]
    row = 10
    points = history(stdan, row, 1) * FOOT_M
    assert points.shape == (16, 2)
    present = int(stdan[0][row, 2])
    there = emv.window(present - 30, 31)
    length = np.hypot(there.x_m[-1] - there.x_m[::2], there.y_m[-1] - there.y_m[::2])
    assert np.hypot(*points.T) == pytest.approx(length, abs=1e-6)
    assert abs(points[0, 0]) < 1.0, "the EMV came along its lane"
    assert points[0, 1] < -1.0, "from behind"
    assert stdan[0][row, 5] * FOOT_M == pytest.approx(there.speed_mps[-1])


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
            assert round(points[-1, 0] * FOOT_M / 3.5) in {column - 2, column - 1, column}
            seen += 1
    assert seen > 50


def test_neighbours_are_found_by_lane_distance_and_direction():
    right_m = np.array([3.2, -3.2, 0.4, 0.4, 3.2, 7.0])
    ahead_m = np.array([0.0, 0.0, 30.0 * FOOT_M, -30.0 * FOOT_M, 0.0, 0.0])
    turned_rad = np.array([0.1, -0.1, 0.0, 0.0, np.pi, 0.0])
    cells = trajectory_tables.neighbour_cells(right_m, ahead_m, turned_rad, np.full(6, 3.2))
    assert cells.tolist() == [26 + 6, 6, 13 + 8, 13 + 4, trajectory_tables.OUTSIDE, trajectory_tables.OUTSIDE]


@given(x_m=METRES, y_m=METRES, tangent_rad=st.floats(-10.0, 10.0))
def test_turning_there_and_back_changes_nothing(x_m, y_m, tangent_rad):
    assert trajectory_tables.across_and_ahead(1.0, 0.0, np.pi / 2) == pytest.approx((1.0, 0.0)), "right is positive"
    there = trajectory_tables.across_and_ahead(x_m, y_m, tangent_rad)
    assert np.hypot(*there) == pytest.approx(np.hypot(x_m, y_m))
    assert trajectory_tables.from_across_and_ahead(*there, tangent_rad) == pytest.approx((x_m, y_m), abs=1e-9)


def test_off_the_road_a_lane_has_ngsims_width(straight_road_of_two_lanes):
    lanes = straight_road_of_two_lanes.lanes
    widths = trajectory_tables.lane_widths_m(straight_road_of_two_lanes, np.array([0, NO_LANE], dtype=np.int32))
    assert widths.tolist() == [lanes[0].width_m, 3.5]


def exported(folder: Path, record: EpisodeRecord) -> Path:
    """The data set of an episode that trains, in a folder."""
    exporter, part = trajectory_tables.NgsimExporter("all"), folder / "part"
    part.mkdir()
    with FileWriter(part) as files:
        source = cast("EpisodeSource", SimpleNamespace(record=lambda: record))
        report = exporter.write_episode(source, "episode", files)
    exporter.assemble([EpisodePart("episode", 0, "train", part, report)], folder)
    return folder


def test_the_tracks_of_a_sample_are_turned_so_that_ahead_is_y(straight_road_of_two_lanes, tmp_path):
    """The target is at the origin at frame 30; bus and car to the left are 30 m apart, one comes late, one is far."""
    tracks = {
        3: moving(40.0, RIGHT_Y_M, 10.0, accel_mps2=1.0, steps=STEPS),
        4: moving(60.0, RIGHT_Y_M, 10.0, steps=STEPS, actor_class=ActorClass.BUS),
        5: moving(30.0, LEFT_Y_M, 10.0, steps=STEPS),
        6: moving(45.0, LEFT_Y_M, 10.0, steps=STEPS - 20, first_step=20),
        7: moving(240.0, RIGHT_Y_M, 10.0, steps=STEPS),
    }
    dataset = exported(tmp_path, record_with(tracks, straight_road_of_two_lanes))
    data, whole = read(dataset, "stdan", "TrainSet.mat")
    assert (dataset / "stdan" / "TrainSet.mat").read_bytes().startswith(b"MATLAB 5.0 MAT-file, written by SIREN")
    assert data[0, :5].tolist() == [1.0, 1.0, 30.0, 0.0, 0.0]
    assert data[0, 5:11] * [FOOT_M, FOOT_M, 1, 1, 1, 1] == pytest.approx([13.0, 1.0, 2.0, 2.0, 1.0, 3.0])
    # The bus is 15.5 m ahead, in the cell of (50.9 + 90) / 15 from behind; the car to the left is 14.5 m behind.
    assert {int(cell): int(data[0, 11 + cell]) for cell in np.flatnonzero(data[0, 11:])} == {13 + 9: 2, 3: 3}
    target, bus, left = whole[0]
    time_s = 0.1 * np.arange(81)
    way_m = 10.0 * time_s + 0.5 * time_s**2 - 34.5
    assert target[0].tolist() == bus[0].tolist() == list(range(81))
    assert target[1] == pytest.approx(np.zeros(81), abs=1e-9)
    assert target[2] * FOOT_M == pytest.approx(way_m)
    assert bus[2] * FOOT_M == pytest.approx(20.0 + 10.0 * time_s - 34.5)
    assert left[1] * FOOT_M == pytest.approx(np.full(81, -3.5)), "to the left is negative"
    assert bus[3] * FOOT_M == pytest.approx(np.full(81, 10.0))
    assert [set(track[5].tolist()) for track in (target, left)] == [{2.0}, {1.0}]
    assert [set(track[6].tolist()) for track in (bus, left)] == [{3.0}, {2.0}]
    short, tracks = read(dataset, "csp", "TrainSet.mat")
    plain = np.delete(data, [5, 6, 8], axis=1)
    assert plain[0, 7] == trajectory_tables.ACCELERATE
    plain[:, 7] = trajectory_tables.NORMAL  # who gains speed is no class there
    assert np.array_equal(short, plain)
    assert np.array_equal(tracks[0, 1], whole[0, 1][:3])
    assert whole.shape == tracks.shape == (4, 3)
    there = [[True, True, True], [True, True, False], [True, True, False], [True, False, False]]
    for layout, height in ((whole, 7), (tracks, 3)):
        assert [[track.shape == (height, 81) for track in row] for row in layout] == there
        assert [[track.shape != (0, 0) for track in row] for row in layout] == there
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
    ("kind", "means"),
    [
        (trajectory_tables.BRAKE, [(10.0, 7.9)]),
        (trajectory_tables.NORMAL, [(10.0, 8.1), (10.0, 10.0), (10.0, 12.4), (0.0, 0.0)]),
        (trajectory_tables.ACCELERATE, [(10.0, 12.6), (0.0, 1.0)]),
    ],
)
def test_who_is_slower_or_faster_by_a_fifth_brakes_or_accelerates(kind, means):
    """Mean speeds in feet a frame of the 3 s before and the 5 s after, which differ in length."""
    frame = np.arange(-30.0, 51.0)
    for past, coming in means:
        ahead_ft = np.where(frame < 0.0, past * frame, coming * frame)
        assert trajectory_tables.longitudinal_class(ahead_ft, 30) == kind
        assert trajectory_tables.longitudinal_class(ahead_ft[30:], 0) == trajectory_tables.NORMAL


def test_cells_are_15_feet_long_and_a_lane_wide():
    ahead_ft = {
        -2.0: [0.0],
        -1.0: [-89.0, 0.0],
        0.0: [10.0, -10.0, 7.0, 7.4, 7.5, 0.0],
        1.0: [0.0, 89.9, -89.9, 90.0, -90.0],
        2.0: [0.0],
    }
    lanes = np.repeat(list(ahead_ft), list(map(len, ahead_ft.values())))
    cells = trajectory_tables.grid_cells(lanes, np.concatenate(list(ahead_ft.values()))).tolist()
    out = trajectory_tables.OUTSIDE
    assert cells == [out, 0, 6, 13 + 7, 13 + 5, 13 + 6, 13 + 6, 13 + 7, out, 26 + 6, 26 + 12, 26, out, out, out]


def test_trucks_are_those_that_are_as_long():
    trucks = {kind for kind in ActorClass if trajectory_tables.vehicle_class(kind) == 3}
    assert trucks == {ActorClass.TRUCK, ActorClass.BUS, ActorClass.FIRE_TRUCK}
    assert {kind for kind in ActorClass if trajectory_tables.vehicle_class(kind) == 1} == TWO_WHEELED
    assert {trajectory_tables.vehicle_class(kind) for kind in ActorClass} == {1, 2, 3}
