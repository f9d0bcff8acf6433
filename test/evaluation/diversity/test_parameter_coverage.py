import numpy as np
import pytest

from siren_ros.evaluation.diversity.parameter_coverage import DrawnRange, parameter_coverage


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
