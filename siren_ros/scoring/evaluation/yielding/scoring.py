"""Computes the yield metrics of a record, for the episode and for every driver in an encounter, and group means.

Paired comparison: two levels of a seed differ only in the level, so their difference is the level's effect.
"""

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Any, Final, Self

import numpy as np

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.base.tables import Interval, Measure, Row, Table
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.scores import ALL, TEMPLATE, Score, with_holm
from siren_ros.scoring.evaluation.statistics import block_sums, interval_of_mean, paired_difference
from siren_ros.scoring.evaluation.yielding.encounters import EmvLine, Encounter, YieldThresholds
from siren_ros.scoring.evaluation.yielding.metrics import DRIVER_METRICS, EPISODE_METRICS, PEOPLE_METRICS, YieldScene


@dataclass(frozen=True)
class DriverMarks:
    """Metrics of one driver."""

    actor_id: int
    began_s: float
    """Simulated time at which the encounter began."""
    in_the_way: bool
    with_siren: bool
    under_test: bool
    """Whether the driver is the AV under test."""
    marks: dict[str, Measure]


@dataclass(frozen=True)
class YieldScores:
    """The scores of one episode."""

    metrics: dict[str, Measure]
    drivers: tuple[DriverMarks, ...]

    def driver_rows(self) -> list[dict[str, Any]]:
        """One flat row per driver; a metric without a value is None."""
        names = ("actor_id", "began_s", "in_the_way", "with_siren", "under_test")
        return [
            {name: getattr(driver, name) for name in names}
            | {name: mark.value if mark.valid else None for name, mark in driver.marks.items()}
            for driver in self.drivers
        ]


def score_yielding(
    record: EpisodeRecord, limits: YieldThresholds | None = None, names: Collection[str] | None = None
) -> YieldScores:
    """Compute all yield metrics of an episode for its first EMV; without motion of the EMV none has a value.

    With ``names``, these metrics of the episode alone and no drivers: corridor and encounters are most of the work.

    Raises:
        InputError: The episode has no EMV.
    """
    line = EmvLine.of(record)
    chosen = [metric for metric in EPISODE_METRICS if names is None or metric.name in names]
    if line is None:
        nothing = Measure.lacking("the EMV did not move")
        return YieldScores(dict.fromkeys((metric.name for metric in chosen), nothing), ())
    scene = YieldScene(record, line, limits or YieldThresholds())
    metrics = {metric.name: metric.compute(scene) for metric in chosen}
    drivers = scene.encounters if names is None else ()
    return YieldScores(metrics, tuple(_marks(scene, encounter) for encounter in drivers))


def _marks(scene: YieldScene, encounter: Encounter) -> DriverMarks:
    return DriverMarks(
        actor_id=encounter.actor_id,
        began_s=float(encounter.driver.track.time_s[0]),
        in_the_way=encounter.was_in_the_way,
        with_siren=encounter.with_siren,
        under_test=encounter.actor_id == scene.record.description.av_id,
        marks={metric.name: metric.compute(scene, encounter) for metric in DRIVER_METRICS},
    )


@dataclass(frozen=True)
class ScoredEpisode:
    """An episode with its scores for one of its EMVs."""

    bag: str
    template: str
    level: str
    seed: int
    map_name: str
    draw: str
    """Values of parameters that the request sets instead of the seed."""
    situation_sha256: str
    """Hash of everything that the levels of one seed have in common before the first step."""
    scores: YieldScores
    emv: int = 1
    """Number of the EMV in the episode, in the order of ids."""

    @classmethod
    def of_each_emv(cls, bag: str, record: EpisodeRecord, names: Collection[str] | None = None) -> tuple[Self, ...]:
        """Scores of a record for each of its EMVs, first one first; ``names`` as in ``score_yielding``."""
        records = (*record.by_emv(),) or (record,)
        return tuple(cls.of(bag, seen, score_yielding(seen, names=names)) for seen in records)

    @classmethod
    def of(cls, bag: str, record: EpisodeRecord, scores: YieldScores) -> Self:
        """Scores of a record's first EMV, with the values that identify the episode."""
        described = record.description
        named = (described.template, described.level.name, described.seed, described.map_name)
        emv = sum(emv_id <= record.emv_ids[0] for emv_id in record.emv_ids)
        return cls(bag, *named, described.pinned, situation_sha256(record), scores, emv)

    @property
    def group(self) -> tuple[str, str, str]:
        """Template, level and map. Episodes of one group differ in their seeds and draws."""
        return self.template, self.level, self.map_name

    def row(self) -> dict[str, Any]:
        """The metrics as one flat row; a missing value is None, and ``NAME_lack`` gives the reason."""
        row: dict[str, Any] = self._names | {"map": self.map_name}
        for name, measure in self.scores.metrics.items():
            row[name] = measure.value if measure.valid else None
            row |= {f"{name}_at_least": measure.at_least, f"{name}_lack": measure.lack}
        return row

    def driver_rows(self) -> list[dict[str, Any]]:
        """One flat row per driver."""
        return [self._names | row for row in self.scores.driver_rows()]

    @property
    def _names(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in ("bag", "template", "level", "seed", "emv")}


