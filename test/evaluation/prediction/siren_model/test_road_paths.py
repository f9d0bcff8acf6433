import numpy as np
import pytest

from siren_ros.evaluation.prediction.siren_model.road_paths import RoadPaths
from siren_ros.roads.road_network import RoadNetwork


def test_all_ways_out_of_a_junction_the_straight_one_first(crossroads: RoadNetwork) -> None:
    paths = RoadPaths(crossroads).ahead(0, 30.0)
    assert [path.curve.points[-1].tolist() for path in paths] == [[140.0, 0.0], [20.0, 120.0], [20.0, -120.0]]
    assert [path.turn_rad for path in paths] == pytest.approx([0.0, np.pi / 2, np.pi / 2])
    assert [line.arc_m for path in paths for line in path.stop_lines] == pytest.approx([100.0] * 3)
    assert [path.stop_lines[0].movement.direction for path in paths] == ["s", "l", "r"]


def test_a_path_ends_with_its_lane_where_nothing_beyond_is_asked_for(crossroads: RoadNetwork) -> None:
    (path,) = RoadPaths(crossroads).ahead(0, 0.0)
    assert path.curve.length_m == pytest.approx(100.0)
    assert path.stop_lines == ()


def test_inside_a_junction_the_path_is_decided_and_the_stop_line_passed(crossroads: RoadNetwork) -> None:
    (path,) = RoadPaths(crossroads).ahead(4, 30.0)
    assert path.curve.points[-1].tolist() == [20.0, 120.0]
    assert path.stop_lines == ()


def test_a_dead_end_has_the_path_to_its_end(crossroads: RoadNetwork) -> None:
    (path,) = RoadPaths(crossroads).ahead(1, 50.0)
    assert path.curve.length_m == pytest.approx(100.0)
