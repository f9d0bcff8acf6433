"""Averages over all choices of n among N, held against trying all choices."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.evaluation.diversity.coverage import (
    DrawnRange,
    expected_kinds,
    expected_nearest,
    kind_coverage,
    parameter_coverage,
)


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


def test_a_range_has_ten_parts_and_a_short_whole_one_a_part_for_each_value() -> None:
    assert DrawnRange(0.0, 1.0, whole=False).parts == 10
    short = DrawnRange(4.0, 6.0, whole=True)
    assert short.parts == 3
    assert short.part_of(np.array([4.0, 5.0, 6.0])).tolist() == [0, 1, 2]
    long = DrawnRange(1.0, 20.0, whole=True)
    assert long.parts == 10
    assert long.part_of(np.array([1.0, 2.0, 3.0, 20.0])).tolist() == [0, 0, 1, 9]


def test_the_ends_of_a_range_and_values_outside_count_for_the_parts_there() -> None:
    drawn = DrawnRange(10.0, 20.0, whole=False)
    assert drawn.part_of(np.array([9.0, 10.0, 10.99, 11.0, 20.0, 30.0])).tolist() == [0, 0, 0, 1, 9, 9]


def test_coverage_counts_the_parts_that_episodes_reach() -> None:
    episodes = [{"a": 0.05, "b": 1.0}, {"a": 0.07, "b": 2.0}, {"a": 0.95, "b": 3.0}]
    ranges = {"a": DrawnRange(0.0, 1.0, whole=False), "fixed": DrawnRange(2.0, 2.0, whole=False)}
    (found,) = parameter_coverage(episodes, ranges)
    assert found.path == "a"
    assert found.counts == (2, *(0,) * 8, 1)
    assert found.share == pytest.approx(0.2)
    # One episode reaches one part of ten; two reach two parts in two of the three choices.
    assert found.curve == pytest.approx([0.1, 0.1 * 5 / 3, 0.2])


def test_a_parameter_that_an_episode_lacks_is_left_out() -> None:
    assert parameter_coverage([{"a": 0.5}, {}], {"a": DrawnRange(0.0, 1.0, whole=False)}) == ()
