from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.generation.differences import MISSING, Mismatch, first_mismatch
from siren_ros.world.actors import Mode

json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=12,
)


@dataclass(frozen=True)
class Table:
    """A structure of arrays with a nested one."""

    name: str
    rows: Any
    inner: Any = ()


TABLE = Table("a", np.array([1.0, 2.0, 3.0]), ({"x": 1}, (2, 3)))


@given(value=json_values)
def test_nothing_differs_from_itself(value: Any) -> None:
    assert first_mismatch(value, value) is None
    assert first_mismatch(Table("a", np.zeros(2), value), Table("a", np.zeros(2), value)) is None


@pytest.mark.parametrize(
    ("other", "mismatch"),
    [
        (replace(TABLE, name="b"), Mismatch(("name",), "a", "b")),
        (replace(TABLE, rows=np.array([1.0, 2.5, 3.5])), Mismatch(("rows", 1), 2.0, 2.5)),
        (replace(TABLE, rows=np.array([1.0, 2.0])), Mismatch(("rows", "length"), 3, 2)),
        (replace(TABLE, inner=({"x": 1}, (2, 4))), Mismatch(("inner", 1, 1), 3, 4)),
        (replace(TABLE, inner=({"x": 1}, (2,))), Mismatch(("inner", 1, 1), 3, MISSING)),
        (replace(TABLE, inner=({"x": 1, "y": None}, (2, 3))), Mismatch(("inner", 0, "y"), MISSING, None)),
        (replace(TABLE, inner=({}, (2, 3))), Mismatch(("inner", 0, "x"), 1, MISSING)),
    ],
)
def test_the_first_difference_has_its_path_and_both_values(other: Table, mismatch: Mismatch) -> None:
    assert first_mismatch(TABLE, other) == mismatch


def test_arrays_of_other_types_differ() -> None:
    found = first_mismatch(np.zeros(3, np.float32), np.zeros(3, np.float64))
    assert found is not None
    assert first_mismatch(np.zeros((2, 3)), np.zeros((3, 2))) is not None


@pytest.mark.parametrize("other", [MISSING, 0.0, [0.0, 0.0], None])
def test_an_array_differs_from_what_is_none(other: Any) -> None:
    array = np.zeros(2)
    for one, two in ((array, other), (other, array)):
        found = first_mismatch({"a": one}, {"a": two})
        assert found is not None
        assert found.path == ("a",)
        assert found.recorded is one


@pytest.mark.parametrize(
    ("one", "other"),
    [(1, 1.0), (0.0, -0.0), (True, 1), ("1", 1), (b"a", "a"), (None, "None"), ({}, []), ("ab", ["a", "b"]), (1, 2)],
)
def test_values_of_another_kind_differ(one: Any, other: Any) -> None:
    assert first_mismatch(one, other) == Mismatch((), one, other)


def test_minus_zero_is_not_zero_and_nan_is_itself() -> None:
    assert first_mismatch(np.array([0.0]), np.array([-0.0])) is not None
    assert first_mismatch(np.array([np.nan]), np.array([np.nan])) is None
    assert first_mismatch({"a": [float("nan")]}, {"a": [float("nan")]}) is None


def test_an_enumeration_is_its_value() -> None:
    assert first_mismatch(Mode.REJOIN, int(Mode.REJOIN)) is None
    assert first_mismatch(Mode.REJOIN, Mode.NOMINAL) is not None


def test_the_name_of_a_path_has_dots() -> None:
    assert Mismatch(("parameters", "request", 0), 1, 2).name == "parameters.request.0"
