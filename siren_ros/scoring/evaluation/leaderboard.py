"""A leaderboard: submissions sorted by their mean, each compared with the best one on the same blocks."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.base.tables.interval import Interval
from siren_ros.base.tables.table import Table
from siren_ros.scoring.evaluation.statistics import (
    BlockSums,
    PairedDifference,
    holm,
    interval_of_mean,
    paired_difference,
)

_SEED: Final = 0
"""Seed of the random exchanges of blocks, so that the same submissions give the same table."""


@dataclass(frozen=True)
class Standing:
    """One row of the leaderboard."""

    name: str
    value: Interval
    to_best: PairedDifference | None
    """Difference of this submission to the best one; None for the best one itself."""
    p_adjusted: float | None
    """p-value, adjusted by Holm's method for all comparisons of the table."""


def standings(submissions: Mapping[str, BlockSums], *, less_is_better: bool) -> tuple[Standing, ...]:
    """Sort the submissions, best first.

    Each was scored on the same blocks: episodes, or videos. The test exchanges two submissions within blocks
    (``paired_difference``). Equal means keep the order of the names.

    Raises:
        InputError: Two submissions do not have the same blocks.
    """
    sign = 1.0 if less_is_better else -1.0
    means = {name: interval_of_mean(sums) for name, sums in sorted(submissions.items())}
    order = sorted(means, key=lambda name: (not means[name].valid, sign * means[name].value))
    if not order:
        return ()
    best, others = order[0], order[1:]
    rng = np.random.default_rng(_SEED)
    differences = [paired_difference(submissions[name], submissions[best], rng) for name in others]
    adjusted = holm([difference.p_value for difference in differences])
    return (
        Standing(best, means[best], None, None),
        *(
            Standing(name, means[name], difference, p_value)
            for name, difference, p_value in zip(others, differences, adjusted, strict=True)
        ),
    )


def table_of(rows: tuple[Standing, ...], score: str, blocks: str) -> Table:
    """The standings as a table; ``score`` and ``blocks`` name what was measured and on what."""
    return Table(
        "leaderboard",
        f"{score}; differences to the best with 95 % intervals, p of exchanged {blocks} by Holm's method",
        ("rank", "submission", score, blocks, "difference", "p"),
        tuple(
            (
                str(number),
                row.name,
                row.value,
                row.value.blocks,
                None if row.to_best is None else row.to_best.difference,
                row.p_adjusted,
            )
            for number, row in enumerate(rows, 1)
        ),
        spec=".3f",
        specs={"p": ".4f"},
    )