def situation_sha256(record: EpisodeRecord) -> str:
    """Hash of the situation at the start of an episode, without its level and the EMV's speed.

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
    """Mean of every metric per group, over episodes with a value, with its interval over episodes."""
    groups: dict[tuple[str, str, str], list[ScoredEpisode]] = {}
    for episode in episodes:
        groups.setdefault(episode.group, []).append(episode)
    return {
        group: {metric.name: _mean([one.scores.metrics[metric.name] for one in members]) for metric in EPISODE_METRICS}
        for group, members in sorted(groups.items())
    }


def _mean(measures: Sequence[Measure]) -> Interval:
    values = np.array([measure.value if measure.valid else np.nan for measure in measures])
    return interval_of_mean(block_sums(values, np.arange(len(values)), np.zeros(len(values), dtype=np.intp)))


def yield_tables(episodes: Sequence[ScoredEpisode]) -> tuple[Table, ...]:
    """A table per template and map: metrics as rows, levels as columns.

    Further EMVs have tables of their own: two of one episode are not independent.
    """
    tables = []
    for emv in sorted({episode.emv for episode in episodes}):
        tables += _tables_of([episode for episode in episodes if episode.emv == emv], emv)
    return tuple(tables)


def _tables_of(episodes: Sequence[ScoredEpisode], emv: int) -> list[Table]:
    means = group_means(episodes)
    which = "" if emv == 1 else f", EMV {emv}"
    places = dict.fromkeys((template, map_name) for template, _, map_name in means)
    several_maps = len({map_name for _, map_name in places}) > 1
    tables = []
    for template, map_name in places:
        of_levels = {
            level: metrics for (name, level, place), metrics in means.items() if (name, place) == (template, map_name)
        }
        rows: tuple[Row, ...] = tuple(
            (metric.name, *(metrics[metric.name] for metrics in of_levels.values()), metric.meaning)
            for metric in EPISODE_METRICS
            if metric not in PEOPLE_METRICS or any(metrics[metric.name].valid for metrics in of_levels.values())
        )
        key = "_".join((template, *([map_name] if several_maps else []), *([f"emv{emv}"] if which else [])))
        caption = f"Yield metrics of {template}{f' on {map_name}' if several_maps else ''}{which}"
        tables.append(Table(key, caption, ("metric", *of_levels, "meaning"), rows, folded=True))
    return tables


def under_test_tables(episodes: Sequence[ScoredEpisode]) -> Iterator[Table]:
    """A table per AV under test: its metrics towards the first EMV, with the reason where a value is missing."""
    for episode in (episode for episode in episodes if episode.emv == 1):
        for driver in episode.scores.drivers:
            if driver.under_test:
                named = f"{episode.bag}: the AV under test (actor {driver.actor_id}), from {driver.began_s:.2f} s on"
                rows = tuple((metric.name, driver.marks[metric.name].text, metric.meaning) for metric in DRIVER_METRICS)
                yield Table(f"driver_{driver.actor_id}", named, ("metric", "value", "meaning"), rows)


OUTCOMES: Final = ("site_time_s", "emv_delay_s", "emv_stops", "civilian_delay_s", "min_ttc_s", "collisions")
"""Measures that are compared between levels."""
CONTRASTS: Final = (("L1", "L0"), ("L2", "L1"), ("L3", "L1"), ("L3", "L2"), ("L3", "L0"))
"""Pairs of levels. L1 − L0: the EMV's privileges; L2 − L1: siren and lane changes; L3 − L1: siren and corridor."""
Pair = tuple[str, str, int, str]


