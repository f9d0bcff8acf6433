"""Scores of all models in all groups of samples, with intervals over episodes, and differences between models."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache, cached_property
from itertools import combinations
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Brief, Flags, Floats, Rows
from siren_ros.base.tables import NOTHING, Interval, Row, Table
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.metrics import BINS, METRIC_OF, METRICS, Metric, calibration_error
from siren_ros.scoring.evaluation.prediction.predictors import is_simple
from siren_ros.scoring.evaluation.prediction.samples import FUTURE_POINTS
from siren_ros.scoring.evaluation.prediction.scoring import Category, EpisodeScores, ModelScores, Trait
from siren_ros.scoring.evaluation.scores import Score, frame_of, with_holm
from siren_ros.scoring.evaluation.statistics import (
    BlockSums,
    block_sums,
    interval_of_mean,
    jackknife,
    paired_difference,
)
from siren_ros.scoring.judging.outcome import NAMES

_PARTS: Final = 3
"""Number of ranges for a parameter with many values: low, middle, high, with equally many episodes."""
_VALUES_MAX: Final = 4
"""A parameter with at most this many values gets a row per value."""


class GroupKind(StrEnum):
    """Criterion by which the rows of a table are grouped."""

    ALL = "all"
    TEMPLATE = "template"
    CATEGORY = "category"
    SUBSET = "subset"
    """Subset of the civilians; a sample may belong to several."""
    LEVEL = "level"
    PEOPLE = "people"
    PARAMETER = "parameter"


@dataclass(frozen=True)
class Group(Brief):
    """One group of samples: a row of a table."""

    kind: GroupKind
    name: str
    """Name of the group: ``S2``, ``held``, ``L3``, ``S2 emv.speed_mps 8.3 to 11.2``."""
    episodes: Flags
    """Which episodes belong to the group, shape ``(B,)``."""
    category: int | None = None
    """Category of its samples (for people their class); None for all."""
    members: Callable[[ModelScores], Flags] | None = None
    """Selects the samples of the group; None for all."""


def _civilians(scores: ModelScores) -> Flags:
    return np.asarray(scores.category != Category.EMV)


SUBSETS: Final[Mapping[str, Callable[[ModelScores], Flags]]] = {
    "civilians": _civilians,
    "moving civilians": lambda scores: _civilians(scores) & (scores.traits & Trait.MOVING > 0),
    "yield or hold": lambda scores: np.isin(scores.category, (Category.YIELDING, Category.HELD)),
    "manoeuvre begins": lambda scores: _civilians(scores) & (scores.traits & Trait.BEGINS > 0),
}
"""Subsets of civilians by what a model must know of them. In the last ones the civilian begins to yield, or drives on,
within the horizon."""


def groups_of(scores: Sequence[EpisodeScores]) -> tuple[Group, ...]:
    """All groups of some episodes, in the order of reports."""
    everything, with_people = np.ones(len(scores), dtype=np.bool_), any(episode.people for episode in scores)
    templates, levels = ([getattr(episode, kind) for episode in scores] for kind in ("template", "level"))
    return (
        Group(GroupKind.ALL, "all", everything),
        *(Group(GroupKind.TEMPLATE, name, np.array(templates) == name) for name in sorted(set(templates))),
        *(Group(GroupKind.CATEGORY, category.name.lower(), everything, category) for category in Category),
        *(Group(GroupKind.SUBSET, name, everything, members=members) for name, members in SUBSETS.items()),
        *(Group(GroupKind.LEVEL, level.name, np.array(levels) == level) for level in sorted(set(levels))),
        *(Group(GroupKind.PEOPLE, name, everything, kind) for kind, name in NAMES.items() if with_people),
        *_by_parameter(scores),
    )


def _by_parameter(scores: Sequence[EpisodeScores]) -> Iterator[Group]:
    """Groups by ranges of each template parameter that differs between its episodes."""
    for template in sorted({episode.template for episode in scores}):
        of_template = np.array([episode.template == template for episode in scores])
        for name in sorted({name for episode in scores if episode.template == template for name in episode.parameters}):
            values = np.array([episode.parameters.get(name, np.nan) for episode in scores])
            values[~of_template] = np.nan
            yield from _ranges(f"{template} {name}", values)


def _ranges(name: str, values: Floats) -> Iterator[Group]:
    known = values[~np.isnan(values)]
    different = np.unique(known)
    if len(different) < 2:
        return
    if len(different) <= _VALUES_MAX:
        for value in different.tolist():
            yield Group(GroupKind.PARAMETER, f"{name} {value:g}", values == value)
        return
    bounds = np.quantile(known, np.linspace(0.0, 1.0, _PARTS + 1))
    part = np.searchsorted(bounds[1:-1], values, side="left")
    for number in range(_PARTS):
        inside = (part == number) & ~np.isnan(values)
        if inside.any():
            low, high = values[inside].min(), values[inside].max()
            yield Group(GroupKind.PARAMETER, f"{name} {low:.4g} to {high:.4g}", inside)


@dataclass(frozen=True)
class SampleTable(ModelScores):
    """Samples of one model in all episodes."""

    episode: Rows
    """Index of the sample's episode, shape ``(N,)``."""

    @property
    def coverage(self) -> float:
        """Share of the population's samples that were scored; 1 if there are no samples."""
        return len(self) / self.population_size if self.population_size else 1.0


