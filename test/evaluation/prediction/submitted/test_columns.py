"""Paths of every known length on the common grid, and rows in words."""

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.prediction.protocol.window import HistoryWindow
from siren_ros.evaluation.prediction.submitted.columns import SubmittedRows, on_grid, refuse


@pytest.mark.parametrize(("points", "period_s"), [(25, 0.2), (30, 0.2), (50, 0.1), (60, 0.1), (80, 0.1)])
def test_the_grid_holds_the_places_at_its_own_times(points: int, period_s: float) -> None:
    """Two vehicles at 10 m/s eastwards and 5 m/s southwards."""
    time = period_s * np.arange(1, points + 1)
    paths = np.stack((np.stack((10.0 * time, 0.0 * time), -1), np.stack((0.0 * time, -5.0 * time), -1)))
    grid = 0.2 * np.arange(1, 26)
    found = on_grid(paths)
    assert found.shape == (2, 25, 2)
    assert found[0] == pytest.approx(np.stack((10.0 * grid, 0.0 * grid), -1))
    assert found[1] == pytest.approx(np.stack((0.0 * grid, -5.0 * grid), -1))


def rows() -> SubmittedRows:
    names = np.array(["a", "b", "c"], dtype=object)
    numbers = np.array([4, 5, 6])
    return SubmittedRows(
        "file", names, numbers, 10 * numbers, np.arange(3), 0.1 * numbers, np.zeros((3, 25, 2)), HistoryWindow()
    )


def test_some_rows_keep_their_columns() -> None:
    some = rows().select(np.array([True, False, True]))
    assert (len(some), some.source, some.window) == (2, "file", HistoryWindow())
    assert some.named(1) == "episode c, actor 6, step 60, mode 2"
    assert some.probability == pytest.approx([0.4, 0.6])
    assert some.xy_m.shape == (2, 25, 2)


def test_the_first_wrong_row_is_named_with_their_number() -> None:
    refuse("file", np.zeros(3, dtype=np.bool_), "rows", rows().named, "none")
    with pytest.raises(InputError, match="file: 2 of 3 rows; the first is episode b, actor 5, step 50, mode 1"):
        refuse("file", np.array([False, True, True]), "rows", rows().named, "none")
