"""Drawings of cars: their glass lies in order, within the body, and above the belt."""

from itertools import pairwise

import pytest

from siren_ros.sensing.vehicles import cars
from siren_ros.sensing.vehicles.cars import CarDesign

DESIGNS = [design for design in vars(cars).values() if isinstance(design, CarDesign)]


@pytest.mark.parametrize("design", DESIGNS)
def test_glass_lies_in_order(design):
    """Windscreen, side windows with pillars of 4 to 20 cm between them, and the rear screen."""
    spans = design.side_windows
    assert all(low < high for low, high in (design.windscreen, design.rear_screen, *spans))
    assert all(0.04 <= after[0] - before[1] <= 0.2 for before, after in pairwise(spans))
    assert 0.8 < design.windscreen[0] < spans[0][0] < design.windscreen[1] + 0.6
    assert design.windscreen[1] < design.rear_screen[0] + 1e-9
    assert spans[-1][1] <= design.rear_screen[1] <= design.profile.length_m
    assert design.windscreen[0] < design.mirror_s_m < spans[0][1], "the mirror is at the first window"


@pytest.mark.parametrize("design", DESIGNS)
def test_axles_and_outlines_are_those_of_a_car(design):
    profile = design.profile
    front, rear = profile.axles
    assert 0.6 < front.s_m < 1.2
    assert 0.5 < profile.length_m - rear.s_m < 1.3
    assert front.wheel_radius_m == rear.wheel_radius_m
    assert profile.top_m[-1][0] == profile.length_m
    steep = [
        abs((b[1] - a[1]) / (b[0] - a[0]))
        for a, b in pairwise(profile.half_width_m)
        if a[0] > 0.3 and profile.length_m - b[0] > 0.3
    ]
    assert max(steep) < 0.15, "the flanks have no steps"
