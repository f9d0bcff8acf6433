"""Neighbours of samples as padded groups, so that a network handles all samples of a batch at once."""

from dataclasses import dataclass

import torch
from torch import Tensor

from siren_ros.datasets.ngsim.grid import CELLS


@dataclass(frozen=True)
class Neighbours:
    """P neighbours of B samples, sorted by sample and then by cell; integer tensors of shape ``(P,)``."""

    sample: Tensor
    cell: Tensor
    """Cell of the social grid, 0 to 38."""
    samples: int
    """B."""

    @property
    def place(self) -> Tensor:
        """Place of each neighbour in all cells of all samples."""
        return self.sample * CELLS + self.cell


@dataclass(frozen=True)
class Groups:
    """Rows of a tensor, brought into G groups of at most S rows."""

    group: Tensor
    """Group of each of P rows, ascending."""
    slot: Tensor
    """Place of each row within its group."""
    count: Tensor
    """Rows in each group, shape ``(G,)``."""

    @classmethod
    def of(cls, group: Tensor, groups: int) -> "Groups":
        """Groups of rows that are sorted by their group."""
        count = torch.bincount(group, minlength=groups)
        first = torch.cumsum(count, 0) - count
        return cls(group, torch.arange(len(group)) - first[group], count)

    @property
    def slots(self) -> int:
        """Rows of the largest group, at least one."""
        return max(int(self.count.max()), 1) if len(self.count) else 1

    @property
    def filled(self) -> Tensor:
        """Which slots hold a row, shape ``(G, S)``."""
        return torch.arange(self.slots) < self.count[:, None]

    def spread(self, rows: Tensor) -> Tensor:
        """Rows ``(P, …)`` as ``(G, S, …)``, zero where a slot holds none."""
        spread = rows.new_zeros((len(self.count), self.slots, *rows.shape[1:]))
        spread[self.group, self.slot] = rows
        return spread

    def gather(self, spread: Tensor) -> Tensor:
        """The opposite of ``spread``."""
        return spread[self.group, self.slot]
