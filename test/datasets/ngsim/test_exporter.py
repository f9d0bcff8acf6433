"""NGSIM files, read by the rules of the published loaders."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import loadmat

from siren_ros.cli.main import main
from siren_ros.datasets.ngsim.conventions import FOOT_M, vehicle_class
from siren_ros.datasets.ngsim.grid import OUTSIDE, grid_cells, lateral_class, longitudinal_class, neighbour_cells
from siren_ros.datasets.ngsim.mat_file import mat_bytes
from siren_ros.datasets.ngsim.road_frame import (
    across_and_ahead,
    from_across_and_ahead,
    lane_widths_m,
    lanes_to_the_right,
)
from siren_ros.datasets.sources.episode_source import open_source
from siren_ros.datasets.sources.tracks import Track, tracks_of
from siren_ros.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.world.actors import ActorClass

METRES = st.floats(-1e3, 1e3)
Set = tuple[npt.NDArray[np.float64], Any]


@pytest.fixture(scope="module")
def dataset(tracked_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("ngsim") / "out"
    assert main(["export", "ngsim", str(tracked_bag), "--out", str(out), "--population", "all"]) == 0
    return out


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
