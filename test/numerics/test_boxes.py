"""The gap of single boxes against that of arrays of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.numerics.boxes import box_gap_m
from siren_ros.numerics.geometry import footprint_corners, separation_m

POSES = st.tuples(st.floats(-6.0, 6.0), st.floats(-6.0, 6.0), st.floats(-np.pi, np.pi))
SIZES = st.tuples(st.floats(1.0, 5.0), st.floats(0.5, 1.5))


@given(POSES, POSES, SIZES, SIZES)
def test_the_gap_is_that_of_the_corners(a, b, a_size, b_size):
    pair = []
    for (x, y, yaw), (length, width) in ((a, a_size), (b, b_size)):
        columns = (np.array([value]) for value in (x, y, yaw, 2.0 * length, 2.0 * width))
        pair.append(footprint_corners(*columns))
    poses = [(x, y, np.cos(yaw), np.sin(yaw)) for x, y, yaw in (a, b)]
    assert box_gap_m(*poses, *a_size, *b_size) == pytest.approx(float(separation_m(*pair)[0]), abs=1e-9)
