"""Which samples a row of a table counts: all, a template's, a category's, a level's, those of a parameter's range."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from siren_ros.evaluation.prediction.scoring.categories import Category
from siren_ros.evaluation.prediction.scoring.episode_scores import EpisodeScores
from siren_ros.numerics.arrays import Flags, Floats

_PARTS: Final = 3
"""Ranges of a parameter with many values: low, middle, high, with equally many episodes."""
_EACH_MAX: Final = 4
"""A parameter with at most so many values has a row for each."""


class GroupKind(StrEnum):
    """What the rows of a table differ in."""

    ALL = "all"
    TEMPLATE = "template"
    CATEGORY = "category"
    LEVEL = "level"
    PARAMETER = "parameter"


@dataclass(frozen=True)
class Group:
    """One row."""

    kind: GroupKind
    name: str
    """``S2``, ``held``, ``L3``, ``S2 emv.speed_mps 8.3 to 11.2``."""
    episodes: Flags
    """Which episodes belong to it, shape ``(B,)``."""
    category: Category | None = None
    """Of the samples; None for all."""


def groups_of(scores: Sequence[EpisodeScores]) -> tuple[Group, ...]:
    """Every group of some episodes, in the order of reports."""
    everything = np.ones(len(scores), dtype=np.bool_)
    found = [Group(GroupKind.ALL, "all", everything)]
    found += _by_name(GroupKind.TEMPLATE, [episode.template for episode in scores])
    found += [Group(GroupKind.CATEGORY, one.name.lower(), everything, one) for one in Category]
    found += _by_name(GroupKind.LEVEL, [episode.level.name for episode in scores])
    return (*found, *_by_parameter(scores))


def _by_name(kind: GroupKind, names: Sequence[str]) -> list[Group]:
    return [Group(kind, name, np.array([one == name for one in names])) for name in sorted(set(names))]


def _by_parameter(scores: Sequence[EpisodeScores]) -> Iterator[Group]:
    """Ranges of each number of each template that differs between its episodes."""
    for template in sorted({episode.template for episode in scores}):
        of_template = np.array([episode.template == template for episode in scores])
        for name in sorted({name for episode in scores if episode.template == template for name in episode.parameters}):
            values = np.array([episode.parameters.get(name, np.nan) for episode in scores])
            values[~of_template] = np.nan
            yield from _ranges(f"{template} {name}", values)


def _ranges(name: str, values: Floats) -> Iterator[Group]:
    there = values[~np.isnan(values)]
    different = np.unique(there)
    if len(different) < 2:
        return
    if len(different) <= _EACH_MAX:
        for value in different.tolist():
            yield Group(GroupKind.PARAMETER, f"{name} {value:g}", values == value)
        return
    bounds = np.quantile(there, np.linspace(0.0, 1.0, _PARTS + 1))
    part = np.searchsorted(bounds[1:-1], values, side="left")
    for number in range(_PARTS):
        inside = (part == number) & ~np.isnan(values)
        if inside.any():
            low, high = values[inside].min(), values[inside].max()
            yield Group(GroupKind.PARAMETER, f"{name} {low:.4g} to {high:.4g}", inside)
