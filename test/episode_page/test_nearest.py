"""TTC and gaps of the EMVs, row by row."""

from collections.abc import Callable

import numpy as np
import pytest

from siren_ros.episode_page.nearest import NOTHING, nearest_of_emvs
from siren_ros.recording.episode_record import EpisodeRecord


def test_the_emv_closes_the_gap_to_the_vehicle_ahead(record_of: Callable[..., EpisodeRecord]) -> None:
    """The EMV (6.2 m, from x 10 m at 14 m/s) comes up behind a car (4.6 m, from x 40 m at 6 m/s) in its lane."""
    record = record_of(duration_s=4.0, changing=0)
    ttc_s, gap_m = nearest_of_emvs(record)
    (emv,) = record.emv_ids
    rows = record.rows_of(emv)
    step = record.rows.step[rows]
    expected_m = 30.0 - 8.0 * 0.05 * step - (6.2 + 4.6) / 2.0
    apart = expected_m > 0.0
    assert gap_m[rows][apart] == pytest.approx(expected_m[apart], abs=1e-3)
    soon = apart & (expected_m / 8.0 < 2.9)
    assert ttc_s[rows][soon] == pytest.approx(expected_m[soon] / 8.0, abs=1e-3)
    assert (ttc_s[rows][expected_m / 8.0 > 3.1] == NOTHING).all()
    others = np.setdiff1d(np.arange(len(record.rows)), rows)
    assert (ttc_s[others] == NOTHING).all()
    assert (gap_m[others] == NOTHING).all()
