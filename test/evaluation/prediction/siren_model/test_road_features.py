import numpy as np
import pytest
from made_records import moving
from scenes import batch_of, showing, with_signal

from siren_ros.evaluation.prediction.siren_model.path_choice import choose_paths
from siren_ros.evaluation.prediction.siren_model.road_features import lane_columns, stop_line_columns
from siren_ros.roads.road_network import RoadNetwork


def lines_of(batch):
    speed = np.hypot(batch.velocity_mps[:, 0], batch.velocity_mps[:, 1])
    choice = choose_paths(batch.network, batch.xy_m, batch.yaw_rad, speed)
    return choice, stop_line_columns(batch, choice)


def test_the_stop_line_and_what_its_signal_shows_on_each_path(crossroads: RoadNetwork) -> None:
    batch = showing(batch_of({1: moving(-40.0, 0.0, 8.0)}, with_signal(crossroads, "rGy")), "rGy")
    choice, found = lines_of(batch)
    assert choice.there[0].tolist() == [True, True, True, False]
    # 24 m further on after 3 s; the bumper is 2.3 m ahead of the centre.
    assert found["line0_distance"][0, :3] * 100.0 == pytest.approx(40.0 - 24.0 - 2.3)
    # The straight path is link 1, the left one link 0, the right one link 2.
    assert found["line0_green"][0].tolist() == [1.0, 0.0, 0.0, 0.0]
    assert found["line0_priority"][0].tolist() == [1.0, 0.0, 0.0, 0.0]
    assert found["line0_red"][0].tolist() == [0.0, 1.0, 0.0, 0.0]
    assert found["line0_yellow"][0].tolist() == [0.0, 0.0, 1.0, 0.0]
    assert found["line0_left"][0].tolist() == [0.0, 1.0, 0.0, 0.0]
    assert (found["line1_there"] == 0.0).all()
    assert (found["line1_distance"][0] == 1.0).all()


def test_a_line_that_the_bumper_has_passed_counts_no_more(crossroads: RoadNetwork) -> None:
    batch = showing(batch_of({1: moving(-24.0, 0.0, 8.0)}, with_signal(crossroads, "rrr")), "rrr")
    _, found = lines_of(batch)
    assert (found["line0_there"][0] == 0.0).all()


def test_a_signal_that_nobody_recorded_is_none(crossroads: RoadNetwork) -> None:
    _, found = lines_of(batch_of({1: moving(-40.0, 0.0, 8.0)}, with_signal(crossroads, "rrr")))
    assert found["line0_there"][0, 0] == 1.0
    assert found["line0_signal"][0, 0] == 0.0


def test_where_the_edges_of_the_carriageway_are(straight_road: RoadNetwork) -> None:
    batch = batch_of({1: moving(20.0, -5.0, 8.0)}, straight_road)
    choice, _ = lines_of(batch)
    lane = lane_columns(straight_road, choice)
    assert lane["offset"][0, 0] * 2.0 == pytest.approx(0.25)
    assert lane["to_right_edge"][0, 0] * 5.0 == pytest.approx(1.75 + 0.25)
    assert lane["to_left_edge"][0, 0] * 5.0 == pytest.approx(1.75 + 3.5 - 0.25)
    assert lane["limit"][0, 0] * 10.0 == pytest.approx(13.89)
