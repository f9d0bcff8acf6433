"""Layers that CSP, STDAN and BAT share. Their names are those of the published weights.

Manoeuvres are modes, with a Gaussian for each predicted point. Neighbours of samples are padded groups, so that a
network handles all samples of a batch at once.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import torch
from torch import Tensor, nn
from torch.nn.functional import one_hot

from siren_ros.data.datasets.ngsim import CELLS
from siren_ros.scoring.evaluation.prediction.samples import FUTURE_POINTS


def one_hot_modes(samples: int, lateral: int, longitudinal: int) -> Iterator[tuple[Tensor, Tensor]]:
    """One-hot rows of the lateral ``(B, lateral)`` and longitudinal ``(B, longitudinal)`` manoeuvre of every mode.

    Lateral manoeuvres change fastest.
    """
    for mode in range(lateral * longitudinal):
        along, across = divmod(mode, lateral)
        yield (
            one_hot(torch.full((samples,), across), lateral).float(),
            one_hot(torch.full((samples,), along), longitudinal).float(),
        )


def gaussian(raw: Tensor) -> Tensor:
    """Convert a decoder's output to μx, μy, two positive scales and a correlation; shape ``(25, B, 5)``."""
    return torch.cat((raw[..., :2], raw[..., 2:4].exp(), raw[..., 4:].tanh()), dim=-1)


def mode_probabilities(lateral: Tensor, longitudinal: Tensor) -> Tensor:
    """Probability of every mode, shape ``(B, modes)``; manoeuvres count as independent, as in training."""
    return (longitudinal[:, :, None] * lateral[:, None, :]).flatten(1)


ENCODED: Final = 64
HEADS: Final = 4
HEAD_SIZE: Final = 48
ATTENDED: Final = HEADS * HEAD_SIZE
EMBEDDED: Final = 32
LATERAL: Final = 3
LONGITUDINAL: Final = 3
HISTORY_POINTS: Final = 16


class GatedLinear(nn.Module):
    """A linear layer whose output is gated by a second layer."""

    def __init__(self) -> None:
        super().__init__()
        self.activation_layer = nn.Linear(ATTENDED, ENCODED)
        self.gated_layer = nn.Linear(ATTENDED, ENCODED)

    def forward(self, values: Tensor) -> Tensor:
        """Map shape ``(…, 192)`` to ``(…, 64)``."""
        return self.activation_layer(values) * torch.sigmoid(self.gated_layer(values))


class AddAndNorm(nn.Module):
    """A residual connection with layer normalisation."""

    def __init__(self) -> None:
        super().__init__()
        self.normalize = nn.LayerNorm(ENCODED)

    def forward(self, first: Tensor, second: Tensor) -> Tensor:
        """Add both inputs and normalise the sum."""
        return self.normalize(first + second)


class GatedEncoder(nn.Module):
    """Common layers of the encoders of STDAN and BAT.

    Args:
        features: Features of a vehicle at a point.
        encoded: Size of a vehicle's encoded point.
    """

    def __init__(self, features: int, encoded: int) -> None:
        super().__init__()
        self.linear1 = nn.Linear(features, EMBEDDED)
        self.lstm = nn.LSTM(EMBEDDED, encoded)
        self.qff, self.kff, self.vff = (nn.Linear(ENCODED, ATTENDED) for _ in range(3))
        self.first_glu, self.second_glu = GatedLinear(), GatedLinear()
        self.qt, self.kt, self.vt = (nn.Linear(ENCODED, ATTENDED) for _ in range(3))
        self.addAndNorm = AddAndNorm()
        self.fc = nn.Linear(2 * ENCODED, ENCODED)
        self.activation = nn.ELU()

    def encoded(self, features: Tensor) -> Tensor:
        """Encode features ``(16, V, F)`` as points ``(V, 16, encoded)``."""
        hidden, _ = self.lstm(self.activation(self.linear1(features)))
        return hidden.permute(1, 0, 2)


class _Decoder(nn.Module):
    """An LSTM over future points. ``lat_linear`` and ``lon_linear`` exist only because the weights have them."""

    def __init__(self) -> None:
        super().__init__()
        self.lstm = nn.LSTM(ENCODED, ENCODED)
        self.linear1 = nn.Linear(ENCODED, 5)
        self.lat_linear = nn.Linear(LATERAL, 8)
        self.lon_linear = nn.Linear(LONGITUDINAL, 8)
        self.dec_linear = nn.Linear(ENCODED + LATERAL + LONGITUDINAL, ENCODED)

    def forward(self, mapped: Tensor, lateral: Tensor, longitudinal: Tensor) -> Tensor:
        manoeuvre = torch.cat((lateral, longitudinal), dim=-1).expand(FUTURE_POINTS, -1, -1)
        hidden, _ = self.lstm(self.dec_linear(torch.cat((mapped, manoeuvre), dim=-1)))
        return gaussian(self.linear1(hidden))


