"""Sums over blocks: all that a mean over samples needs to be computed for any choice of blocks."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from siren_ros.numerics.arrays import Flags, Floats, Rows


def identity(values: Floats) -> Floats:
    """The values themselves."""
    return values


@dataclass(frozen=True)
class BlockSums:
    """Sums of some quantity over B blocks; a block is an episode, a stratum its template. Arrays of shape ``(B,)``."""

    total: Floats
    count: Floats
    """Number of values in each block."""
    stratum: Rows
    of_stratum: Callable[[Floats], Floats] = identity
    """What is done to a stratum's mean before the mean over the strata: the root, of squares."""

    def __len__(self) -> int:
        return len(self.total)

    def with_values(self) -> "BlockSums":
        """Those blocks that have a value."""
        return self._at(self.count > 0)

    def value(self) -> float:
        """Mean over the strata, each counted once, of the means over all values of a stratum."""
        return float(self.mean_of(self.total[None], self.count[None])[0])

    def left_out(self) -> Floats:
        """The same without each block, shape ``(B,)``; with all where a block is alone in its stratum."""
        strata, stratum, blocks = np.unique(self.stratum, return_inverse=True, return_counts=True)
        totals, counts = (np.bincount(stratum, weights=one)[stratum] for one in (self.total, self.count))
        shared = blocks[stratum] > 1
        others = self.of_stratum((totals - self.total * shared) / (counts - self.count * shared))
        return self.value() + (others - self.of_stratum(totals / counts)) / len(strata)

    def of(self, stratum: int) -> "BlockSums":
        """The blocks of one stratum."""
        return self._at(self.stratum == stratum)

    def _at(self, chosen: Flags) -> "BlockSums":
        return BlockSums(self.total[chosen], self.count[chosen], self.stratum[chosen], self.of_stratum)

    def mean_of(self, totals: Floats, counts: Floats) -> Floats:
        """As ``value``, of other sums over the same blocks; shapes ``(R, B)`` give ``(R,)``."""
        of_strata = [
            self.of_stratum(totals[:, here].sum(axis=1) / counts[:, here].sum(axis=1))
            for here in (self.stratum == one for one in np.unique(self.stratum).tolist())
        ]
        return np.asarray(np.mean(of_strata, axis=0), dtype=np.float64)


def block_sums(
    values: Floats,
    block: Rows,
    stratum: Rows,
    of_stratum: Callable[[Floats], Floats] = identity,
) -> BlockSums:
    """Sums of values over their blocks; NaN is no value.

    Args:
        values: Shape ``(N,)``.
        block: Block of each value, shape ``(N,)``.
        stratum: Stratum of each block, shape ``(B,)``.
        of_stratum: As in ``BlockSums``.
    """
    there = ~np.isnan(values)
    blocks = len(stratum)
    return BlockSums(
        np.bincount(block[there], weights=values[there], minlength=blocks).astype(np.float64),
        np.bincount(block[there], minlength=blocks).astype(np.float64),
        stratum,
        of_stratum,
    )
