from dataclasses import replace

import numpy as np
import pytest
from made_records import moving, record_with
from made_scores import scored

from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses
from siren_ros.scoring.evaluation.prediction.road_use import off_road, road_raster, wrong_way
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, future_times_s, samples_of
from siren_ros.simulation.roads.road_network import Junction, JunctionKind

TIMES_S = future_times_s()


def rates(straight_road, y_m, aside_mps=0.0, along_mps=5.0, yaw_rad=0.0):
    record = record_with({1: moving(60.0, y_m, along_mps, 0.0, yaw_rad, steps=161)}, straight_road)
    samples = samples_of(record, HistoryWindow(), Population.ALL).select(np.array([0]))
    velocity = np.array([along_mps * np.cos(yaw_rad), aside_mps + along_mps * np.sin(yaw_rad)])
    hypotheses = Hypotheses.certain(samples.batch.xy_m[:, None] + TIMES_S[:, None] * velocity)
    return float(off_road(hypotheses, samples)[0]), float(wrong_way(hypotheses, samples)[0])


def test_a_vehicle_that_keeps_its_lane_is_on_the_road_and_the_right_way(straight_road) -> None:
    assert rates(straight_road, -5.25) == (0.0, 0.0)
    assert rates(straight_road, -1.75) == (0.0, 0.0)


def test_a_path_beyond_the_edge_is_off_the_road(straight_road) -> None:
    assert rates(straight_road, -5.25, aside_mps=-3.0)[0] == 1.0
    assert rates(straight_road, -5.25, aside_mps=-0.2)[0] == 0.0, "1 m to the side stays in the lane"


def test_a_vehicle_off_the_road_says_nothing(straight_road) -> None:
    assert np.isnan(rates(straight_road, -60.0)[0])


def test_a_path_back_along_the_lane_is_the_wrong_way(straight_road) -> None:
    record = record_with({1: moving(60.0, -5.25, 5.0, steps=161)}, straight_road)
    samples = samples_of(record, HistoryWindow(), Population.ALL).select(np.array([0]))
    back = Hypotheses.certain(samples.batch.xy_m[:, None] - TIMES_S[:, None] * np.array([5.0, 0.0]))
    assert wrong_way(back, samples).tolist() == [1.0]
    stands = Hypotheses.certain(np.repeat(samples.batch.xy_m[:, None], 25, axis=1))
    assert wrong_way(stands, samples).tolist() == [0.0]


def test_a_vehicle_that_is_against_its_lane_at_present_says_nothing(straight_road) -> None:
    assert np.isnan(rates(straight_road, -5.25, yaw_rad=np.pi)[1])


def test_the_truth_of_an_episode_keeps_to_the_road(straight_road) -> None:
    tracks = {number: moving(20.0 * number, -5.25, 6.0, 0.1, steps=181) for number in range(1, 4)}
    samples = samples_of(record_with(tracks, straight_road), HistoryWindow(), Population.ALL)
    truth = Hypotheses.certain(samples.future_xy_m)
    assert off_road(truth, samples).tolist() == [0.0] * len(samples)
    assert wrong_way(truth, samples).tolist() == [0.0] * len(samples)


def test_without_a_map_there_is_no_value() -> None:
    samples = scored(np.zeros((3, 25, 2)))
    for rate in (off_road, wrong_way):
        assert np.isnan(rate(Hypotheses.certain(samples.future_xy_m), samples)).all()


def test_a_junction_has_no_wrong_way(straight_road) -> None:
    outline = np.array([[50.0, -9.0], [60.0, -9.0], [60.0, 9.0], [50.0, 9.0]])
    junction = Junction("j", JunctionKind.SIGNAL, outline, 55.0, 0.0)
    raster = road_raster(replace(straight_road, junctions={"j": junction}))
    assert raster is not None
    inside, outside = (raster.cells(np.array([x_m, -5.25])) for x_m in (55.0, 70.0))
    assert raster.road[inside]
    assert (raster.directions[inside], raster.directions[outside]) == (255, 0b11000111)
    assert raster.road[raster.cells(np.array([55.0, 8.0]))], "where no lane is"


def test_lanes_have_the_directions_within_90_degrees(straight_road) -> None:
    raster = road_raster(straight_road)
    assert raster is not None
    lane = straight_road.lanes[0]
    middle = lane.centre.at(0.5 * lane.length_m)
    assert lane.centre.heading_rad(1.0) == pytest.approx(0.0)
    assert raster.directions[raster.cells(middle)] == sum(1 << sector for sector in (6, 7, 0, 1, 2))