def effects(
    episodes: Sequence[ScoredEpisode],
    contrasts: Sequence[tuple[str, str]] = CONTRASTS,
    outcomes: Sequence[str] = OUTCOMES,
    seed: int = 0,
) -> tuple[Score, ...]:
    """Differences of outcomes between two levels (the model and the one it is compared with), per template and overall.

    The blocks of the intervals are the pairs; episodes without a partner at the other level are left out. A travel time
    is the one up to the episode's end where the EMV has not arrived by then, so that effects on it are understated and
    never overstated by the end of the episode. ``seed`` is that of the permutation test.

    Raises:
        InputError: Two episodes of one pair differ in more than the level, or a pair has two episodes of one level.
    """
    pairs = pairs_of(episodes)
    results: list[Score] = []
    for outcome in outcomes:
        of_outcome = []
        for contrast in contrasts:
            here = {
                key: [levels[level].scores.metrics[outcome] for level in contrast]
                for key, levels in sorted(pairs.items())
                if set(contrast) <= set(levels)
            }
            templates = sorted({key[0] for key in here})
            for template in [*templates, *([ALL] if len(templates) > 1 else [])]:
                chosen = {key: sides for key, sides in here.items() if template in (ALL, key[0])}
                rng = random_stream(seed, f"counterfactual/{outcome}/{template}/{'/'.join(contrast)}")
                of_outcome.append(_compared(contrast, template, outcome, chosen, rng))
        results += with_holm(of_outcome)
    return tuple(results)


def _compared(
    levels: tuple[str, str],
    template: str,
    outcome: str,
    sides_of: Mapping[Pair, Sequence[Measure]],
    rng: np.random.Generator,
) -> Score:
    """Difference of the sides where both have a value."""
    known = {key: sides for key, sides in sides_of.items() if all(side.valid for side in sides)}
    names = sorted({key[0] for key in sides_of})
    stratum = np.array([names.index(key[0]) for key in known], dtype=np.intp)
    first, second = (
        block_sums(np.array([sides[side].value for sides in known.values()]), np.arange(len(known)), stratum)
        for side in (0, 1)
    )
    difference, p_value = paired_difference(first, second, rng)
    cut_off = sum(any(side.at_least for side in sides) for sides in known.values())
    level, against = levels
    return Score(level, TEMPLATE, template, outcome, difference, len(known), against, p_value, cut_off=cut_off)


def effect_tables(results: Sequence[Score]) -> tuple[Table, ...]:
    """A table per outcome; levels are written as ``L2 − L1``."""
    tables = (
        Table(
            outcome,
            f"Effects on {outcome}",
            ("levels", "template", "difference", "p", "p (Holm)", "pairs", "cut off"),
            tuple(map(_row, (effect for effect in results if effect.metric == outcome))),
            spec=".3f",
            specs={"difference": "+.2f"},
            folded=True,
        )
        for outcome in OUTCOMES
    )
    return tuple(table for table in tables if table.rows)


def _row(effect: Score) -> Row:
    levels, p_values = f"{effect.model} − {effect.against}", (effect.p_value, effect.p_adjusted)
    return levels, effect.group, effect.interval, *p_values, effect.samples, effect.cut_off


def pairs_of(episodes: Iterable[ScoredEpisode]) -> Mapping[Pair, Mapping[str, ScoredEpisode]]:
    """Episodes by template, map, seed and draw, then by level; of several EMVs only the first.

    Raises InputError as ``effects`` does.
    """
    pairs: dict[Pair, dict[str, ScoredEpisode]] = {}
    for episode in (episode for episode in episodes if episode.emv == 1):
        levels = pairs.setdefault((episode.template, episode.map_name, episode.seed, episode.draw), {})
        if episode.level in levels:
            allowed = f"one episode of each level and seed; {levels[episode.level].bag} is one"
            raise InputError("bag", episode.bag, allowed)
        for other in levels.values():
            if other.situation_sha256 != episode.situation_sha256:
                allowed = f"the situation of {other.bag}: map, drawn values, site and traffic"
                raise InputError("bag", episode.bag, allowed)
        levels[episode.level] = episode
    return pairs
