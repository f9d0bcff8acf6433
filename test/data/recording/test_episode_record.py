"""Rows and tracks of a record made by hand."""

import numpy as np
import pytest
from hand_made_record import EASTBOUND, EMV, NORTHBOUND, Driven, at_speed, crossing, hand_made

from siren_ros.errors import InputError

RECORD = hand_made(
    crossing(),
    {EMV: Driven(NORTHBOUND, at_speed(10.0, 8.0, 6)), 2: Driven(EASTBOUND, at_speed(5.0, 4.0, 3), first_step=2)},
    lambda step: "rG" if step < 4 else "Gr",
)


def test_a_track_has_the_steps_times_and_speeds_of_one_actor():
    track = RECORD.track(2)
    assert track.step.tolist() == [2, 3, 4]
    assert track.time_s == pytest.approx([0.1, 0.15, 0.2])
    assert track.speed_mps == pytest.approx([4.0] * 3)
    assert track.xy_m[:, 0] == pytest.approx(-110.0 + 5.0 + 0.2 * np.arange(3))
    assert set(track.actor_id.tolist()) == {2}


def test_rows_are_sorted_by_actor_and_then_by_step():
    rows = RECORD.rows
    assert rows.actor_id.tolist() == [EMV] * 6 + [2] * 3
    assert rows.step.tolist() == [0, 1, 2, 3, 4, 5, 2, 3, 4]
    assert RECORD.rows_of(EMV).tolist() == [0, 1, 2, 3, 4, 5]
    assert RECORD.rows_of(2).tolist() == [6, 7, 8]
    assert len(RECORD.rows_of(7)) == 0
    assert rows.select(rows.step == 3).actor_id.tolist() == [EMV, 2]


def test_steps_and_signals():
    assert RECORD.steps == 6
    assert RECORD.signal_states("J") == {step: "rG" if step < 4 else "Gr" for step in range(6)}
    with pytest.raises(InputError, match=r"signal_id: 'K' .*one of J"):
        RECORD.signal_states("K")
