from dataclasses import replace

import numpy as np
import pytest
from made_records import moving
from scenes import batch_of, showing, with_signal

from siren_ros.evaluation.prediction.siren_model.path_choice import choose_paths
from siren_ros.evaluation.prediction.siren_model.road_features import lane_columns, stop_line_columns
from siren_ros.numerics.polyline import Polyline
from siren_ros.roads.road_network import LaneKind, RoadNetwork


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


def at(x_m: float, y_m: float, network: RoadNetwork, yaw_rad: float = 0.0, speed_mps: float = 0.0):
    """The batch of a vehicle that is somewhere at the present, after 3 s."""
    start = x_m - 3.0 * speed_mps * np.cos(yaw_rad), y_m - 3.0 * speed_mps * np.sin(yaw_rad)
    return batch_of({1: moving(*start, speed_mps, yaw_rad=yaw_rad)}, network)


@pytest.mark.parametrize(("past_m", "there"), [(-0.1, 1.0), (0.9, 1.0), (1.1, 0.0)])
def test_a_line_counts_until_the_bumper_is_a_metre_past_it(
    crossroads: RoadNetwork, past_m: float, there: float
) -> None:
    _, found = lines_of(at(past_m - 2.3, 0.0, crossroads))
    assert found["line0_there"][0, 0] == there
    assert found["line0_distance"][0, 0] * 100.0 == pytest.approx(max(-past_m, 0.0) if there else 100.0)


def two_lines(network: RoadNetwork) -> RoadNetwork:
    """The lane behind the crossroads ends after 30 m at another junction, where the way goes straight on."""
    lanes = list(network.lanes)
    lanes[2] = replace(lanes[2], centre=Polyline.through([(40.0, 0.0), (70.0, 0.0)]))
    lanes.append(replace(lanes[2], index=7, edge=7, centre=Polyline.through([(70.0, 0.0), (170.0, 0.0)])))
    edges = (*network.edges, replace(network.edges[2], index=7, lanes=(7,)))
    onward = replace(network.connections[1], from_lane=2, to_lane=7, via=(), gives_way=True)
    return replace(network, lanes=tuple(lanes), edges=edges, connections=(*network.connections, onward))


def test_the_next_two_lines_of_a_path(crossroads: RoadNetwork) -> None:
    network = two_lines(crossroads)
    for x_m, ahead_m in ((-10.0, (10.0, 80.0)), (-1.0, (70.0 + 1.0,))):
        _, found = lines_of(at(x_m, 0.0, network, speed_mps=8.0))
        there = [found[f"line{number}_there"][0, 0] for number in (0, 1)]
        assert there == [1.0, float(len(ahead_m) == 2)]
        for number, away_m in enumerate(ahead_m):
            assert found[f"line{number}_distance"][0, 0] * 100.0 == pytest.approx(away_m - 2.3)
            gives_way = found[f"line{number}_gives_way"][0, 0]
            assert gives_way == float(number == len(ahead_m) - 1)
            assert found[f"line{number}_must_stop"][0, 0] == 0.0
            assert found[f"line{number}_straight"][0, 0] == 1.0


def test_how_a_vehicle_stands_in_its_lane_and_what_is_left_of_the_road(crossroads: RoadNetwork) -> None:
    choice, _ = lines_of(at(-10.0, 0.4, crossroads, yaw_rad=-0.1))
    lane = lane_columns(crossroads, choice)
    assert lane["offset"][0, :3] == pytest.approx(np.full(3, 0.2))
    assert lane["sin_turned"][0, :3] == pytest.approx(np.full(3, np.sin(-0.1)))
    assert lane["turn"][0, :3] == pytest.approx([0.0, np.pi / 2.0, np.pi / 2.0])
    assert lane["half_width"][0, 0] == pytest.approx(0.25 * 3.5)
    assert [lane[name][0, 0] for name in ("lane", "shoulder", "across", "shoulder_right")] == [1.0, 0.0, 0.0, 0.0]
    choice, _ = lines_of(at(100.0, 0.0, crossroads))
    assert lane_columns(crossroads, choice)["ends"][0, 0] * 100.0 == pytest.approx(40.0)
    choice, _ = lines_of(at(30.0, 0.0, crossroads))
    assert lane_columns(crossroads, choice)["across"][0, 0] == 1.0


def test_a_shoulder_is_told_and_does_not_widen_the_carriageway(crossroads: RoadNetwork) -> None:
    lanes, edges = list(crossroads.lanes), list(crossroads.edges)
    lanes[0] = replace(lanes[0], position=1)
    verge = Polyline.through([(-100.0, -3.0), (0.0, -3.0)])
    lanes.append(replace(lanes[0], index=7, position=0, kind=LaneKind.SHOULDER, centre=verge, width_m=2.5))
    edges[0] = replace(edges[0], lanes=(7, 0))
    network = replace(crossroads, lanes=tuple(lanes), edges=tuple(edges))
    for y_m, expected in ((0.3, ("lane", 1.0, 1.75 + 0.3, 1.75 - 0.3)), (-3.0, ("shoulder", 0.0, 1.25, 1.25 + 3.5))):
        choice, _ = lines_of(at(-60.0, y_m, network))
        found = {name: values[0, 0] for name, values in lane_columns(network, choice).items()}
        kind, shoulder_right, right_m, left_m = expected
        assert found[kind] == 1.0
        assert found["shoulder_right"] == shoulder_right
        assert found["to_right_edge"] * 5.0 == pytest.approx(right_m)
        assert found["to_left_edge"] * 5.0 == pytest.approx(left_m)


def test_a_path_that_is_none_is_in_no_lane(crossroads: RoadNetwork) -> None:
    choice, _ = lines_of(at(-10.0, 0.0, crossroads, speed_mps=8.0))
    assert choice.there[0].tolist() == [True, True, True, False]
    found = lane_columns(crossroads, choice)
    assert all(values[0, 3] == 0.0 for values in found.values())
    assert found["limit"][0, 0] > 0.0


def test_a_link_that_the_signal_did_not_show_is_unknown(crossroads: RoadNetwork) -> None:
    """The signal of three links was recorded with two: the way to the right is the third."""
    batch = showing(batch_of({1: moving(-40.0, 0.0, 8.0)}, with_signal(crossroads, "rGy")), "rG")
    _, found = lines_of(batch)
    assert found["line0_there"][0].tolist() == [1.0, 1.0, 1.0, 0.0]
    assert found["line0_signal"][0].tolist() == [1.0, 1.0, 0.0, 0.0]
    assert found["line0_yellow"][0].tolist() == [0.0] * 4
