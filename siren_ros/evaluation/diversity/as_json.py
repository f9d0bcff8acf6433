"""Diversity as JSON types; null where there is no value."""

from typing import Any

import numpy as np

from siren_ros.evaluation.diversity.summary import Distances, GroupDiversity
from siren_ros.numerics.arrays import Floats


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
        "ways_m": _distances(found.ways),
        "events": _distances(found.events),
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


def _distances(found: Distances) -> dict[str, Any]:
    return {
        "mean": found.mean if len(found.curve) else None,
        "nearest_by_episodes": _list(found.curve),
    }


def _list(values: Floats) -> list[float]:
    return [float(value) for value in values]


def _one(value: np.float64) -> float | None:
    return None if np.isnan(value) else float(value)
