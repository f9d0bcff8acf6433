"""The scores of all tasks as rows of one long table, and their files, data frames and leaderboards.

A row is one metric of a model in a group, or its difference to another model's. All tasks have the same columns.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, Self

import numpy as np

from siren_ros.base.numerics.arrays import data_frame
from siren_ros.base.tables import NOTHING, Interval, Table, csv_text, interval_of_json
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.statistics import BlockSums, holm, interval_of_mean, paired_difference

ALL: Final = "all"
"""Kind and name of the group that has everything."""
TEMPLATE: Final = "template"
"""Kind of the groups that are templates."""


@dataclass(frozen=True)
class Score:
    """One row."""

    model: str
    """Model, detector, submission or level."""
    kind: str
    """Criterion of the group, such as ``template``."""
    group: str
    metric: str
    interval: Interval
    """Value of the metric; for a difference the model's value minus the other's."""
    samples: int
    """Number of samples, labels, videos or pairs."""
    against: str = ""
    """The other model of a difference; empty for a value."""
    p_value: float = 1.0
    """p-value of a difference by the permutation test."""
    p_adjusted: float = 1.0
    """p-value by Holm's correction over the differences that belong together."""
    cut_off: int = 0
    """Number of pairs of a difference in which a value is only a lower bound, because the episode ended early."""

    @property
    def value(self) -> float | None:
        """The value without its interval; None if there is none."""
        return self.interval.value if self.interval.valid else None

    def json(self) -> dict[str, Any]:
        """The row as JSON types, by columns; the columns of differences only for a difference."""
        about = {"model": self.model, "kind": self.kind, "group": self.group, "metric": self.metric}
        row = {**about, **self.interval.json(), "samples": self.samples}
        if not self.against:
            return row
        tested = {"p": self.p_value, "p_holm": self.p_adjusted, "cut_off": self.cut_off}
        return {**row, "against": self.against, **tested}


@dataclass(frozen=True)
class Scores:
    """Rows with values, found by what they are of."""

    rows: tuple[Score, ...]

    @classmethod
    def of_json(cls, content: Mapping[str, Any]) -> Self:
        """The ``rows`` of a file of scores; InputError if it has none."""
        try:
            rows = content["rows"]
            places = [(row["model"], row["kind"], row["group"], row["metric"]) for row in rows]
            values = [(interval_of_json(row), row["samples"]) for row in rows]
            return cls(tuple(Score(*place, *value) for place, value in zip(places, values, strict=True)))
        except (KeyError, TypeError, AttributeError) as error:
            raise InputError("scores", repr(error), "rows of scores, as `siren evaluate` writes them") from error

    @cached_property
    def by_place(self) -> Mapping[tuple[str, str, str, str], Score]:
        """The rows by model, kind of group, group and metric."""
        return {(row.model, row.kind, row.group, row.metric): row for row in self.rows}

    @cached_property
    def models(self) -> tuple[str, ...]:
        """The models, in the order of the rows."""
        return tuple(dict.fromkeys(row.model for row in self.rows))

    def groups(self, *kinds: str) -> tuple[tuple[str, str], ...]:
        """Kind and name of the groups of some kinds, or of all, in the order of the rows."""
        return tuple(dict.fromkeys((row.kind, row.group) for row in self.rows if not kinds or row.kind in kinds))

    def interval(self, model: str, kind: str, group: str, metric: str) -> Interval:
        """A value with its interval; ``NOTHING`` if there is no such row."""
        row = self.by_place.get((model, kind, group, metric))
        return NOTHING if row is None else row.interval

    def value(self, model: str, kind: str, group: str, metric: str) -> float | None:
        """A value alone; None if there is no such row."""
        row = self.by_place.get((model, kind, group, metric))
        return None if row is None else row.value


def single(value: float | None, blocks: int = 1) -> Interval:
    """A value without bounds; ``NOTHING`` for None and NaN."""
    return NOTHING if value is None or math.isnan(value) else Interval(value, value, value, blocks, scatter_known=False)


_OF_VALUES: Final = ("model", "kind", "group", "metric", "value", "low", "high", "episodes", "samples")
_OF_DIFFERENCES: Final = (*_OF_VALUES, "against", "p", "p_holm", "cut_off")


def csv_of(rows: Iterable[Score], *, differences: bool = False) -> str:
    """Values, or differences, as CSV with a head; a missing value or bound is an empty cell."""
    head = _OF_DIFFERENCES if differences else _OF_VALUES
    return csv_text(head, [tuple(row.json().values()) for row in rows])


def frame_of(rows: Iterable[Score]) -> Any:
    """Rows as a ``pandas.DataFrame``; NaN stands for a missing value or bound. InputError without pandas."""
    content = [row.json() for row in rows]
    missing = {None: np.nan}
    return data_frame({name: [missing.get(row[name], row[name]) for row in content] for name in content[0]})


def with_holm(rows: Sequence[Score]) -> list[Score]:
    """Differences with their p-values adjusted for each other."""
    adjusted = holm([row.p_value for row in rows])
    return [replace(row, p_adjusted=p_value) for row, p_value in zip(rows, adjusted, strict=True)]


_SEED: Final = 0
"""Seed of the random exchanges of blocks, so that the same submissions give the same table."""


def standings(submissions: Mapping[str, BlockSums], metric: str, *, less_is_better: bool) -> tuple[Score, ...]:
    """The rows of a leaderboard: all submissions, best first, then the difference of each other one to the best.

    Each was scored on the same blocks: episodes, or videos. The test exchanges two submissions within blocks
    (``paired_difference``). Equal means keep the order of the names.

    Raises:
        InputError: Two submissions do not have the same blocks.
    """
    sign = 1.0 if less_is_better else -1.0
    means = {name: interval_of_mean(sums) for name, sums in sorted(submissions.items())}
    order = sorted(means, key=lambda name: sign * means[name].value)
    rng = np.random.default_rng(_SEED)
    values = [Score(name, ALL, ALL, metric, means[name], means[name].blocks) for name in order]
    differences = []
    for name in order[1:]:
        difference, p_value = paired_difference(submissions[name], submissions[order[0]], rng)
        differences.append(Score(name, ALL, ALL, metric, difference, difference.blocks, order[0], p_value))
    return (*values, *with_holm(differences))


def leaderboard(rows: Sequence[Score], blocks: str) -> Table:
    """The standings as a table; ``blocks`` names what was scored."""
    to_best = {row.model: row for row in rows if row.against}
    cells = []
    for number, row in enumerate((row for row in rows if not row.against), 1):
        other = to_best.get(row.model)
        tested = (None, None) if other is None else (other.interval, other.p_adjusted)
        cells.append((str(number), row.model, row.interval, row.samples, *tested))
    score = rows[0].metric
    caption = f"{score}; differences to the best with 95 % intervals, p of exchanged {blocks} by Holm's method"
    head = ("rank", "submission", score, blocks, "difference", "p")
    return Table("leaderboard", caption, head, tuple(cells), spec=".3f", specs={"p": ".4f"})
