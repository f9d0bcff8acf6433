"""Paired comparison: two levels of a seed differ only in the level, so their difference is the level's effect."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.base.tables.interval import Measure
from siren_ros.base.tables.table import Row, Table
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.statistics import PairedDifference, block_sums, holm, paired_difference
from siren_ros.scoring.evaluation.yielding.scoring import ScoredEpisode

OUTCOMES: Final = ("site_time_s", "emv_delay_s", "emv_stops", "civilian_delay_s", "min_ttc_s", "collisions")
"""Measures that are compared between levels."""
CONTRASTS: Final = (("L1", "L0"), ("L2", "L1"), ("L3", "L1"), ("L3", "L2"), ("L3", "L0"))
"""Pairs of levels. L1 − L0: the EMV's privileges; L2 − L1: siren and lane changes; L3 − L1: siren and corridor."""
ALL: Final = "all"
"""Name for all templates together, which count equally."""
Pair = tuple[str, str, int, str]


@dataclass(frozen=True)
class Effect:
    """Difference of an outcome between two levels (first minus second), over pairs of episodes."""

    template: str
    outcome: str
    first: str
    second: str
    paired: PairedDifference
    cut_off: int
    """Number of pairs in which a value is only a lower bound, because the episode ended early."""
    adjusted_p: float
    """p-value adjusted for all effects on this outcome (Holm)."""


def effects(
    episodes: Sequence[ScoredEpisode],
    contrasts: Sequence[tuple[str, str]] = CONTRASTS,
    outcomes: Sequence[str] = OUTCOMES,
    seed: int = 0,
) -> tuple[Effect, ...]:
    """Compute the effects of the level, per template and over all of them.

    The blocks of the intervals are the pairs; episodes without a partner at the other level are left out. A travel time
    is the one up to the episode's end where the EMV has not arrived by then, so that effects on it are understated and
    never overstated by the end of the episode. ``seed`` is that of the permutation test.

    Raises:
        InputError: Two episodes of one pair differ in more than the level, or a pair has two episodes of one level.
    """
    pairs = pairs_of(episodes)
    results: list[Effect] = []
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
                of_outcome.append(Effect(template, outcome, *contrast, *_compared(chosen, rng), adjusted_p=1.0))
        adjusted = holm([effect.paired.p_value for effect in of_outcome])
        results += [replace(effect, adjusted_p=p_value) for effect, p_value in zip(of_outcome, adjusted, strict=True)]
    return tuple(results)


def _compared(sides_of: Mapping[Pair, Sequence[Measure]], rng: np.random.Generator) -> tuple[PairedDifference, int]:
    """Difference of the sides where both have a value, and the number of pairs with a lower bound."""
    known = {key: sides for key, sides in sides_of.items() if all(side.valid for side in sides)}
    names = sorted({key[0] for key in sides_of})
    stratum = np.array([names.index(key[0]) for key in known], dtype=np.intp)
    first, second = (
        block_sums(np.array([sides[side].value for sides in known.values()]), np.arange(len(known)), stratum)
        for side in (0, 1)
    )
    return paired_difference(first, second, rng), sum(any(side.at_least for side in sides) for sides in known.values())


def effect_tables(results: Sequence[Effect]) -> tuple[Table, ...]:
    """A table per outcome; levels are written as ``L2 − L1``."""
    tables = (
        Table(
            outcome,
            f"Effects on {outcome}",
            ("levels", "template", "difference", "p", "p (Holm)", "pairs", "cut off"),
            tuple(map(_row, (effect for effect in results if effect.outcome == outcome))),
            spec=".3f",
            specs={"difference": "+.2f"},
            folded=True,
        )
        for outcome in OUTCOMES
    )
    return tuple(table for table in tables if table.rows)


def _row(effect: Effect) -> Row:
    levels, difference = f"{effect.first} − {effect.second}", effect.paired.difference
    p_values = effect.paired.p_value, effect.adjusted_p
    return levels, effect.template, difference, *p_values, difference.blocks, effect.cut_off


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
