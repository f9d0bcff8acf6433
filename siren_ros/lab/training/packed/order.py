"""Order of samples in a pass over files: it depends on seed and pass only, and shards do not overlap."""

from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Final

import numpy as np

from siren_ros.errors import InputError
from siren_ros.lab.training.packed.parquet_samples import PackedSamples, Sample

GROUPS_MIXED: Final = 8
"""Number of groups whose samples are mixed, because neighbours in a file are also neighbours in time."""


def shuffled(count: int, seed: int, turn: int) -> list[int]:
    """The numbers below ``count`` in the random order of a pass (``turn``)."""
    return [int(number) for number in np.random.default_rng([seed, turn]).permutation(count)]


def samples_of_shard(
    files: Sequence[PackedSamples], shard: int = 0, shards: int = 1, *, seed: int | None = None, turn: int = 0
) -> Iterator[Sample]:
    """Samples of one shard; all shards together give each sample once.

    Args:
        files: In the order that counts.
        shard: Number of the shard, from 0 on.
        shards: Number of all shards.
        seed: Of the order; None for that of the files.
        turn: Number of the pass over the files; each has an order of its own.

    Raises:
        InputError: A shard that is not below the number of shards, or a damaged file.
    """
    if not 0 <= shard < shards:
        raise InputError("shard", shard, f"0 to {shards - 1}")
    groups = [(file, group) for file in files for group in range(len(file.first_of_group) - 1)]
    if seed is not None:
        groups = [groups[number] for number in shuffled(len(groups), seed, turn)]
    mine = iter(groups[shard::shards])
    while mixed := list(islice(mine, GROUPS_MIXED if seed is not None else 1)):
        held = [sample for file, group in mixed for sample in _samples(file, group)]
        order = range(len(held)) if seed is None else _within(held, seed, turn, mixed[0][1])
        for number in order:
            yield held[number]


def _samples(file: PackedSamples, group: int) -> list[Sample]:
    columns = file.group(group)
    count = int(file.first_of_group[group + 1] - file.first_of_group[group])
    return [{name: values[row] for name, values in columns.items()} for row in range(count)]


def _within(held: Sequence[Sample], seed: int, turn: int, group: int) -> list[int]:
    return [int(number) for number in np.random.default_rng([seed, turn, 1, group]).permutation(len(held))]
