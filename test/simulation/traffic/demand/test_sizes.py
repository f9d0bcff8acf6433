"""Sizes that vary within a class: how far, by what, and that traffic is planned for the largest."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.simulation.dynamics.parameters import load_vehicle_parameters
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.traffic.demand.sizes import WIDEST_M, largest, varied_size
from siren_ros.simulation.world.actors import ActorClass

SEDAN = (4.75, 1.83, 1.45)
BUS = (12.0, 2.55, 3.1)
HALF_A_DIGIT_M = 0.005 + 1e-9


@given(st.floats(0.0, 0.15), st.integers(0, 1000), st.text(max_size=8))
def test_a_size_is_within_the_spread_of_its_class(spread: float, seed: int, name: str) -> None:
    size = varied_size(SEDAN, spread, seed, name)
    assert size == varied_size(SEDAN, spread, seed, name)
    for drawn, of_class in zip(size, SEDAN, strict=True):
        assert abs(drawn - of_class) <= spread * of_class + HALF_A_DIGIT_M


def test_sizes_fill_the_spread_and_differ_by_seed_and_name() -> None:
    sizes = [varied_size(SEDAN, 0.1, seed, f"background{number}") for seed in range(10) for number in range(30)]
    assert len(set(sizes)) == len(sizes)
    lengths = [length / SEDAN[0] for length, _, _ in sizes]
    assert min(lengths) < 0.91
    assert max(lengths) > 1.09
    assert sum(lengths) / len(lengths) == pytest.approx(1.0, abs=0.02)


def test_no_bus_is_wider_than_the_law_allows() -> None:
    widths = [varied_size(BUS, 0.1, seed, "bus")[1] for seed in range(50)]
    assert max(widths) == WIDEST_M
    assert min(widths) < 2.4


def test_traffic_is_planned_for_the_largest() -> None:
    planned = largest({ActorClass.SEDAN: SEDAN}, 0.1)[ActorClass.SEDAN]
    assert planned == pytest.approx((5.225, 2.013, 1.595))
    assert largest({ActorClass.SEDAN: SEDAN}, 0.0) == {ActorClass.SEDAN: SEDAN}


def test_only_sizes_change_where_an_episode_asks_for_them() -> None:
    plain = set_up_episode(EpisodeRequest("S2", seed=3, sensors="none")).plan
    varied = set_up_episode(EpisodeRequest("S2", seed=3, sensors="none", values="demand.variety.size_spread=0.1")).plan
    of_class = {kind: one.length_m for kind, one in load_vehicle_parameters().items()}
    assert all(one.length_m == of_class[one.actor_class] for one in (*plain.emvs, *plain.background))
    everybody = (*varied.emvs, *varied.groups, *varied.background, *varied.reserve)
    shares = [one.length_m / of_class[one.actor_class] for one in everybody]
    assert 0.9 - 1e-3 < min(shares) < 0.95
    assert 1.05 < max(shares) < 1.1 + 1e-3
    assert len(set(shares)) > 0.8 * len(shares)
