"""What a driver sees of the streets from the side, from the geometry of a junction that is known in numbers."""

import math
from dataclasses import replace

import pytest
from behaviour.lab import RoadBuilder

from siren_ros.simulation.conflicts.clear_view import SETBACK_M, Lookout, SideStreet, safe_mps, side_streets

STREET = SideStreet(near_m=4.0, far_m=10.0, aside_m=7.0, limit_mps=8.0)
LOOKOUT = Lookout(horizon_s=8.0, pet_s=1.0, brake_mps2=3.0, reaction_s=0.5, standoff_m=1.0, length_m=6.0)


def crossroads():
    """A lane to the east, 12 m over the junction; a street from the south and one from the north, 4 m and 8 m in."""
    road = RoadBuilder().edge([[-200, 0], [0, 0]], 1, ("W", "J"))
    road.edge([[0, 0], [12, 0]], 1, ("J", "J"), internal=True).edge([[12, 0], [200, 0]], 1, ("J", "E"))
    road.edge([[0, 3.3], [-200, 3.3]], 1, ("J", "W"))
    for x_m, way in ((8.0, 1.0), (4.0, -1.0)):
        ends = [[-150, -8], [-8, 8], [8, 150]]
        for (begin, end), names in zip(ends, (("S", "J"), ("J", "J"), ("J", "N")), strict=True):
            road.edge([[x_m, way * begin], [x_m, way * end]], 1, names, internal=names == ("J", "J"))
    road.connect(0, 2, via=(1,)).connect(4, 6, via=(5,)).connect(7, 9, via=(8,))
    return road.built()


def test_the_view_opens_at_the_facades():
    """From 5 m before the line the eye is 4 m before the façades and 11 m before the street: the view is 7 m · 11/4."""
    assert STREET.seen_m(5.0) == pytest.approx(7.0 * 11.0 / 4.0)
    assert math.isinf(STREET.seen_m(1.0))
    assert math.isinf(STREET.seen_m(0.0))


def test_who_comes_into_view_is_let_pass_after_a_stop():
    """5 m before the line 8 m are left to the stop, of which 0.5 s go by before braking with 3 m/s²."""
    speed = safe_mps(STREET, 5.0, LOOKOUT)
    assert 0.5 * speed + speed**2 / 6.0 == pytest.approx(8.0)
    assert safe_mps(replace(STREET, near_m=0.0), 5.0, replace(LOOKOUT, standoff_m=6.0)) == 0.0


def test_a_view_that_is_long_enough_asks_for_nothing():
    """With a view of 6.5 s who is not seen yet comes after an EMV that covers 18 m at the speed for a stop."""
    free = replace(STREET, aside_m=40.0 * 4.0 / 11.0 * 1.3)
    assert free.seen_m(5.0) / free.limit_mps == pytest.approx(6.5)
    stops_mps = safe_mps(STREET, 5.0, LOOKOUT)
    assert stops_mps * 5.5 > 5.0 + 10.0 + 6.0
    assert math.isinf(safe_mps(free, 5.0, LOOKOUT))
    assert math.isfinite(safe_mps(free, 5.0, replace(LOOKOUT, pet_s=4.0)))


def test_who_does_not_reckon_with_others_sees_enough_everywhere():
    assert math.isinf(safe_mps(STREET, 5.0, replace(LOOKOUT, horizon_s=0.2)))


def test_streets_from_both_sides_are_where_their_lanes_cross():
    network = crossroads()
    right, left = side_streets(network, network.connections[0])
    width, near = 3.3, pytest.approx(4.0, abs=0.3)
    assert left.near_m + 0.5 * width == near
    assert right.near_m + 0.5 * width == pytest.approx(8.0, abs=0.3)
    assert (right.far_m - right.near_m, left.far_m - left.near_m) == pytest.approx((width, width))
    assert right.aside_m == pytest.approx(0.5 * width + SETBACK_M)
    assert left.aside_m == pytest.approx(1.5 * width + SETBACK_M)
    assert right.limit_mps == pytest.approx(13.89)


def test_a_movement_that_nobody_crosses_has_no_streets():
    network = crossroads()
    assert side_streets(replace(network, connections=network.connections[:1]), network.connections[0]) == ()
