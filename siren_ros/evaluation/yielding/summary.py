"""Yield metrics over many episodes: means with intervals over groups, and plain rows for tables."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Any, Self

import numpy as np

from siren_ros.evaluation.statistics.block_sums import block_sums
from siren_ros.evaluation.statistics.interval import Interval
from siren_ros.evaluation.statistics.jackknife import interval_of_mean
from siren_ros.evaluation.yielding.metrics import EPISODE_METRICS
from siren_ros.evaluation.yielding.scoring import YieldScores
from siren_ros.recording.episode_record import EpisodeRecord


@dataclass(frozen=True)
class ScoredEpisode:
    """An episode with its scores."""

    bag: str
    template: str
    level: str
    seed: int
    map_name: str
    draw: str
    """Values of parameters in place of the seed's own, as the request has them."""
    situation_sha256: str
    """Of all that levels of one seed have in common before the first step."""
    scores: YieldScores

    @classmethod
    def of(cls, bag: str, record: EpisodeRecord, scores: YieldScores) -> Self:
        """The scores of a record with what names it."""
        described = record.description
        named = (described.template, described.level.name, described.seed, described.map_name)
        return cls(bag, *named, described.draw, situation_sha256(record), scores)

    @property
    def group(self) -> tuple[str, str, str]:
        """Template, level and map: episodes that share them differ in their seeds and draws."""
        return self.template, self.level, self.map_name

    def row(self) -> dict[str, Any]:
        """The metrics as one flat row; one without a value is None, and ``NAME_lack`` says why."""
        found: dict[str, Any] = {
            "bag": self.bag,
            "template": self.template,
            "level": self.level,
            "seed": self.seed,
            "map": self.map_name,
        }
        for name, measure in self.scores.metrics.items():
            found[name] = measure.value if measure.valid else None
            found[f"{name}_at_least"] = measure.at_least
            found[f"{name}_lack"] = measure.lack
        return found

    def driver_rows(self) -> list[dict[str, Any]]:
        """One flat row for each driver."""
        named = {"bag": self.bag, "template": self.template, "level": self.level, "seed": self.seed}
        return [{**named, **row} for row in self.scores.driver_rows()]


def situation_sha256(record: EpisodeRecord) -> str:
    """Hash of the situation that an episode begins in, apart from its level and the EMV's speed.

    At L0 the EMV obeys the speed limit from the start, so its first speed belongs to the level.
    """
    described = record.description
    common = [described.map_sha256, described.preset, described.duration_s, described.parameters.get("template")]
    digest = sha256(json.dumps([*common, described.site], sort_keys=True, default=dict).encode())
    if record.states:
        first = record.states[0]
        others = first.select(~np.isin(first.actor_id, record.emv_ids))
        for array in (first.actor_id, first.x_m, first.y_m, first.yaw_rad, others.vx_mps, others.vy_mps):
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def group_means(episodes: Sequence[ScoredEpisode]) -> Mapping[tuple[str, str, str], dict[str, Interval]]:
    """Mean of every metric over the episodes of each group that have a value, with its interval over episodes."""
    groups: dict[tuple[str, str, str], list[ScoredEpisode]] = {}
    for episode in episodes:
        groups.setdefault(episode.group, []).append(episode)
    return {group: _means(found) for group, found in sorted(groups.items())}


def _means(episodes: Sequence[ScoredEpisode]) -> dict[str, Interval]:
    means = {}
    for metric in EPISODE_METRICS:
        measures = [episode.scores.metrics[metric.name] for episode in episodes]
        values = np.array([measure.value if measure.valid else np.nan for measure in measures])
        blocks = np.arange(len(values))
        sums = block_sums(values, blocks, np.zeros(len(values), dtype=np.intp))
        means[metric.name] = interval_of_mean(sums)
    return means
