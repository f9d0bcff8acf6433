"""Lines along lanes that begin beside the end of the one before, in a frame that is not along x."""

from dataclasses import replace

import numpy as np
import pytest

from siren_ros.base.numerics.geometry import Polyline, rotate
from siren_ros.simulation.behaviour.paths.lane_path import LaneEnd, path_on_lanes
from siren_ros.simulation.behaviour.paths.sideways_jump import without_jumps
from siren_ros.simulation.behaviour.paths.tracked_path import Navigation, on_reference

CONFIG = replace(Navigation(), curvature_rate_1pms=0.15)


def road(lab, *lanes, turn=0.6):
    """Lanes given by x from, x to and y, one after the other."""
    builder = lab.RoadBuilder()
    for number, (begin, end, y) in enumerate(lanes):
        builder.edge(rotate(np.array([[begin, y], [end, y]]), turn), 1, (f"n{number}", f"n{number + 1}"))
    return builder.built()


def path(network, count, from_m=0.0):
    line = path_on_lanes(network, tuple(range(count)), LaneEnd.HORIZON, from_m, 1000.0)
    return line, on_reference(line, CONFIG, stop_at_end=False, shorten_m=0.0)


@pytest.mark.parametrize("shift", [-1.75, -0.5, 0.5, 1.75])
def test_the_path_moves_over_gently_and_fast(lab, shift):
    """At least at 45 km/h; a line straight through the points is driven at walking pace."""
    network = road(lab, (0.0, 100.0, 0.0), (100.0, 200.0, shift))
    line, tracked = path(network, 2)
    assert tracked.speed_cap_mps(100.0) > 12.5
    assert min(tracked.speed_cap_mps(s) for s in range(60, 140)) > 12.5
    y = rotate(line.curve.points, -0.6)[:, 1]
    assert np.all(np.diff(np.sign(shift) * y) >= -1e-6)
    assert (y[0], y[-1]) == pytest.approx((0.0, shift), abs=1e-6)
    assert np.abs(y[line.curve.points @ np.array([np.cos(0.6), np.sin(0.6)]) < 82.0]).max() < 0.01
    assert line.start_m[1] == pytest.approx(100.0, abs=0.3)


def test_a_shifted_stub_between_two_roads_in_line_is_driven_straight_through(lab):
    network = road(lab, (0.0, 100.0, 0.0), (100.0, 103.0, 1.6), (103.0, 200.0, 0.0))
    line, tracked = path(network, 3)
    assert np.abs(rotate(line.curve.points, -0.6)[:, 1]).max() < 0.2
    assert min(tracked.speed_cap_mps(s) for s in range(60, 140)) > 12.5
    assert line.start_m == pytest.approx([0.0, 100.0, 103.0], abs=1.5)


def test_roads_without_a_jump_and_real_bends_stay_as_they_are():
    corner = Polyline.through([[0.0, 0.0], [50.0, 0.0], [50.0, 50.0]])
    dog_leg = Polyline.through([[0.0, 0.0], [50.0, 0.0], [50.0, 4.0], [100.0, 4.0]])
    straight = Polyline.through([[0.0, 0.0], [50.0, 0.0], [100.0, 1.0]])
    for line in (corner, dog_leg, straight):
        starts = np.array([0.0, 50.0])
        kept, begun = without_jumps(line, starts)
        assert kept is line
        assert begun is starts


def test_a_jump_near_an_end_of_the_line_is_blended_on_the_way_that_there_is():
    line = Polyline.through([[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [40.0, 1.0]])
    blended, starts = without_jumps(line, np.array([0.0, 4.0]))
    assert blended.points[0] == pytest.approx([0.0, 0.0])
    assert blended.points[-1] == pytest.approx([40.0, 1.0])
    assert np.abs(blended.heading_rad(np.arange(0.0, 39.0))).max() < 0.2
    assert 0.0 < starts[1] < 6.0
