"""Looking actors up by id."""

import numpy as np
import numpy.typing as npt
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.numerics.arrays import Ids
from siren_ros.world.actors import rows_of_ids

_ids = st.sets(st.integers(1, 40), max_size=12).map(lambda found: np.array(sorted(found), np.uint32))


@given(present=_ids, wanted=st.lists(st.integers(1, 45), max_size=12).map(lambda ids: np.array(ids, np.uint32)))
def test_rows_hold_the_wanted_ids_or_are_minus_one(present: Ids, wanted: Ids) -> None:
    rows = rows_of_ids(present, wanted)
    assert rows.dtype == np.intp
    listed = present.tolist()
    assert rows.tolist() == [listed.index(one) if one in listed else -1 for one in wanted.tolist()]


@given(present=_ids)
def test_the_same_ids_are_the_rows_in_order(present: npt.NDArray[np.uint32]) -> None:
    assert rows_of_ids(present, present.copy()).tolist() == list(range(len(present)))
