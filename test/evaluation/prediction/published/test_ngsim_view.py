import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_records import Track, moving, record_with

from siren_ros.datasets.ngsim.conventions import FOOT_M
from siren_ros.evaluation.prediction.protocol.samples import Population, samples_of
from siren_ros.evaluation.prediction.protocol.window import HistoryWindow
from siren_ros.evaluation.prediction.published.ngsim_view import NgsimView, ngsim_view
from siren_ros.roads.road_network import RoadNetwork

RIGHT_LANE, LEFT_LANE, OPPOSITE_LANE = -5.25, -1.75, 1.75
OFF_THE_LANES = 500.0
FRAME = 30
"""The first frame with a whole past."""


def view_of(tracks: dict[int, Track], network: RoadNetwork) -> NgsimView:
    return ngsim_view(samples_of(record_with(tracks, network), HistoryWindow(), Population.ALL).batch)


def cells_of(view: NgsimView, target: int) -> dict[int, int]:
    """Cells of the neighbours of an actor in the first frame, by the neighbour's id."""
    first = (view.actors.actor_id[view.target] == target) & (view.actors.frame[view.target] == 0)
    pairs = np.isin(view.sample, np.flatnonzero(first))
    ids = view.actors.actor_id[view.neighbour[pairs]]
    return dict(zip(ids.tolist(), view.cell[pairs].tolist(), strict=True))


def ahead(feet: float) -> float:
    return 100.0 + feet * FOOT_M


def test_neighbours_are_in_their_cells(straight_road: RoadNetwork) -> None:
    tracks = {
        1: moving(100.0, LEFT_LANE, 0.0),
        2: moving(ahead(30.0), LEFT_LANE, 0.0),
        3: moving(ahead(-46.0), RIGHT_LANE, 0.0),
        4: moving(ahead(0.0), RIGHT_LANE, 0.0),
        5: moving(ahead(91.0), LEFT_LANE, 0.0),
        6: moving(ahead(10.0), OPPOSITE_LANE, 0.0, yaw_rad=np.pi),
    }
    view = view_of(tracks, straight_road)
    assert cells_of(view, 1) == {2: 13 + 8, 3: 26 + 3, 4: 26 + 6}
    # Seen from the right lane, the left one is the first column.
    assert cells_of(view, 4) == {1: 6, 2: 8, 3: 13 + 3}
    # The vehicle that comes towards them has left and right the other way round, and nobody of its direction.
    assert cells_of(view, 6) == {}


def test_a_neighbour_without_a_whole_past_is_left_out(straight_road: RoadNetwork) -> None:
    tracks = {
        1: moving(100.0, LEFT_LANE, 0.0),
        2: moving(120.0, LEFT_LANE, 0.0, first_step=2),
        3: moving(80.0, LEFT_LANE, 0.0, without=frozenset({20})),
    }
    assert cells_of(view_of(tracks, straight_road), 1) == {}


def test_the_later_actor_takes_the_cell(straight_road: RoadNetwork) -> None:
    tracks = {
        1: moving(ahead(29.0), LEFT_LANE, 0.0),
        2: moving(100.0, LEFT_LANE, 0.0),
        3: moving(ahead(31.0), LEFT_LANE, 0.0),
    }
    assert cells_of(view_of(tracks, straight_road), 2) == {3: 13 + 8}


def test_on_a_lane_ahead_is_along_the_lane_whatever_the_heading(straight_road: RoadNetwork) -> None:
    tracks = {1: moving(100.0, LEFT_LANE, 0.5, yaw_rad=0.3), 2: moving(110.0, LEFT_LANE, 0.0)}
    view = view_of(tracks, straight_road)
    row = np.flatnonzero((view.actors.actor_id[view.target] == 1) & (view.actors.frame[view.target] == 0))
    assert view.tangent_rad[row] == pytest.approx([0.0])
    past = view.right_ahead_m(view.target[row], row)[0]
    time = np.arange(-15, 1) * 0.2
    assert past == pytest.approx(np.stack((-0.5 * np.sin(0.3) * time, 0.5 * np.cos(0.3) * time), axis=1))


@settings(max_examples=20, deadline=None)
@given(yaw_rad=st.floats(-np.pi, np.pi), speed_mps=st.floats(1.0, 20.0))
def test_off_the_lanes_ahead_is_the_heading(yaw_rad: float, speed_mps: float, straight_road: RoadNetwork) -> None:
    across = np.array([-np.sin(yaw_rad), np.cos(yaw_rad)])
    left_x, left_y = 3.5 * across
    tracks = {
        1: moving(0.0, OFF_THE_LANES, speed_mps, yaw_rad=yaw_rad),
        2: moving(left_x, OFF_THE_LANES + left_y, speed_mps, yaw_rad=yaw_rad),
    }
    view = view_of(tracks, straight_road)
    assert cells_of(view, 1) == {2: 6}
    assert cells_of(view, 2) == {1: 26 + 6}
    past = view.right_ahead_m(view.target, np.arange(len(view)))
    straight = np.stack((np.zeros(16), speed_mps * np.arange(-15, 1) * 0.2), axis=-1)
    assert past == pytest.approx(np.broadcast_to(straight, past.shape), abs=1e-9)
    alongside = view.right_ahead_m(view.neighbour, view.sample) - straight
    side = np.where(view.actors.actor_id[view.neighbour] == 2, -3.5, 3.5)
    assert alongside[..., 0] == pytest.approx(np.broadcast_to(side[:, None], alongside.shape[:2]), abs=1e-9)
    assert alongside[..., 1] == pytest.approx(0.0, abs=1e-9)


@settings(max_examples=20, deadline=None)
@given(yaw_rad=st.floats(-np.pi, np.pi))
def test_there_and_back_is_the_record(yaw_rad: float, straight_road: RoadNetwork) -> None:
    view = view_of({1: moving(3.0, OFF_THE_LANES, 7.0, yaw_rad=yaw_rad, accel_mps2=0.5)}, straight_road)
    past = view.right_ahead_m(view.target, np.arange(len(view)))
    assert view.on_map(past) == pytest.approx(view.actors.xy_m[view.target])
    assert view.on_map(past[:, None])[:, 0] == pytest.approx(view.actors.xy_m[view.target])


def test_parts_are_whole_frames_and_make_the_view(straight_road: RoadNetwork) -> None:
    tracks = {key: moving(40.0 + 9.0 * key, RIGHT_LANE, 3.0) for key in (1, 2, 3)}
    view = view_of(tracks, straight_road)
    assert view.scene.tolist() == np.repeat(np.arange(len(view) // 3), 3).tolist()
    parts = list(view.parts(4))
    assert [len(part) for part in parts] == [6] * (len(view) // 6) + [len(view) % 6] * (len(view) % 6 > 0)
    assert np.concatenate([part.target for part in parts]).tolist() == view.target.tolist()
    assert np.concatenate([part.neighbour for part in parts]).tolist() == view.neighbour.tolist()
    assert np.concatenate([part.cell for part in parts]).tolist() == view.cell.tolist()
    assert np.concatenate([part.target[part.sample] for part in parts]).tolist() == view.target[view.sample].tolist()
    assert all(part.scene[0] == 0 for part in parts)


def test_nobody_gives_an_empty_view(straight_road: RoadNetwork) -> None:
    view = view_of({1: moving(0.0, RIGHT_LANE, 5.0, steps=20)}, straight_road)
    assert len(view) == 0
    assert list(view.parts(8)) == []
