"""The lanes beside a path, and what a driver sees along it."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import IN_TURN_LANE, LEFT_X_M, line
from seen_on_crossing import NETWORK, OWN, WAY, seen

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.running.seat.sight import Way, sight_of


def test_the_right_lane_of_two_has_one_to_its_left_also_across_the_junction() -> None:
    assert (WAY.lanes.left == 1.0).all()
    assert (WAY.lanes.right == 0.0).all()
    assert [WAY.lanes.offset_m(50, lane) for lane in (-1, 0, 1, 2)] == [0.0, 0.0, 3.5, 3.5]
    assert [WAY.lanes.lane_there(50, lane) for lane in (-1, 0, 1, 2)] == [0, 0, 1, 1]
    assert [WAY.lanes.lane_at(50, offset_m) for offset_m in (-3.0, -1.0, 1.0, 2.5)] == [-1, 0, 0, 1]


def test_the_left_lane_has_one_to_its_right() -> None:
    way = Way.of(NETWORK, Polyline.through(line((LEFT_X_M, -120.0), (LEFT_X_M, 110.0))))
    lanes = way.lanes
    assert [lanes.offset_m(20, lane) for lane in (-2, -1, 0, 1)] == [-3.5, -3.5, 0.0, 0.0]
    fast = replace(NETWORK, lanes=tuple(replace(lane, speed_limit_mps=30.0) for lane in NETWORK.lanes))
    assert all(Way.of(fast, one.curve).duty.all() for one in (way, WAY)), "a rescue lane out of town, in both lanes"
    assert not WAY.duty.any()


def test_a_lane_that_ends_at_a_junction_comes_nearer_on_the_way_across() -> None:
    lanes = Way.of(NETWORK, Polyline.through(IN_TURN_LANE)).lanes
    offsets = np.array([lanes.offset_m(row, 1) for row in range(len(lanes.left))])
    assert offsets[90] == 3.5
    assert offsets[140] == 0.0
    across = offsets[102:120]
    assert (np.diff(across) < 0.0).all()
    assert ((across > 0.0) & (across < 3.5)).all()


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
