"""Diversity of the episodes of each template, level and map, also as JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
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
        return float(np.mean([parameter.share for parameter in self.parameters])) if self.parameters else None


def diversity(
    profiles: Sequence[InteractionProfile], ranges: Mapping[str, Mapping[str, DrawnRange]]
) -> tuple[GroupDiversity, ...]:
    """Diversity of every group; ``ranges`` are those that each template's seeds draw its parameters from."""
    groups: dict[tuple[str, str, str], list[InteractionProfile]] = {}
    for profile in profiles:
        groups.setdefault(profile.group, []).append(profile)
    return tuple(_group(group, members, ranges.get(group[0], {})) for group, members in sorted(groups.items()))


def _group(
    group: tuple[str, str, str], members: Sequence[InteractionProfile], ranges: Mapping[str, DrawnRange]
) -> GroupDiversity:
    profiles = tuple(sorted(members, key=lambda profile: (profile.seed, profile.draw, profile.bag)))
    parameters = parameter_coverage([profile.parameters for profile in profiles], ranges)
    ways, events = (_distances(distance_matrix(profiles, kind)) for kind in (way_distance_m, event_distance))
    transitions = kind_coverage([profile.transitions for profile in profiles])
    return GroupDiversity(group, profiles, parameters, ways, events, transitions)


def _distances(matrix: Floats) -> Distances:
    count = len(matrix)
    if count < 2:
        return Distances(0.0, np.full(count, np.nan), np.zeros(0))
    others = matrix + np.diag(np.full(count, np.inf))
    return Distances(float(matrix.sum() / (count * (count - 1))), others.min(axis=1), expected_nearest(matrix))


_GROUP: Final = ("template", "level", "map")


def diversity_tables(diversities: Sequence[GroupDiversity]) -> tuple[Table, Table]:
    """The groups, and the novelty of each episode. A group of one episode has no distances and no forecast."""
    distances = ("ways apart, m", "nearest way, m", "events apart", "nearest events")
    groups = Table(
        "groups",
        "Diversity by template, level and map",
        (*_GROUP, "episodes", "ranges tried", *distances, "transitions", "next adds", "coverage"),
        tuple(map(_row, diversities)),
        specs={"ranges tried": ".0%", "coverage": ".0%", **dict.fromkeys((*distances[:2], "next adds"), ".1f")},
    )
    novelty = Table(
        "novelty",
        "Novelty of each episode: distance to the nearest other one",
        (*_GROUP, "seed", "draw", "nearest way, m", "nearest order of events"),
        tuple(
            (*profile.group, str(profile.seed), profile.draw, float(way), float(event))
            for group in diversities
            for profile, way, event in zip(group.profiles, group.ways.nearest, group.events.nearest, strict=True)
        ),
        specs={"nearest way, m": ".1f"},
        folded=True,
    )
    return groups, novelty


def _row(group: GroupDiversity) -> Row:
    seen, adds, coverage = group.transitions.seen, group.transitions.next_adds, group.transitions.coverage
    named = *group.group, len(group.profiles), group.parameter_share
    if len(group.profiles) == 1:
        return *named, *[None] * 4, seen, None, None
    distances = ((kind.mean, float(np.mean(kind.nearest))) for kind in (group.ways, group.events))
    return *named, *chain.from_iterable(distances), seen, adds, coverage


def diversity_as_json(diverse: GroupDiversity) -> dict[str, Any]:
    """One group, with the novelty of each of its episodes."""
    transitions = diverse.transitions
    novelty = zip(diverse.profiles, diverse.ways.nearest.tolist(), diverse.events.nearest.tolist(), strict=True)
    return {
        **dict(zip(_GROUP, diverse.group, strict=True)),
        "episodes": len(diverse.profiles),
        "parameters": {
            parameter.path: {
                "share": parameter.share,
                "episodes_by_part": list(parameter.counts),
                "share_by_episodes": parameter.curve.tolist(),
            }
            for parameter in diverse.parameters
        },
        "ways_m": _distances_as_json(diverse.ways),
        "events": _distances_as_json(diverse.events),
        "transitions": {
            "seen": transitions.seen,
            "in_one_episode": transitions.once,
            "next_episode_adds": transitions.next_adds,
            "coverage": transitions.coverage,
            "seen_by_episodes": transitions.curve.tolist(),
        },
        "novelty": [
            {
                "bag": profile.bag,
                "seed": profile.seed,
                "draw": profile.draw,
                "way_m": None if np.isnan(way) else way,
                "events": None if np.isnan(event) else event,
            }
            for profile, way, event in novelty
        ],
    }


def _distances_as_json(kind: Distances) -> dict[str, Any]:
    return {"mean": kind.mean if len(kind.curve) else None, "nearest_by_episodes": kind.curve.tolist()}
