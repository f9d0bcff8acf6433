"""Samples as PyTorch datasets: by number, or as a stream divided among ranks and workers. Needs torch.

Both take files of ``siren pack``; ``SampleDataset`` also takes samples in memory, as they come out of bags.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset, IterableDataset, default_collate, get_worker_info

from siren_ros.errors import InputError
from siren_ros.lab.training.packed.parquet_samples import PackedSamples, Sample, SampleSource, samples_of_shard

__all__ = ["SampleDataset", "SampleStream", "collated"]


def tensors_of(sample: Sample) -> dict[str, Any]:
    """Convert arrays and numbers to tensors; texts stay."""
    return {
        name: value if isinstance(value, str) else torch.from_numpy(np.array(value)) for name, value in sample.items()
    }


def collated(samples: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Join a batch: tensors of equal shape are stacked; texts and tensors of different length become lists."""
    batch: dict[str, Any] = {}
    for name in samples[0]:
        values = [sample[name] for sample in samples]
        stacks = isinstance(values[0], torch.Tensor) and len({value.shape for value in values}) == 1
        batch[name] = default_collate(values) if stacks else values
    return batch


class SampleDataset(Dataset):
    """Samples by number, for DataLoader's own samplers."""

    def __init__(self, source: SampleSource | Path | str) -> None:
        """Take samples in memory, or a file of ``siren pack``; InputError if it cannot be read."""
        self.source: SampleSource = PackedSamples(Path(source)) if isinstance(source, Path | str) else source

    def __len__(self) -> int:
        return len(self.source)

    def __getitem__(self, number: int) -> dict[str, Any]:
        return tensors_of(self.source[number])


class SampleStream(IterableDataset):
    """All samples of some files in an order of seed and epoch, each once over all ranks and workers.

    It reads whole groups of a file, so that it is faster than drawing single samples. The groups are shuffled, and the
    samples of eight groups are mixed.
    """

    def __init__(self, files: Sequence[Path | str], seed: int | None = 0, rank: int = 0, ranks: int = 1) -> None:
        """Take files, the seed of the order (None for the files' order), and this process's rank among all.

        Raises:
            InputError: A file that cannot be read, or a rank that is not below the number of ranks.
        """
        if not 0 <= rank < ranks:
            raise InputError("rank", rank, f"0 to {ranks - 1}")
        self._files = [PackedSamples(Path(file)) for file in files]
        self._seed, self._rank, self._ranks = seed, rank, ranks
        self._epoch = 0

    def __len__(self) -> int:
        return sum(map(len, self._files))

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch, since each has its own order; call it before iterating over the loader."""
        self._epoch = epoch

    def __iter__(self) -> Iterator[dict[str, Any]]:
        worker = get_worker_info()
        workers, number = (1, 0) if worker is None else (worker.num_workers, worker.id)
        shard, shards = self._rank * workers + number, self._ranks * workers
        for sample in samples_of_shard(self._files, shard, shards, seed=self._seed, turn=self._epoch):
            yield tensors_of(sample)
