"""How often an interval of 95 % holds the true value: simulated episodes, the functions that the reports use.

Episodes have between 50 and 400 samples. Their means are normal, or log-normal with σ = 0.5, which is as skewed as an
error in metres gets. Student's interval misses skewed means somewhat more often than it says; the bands tell how much.
"""

from collections.abc import Callable

import numpy as np
import pytest

from siren_ros.base.tables.interval import Interval
from siren_ros.scoring.evaluation.detection.devkit_score import average_precision
from siren_ros.scoring.evaluation.risk.scoring import balanced_accuracy, f1, macro_f1
from siren_ros.scoring.evaluation.statistics import (
    BlockSums,
    estimate_of_mean,
    interval_of_mean,
    jackknife,
    paired_difference,
    ranking_interval,
)

TRIALS = 600
"""The share of hits is known up to ±0.02 (two standard errors)."""
Means = Callable[[np.random.Generator, int], np.ndarray]


def normal(rng: np.random.Generator, episodes: int) -> np.ndarray:
    return rng.normal(2.0, 0.8, episodes)


def skewed(rng: np.random.Generator, episodes: int) -> np.ndarray:
    """Of mean 2."""
    return 2.0 * rng.lognormal(-0.125, 0.5, episodes)


def sums_of(rng: np.random.Generator, means: Means, episodes: int, strata: int = 1) -> BlockSums:
    count = rng.integers(50, 400, episodes * strata).astype(np.float64)
    values = np.concatenate([means(rng, episodes) for _ in range(strata)])
    return BlockSums(values * count, count, np.repeat(np.arange(strata), episodes))


def coverage(interval_of: Callable[[np.random.Generator], Interval], true: float, trials: int = TRIALS) -> float:
    intervals = [interval_of(np.random.default_rng(seed)) for seed in range(trials)]
    return float(np.mean([interval.low <= true <= interval.high for interval in intervals]))


def percentile_bootstrap(sums: BlockSums, rng: np.random.Generator) -> Interval:
    """What stood here before: episodes drawn again, the middle 95 % of their means."""
    weight = rng.multinomial(len(sums), np.full(len(sums), 1.0 / len(sums)), size=500)
    low, high = np.quantile(weight @ sums.total / (weight @ sums.count), (0.025, 0.975))
    return Interval(sums.value(), float(low), float(high), len(sums))


@pytest.mark.parametrize("episodes", [5, 7, 10, 20, 40])
@pytest.mark.parametrize(("means", "least"), [(normal, 0.92), (skewed, 0.88)])
def test_a_mean_over_the_samples_of_episodes(episodes, means, least) -> None:
    held = coverage(lambda rng: interval_of_mean(sums_of(rng, means, episodes)), 2.0)
    assert least < held < 0.97


@pytest.mark.parametrize(("episodes", "most"), [(5, 0.88), (10, 0.91)])
def test_the_percentile_bootstrap_would_fail(episodes, most) -> None:
    held = coverage(lambda rng: percentile_bootstrap(sums_of(rng, normal, episodes), rng), 2.0, 600)
    assert held < most


@pytest.mark.parametrize(("episodes", "least"), [(2, 0.92), (5, 0.92), (20, 0.92)])
def test_a_mean_over_seven_templates(episodes, least) -> None:
    """With two episodes of each, Welch's degrees of freedom are few, and the interval rather too wide."""
    held = coverage(lambda rng: interval_of_mean(sums_of(rng, skewed, episodes, 7)), 2.0)
    assert least < held < 0.99


@pytest.mark.parametrize("episodes", [5, 20])
def test_a_paired_difference(episodes) -> None:
    """The second model is 0.3 m worse; both have the episode's difficulty in common."""

    def interval_of(rng: np.random.Generator) -> Interval:
        first = sums_of(rng, skewed, episodes)
        noise = first.count * rng.normal(0.3, 0.4, episodes)
        other = BlockSums(first.total + noise, first.count, first.stratum)
        return paired_difference(other, first, rng).difference

    assert 0.92 < coverage(interval_of, 0.3, 300) < 0.985


@pytest.mark.parametrize("episodes", [5, 20])
def test_the_ratio_of_two_models(episodes) -> None:
    """As the error of IDM over that of CV: 1.2, with scatter of its own in each episode."""

    def interval_of(rng: np.random.Generator) -> Interval:
        first = sums_of(rng, skewed, episodes)
        total = first.total * rng.normal(1.2, 0.2, episodes)
        other = BlockSums(total, first.count, first.stratum)
        return jackknife(other.value() / first.value(), other.left_out() / first.left_out(), first.stratum).interval()

    assert 0.89 < coverage(interval_of, 1.2) < 0.97


@pytest.mark.parametrize("episodes", [5, 20])
def test_a_rank_correlation_over_templates(episodes) -> None:
    """Seven templates of 1.0 to 2.5 m, of which two neighbours stand the other way round in the paper."""
    true = np.linspace(1.0, 2.5, 7)
    paper = [1.0, 3.0, 2.0, 4.0, 5.0, 6.0, 7.0]

    def interval_of(rng: np.random.Generator) -> Interval:
        estimates = [
            estimate_of_mean(sums_of(rng, lambda drawn, count, mean=mean: 0.5 * mean * skewed(drawn, count), episodes))
            for mean in true
        ]
        return ranking_interval(estimates, paper)

    assert coverage(interval_of, 1.0 - 6.0 * 2.0 / (7.0 * 48.0), 150) > 0.92


@pytest.mark.parametrize("episodes", [6, 20])
def test_an_average_precision(episodes) -> None:
    """Of 40 detections in an episode more or fewer find one of 40 labels; 20,000 episodes give the true value."""

    def weighted(rng: np.random.Generator, count: int, weight: np.ndarray) -> np.ndarray:
        sure = np.clip(rng.normal(0.6, 0.15, count), 0.1, 0.95)
        hit = rng.random((count, 40)) < sure[:, None]
        score = rng.random((count, 40)) + 0.5 * hit
        order = np.argsort(-score, axis=None)
        return average_precision(
            hit.ravel()[order], np.repeat(np.arange(count), 40)[order], np.full(count, 40.0), weight
        )

    true = float(weighted(np.random.default_rng(1), 20_000, np.ones((1, 20_000)))[0])

    def interval_of(rng: np.random.Generator) -> Interval:
        weight = np.vstack((np.ones(episodes), 1.0 - np.eye(episodes)))
        value, *left_out = weighted(rng, episodes, weight).tolist()
        return jackknife(value, np.array(left_out), np.zeros(episodes, dtype=np.intp)).interval()

    assert 0.90 < coverage(interval_of, true, 400) < 0.985


@pytest.mark.parametrize("videos", [20, 105])
@pytest.mark.parametrize("score", [balanced_accuracy, macro_f1, lambda counts: f1(counts, 1)])
def test_scores_of_risk(videos, score) -> None:
    """A model that is right in 75, 50 and 50 % of normal videos, near-misses and collisions, at the paper's balance."""
    answers = np.array([[0.75, 0.15, 0.1, 0.0], [0.3, 0.5, 0.2, 0.0], [0.2, 0.3, 0.5, 0.0]])
    shares = np.array([[0.705], [0.238], [0.057]]) * answers
    true = score(np.rint(shares * 1e6).astype(np.int64)).value

    def interval_of(rng: np.random.Generator) -> Interval:
        return score(rng.multinomial(videos, shares.ravel()).reshape(3, 4))

    assert 0.89 < coverage(interval_of, true, 600) < 0.98
