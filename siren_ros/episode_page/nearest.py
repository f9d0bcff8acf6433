"""How close the EMVs come to others at each step, as their measures of conflict say it."""

from typing import Final

import numpy as np

from siren_ros.judging.surrogate_safety import conflict_series
from siren_ros.numerics.arrays import Floats
from siren_ros.recording.episode_record import EpisodeRecord

NOTHING: Final = 9999.0
"""In place of a value: no EMV, nobody else there, or no contact ahead."""


def nearest_of_emvs(record: EpisodeRecord) -> tuple[Floats, Floats]:
    """Least TTC in seconds and least gap of footprints in metres, for each row of the record."""
    ttc_s, gap_m = np.full((2, len(record.rows)), NOTHING)
    for emv_id in record.emv_ids:
        mine = record.rows_of(emv_id)
        if not len(mine):
            continue
        encounters, contacts = conflict_series(record, emv_id)
        row = mine[np.searchsorted(record.rows.step[mine], encounters.step)]
        np.minimum.at(ttc_s, row, contacts.time_s)
        np.minimum.at(gap_m, row, contacts.gap_m)
    return ttc_s, gap_m
