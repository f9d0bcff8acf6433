"""What a driver in the seat sees where its way comes back to a road."""

import numpy as np
import pytest
from seen_on_crossing import NETWORK, OWN, WAY, seen

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.running.seat.sight import sight_of
from siren_ros.running.seat.way import Way


def test_a_way_that_comes_back_to_its_road_is_followed_from_where_the_vehicle_was():
    sight = seen(emv_m=10.0, own_m=40.0, own_mps=5.0)[1]
    points = WAY.curve.points
    around = points[[-1, 0]] + np.array([[200.0, 0.0], [200.0, -50.0]])
    again = points + np.array([0.05, 0.0])  # a little to the right of the first time
    way = Way.of(NETWORK, Polyline.through(np.concatenate((points, around, again))))
    later_m = way.curve.length_m - WAY.curve.length_m
    first, second = (
        sight_of(sight.states, (), sight.bodies, OWN, way, sight.s_m + far) for far in (-0.3, later_m - 0.3)
    )
    assert first.s_m == pytest.approx(sight.s_m)
    assert second.s_m == pytest.approx(sight.s_m + later_m, abs=0.1)
    assert second.left_m == pytest.approx(first.left_m + 0.05)
    assert first.sirens[0].gap_m == pytest.approx(second.sirens[0].gap_m, abs=0.1)
