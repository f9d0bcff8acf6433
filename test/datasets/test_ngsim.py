"""NGSIM files of formulas and of a recorded episode, read by the rules of the published loaders."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from datasets.made_bag import BUS, CAR, EMV, Export
from evaluation.made_records import moving, record_with
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import loadmat

from siren_ros.datasets.ngsim import NgsimExporter, _cells, _on_road, _Sample, mat_bytes
from siren_ros.datasets.ngsim_frame import (
    ACCELERATE,
    CELLS_ALONG,
    FOOT_M,
    KEEP,
    NORMAL,
    OUTSIDE,
    across_and_ahead,
    from_across_and_ahead,
    grid_cells,
    lane_widths_m,
    lanes_to_the_right,
    lateral_class,
    longitudinal_class,
    neighbour_cells,
    vehicle_class,
)
from siren_ros.record.episode_source import open_source
from siren_ros.record.tracks import Track, tracks_of
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.world.actors import ActorClass

METRES = st.floats(-1e3, 1e3)
Set = tuple[npt.NDArray[np.float64], Any]
STEPS = 2 * 80 + 1
"""81 frames: one whole window, whose present is frame 30."""
RIGHT_Y_M, LEFT_Y_M = -5.25, -1.75
WINDOWS = {EMV: 131 - 80, CAR: 126 - 80, BUS: 129 - 80}
"""Whole windows of 81 frames of each vehicle."""


@pytest.fixture(scope="module")
def dataset(exported: Export, tracked_bag: Path) -> Path:
    return exported("ngsim", tracked_bag, "--population", "all")


@pytest.fixture(scope="module")
def tracks(tracked_bag: Path) -> tuple[Track, ...]:
    with open_source(tracked_bag) as source:
        return tracks_of(source.record())


@pytest.fixture(scope="module")
def stdan(dataset: Path) -> Set:
    content = loadmat(dataset / "stdan" / "TrainSet.mat")
    return content["traj"], content["tracks"]


def history(found: Set, row: int, vehicle: int) -> npt.NDArray[np.float64]:
    """Sixteen points relative to the target's present, every second frame."""
    data, cells = found
    own = cells[int(data[row, 0]) - 1][int(data[row, 1]) - 1].T
    other = cells[int(data[row, 0]) - 1][vehicle - 1].T
    reference = own[own[:, 0] == data[row, 2]][0, 1:3]
    present = int(np.argwhere(other[:, 0] == data[row, 2]).item())
    points: npt.NDArray[np.float64] = other[present - 30 : present + 1 : 2, 1:3] - reference
    return points


def test_every_whole_window_is_a_sample(stdan: Set, tracks: tuple[Track, ...]) -> None:
    assert stdan[0].shape == (sum(max(0, len(track) - 80) for track in tracks), 50)
    assert len(stdan[0]) > 300


def test_histories_are_the_tracks_turned_onto_the_lane(stdan: Set, tracks: tuple[Track, ...]) -> None:
    emv = tracks[0]
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


def test_neighbours_stand_in_their_cells(stdan: Set) -> None:
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


def test_the_layout_of_csp_is_the_shorter_one(dataset: Path, stdan: Set) -> None:
    content = loadmat(dataset / "csp" / "TrainSet.mat")
    data = content["traj"]
    assert data.shape == (len(stdan[0]), 47)
    assert np.array_equal(data[:, :5], stdan[0][:, :5])
    assert np.array_equal(data[:, 8:], stdan[0][:, 11:])
    assert set(np.unique(data[:, 6])) <= {1.0, 2.0, 3.0}
    assert set(np.unique(data[:, 7])) <= {1.0, 2.0}
    assert content["tracks"][0][0].shape[0] == 3


def test_classes_are_ngsims(stdan: Set) -> None:
    kinds = {int(value) for row in stdan[1] for cell in row if cell.size for value in np.unique(cell[6])}
    assert kinds <= {2, 3}


def test_the_grid_is_the_published_one() -> None:
    expected = [
        (-1, -89.0, 0),
        (-1, 0.0, 6),
        (0, 7.5, 20),
        (0, 7.4, 19),
        (0, 0.0, OUTSIDE),
        (1, 89.9, 38),
        (1, 90.0, OUTSIDE),
        (2, 0.0, OUTSIDE),
    ]
    lane, ahead_ft, cell = np.array(expected).T
    assert grid_cells(lane, ahead_ft).tolist() == cell.tolist()


