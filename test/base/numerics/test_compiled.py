"""Compiled loops are compiled anew when something that they hold changes, in whichever file."""

import math
import subprocess
import sys
import textwrap

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from siren_ros.base.numerics.compiled import box_gap_m, compiled, within, wrapped_rad
from siren_ros.base.numerics.geometry import footprint_corners, separation_m, wrap_angle

_CALLER = """
    from callee import OFFSET, doubled
    from siren_ros.base.numerics.compiled import compiled

    @compiled
    def answer(x: float) -> float:
        return doubled(x) + OFFSET

    print(answer(3.0))
"""
_CALLEE = """
    from siren_ros.base.numerics.compiled import compiled

    OFFSET = {offset}

    @compiled
    def helper(x: float) -> float:
        return {factor} * x

    @compiled
    def doubled(x: float) -> float:
        return helper(x)
"""


def _answer(folder, factor, offset):
    (folder / "callee.py").write_text(textwrap.dedent(_CALLEE.format(factor=factor, offset=offset)))
    # -B: Python's own cache takes a source of the same second and size for the same source.
    done = subprocess.run([sys.executable, "-B", "caller.py"], cwd=folder, capture_output=True, text=True, check=True)
    return float(done.stdout)


def test_changes_in_another_file_are_seen(tmp_path):
    (tmp_path / "caller.py").write_text(textwrap.dedent(_CALLER))
    assert (_answer(tmp_path, factor=2.0, offset=1.0), _answer(tmp_path, factor=4.0, offset=1.0)) == (7.0, 13.0)
    assert _answer(tmp_path, factor=4.0, offset=2.0) == 14.0
    cached = {path.name for path in (tmp_path / "__pycache__").glob("caller.answer*.nbi")}
    assert len(cached) == 3


_NAMED = """
    from parts import Range
    from siren_ros.base.numerics.compiled import compiled

    @compiled
    def lowest(values: Range) -> float:
        return values.low

    print(lowest(Range(low=1.0, high=2.0)))
"""


def test_another_order_of_named_fields_is_seen(tmp_path):
    (tmp_path / "named.py").write_text(textwrap.dedent(_NAMED))
    for fields in ("low: float\n    high: float", "high: float\n    low: float"):
        (tmp_path / "parts.py").write_text(
            f"from typing import NamedTuple\n\n\nclass Range(NamedTuple):\n    {fields}\n"
        )
        command = [sys.executable, "-B", "named.py"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        assert float(done.stdout) == 1.0


@compiled
def _sum(values):
    total = 0.0
    for value in values:
        total += value
    return total


def test_sums_stay_in_the_written_order():
    assert _sum(np.array([1e16, 1.0, -1e16, 1.0])) == 1.0


@given(st.floats(-50.0, 50.0), st.floats(-3.0, 0.0), st.floats(0.0, 3.0))
@example(math.pi, 0.0, 3.0)
@example(-math.pi, -3.0, 0.0)
def test_angles_and_bounds_are_those_of_arrays(value, low, high):
    assert wrapped_rad(value) == wrap_angle(value)
    assert within(value, low, high) == np.clip(value, low, high)


POSES = st.tuples(st.floats(-6.0, 6.0), st.floats(-6.0, 6.0), st.floats(-np.pi, np.pi))
SIZES = st.tuples(st.floats(1.0, 5.0), st.floats(0.5, 1.5))


@given(POSES, POSES, SIZES, SIZES)
def test_the_gap_is_that_of_the_corners(a, b, a_size, b_size):
    pair = []
    for (x, y, yaw), (length, width) in ((a, a_size), (b, b_size)):
        pair.append(footprint_corners(*(np.array([value]) for value in (x, y, yaw, 2.0 * length, 2.0 * width))))
    poses = [(x, y, np.cos(yaw), np.sin(yaw)) for x, y, yaw in (a, b)]
    assert box_gap_m(*poses, *a_size, *b_size) == pytest.approx(float(separation_m(*pair)[0]), abs=1e-9)
