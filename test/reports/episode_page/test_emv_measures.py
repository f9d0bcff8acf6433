"""TTC, gaps and delay of the EMVs, row by row."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.reports.episode_page.emv_measures import NOTHING, measures_of_emvs
from siren_ros.scoring.evaluation.yielding.scoring import score_yielding
from siren_ros.simulation.scenario.paper import PAPER_SPEEDS


def test_the_emv_closes_the_gap_to_the_vehicle_ahead(record_of: Callable[..., EpisodeRecord]) -> None:
    """The EMV (6.2 m, from x 10 m at 14 m/s) comes up behind a car (4.6 m, from x 40 m at 6 m/s) in its lane."""
    record = record_of(duration_s=4.0, changing=0)
    ttc_s, gap_m, _ = measures_of_emvs(record)
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


def test_the_delay_grows_with_the_share_that_is_lost(record_of: Callable[..., EpisodeRecord]) -> None:
    """The EMV drives 14 m/s where the template's target speed is the paper's."""
    record = record_of(duration_s=4.0)
    (emv,) = record.emv_ids
    _, _, delay_s = measures_of_emvs(record)
    rows = record.rows_of(emv)
    steps = np.arange(1, len(rows) + 1)
    assert delay_s[rows] == pytest.approx(steps * STEP_S * (1.0 - 14.0 / PAPER_SPEEDS.emv_route_follow_mps))
    assert delay_s[rows][-1] == pytest.approx(score_yielding(record).metrics["emv_delay_s"].value)
    assert (np.delete(delay_s, rows) == NOTHING).all()


def test_a_target_speed_of_nothing_gives_no_delay(record_of: Callable[..., EpisodeRecord]) -> None:
    record = record_of(duration_s=1.0)
    parameters = {**record.description.parameters, "template": {"emv.speed_mps": 0.0}}
    record = replace(record, description=replace(record.description, parameters=parameters))
    assert (np.abs(measures_of_emvs(record)[2]) == NOTHING).all()
