"""Distributions of ordinary traffic: a study's against those of real tracks, as quantiles and distances."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.tables import Row, Table
from siren_ros.scoring.evaluation.realism.quantities import TRAFFIC, RealismEpisode
from siren_ros.scoring.evaluation.realism.road_tracks import RoadTracks

QUANTILES: Final = (10, 25, 50, 75, 90)
LEAST: Final = 2
"""Fewest samples of each side for a distance."""
Distributions = Mapping[str, tuple[Floats, Floats]]
"""Simulated and real samples by quantity."""


def samples_of_tracks(tracks: RoadTracks) -> dict[str, Floats]:
    """What one recording of real traffic shows."""
    return {name: measure(tracks) for name, measure in TRAFFIC.items()}


def distributions(episodes: Sequence[RealismEpisode], recordings: Iterable[Mapping[str, Floats]]) -> Distributions:
    """All samples of the episodes and all of the recordings."""
    sides = [episode.samples for episode in episodes], list(recordings)
    return {name: (_pooled(sides[0], name), _pooled(sides[1], name)) for name in TRAFFIC}


def _pooled(parts: Sequence[Mapping[str, Floats]], name: str) -> Floats:
    return np.concatenate([np.empty(0), *(part[name] for part in parts)])


def distances(simulated: Floats, real: Floats) -> tuple[float, float] | None:
    """Kolmogorov's and Smirnov's distance, from 0 to 1, and Wasserstein's in the quantity's unit.

    None without enough samples.
    """
    from scipy.stats import ks_2samp, wasserstein_distance  # noqa: PLC0415 - takes half a second to load

    if min(len(simulated), len(real)) < LEAST:
        return None
    return float(ks_2samp(simulated, real).statistic), float(wasserstein_distance(simulated, real))


def distributions_as_json(found: Distributions) -> list[dict[str, Any]]:
    """Quantiles and distances as JSON types; null for a missing value."""
    rows = []
    for name, sides in found.items():
        smirnov, wasserstein = distances(*sides) or (None, None)
        of_sides = {
            side: {"samples": len(values), **{f"p{share}": _at(values, share) for share in QUANTILES}}
            for side, values in zip(("simulated", "real"), sides, strict=True)
        }
        rows.append({"quantity": name, **of_sides, "kolmogorov_smirnov": smirnov, "wasserstein": wasserstein})
    return rows


def _at(values: Floats, share: float) -> float | None:
    return float(np.percentile(values, share)) if len(values) else None


def distribution_table(found: Distributions) -> Table:
    """Quantiles of both sides (simulated/real), and how far apart the two are."""
    rows: tuple[Row, ...] = tuple(
        (
            name,
            *((_at(simulated, share), _at(real, share)) for share in QUANTILES),
            *(distances(simulated, real) or (None, None)),
            (len(simulated), len(real)),
        )
        for name, (simulated, real) in found.items()
    )
    head = ("quantity", *(f"p{share}" for share in QUANTILES), "KS", "Wasserstein", "samples")
    return Table("traffic", "Ordinary traffic, simulated/real", head, rows)
