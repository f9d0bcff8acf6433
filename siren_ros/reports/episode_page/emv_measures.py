"""Measures of the EMVs at each step: how close they come to others, and their lost time, as the metrics define them."""

from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.scoring.evaluation.yielding.metrics import lost_shares
from siren_ros.scoring.judging.surrogate_safety import conflict_series

NOTHING: Final = 9999.0
"""Stands for a missing value: no EMV, no other actor, or no predicted contact."""


def measures_of_emvs(record: EpisodeRecord) -> tuple[Floats, Floats, Floats]:
    """For each row of the record: smallest TTC in seconds, smallest gap in metres, delay so far in seconds."""
    ttc_s, gap_m, delay_s = np.full((3, len(record.rows)), NOTHING)
    for seen in record.by_emv():
        mine = record.rows_of(emv_id := seen.emv_ids[0])
        if not len(mine):
            continue
        encounters, contacts = conflict_series(record, emv_id)
        row = mine[np.searchsorted(record.rows.step[mine], encounters.step)]
        np.minimum.at(ttc_s, row, contacts.time_s)
        np.minimum.at(gap_m, row, contacts.gap_m)
        with np.errstate(all="ignore"):  # a record of another program may have any target speed
            lost_s = np.cumsum(lost_shares(seen)) * STEP_S
        delay_s[mine] = np.nan_to_num(lost_s, nan=NOTHING).clip(-NOTHING, NOTHING)
    return ttc_s, gap_m, delay_s
