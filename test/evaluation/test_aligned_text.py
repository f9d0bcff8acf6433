"""Columns of equal width."""

from siren_ros.evaluation.aligned_text import aligned


def test_columns_are_as_wide_as_their_widest_cell() -> None:
    assert aligned([["model", "n"], ["a", "12"], ["", ""]]) == ["model  n", "a      12", ""]