def test_neighbours_are_found_by_lane_distance_and_direction() -> None:
    right_m = np.array([3.2, -3.2, 0.4, 0.4, 3.2, 7.0])
    ahead_m = np.array([0.0, 0.0, 30.0 * FOOT_M, -30.0 * FOOT_M, 0.0, 0.0])
    turned_rad = np.array([0.1, -0.1, 0.0, 0.0, np.pi, 0.0])
    cells = neighbour_cells(right_m, ahead_m, turned_rad, np.full(6, 3.2))
    assert cells.tolist() == [26 + 6, 6, 13 + 8, 13 + 4, OUTSIDE, OUTSIDE]


def test_right_is_positive() -> None:
    right, ahead = across_and_ahead(1.0, 0.0, np.pi / 2)
    assert (right, ahead) == pytest.approx((1.0, 0.0))
    right, ahead = across_and_ahead(1.0, 0.0, 0.0)
    assert (right, ahead) == pytest.approx((0.0, 1.0))


@given(x_m=METRES, y_m=METRES, tangent_rad=st.floats(-10.0, 10.0))
def test_turning_there_and_back_changes_nothing(x_m: float, y_m: float, tangent_rad: float) -> None:
    there = across_and_ahead(x_m, y_m, tangent_rad)
    assert np.hypot(*there) == pytest.approx(np.hypot(x_m, y_m))
    assert from_across_and_ahead(*there, tangent_rad) == pytest.approx((x_m, y_m), abs=1e-9)


def test_classes_of_vehicles() -> None:
    assert vehicle_class(ActorClass.AMBULANCE) == 2
    assert vehicle_class(ActorClass.FIRE_TRUCK) == 3


def test_off_the_road_a_lane_has_ngsims_width(straight_road_of_two_lanes: RoadNetwork) -> None:
    lanes = straight_road_of_two_lanes.lanes
    widths = lane_widths_m(straight_road_of_two_lanes, np.array([0, NO_LANE], dtype=np.int32))
    assert widths.tolist() == [lanes[0].width_m, 3.5]


def test_manoeuvres_are_named_by_what_the_lanes_do() -> None:
    changing = np.array([0] * 60 + [1] * 60)
    assert [lateral_class(changing, present) for present in (10, 59, 60, 110)] == [1, 3, 3, 1]
    assert lateral_class(-changing, 59) == 2
    steady = np.arange(120, dtype=float)
    assert longitudinal_class(steady, 50) == 1
    braking = np.concatenate((np.arange(60.0), 59.0 + 0.5 * np.arange(60)))
    assert longitudinal_class(braking, 59) == 2
    assert longitudinal_class(-braking[::-1], 59) == 3


def test_only_changes_on_one_road_count(straight_road_of_two_lanes: RoadNetwork) -> None:
    network = straight_road_of_two_lanes
    east = network.edge_by_id["east"].lanes
    west = network.edge_by_id["west"].lanes
    lanes = np.array([east[0], east[1], east[1], west[0], west[0]], dtype=np.int32)
    numbers = np.array([2, 1, 1, 2, 2])
    assert lanes_to_the_right(network, lanes, numbers).tolist() == [0, -1, -1, -1, -1]


def test_the_same_content_gives_the_same_file() -> None:
    content = {"traj": np.eye(3)}
    assert mat_bytes(content) == mat_bytes(content)
    assert mat_bytes(content).startswith(b"MATLAB 5.0 MAT-file, written by SIREN")


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


def sample(network: RoadNetwork, accel_mps2: float = 0.0) -> _Sample:
    made = record(network, accel_mps2)
    roads = [_on_road(made, track) for track in tracks_of(made)]
    return next(iter(NgsimExporter("all")._samples(made, roads)))


def test_the_row_has_the_target_at_its_origin(straight_road_of_two_lanes: RoadNetwork) -> None:
    row = sample(straight_road_of_two_lanes).row
    vehicle, frame, x, y, speed, accel, lane, kind, lateral, longitudinal = row[:10]
    assert (vehicle, frame, x, y) == (1.0, 30.0, 0.0, 0.0)
    assert speed == pytest.approx(10.0 / FOOT_M)
    assert (accel, lane, kind) == (0.0, 2.0, 2.0)
    assert (lateral, longitudinal) == (KEEP, NORMAL)


def test_neighbours_are_in_the_cells_where_they_are(straight_road_of_two_lanes: RoadNetwork) -> None:
    """20 m are 65.6 ft: the cell of 155.6 / 15 from behind; 10 m behind in the lane to the left: that of 57.2 / 15."""
    cells = sample(straight_road_of_two_lanes).row[10:]
    taken = {int(cell): int(cells[cell]) for cell in np.flatnonzero(cells)}
    ahead, behind = CELLS_ALONG + round((20.0 / FOOT_M + 90.0) / 15.0), round((-10.0 / FOOT_M + 90.0) / 15.0)
    assert taken == {ahead: 2, behind: 3}


