import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.evaluation.statistics.holm import holm


def test_the_example_of_four_tests() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


def test_one_test_and_none() -> None:
    assert holm([0.2]) == [0.2]
    assert holm([]) == []


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8))
def test_adjusted_values_are_no_smaller_and_keep_the_order(values: list[float]) -> None:
    adjusted = holm(values)
    assert all(new >= value for value, new in zip(values, adjusted, strict=True))
    order = sorted(range(len(values)), key=lambda index: values[index])
    assert [adjusted[index] for index in order] == sorted(adjusted)
