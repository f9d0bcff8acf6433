"""Two models on the same samples: the difference of their means, its interval and its significance."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.errors import InputError
from siren_ros.evaluation.statistics.block_sums import BlockSums
from siren_ros.evaluation.statistics.interval import CONFIDENCE, NOTHING, Interval
from siren_ros.evaluation.statistics.jackknife import jackknife
from siren_ros.numerics.arrays import Flags

ENUMERATED_BLOCKS: Final = 12
"""With at most so many blocks the test tries all 4096 exchanges."""
_RANDOM_EXCHANGES: Final = 4096
_SAME: Final = 1e-12
"""Relative tolerance at which two differences count as equal: sums of other order differ by rounding."""


@dataclass(frozen=True)
class PairedDifference:
    """The first model's mean minus the second's; negative where the first has the smaller errors."""

    difference: Interval
    p_value: float
    """Of the test of exchanged blocks: small where the difference is hardly chance. 1 with one block or none."""


def paired_difference(
    first: BlockSums,
    second: BlockSums,
    rng: np.random.Generator,
    confidence: float = CONFIDENCE,
) -> PairedDifference:
    """Compares two models that were scored on the same samples.

    The interval is the jackknife's, which leaves out a block of both at once. The p-value is that of a permutation
    test: if the two were alike, they could be exchanged within any block. It is the share of exchanges whose difference
    is at least as far from 0 as the one found; all exchanges for few blocks, otherwise random ones (B. Phipson,
    G. Smyth, Stat. Appl. Genet. Mol. Biol. 9 (2010) 39). With B blocks it is not below 2 / 2ᴮ.

    Raises:
        InputError: The two do not have the same numbers of values in the same blocks.
    """
    if len(first) != len(second) or not np.array_equal(first.count, second.count):
        raise InputError("paired models", f"{len(first)} and {len(second)} blocks", "the same samples in every block")
    one, two = first.with_values(), second.with_values()
    if len(one) == 0:
        return PairedDifference(NOTHING, 1.0)
    found = one.value() - two.value()
    interval = jackknife(found, one.left_out() - two.left_out(), one.stratum).interval(confidence)
    return PairedDifference(interval, _p_value(one, two, found, rng))


def _p_value(one: BlockSums, two: BlockSums, found: float, rng: np.random.Generator) -> float:
    blocks = len(one)
    exact = blocks <= ENUMERATED_BLOCKS
    exchanged: Flags = (
        (np.arange(2**blocks)[:, None] >> np.arange(blocks) & 1).astype(np.bool_)
        if exact
        else rng.random((_RANDOM_EXCHANGES, blocks)) < 0.5
    )
    counts = np.ones((1, blocks)) * one.count
    first = one.mean_of(np.where(exchanged, two.total, one.total), counts)
    second = two.mean_of(np.where(exchanged, one.total, two.total), counts)
    limit = abs(found) - _SAME * max(abs(found), 1.0)
    as_far = int(np.count_nonzero(np.abs(first - second) >= limit))
    return as_far / len(exchanged) if exact else (as_far + 1) / (len(exchanged) + 1)