def test_tracks_are_turned_so_that_ahead_is_y(straight_road_of_two_lanes: RoadNetwork) -> None:
    """Frames 0 to 80; the target is at the origin at frame 30."""
    target, bus, left = sample(straight_road_of_two_lanes).tracks
    frames = np.arange(81)
    assert target[0].tolist() == bus[0].tolist() == frames.tolist()
    assert target[1] == pytest.approx(np.zeros(81), abs=1e-9)
    assert target[2] == pytest.approx((frames - 30) * 1.0 / FOOT_M)
    assert bus[2] == pytest.approx(((frames - 30) * 1.0 + 20.0) / FOOT_M)
    assert left[1] == pytest.approx(np.full(81, -3.5 / FOOT_M)), "to the left is negative"
    assert left[2] == pytest.approx(((frames - 30) * 1.0 - 10.0) / FOOT_M)
    assert (set(bus[6].tolist()), set(left[6].tolist())) == ({3.0}, {2.0})
    assert (set(target[5].tolist()), set(left[5].tolist())) == ({2.0}, {1.0})
    assert bus[3] == pytest.approx(np.full(81, 10.0 / FOOT_M))


def test_who_gains_speed_accelerates(straight_road_of_two_lanes: RoadNetwork) -> None:
    found = sample(straight_road_of_two_lanes, accel_mps2=1.0)
    assert found.row[9] == ACCELERATE
    assert found.row[5] == pytest.approx(1.0 / FOOT_M)
    assert found.row[4] == pytest.approx(13.0 / FOOT_M)


def test_cells_of_vehicles_that_are_not_there_are_empty() -> None:
    track = np.arange(14.0).reshape(7, 2)
    cells = _cells([[track, track], [track]], 3)
    assert cells.shape == (2, 2)
    assert cells[0, 1].tolist() == track[:3].tolist()
    assert cells[1, 1].shape == (0, 0)
    assert _cells([], 3).shape == (0, 0)


@pytest.fixture(scope="module")
def made_dataset(exported: Export, made_drive: Path) -> Path:
    return exported("ngsim", made_drive, "--population", "all")


def read(dataset: Path, layout: str, name: str) -> tuple[Any, Any]:
    content = loadmat(dataset / layout / name)
    return content["traj"], content["tracks"]


def test_a_row_for_each_window_and_a_data_set_for_each_row(made_dataset: Path) -> None:
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


def test_columns_of_both_layouts(made_dataset: Path) -> None:
    """The EMV's third window: its present is frame 32, the bus is 20 m − 3.2 m ahead in the lane to the left."""
    data, tracks = read(made_dataset, "stdan", "TrainSet.mat")
    row = data[2]
    assert row[2] == 32.0
    assert row[3:7] == pytest.approx([0.0, 0.0, 10.0 / FOOT_M, 0.0])
    assert row[7:11].tolist() == [2.0, 2.0, 1.0, 1.0], "right lane, a car, keeps lane and speed"
    ahead_ft = {BUS: (20.0 - 3.2) / FOOT_M, CAR: (60.0 + 6.0 * 2.7 + 0.1 * 2.7**2 - 52.0) / FOOT_M}
    cells = {int(cell): int(row[11 + cell]) for cell in np.flatnonzero(row[11:]).tolist()}
    column = {BUS: 0, CAR: 1}
    near = {key for key, value in ahead_ft.items() if value < 90.0 and key != CAR}
    assert cells == {13 * column[key] + round((ahead_ft[key] + 90.0) / 15.0): 2 for key in near}
    bus = tracks[2][1]
    assert bus[0].tolist() == list(range(2, 83))
    assert bus[1] == pytest.approx(np.full(81, -3.5 / FOOT_M)), "to the left is negative"
    assert bus[2] == pytest.approx((20.0 + 0.9 * bus[0] - 1.0 * 32.0) / FOOT_M)
    assert set(bus[6].tolist()) == {3.0}
    short, short_tracks = read(made_dataset, "csp", "TrainSet.mat")
    assert np.array_equal(short, np.delete(data, [5, 6, 8], axis=1))
    assert np.array_equal(short_tracks[2][1], bus[:3])


def test_who_gains_speed_is_no_class_of_the_shorter_layout(made_dataset: Path) -> None:
    """The car's mean speed of the next 5 s is at most 1.12 times that of the last 3 s."""
    data, _ = read(made_dataset, "stdan", "TrainSet.mat")
    own = slice(WINDOWS[EMV], WINDOWS[EMV] + WINDOWS[CAR])
    assert data[own, 2].tolist() == list(range(35, 35 + WINDOWS[CAR]))
    assert data[own, 6] == pytest.approx(np.full(WINDOWS[CAR], 0.2 / FOOT_M))
    assert set(data[own, 10].tolist()) == {1.0}
