"""Samples for NGSIM's loaders from vehicles whose ways are formulas, on a road to the east."""

import numpy as np
import pytest
from evaluation.made_records import moving, record_with

from siren_ros.datasets.ngsim.conventions import FOOT_M
from siren_ros.datasets.ngsim.exporter import NgsimExporter, _cells, _on_road, _Sample
from siren_ros.datasets.ngsim.grid import ACCELERATE, CELLS_ALONG, KEEP, NORMAL
from siren_ros.datasets.sources.tracks import tracks_of
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.world.actors import ActorClass

STEPS = 2 * 80 + 1
"""81 frames: one whole window, whose present is frame 30."""
RIGHT_Y_M, LEFT_Y_M = -5.25, -1.75


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
