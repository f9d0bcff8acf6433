"""Diversity of the episodes of each template, level and map, also as JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from siren_ros.evaluation.diversity.coverage import (
    DrawnRange,
    KindCoverage,
    ParameterCoverage,
    expected_nearest,
    kind_coverage,
    parameter_coverage,
)
from siren_ros.evaluation.diversity.profile import InteractionProfile, distance_matrix, event_distance, way_distance_m
from siren_ros.numerics.arrays import Floats
from siren_ros.tables.table import Row, Table


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


_GROUP: Final = ("template", "level", "map")


def diversity_tables(found: Sequence[GroupDiversity]) -> tuple[Table, Table]:
    """The groups, and the novelty of each episode. A group of one episode has no distances and no forecast."""
    groups = Table(
        "groups",
        "Diversity by template, level and map",
        (
            *_GROUP,
            "episodes",
            "ranges tried",
            "ways apart, m",
            "nearest way, m",
            "events apart",
            "nearest events",
            "transitions",
            "next adds",
            "coverage",
        ),
        tuple(map(_row, found)),
        specs={
            "ranges tried": ".0%",
            "ways apart, m": ".1f",
            "nearest way, m": ".1f",
            "next adds": ".1f",
            "coverage": ".0%",
        },
    )
    novelty = Table(
        "novelty",
        "Novelty of each episode: distance to the nearest other one",
        (*_GROUP, "seed", "draw", "nearest way, m", "nearest order of events"),
        tuple(
            (*profile.group, str(profile.seed), profile.draw, float(way), float(event))
            for one in found
            for profile, way, event in zip(one.profiles, one.ways.nearest, one.events.nearest, strict=True)
        ),
        specs={"nearest way, m": ".1f"},
        folded=True,
    )
    return groups, novelty


def _row(one: GroupDiversity) -> Row:
    alone = len(one.profiles) == 1
    return (
        *one.group,
        len(one.profiles),
        one.parameter_share,
        *(
            None if alone else value
            for value in (
                one.ways.mean,
                float(np.mean(one.ways.nearest)),
                one.events.mean,
                float(np.mean(one.events.nearest)),
            )
        ),
        one.transitions.seen,
        None if alone else one.transitions.next_adds,
        None if alone else one.transitions.coverage,
    )


def diversity_as_json(found: GroupDiversity) -> dict[str, Any]:
    """One group, with the novelty of each of its episodes."""
    template, level, map_name = found.group
    return {
        "template": template,
        "level": level,
        "map": map_name,
        "episodes": len(found.profiles),
        "parameters": {
            one.path: {"share": one.share, "episodes_by_part": list(one.counts), "share_by_episodes": _list(one.curve)}
            for one in found.parameters
        },
        "ways_m": _distances_as_json(found.ways),
        "events": _distances_as_json(found.events),
        "transitions": {
            "seen": found.transitions.seen,
            "in_one_episode": found.transitions.once,
            "next_episode_adds": found.transitions.next_adds,
            "coverage": found.transitions.coverage,
            "seen_by_episodes": _list(found.transitions.curve),
        },
        "novelty": [
            {"bag": profile.bag, "seed": profile.seed, "draw": profile.draw, "way_m": _one(way), "events": _one(event)}
            for profile, way, event in zip(found.profiles, found.ways.nearest, found.events.nearest, strict=True)
        ],
    }


def _distances_as_json(found: Distances) -> dict[str, Any]:
    return {"mean": found.mean if len(found.curve) else None, "nearest_by_episodes": _list(found.curve)}


def _list(values: Floats) -> list[float]:
    return [float(value) for value in values]


def _one(value: np.float64) -> float | None:
    return None if np.isnan(value) else float(value)
