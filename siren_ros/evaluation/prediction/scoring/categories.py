"""What a vehicle does in the window of a sample: rows of the tables."""

from enum import IntEnum

import numpy as np

from siren_ros.evaluation.prediction.protocol.samples import SampleBatch
from siren_ros.evaluation.prediction.protocol.window import LAST_FUTURE_STEP
from siren_ros.numerics.arrays import Codes
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.world.actors import Mode


class Category(IntEnum):
    """Each sample has one."""

    EMV = 0
    YIELDING = 1
    """A civilian whose window of 5 s holds a step of a yield response; it may begin there."""
    HELD = 2
    """A civilian that stands in the hold of a pull-over at the present."""
    OTHER = 3


def categories_of(record: EpisodeRecord, batch: SampleBatch) -> Codes:
    """Category of each sample of an episode, shape ``(N,)``; from the recorded modes, present and future."""
    rows = record.rows
    category = np.full(len(batch), Category.OTHER, dtype=np.uint8)
    if not len(batch):
        return category
    actor = batch.actors.actor_id[batch.target].astype(np.int64)
    step = batch.step[batch.actors.frame[batch.target]]
    span = int(rows.step.max()) + LAST_FUTURE_STEP + 1
    keys = rows.actor_id.astype(np.int64) * span + rows.step
    now = np.searchsorted(keys, actor * span + step)
    end = np.searchsorted(keys, actor * span + step + LAST_FUTURE_STEP, side="right")
    yielding = (rows.mode >= Mode.YIELD_REACTING) & (rows.mode <= Mode.YIELD_HOLD)
    before = np.concatenate(([0], np.cumsum(yielding)))
    category[before[end] > before[now]] = Category.YIELDING
    category[rows.mode[now] == Mode.YIELD_HOLD] = Category.HELD
    category[batch.actors.is_emv[batch.target]] = Category.EMV
    return category
