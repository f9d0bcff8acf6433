"""Compiled arithmetic of single numbers is that of arrays."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.numerics.geometry import wrap_angle
from siren_ros.numerics.scalars import within, wrapped_rad


@given(st.floats(-50.0, 50.0))
def test_it_is_that_of_arrays(angle_rad: float) -> None:
    assert wrapped_rad(angle_rad) == wrap_angle(angle_rad)


@pytest.mark.parametrize("turns", [-3, -1, 1, 5])
def test_half_a_turn_is_positive(turns: int) -> None:
    assert wrapped_rad(turns * math.pi) == pytest.approx(math.pi, abs=1e-12)


@given(st.floats(-5.0, 5.0), st.floats(-3.0, 0.0), st.floats(0.0, 3.0))
def test_bounds_are_kept_as_for_arrays(value: float, low: float, high: float) -> None:
    assert within(value, low, high) == np.clip(value, low, high)
