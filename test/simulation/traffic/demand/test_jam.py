"""How the head of a jam moves."""

import pytest

from siren_ros.base.numerics.units import STEP_S
from siren_ros.simulation.traffic.demand.jam import JamHead


def speeds(head: JamHead, *times_s: float) -> list[float]:
    return [head.speed_mps(round(time_s / STEP_S)) for time_s in times_s]


def test_it_rolls_and_then_stands_for_good():
    head = JamHead(("a", "b"), moves=False, roll_s=6.0, roll_mps=1.5, stand_s=15.0)
    assert speeds(head, 0.0, 5.95, 6.0, 21.0, 500.0) == [1.5, 1.5, 0.0, 0.0, 0.0]


def test_it_stops_and_goes_in_turn():
    head = JamHead(("a",), moves=True, roll_s=6.0, roll_mps=1.5, stand_s=15.0)
    assert speeds(head, 0.0, 6.0, 20.95, 21.0, 26.95, 27.0) == pytest.approx([1.5, 0.0, 0.0, 1.5, 1.5, 0.0])
