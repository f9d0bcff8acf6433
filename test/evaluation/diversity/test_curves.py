"""Averages over all choices of n among N, held against trying all choices."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.evaluation.diversity.curves import expected_kinds, expected_nearest, kind_coverage


@given(st.lists(st.sets(st.integers(0, 5), min_size=1), min_size=1, max_size=5))
def test_expected_kinds_are_the_mean_over_all_choices(episodes: list[set[int]]) -> None:
    kinds = sorted(set().union(*episodes))
    incidences = [sum(kind in episode for episode in episodes) for kind in kinds]
    tried = [
        np.mean([len(set().union(*chosen)) for chosen in combinations(episodes, count)])
        for count in range(1, len(episodes) + 1)
    ]
    assert expected_kinds(incidences, len(episodes)) == pytest.approx(tried)
    assert kind_coverage(episodes).curve == pytest.approx(tried)


@given(st.lists(st.floats(0.0, 100.0), min_size=2, max_size=6))
def test_the_expected_nearest_is_the_mean_over_all_choices_of_others(places: list[float]) -> None:
    matrix = np.abs(np.subtract.outer(places, places))
    count = len(places)
    tried = [
        np.mean(
            [
                min(matrix[one, other] for other in chosen)
                for one in range(count)
                for chosen in combinations([k for k in range(count) if k != one], size)
            ]
        )
        for size in range(1, count)
    ]
    assert expected_nearest(matrix) == pytest.approx(tried, abs=1e-9)


def test_a_single_episode_has_no_nearest() -> None:
    assert expected_nearest(np.zeros((1, 1))).shape == (0,)


def test_what_one_more_episode_adds_is_what_single_episodes_have_alone() -> None:
    found = kind_coverage([{"a", "b"}, {"a", "c"}, {"a", "b", "d"}, {"a"}])
    assert (found.seen, found.once) == (4, 2)
    assert found.next_adds == pytest.approx(2 / 4)
    # Chao and Jost 2012, eq. 10 for incidences: U = 8, T = 4, Q1 = 2, Q2 = 1.
    assert found.coverage == pytest.approx(1.0 - 2 / 8 * (3 * 2 / (3 * 2 + 2 * 1)))


def test_coverage_without_kinds_of_two_episodes_takes_the_other_form() -> None:
    found = kind_coverage([{"a", "b", "c"}, {"a"}, {"a", "d"}])
    assert found.coverage == pytest.approx(1.0 - 3 / 6 * (2 * 2 / (2 * 2 + 2)))


def test_all_is_covered_where_every_kind_comes_again_and_nothing_is_known_of_one_episode() -> None:
    assert kind_coverage([{"a", "b"}, {"a", "b"}]).coverage == 1.0
    assert kind_coverage([{"a", "b"}]).coverage == 0.0
