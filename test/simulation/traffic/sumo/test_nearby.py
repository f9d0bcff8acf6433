import math

import pytest

from siren_ros.simulation.traffic.sumo.nearby import Reserve, nearest_m


def test_the_nearest_point_counts() -> None:
    assert nearest_m((0.0, 0.0), [(3.0, 4.0), (1.0, 0.0)]) == 1.0
    assert nearest_m((0.0, 0.0), []) == math.inf


def test_those_in_the_ring_around_every_point_try_to_enter_in_their_order() -> None:
    reserve = Reserve("abcd", [(0.0, 50.0), (0.0, 10.0), (0.0, -40.0), (200.0, 0.0)])
    asked: list[str] = []

    def enter(name: str) -> bool:
        asked.append(name)
        return name != "a"

    reserve.let_in([], 0.0, math.inf, enter)
    assert asked == []
    reserve.let_in([(0.0, 0.0)], 20.0, 100.0, enter)
    assert asked == ["a", "c"]
    reserve.let_in([(0.0, 0.0)], 20.0, 100.0, enter)
    assert asked == ["a", "c", "a"], "one has entered, the other one tries again"
    reserve.let_in([(0.0, 0.0), (200.0, 0.0)], 0.0, 20.0, enter)
    assert asked[3:] == ["b", "d"]


@pytest.mark.parametrize(("least_m", "most_m"), [(10.1, 20.0), (0.0, 9.9)])
def test_nobody_enters_outside(least_m: float, most_m: float) -> None:
    Reserve("a", [(10.0, 0.0)]).let_in([(0.0, 0.0)], least_m, most_m, lambda name: pytest.fail(f"{name} is asked"))
