"""The share that n of N episodes show (exact averages over all choices of n), and coverage of parameters' ranges."""

from collections import Counter
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import gammaln

from siren_ros.errors import SirenError
from siren_ros.evaluation.diversity.profile import InteractionProfile
from siren_ros.numerics.arrays import Floats
from siren_ros.scenario.templates import load_template


def _log_choices(total: Floats, chosen: Floats) -> Floats:
    """Logarithm of the binomial coefficient; −∞ where there is no choice."""
    possible = (chosen >= 0) & (chosen <= total)
    safe = np.where(possible, chosen, 0.0)
    log = gammaln(total + 1.0) - gammaln(safe + 1.0) - gammaln(total - safe + 1.0)
    return np.asarray(np.where(possible, log, -np.inf), dtype=np.float64)


def expected_kinds(incidences: Sequence[int], episodes: int) -> Floats:
    """Expected number of kinds among n episodes, n = 1 … N (rarefaction; S. Hurlbert, Ecology 52 (1971) 577).

    ``incidences`` are the numbers of episodes, of all N, in which each kind occurs, 1 to N. Returns shape ``(N,)``.
    """
    chosen = np.arange(1, episodes + 1, dtype=np.float64)
    without = episodes - np.array(incidences, dtype=np.float64)[:, None]
    total = np.full_like(chosen, episodes)
    without = np.broadcast_to(without, (len(incidences), episodes))
    missed = np.exp(_log_choices(without, chosen) - _log_choices(total, chosen))
    return np.asarray((1.0 - missed).sum(axis=0), dtype=np.float64)


def expected_nearest(distances: Floats) -> Floats:
    """Expected distance of an episode to the nearest of n others, n = 1 … N − 1, mean over the N episodes.

    Takes the distances between all pairs, shape ``(N, N)``. Returns shape ``(N - 1,)``, empty for a single episode.
    """
    others = len(distances) - 1
    if others < 1:
        return np.zeros(0)
    ordered = np.sort(distances + np.diag(np.full(others + 1, np.inf)), axis=1)[:, :others].mean(axis=0)
    chosen = np.arange(1, others + 1, dtype=np.float64)[:, None]
    farther = np.arange(others - 1, -1, -1, dtype=np.float64)[None, :]
    # The one at rank r is the nearest of the n where it is chosen and the n - 1 others are farther away.
    weight = np.exp(
        _log_choices(np.broadcast_to(farther, (others, others)), np.broadcast_to(chosen - 1.0, (others, others)))
        - _log_choices(np.full((others, 1), float(others)), chosen)
    )
    return np.asarray(weight @ ordered, dtype=np.float64)


@dataclass(frozen=True)
class KindCoverage:
    """Kinds that were seen, and an estimate of those that were not."""

    seen: int
    once: int
    """Kinds that a single episode has."""
    next_adds: float
    """Kinds that one more episode is expected to add: those of a single episode, by the number of episodes (I. J.
    Good, Biometrika 40 (1953) 237). With a single episode all are of it, and nothing is known."""
    coverage: float
    """Estimated share of what the next episode shows that has been seen (A. Chao, L. Jost, Ecology 93 (2012) 2533)."""
    curve: Floats
    """As ``expected_kinds``."""


def kind_coverage(episodes: Sequence[Collection[Hashable]]) -> KindCoverage:
    """Coverage of the kinds of things that episodes have; at least one episode."""
    count = len(episodes)
    incidences = list(Counter(kind for episode in episodes for kind in set(episode)).values())
    once, twice, total = incidences.count(1), incidences.count(2), sum(incidences)
    missing = 0.0
    if total and once and count > 1:
        ahead = (count - 1) * once
        share = ahead / (ahead + 2.0 * twice) if twice else (ahead - (count - 1)) / (ahead - (count - 1) + 2.0)
        missing = once / total * share
    elif total and count == 1:
        missing = 1.0
    return KindCoverage(len(incidences), once, once / count, 1.0 - missing, expected_kinds(incidences, count))


PARTS: Final = 10
"""Equal parts of a range; a whole-number parameter with fewer values has a part for each."""


@dataclass(frozen=True)
class DrawnRange:
    """The range that a parameter is drawn from."""

    low: float
    high: float
    whole: bool

    @property
    def parts(self) -> int:
        """Number of parts."""
        return min(PARTS, round(self.high - self.low) + 1) if self.whole else PARTS

    def part_of(self, values: Floats) -> Floats:
        """Part of each value, from 0; values outside count for the part at that end."""
        width = (self.high - self.low + (1.0 if self.whole else 0.0)) / self.parts
        return np.clip(np.floor((values - self.low) / width), 0, self.parts - 1)


@dataclass(frozen=True)
class ParameterCoverage:
    """The parts of one parameter's range."""

    path: str
    drawn: DrawnRange
    counts: tuple[int, ...]
    """Episodes in each part."""
    curve: Floats
    """Expected share of the parts that n episodes reach, n = 1 … N; shape ``(N,)``."""

    @property
    def share(self) -> float:
        """Share of the parts with an episode."""
        return sum(count > 0 for count in self.counts) / len(self.counts)


def parameter_coverage(
    episodes: Sequence[Mapping[str, float]], ranges: Mapping[str, DrawnRange]
) -> tuple[ParameterCoverage, ...]:
    """Coverage of every parameter that has a range and a value in all episodes, by path."""
    covered = []
    for path, drawn in sorted(ranges.items()):
        if drawn.high <= drawn.low or not all(path in episode for episode in episodes):
            continue
        part = drawn.part_of(np.array([episode[path] for episode in episodes], dtype=np.float64)).astype(np.intp)
        counts = np.bincount(part, minlength=drawn.parts)
        reached = [int(count) for count in counts if count]
        curve = expected_kinds(reached, len(episodes)) / drawn.parts
        covered.append(ParameterCoverage(path, drawn, tuple(counts.tolist()), curve))
    return tuple(covered)


def drawn_ranges(profiles: Iterable[InteractionProfile]) -> dict[str, dict[str, DrawnRange]]:
    """By template and parameter; a template that is not among ours has none.

    Episodes whose values a study drew have the template's whole ranges; the others those that every seed draws from.
    """
    some_drawn: dict[str, bool] = {}
    for profile in profiles:
        some_drawn[profile.template] = bool(profile.draw) or some_drawn.get(profile.template, False)
    ranges: dict[str, dict[str, DrawnRange]] = {}
    for name, drawn in some_drawn.items():
        try:
            template = load_template(name)
        except SirenError:
            continue
        limits = (template.ranges if drawn else template.drawn).items()
        ranges[name] = {path: DrawnRange(limit.minimum, limit.maximum, limit.integer) for path, limit in limits}
    return ranges