class ManoeuvreGenerator(nn.Module):
    """Recognises the manoeuvre, maps past points to future points accordingly, and decodes these.

    ``manmapping`` has weights and is not used.
    """

    def __init__(self) -> None:
        super().__init__()
        self.Decoder = _Decoder()
        self.mu_fc1 = nn.Linear(ENCODED, ATTENDED)
        self.mu_fc = nn.Linear(ATTENDED, ENCODED)
        self.op_lat = nn.Linear(ENCODED, LATERAL)
        self.op_lon = nn.Linear(ENCODED, LONGITUDINAL)
        self.normalize = nn.LayerNorm(ENCODED)
        self.mapping = nn.Parameter(torch.zeros(HISTORY_POINTS, FUTURE_POINTS, LATERAL + LONGITUDINAL))
        self.manmapping = nn.Parameter(torch.zeros(HISTORY_POINTS, 1))
        self.activation = nn.ELU()

    def recognise(self, encoded: Tensor) -> tuple[Tensor, Tensor]:
        """Probabilities of the lateral and of the longitudinal manoeuvres, each ``(B, 3)``.

        Args:
            encoded: The encoded past, shape ``(B, 16, 64)``.
        """
        state = self.activation(self.normalize(self.mu_fc(self.activation(self.mu_fc1(encoded[:, -1])))))
        return torch.softmax(self.op_lat(state), dim=-1), torch.softmax(self.op_lon(state), dim=-1)

    def decode(self, encoded: Tensor, chosen: tuple[Tensor, Tensor], fed: tuple[Tensor, Tensor]) -> Tensor:
        """Decode the Gaussians of the future, shape ``(25, B, 5)``.

        Args:
            encoded: The encoded past, shape ``(B, 16, 64)``.
            chosen: Manoeuvres that choose the mapping, one-hot, lateral and longitudinal, each ``(B, 3)``.
            fed: What the decoder gets of the manoeuvres, of the same shapes.
        """
        # The mapping of every combination of manoeuvres is computed, although a sample uses only one.
        weights = torch.softmax(torch.einsum("hfc,bc->bfh", self.mapping, torch.cat(chosen, dim=-1)), dim=-1)
        return self.Decoder((weights @ encoded).permute(1, 0, 2), *fed)


def most_probable(probabilities: Tensor) -> Tensor:
    """The most probable manoeuvre as a one-hot row."""
    return one_hot(probabilities.argmax(dim=-1), probabilities.shape[-1]).float()


@dataclass(frozen=True)
class Neighbours:
    """P neighbours of B samples, sorted by sample and then by cell; integer tensors of shape ``(P,)``."""

    sample: Tensor
    cell: Tensor
    """Cell of the social grid, 0 to 38."""
    samples: int
    """Number of samples, B."""

    @property
    def place(self) -> Tensor:
        """Index of each neighbour's cell among all cells of all samples."""
        return self.sample * CELLS + self.cell


@dataclass(frozen=True)
class NetworkInput:
    """Features of B samples and P neighbours by point and vehicle; each network defines its F features."""

    history: Tensor
    """Features of the samples, shape ``(16, B, F)``."""
    neighbour_history: Tensor
    """Features of the neighbours, shape ``(16, P, F)``."""
    neighbours: Neighbours


@dataclass(frozen=True)
class Groups:
    """Sorts the rows of a tensor into G groups of at most S rows."""

    group: Tensor
    """Group of each of P rows, increasing."""
    slot: Tensor
    """Slot of each row in its group."""
    count: Tensor
    """Number of rows in each group, shape ``(G,)``."""

    @classmethod
    def of(cls, group: Tensor, groups: int) -> "Groups":
        """Make groups from rows that are sorted by group."""
        count = torch.bincount(group, minlength=groups)
        first = torch.cumsum(count, 0) - count
        return cls(group, torch.arange(len(group)) - first[group], count)

    @property
    def slots(self) -> int:
        """Number of rows of the largest group, at least one."""
        return max(int(self.count.max()), 1) if len(self.count) else 1

    @property
    def filled(self) -> Tensor:
        """Which slots hold a row, shape ``(G, S)``."""
        return torch.arange(self.slots) < self.count[:, None]

    def spread(self, rows: Tensor) -> Tensor:
        """Rearrange rows ``(P, …)`` as ``(G, S, …)``; empty slots are zero."""
        spread = rows.new_zeros((len(self.count), self.slots, *rows.shape[1:]))
        spread[self.group, self.slot] = rows
        return spread

    def gather(self, spread: Tensor) -> Tensor:
        """Inverse of ``spread``."""
        return spread[self.group, self.slot]
