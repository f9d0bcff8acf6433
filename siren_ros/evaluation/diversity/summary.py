"""Diversity of the episodes of each template, level and map."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from siren_ros.evaluation.diversity.curves import KindCoverage, expected_nearest, kind_coverage
from siren_ros.evaluation.diversity.distances import distance_matrix, event_distance, way_distance_m
from siren_ros.evaluation.diversity.parameter_coverage import DrawnRange, ParameterCoverage, parameter_coverage
from siren_ros.evaluation.diversity.profile import InteractionProfile
from siren_ros.numerics.arrays import Floats


@dataclass(frozen=True)
class Distances:
    """One kind of distance among N episodes."""

    mean: float
    """Over all pairs; 0 for a single episode."""
    nearest: Floats
    """Of each episode to the nearest other one, how new it is; shape ``(N,)``, NaN for a single episode."""
    curve: Floats
    """Expected distance of one more episode to the nearest of n, n = 1 … N − 1."""


@dataclass(frozen=True)
class GroupDiversity:
    """The episodes of one template, level and map."""

    group: tuple[str, str, str]
    profiles: tuple[InteractionProfile, ...]
    """By seed and draw."""
    parameters: tuple[ParameterCoverage, ...]
    ways: Distances
    """In metres."""
    events: Distances
    """As shares of the longer order of events."""
    transitions: KindCoverage

    @property
    def parameter_share(self) -> float | None:
        """Mean share of the parts of the parameters' ranges that were tried; None where none is drawn."""
        return float(np.mean([one.share for one in self.parameters])) if self.parameters else None


def diversity(
    profiles: Sequence[InteractionProfile], ranges: Mapping[str, Mapping[str, DrawnRange]]
) -> tuple[GroupDiversity, ...]:
    """Diversity of every group.

    Args:
        profiles: The episodes, of any groups.
        ranges: Between what each template's seeds draw its parameters.
    """
    groups: dict[tuple[str, str, str], list[InteractionProfile]] = {}
    for profile in profiles:
        groups.setdefault(profile.group, []).append(profile)
    return tuple(_group(group, found, ranges.get(group[0], {})) for group, found in sorted(groups.items()))


def _group(
    group: tuple[str, str, str], found: Sequence[InteractionProfile], ranges: Mapping[str, DrawnRange]
) -> GroupDiversity:
    ordered = tuple(sorted(found, key=lambda one: (one.seed, one.draw, one.bag)))
    return GroupDiversity(
        group,
        ordered,
        parameter_coverage([one.parameters for one in ordered], ranges),
        _distances(distance_matrix(ordered, way_distance_m)),
        _distances(distance_matrix(ordered, event_distance)),
        kind_coverage([one.transitions for one in ordered]),
    )


def _distances(matrix: Floats) -> Distances:
    count = len(matrix)
    if count < 2:
        return Distances(0.0, np.full(count, np.nan), np.zeros(0))
    others = matrix + np.diag(np.full(count, np.inf))
    return Distances(float(matrix.sum() / (count * (count - 1))), others.min(axis=1), expected_nearest(matrix))