def sample_table(parts: Mapping[int, ModelScores]) -> SampleTable:
    """Join the samples of one model from its scores by episode index; at least one episode."""
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts.values()])
        for name in ("step", "actor_id", "category", "traits", "moved_m")
    }
    return SampleTable(
        **columns,
        values={
            metric.name: np.concatenate([part.values[metric.name] for part in parts.values()]) for metric in METRICS
        },
        distance_sum_m=sum((part.distance_sum_m for part in parts.values()), np.zeros(FUTURE_POINTS)),
        reliability=sum((part.reliability for part in parts.values()), np.zeros((3, BINS))),
        population_size=sum(part.population_size for part in parts.values()),
        episode=np.repeat(list(parts), [len(part) for part in parts.values()]),
    )


_OF_SOME_VEHICLES: Final = (GroupKind.CATEGORY, GroupKind.SUBSET, GroupKind.PEOPLE)
_PARAMETER_METRICS: Final = frozenset({"ade_m", "fde_m"})
"""The only metrics in the many rows by parameter."""


@dataclass(frozen=True)
class ScoreTable(Brief):
    """All scores of an evaluation."""

    episodes: tuple[EpisodeScores, ...]
    models: tuple[str, ...]
    groups: tuple[Group, ...]
    samples: Mapping[str, SampleTable]
    """Samples by model."""
    cells: Mapping[tuple[str, str, str], Score]
    """Scores by model, name of the group, and metric."""

    def facts(self) -> dict[str, object]:
        """What was scored, and the mean ADE of each model, as plain values."""
        values = {f"{model} ade_m": self.value(model, GroupKind.ALL, "ade_m") for model in self.models}
        return {
            "episodes": len(self.episodes),
            "templates": ", ".join(group.name for group in self.of_kind(GroupKind.TEMPLATE)),
            "groups": len(self.groups),
            "population": self.episodes[0].population.value,
            **values,
        }

    def _repr_html_(self) -> str:
        """Table with ADE and FDE of each model in each template, and the intervals of ADE."""
        groups = (*self.of_kind(GroupKind.TEMPLATE), *self.of_kind(GroupKind.ALL))
        rows: tuple[Row, ...] = tuple(
            (model, *(tuple(self.cells[model, group.name, metric].interval for metric in CLAIMED) for group in groups))
            for model in self.models
        )
        caption = f"ADE/FDE in m [95 % intervals], {len(self.episodes)} episodes"
        return Table("scores", caption, ("model", *(group.name for group in groups)), rows).html()

    def of_kind(self, kind: GroupKind) -> tuple[Group, ...]:
        """The groups of one kind; those of ``template`` are named as the templates are.

        Raises:
            InputError: There is no such kind.
        """
        _check("kind", kind, [*GroupKind])
        return tuple(group for group in self.groups if group.kind == kind)

    def value(self, model: str, group: str, metric: str) -> float | None:
        """Look up one value of the table.

        Args:
            model: One of ``models``.
            group: Name of one of ``groups``: ``all``, a template, a level, a category or another one.
            metric: Such as ``ade_m`` or ``min_fde_6_m``; the error names all.

        Returns:
            The mean. None where there is none: the group has no samples of the model, or the metric says nothing of
            them. A metric of whole frames says nothing of some of their vehicles, and groups by a parameter of a
            template have ``ade_m`` and ``fde_m`` alone.

        Raises:
            InputError: A name is unknown.
        """
        _check("model", model, self.models)
        _check("group", group, [known.name for known in self.groups])
        _check("metric", metric, METRIC_OF)
        cell = self.cells.get((model, group, metric))
        return None if cell is None else cell.value

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame`` with a row for each model, group and metric.

        Its columns are ``model``, ``kind`` (of the group), ``group``, ``metric``, ``value``, ``low`` and ``high`` (of
        the 95 % interval), ``episodes`` and ``samples``. NaN stands where there is no value or no interval.

        Raises:
            InputError: pandas is not installed.
        """
        return frame_of(self.cells.values())

    @cached_property
    def claims(self) -> tuple[Score, ...]:
        """Difference of each model that is not simple to the best simple baseline, over all templates and in each.

        The best is the one with the least error on these very samples, which favours the baseline.
        """
        simple = [model for model in self.models if is_simple(model)]
        others = [model for model in self.models if model not in simple]
        return tuple(claim for model in others for claim in _claims_of(self, model, simple))


def _check(parameter: str, name: str, known: Collection[str]) -> None:
    if name not in known:
        raise InputError(parameter, name, f"one of {', '.join(known)}")


def score_table(scores: Sequence[EpisodeScores]) -> ScoreTable:
    """Score some episodes: at least one, all with the same models."""
    models = tuple(scores[0].models)
    samples = {model: sample_table({n: one.models[model] for n, one in enumerate(scores)}) for model in models}
    with_people = {n: one.people for n, one in enumerate(scores) if one.people}
    people = {model: sample_table({n: of[model] for n, of in with_people.items()}) for model in models if with_people}
    groups = groups_of(scores)
    stratum = strata(scores)
    cells: dict[tuple[str, str, str], Score] = {}
    for model in models:
        for group in groups:
            table = people[model] if group.kind is GroupKind.PEOPLE else samples[model]
            chosen = group.episodes[table.episode]
            if group.category is not None:
                chosen &= table.category == group.category
            if group.members is not None:
                chosen &= group.members(table)
            for metric in METRICS:
                if group.kind is GroupKind.PARAMETER and metric.name not in _PARAMETER_METRICS:
                    continue
                if metric.of_frames and group.kind in _OF_SOME_VEHICLES:
                    continue
                sums = sums_of(table, metric, chosen, stratum)
                about = (group.kind.value, group.name, metric.name)
                score = Score(model, *about, interval_of_mean(sums), int(sums.count.sum()))
                cells[model, group.name, metric.name] = score
    return ScoreTable(tuple(scores), models, groups, samples, cells)


def calibration_interval(table: ScoreTable, model: str) -> Interval:
    """Calibration error of a model, with the jackknife's interval over episodes."""
    counts = np.array([episode.models[model].reliability for episode in table.episodes])
    error = calibration_error(counts.sum(axis=0)).value
    if error is None:
        return NOTHING
    left_out = [calibration_error(counts.sum(axis=0) - of_episode).value for of_episode in counts]
    values = np.array([np.nan if value is None else value for value in left_out])
    return jackknife(error, values, strata(table.episodes)).interval()


