import pytest

from siren_ros.simulation.roads.movements import movement_path


def test_the_length_of_a_way_is_that_of_its_path_and_that_of_no_lane_is_0(town):
    for connection in town.connections:
        if connection.via:
            assert town.length_m(connection.via) == pytest.approx(movement_path(town, connection).length_m, abs=0.1)
    assert town.length_m(()) == 0.0
