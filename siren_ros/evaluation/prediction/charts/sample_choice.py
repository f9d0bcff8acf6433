"""Which samples are drawn: the best, the median and the worst one of each model and template."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.evaluation.prediction.reports.groups import GroupKind
from siren_ros.evaluation.prediction.reports.score_table import ScoreTable

MOVED_MIN_M: Final = 5.0
"""A vehicle that stands is predicted by anybody: only samples that move farther are drawn."""
RANKS: Final = ("best", "median", "worst")


@dataclass(frozen=True)
class ChosenSample:
    """One sample of one model."""

    model: str
    template: str
    rank: str
    episode: int
    """Position of its episode."""
    step: int
    actor_id: int
    ade_m: float


def chosen_samples(table: ScoreTable) -> Iterator[ChosenSample]:
    """Three samples for each template and model by ADE, among those that move; none where none moves."""
    for group in table.of_kind(GroupKind.TEMPLATE):
        for model in table.models:
            samples = table.samples[model]
            rows = np.flatnonzero(samples.of_episodes(group.episodes) & (samples.moved_m >= MOVED_MIN_M))
            if not len(rows):
                continue
            ade = samples.values["ade_m"][rows]
            order = np.argsort(ade, kind="stable")
            for rank, place in zip(RANKS, (0, len(order) // 2, -1), strict=True):
                row = rows[order[place]]
                key = int(samples.key[row])
                yield ChosenSample(
                    model=model,
                    template=group.name,
                    rank=rank,
                    episode=int(samples.episode[row]),
                    step=key >> 32,
                    actor_id=key & 0xFFFFFFFF,
                    ade_m=float(samples.values["ade_m"][row]),
                )