def strata(scores: Sequence[EpisodeScores]) -> Rows:
    """Number of each episode's template, shape ``(B,)``."""
    return np.unique([episode.template for episode in scores], return_inverse=True)[1].astype(np.intp)


def sums_of(table: SampleTable, metric: Metric, chosen: Flags | Rows, stratum: Rows) -> BlockSums:
    """Sums of a metric over the episodes, for some samples."""
    return block_sums(table.values[metric.name][chosen], table.episode[chosen], stratum, metric.of_mean)


COMPARED: Final = ("ade_m", "fde_m", "min_ade_6_m", "min_fde_6_m")


def differences(table: ScoreTable, seed: int = 0) -> tuple[Score, ...]:
    """Compare all pairs of models on their common samples by all compared metrics, over all templates and in each."""
    pairs = list(combinations(table.models, 2))
    common = {pair: common_rows(*(table.samples[model] for model in pair)) for pair in pairs}
    rows: list[Score] = []
    for metric in COMPARED:
        for group in (*table.of_kind(GroupKind.ALL), *table.of_kind(GroupKind.TEMPLATE)):
            rows += with_holm([_compared(table, pair, common[pair], metric, group, seed) for pair in pairs])
    return tuple(rows)


def _compared(
    table: ScoreTable, pair: tuple[str, str], common: tuple[Rows, Rows], metric: str, group: Group, seed: int
) -> Score:
    """Difference of two models on their common samples of a group."""
    sums = []
    for model, rows in zip(pair, common, strict=True):
        samples = table.samples[model]
        chosen = rows[group.episodes[samples.episode[rows]]]
        sums.append(sums_of(samples, METRIC_OF[metric], chosen, strata(table.episodes)))
    first, second = sums
    difference, p_value = paired_difference(first, second, np.random.default_rng(seed))
    about = (group.kind.value, group.name, metric)
    return Score(pair[0], *about, difference, int(first.count.sum()), pair[1], p_value)


CLAIMED: Final = ("ade_m", "fde_m")


def _claims_of(table: ScoreTable, model: str, simple: Sequence[str], seed: int = 0) -> Iterator[Score]:
    common = cache(lambda best: common_rows(table.samples[model], table.samples[best]))
    for metric in CLAIMED:
        found = []
        for group in (*table.of_kind(GroupKind.ALL), *table.of_kind(GroupKind.TEMPLATE)):
            errors = {name: error for name in simple if (error := table.value(name, group.name, metric)) is not None}
            if errors:
                best = min(errors, key=errors.__getitem__)
                found.append(_compared(table, (model, best), common(best), metric, group, seed))
        yield from with_holm([claim for claim in found if claim.interval.valid])


def beaten(table: ScoreTable, claim: Score) -> tuple[float, float]:
    """Error of a claim's baseline over all its samples, and the difference as its share: −0.2 means 20 % less."""
    error = table.cells[claim.against, claim.group, claim.metric].interval.value
    return error, claim.interval.value / error if error else 0.0


def common_rows(first: SampleTable, second: SampleTable) -> tuple[Rows, Rows]:
    """Rows of the samples that both models have, in the same order."""
    keys, other_keys = (np.rec.fromarrays((table.episode, table.step, table.actor_id)) for table in (first, second))
    return np.intersect1d(keys, other_keys, assume_unique=True, return_indices=True)[1:]
