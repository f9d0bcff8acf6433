"""The networks of CSP, STDAN and BAT in the published variants; layer names are those of the weights.

Manoeuvres are modes, with a Gaussian for each predicted point. Neighbours of samples are padded groups, so that a
network handles all samples of a batch at once.

CSP: N. Deo, M. M. Trivedi, "Convolutional Social Pooling for Vehicle Trajectory Prediction", CVPR Workshops 2018.

STDAN: X. Chen, H. Zhang, F. Zhao, Y. Hu, C. Tan, J. Yang, "Intention-Aware Vehicle Trajectory Prediction Based on
Spatial-Temporal Dynamic Attention Network for Internet of Vehicles", IEEE T-ITS 23 (2022) 19471. ``fc`` of the encoder
has weights and is not used.

BAT: H. Liao, Z. Li, H. Shen, W. Zeng, D. Liao, G. Li, C. Xu, "BAT: Behavior-Aware Human-Like Trajectory Prediction for
Autonomous Driving", AAAI 2024. The samples of a scene see each other: all their neighbours attend to each other, and
the behaviours' LSTM runs from sample to sample. The published code takes each of its random batches for a scene; here
the caller says what a scene is. The encoder's ``qff``, ``kff``, ``vff``, ``second_glu``, ``qt``, ``kt``, ``vt``,
``addAndNorm`` and ``fc`` have weights and are not used.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import torch
from torch import Tensor, nn
from torch.nn.functional import one_hot

from siren_ros.data.datasets.trajectory_tables import CELLS, CELLS_ALONG, GRID_COLUMNS
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


_CSP_EMBEDDED: Final = 32
_CSP_DYNAMICS: Final = 32
_CSP_POOLED: Final = 16
_CSP_DECODED: Final = 128
_CSP_LONGITUDINAL: Final = 2
_CSP_SOCIAL: Final = 5 * _CSP_POOLED
"""Size of CSP's social encoding: 13 cells along the road become 9 after two convolutions, and 5 after pooling."""


class Csp(nn.Module):
    """An LSTM for every vehicle, convolutions over the social grid, an LSTM that decodes each manoeuvre.

    Features: x to the right and y ahead of the target at the present, in feet.
    """

    def __init__(self) -> None:
        super().__init__()
        self.ip_emb = nn.Linear(2, _CSP_EMBEDDED)
        self.enc_lstm = nn.LSTM(_CSP_EMBEDDED, ENCODED)
        self.dyn_emb = nn.Linear(ENCODED, _CSP_DYNAMICS)
        self.soc_conv = nn.Conv2d(ENCODED, ENCODED, 3)
        self.conv_3x1 = nn.Conv2d(ENCODED, _CSP_POOLED, (3, 1))
        self.soc_maxpool = nn.MaxPool2d((2, 1), padding=(1, 0))
        self.dec_lstm = nn.LSTM(_CSP_SOCIAL + _CSP_DYNAMICS + LATERAL + _CSP_LONGITUDINAL, _CSP_DECODED)
        self.op = nn.Linear(_CSP_DECODED, 5)
        self.op_lat = nn.Linear(_CSP_SOCIAL + _CSP_DYNAMICS, LATERAL)
        self.op_lon = nn.Linear(_CSP_SOCIAL + _CSP_DYNAMICS, _CSP_LONGITUDINAL)
        self.activation = nn.LeakyReLU(0.1)

    def forward(self, given: NetworkInput) -> tuple[Tensor, Tensor, Tensor]:
        """Modes ``(6, 25, B, 5)``, and the probabilities of lateral ``(B, 3)`` and longitudinal ``(B, 2)`` manoeuvres.

        Mode l + 3 k has the lateral manoeuvre l and the longitudinal manoeuvre k.
        """
        dynamics = self.activation(self.dyn_emb(self._encoded(given.history)))
        encoded = torch.cat((self._pooled(given), dynamics), dim=1)
        lateral = torch.softmax(self.op_lat(encoded), dim=1)
        longitudinal = torch.softmax(self.op_lon(encoded), dim=1)
        decoded = []
        for mode in one_hot_modes(len(encoded), LATERAL, _CSP_LONGITUDINAL):
            hidden, _ = self.dec_lstm(torch.cat((encoded, *mode), dim=1).expand(FUTURE_POINTS, -1, -1))
            decoded.append(gaussian(self.op(hidden)))
        return torch.stack(decoded), lateral, longitudinal

    def _encoded(self, history: Tensor) -> Tensor:
        _, (last, _) = self.enc_lstm(self.activation(self.ip_emb(history)))
        return last[0]

    def _pooled(self, given: NetworkInput) -> Tensor:
        grid = given.history.new_zeros((given.neighbours.samples * CELLS, ENCODED))
        if given.neighbour_history.shape[1]:
            grid[given.neighbours.place] = self._encoded(given.neighbour_history)
        # dimensions: channels, cells along the road, columns of lanes
        grid = grid.view(-1, GRID_COLUMNS, CELLS_ALONG, ENCODED).permute(0, 3, 2, 1)
        convolved = self.activation(self.conv_3x1(self.activation(self.soc_conv(grid))))
        return self.soc_maxpool(convolved).reshape(-1, _CSP_SOCIAL)


class StdanEncoder(GatedEncoder):
    """Attention over the cells at each point of the past, then over the points.

    Features: x, y (feet), class, speed (ft/s), acceleration (ft/s²).
    """

    def __init__(self) -> None:
        super().__init__(features=5, encoded=ENCODED)

    def forward(self, given: NetworkInput) -> Tensor:
        """Encode the past, shape ``(B, 16, 64)``."""
        target = self.encoded(given.history)
        social = self.addAndNorm(target, self.first_glu(self._over_cells(target, given)))
        return self.addAndNorm(target, self.second_glu(self._over_time(social)))

    def _over_cells(self, target: Tensor, given: NetworkInput) -> Tensor:
        """Attention of the target to the 39 cells, shape ``(B, 16, 192)``.

        An empty cell is a vector of zeros, so that all empty cells have one key and one value, the biases: they are one
        slot here, with their number as its weight.
        """
        groups = Groups.of(given.neighbours.sample, given.neighbours.samples)
        query = _heads(self.qff(target)).unsqueeze(-2)
        empty = (query @ self.kff.bias.view(HEADS, HEAD_SIZE, 1)) / math.sqrt(ENCODED)
        empty = empty + torch.log(CELLS - groups.count.to(target.dtype)).view(-1, 1, 1, 1, 1)
        empty_value = self.vff.bias.view(HEADS, 1, HEAD_SIZE)
        if not groups.group.numel():
            return (torch.softmax(empty, dim=-1) @ empty_value).squeeze(-2).flatten(-2)
        seen = groups.spread(self.encoded(given.neighbour_history))
        # (B, S, 16, …) to (B, 16, heads, S, …)
        keys, values = (_heads(layer(seen)).permute(0, 2, 3, 1, 4) for layer in (self.kff, self.vff))
        scores = (query @ keys.transpose(-1, -2)) / math.sqrt(ENCODED)
        scores = scores.masked_fill(~groups.filled[:, None, None, None, :], -math.inf)
        weights = torch.softmax(torch.cat((scores, empty), dim=-1), dim=-1)
        return (weights[..., :-1] @ values + weights[..., -1:] @ empty_value).squeeze(-2).flatten(-2)

    def _over_time(self, social: Tensor) -> Tensor:
        """Attention among the points of the past, shape ``(B, 16, 192)``."""
        query, key, value = (_heads(layer(social)).transpose(1, 2) for layer in (self.qt, self.kt, self.vt))
        weights = torch.softmax((query @ key.transpose(-1, -2)) / math.sqrt(ENCODED), dim=-1)
        return (weights @ value).transpose(1, 2).flatten(-2)


def _heads(values: Tensor) -> Tensor:
    return values.unflatten(-1, (HEADS, HEAD_SIZE))


class Stdan(nn.Module):
    """STDAN with encoder ``gd`` and generator ``g``; it gives one hypothesis per sample."""

    def __init__(self) -> None:
        super().__init__()
        self.gd = StdanEncoder()
        self.g = ManoeuvreGenerator()

    def forward(self, given: NetworkInput) -> tuple[Tensor, Tensor, Tensor]:
        """Gaussians ``(25, B, 5)``, and the probabilities of lateral and longitudinal manoeuvres, each ``(B, 3)``.

        The most probable manoeuvres choose the mapping; the decoder gets all probabilities.
        """
        encoded = self.gd(given)
        lateral, longitudinal = self.g.recognise(encoded)
        chosen = most_probable(lateral), most_probable(longitudinal)
        return self.g.decode(encoded, chosen, (lateral, longitudinal)), lateral, longitudinal


_VEHICLE: Final = 16
_BEHAVIOURS: Final = 6
_BEHAVIOUR_EMBEDDED: Final = 4


@dataclass(frozen=True)
class BatInput(NetworkInput):
    """Input of BAT: r (feet), φ, displacement x and y (feet), class, speed (ft/s), acceleration (ft/s²), lane."""

    behaviour: Tensor
    """Behaviour tensor, shape ``(16, B, 39, 6)``."""
    scene: Tensor
    """Scene of each sample, from 0 and increasing, shape ``(B,)``."""


class _Attention(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.linear_query = nn.Linear(_VEHICLE, _VEHICLE)
        self.linear_key = nn.Linear(_VEHICLE, _VEHICLE)
        self.linear_value = nn.Linear(_VEHICLE, _VEHICLE)

    def forward(self, vehicles: Tensor, filled: Tensor) -> Tensor:
        """Attention among the vehicles of each group, shape ``(G, 16, S, 16)``.

        Args:
            vehicles: Encoded points by group, point and slot, of the shape of the answer.
            filled: Which slots hold a vehicle, shape ``(G, S)``.
        """
        keys = self.linear_key(vehicles).transpose(-1, -2)
        scores = self.linear_query(vehicles) @ keys / math.sqrt(_VEHICLE)
        scores = scores.masked_fill(~filled[:, None, None, :], -math.inf)
        # A group without vehicles gives NaN in the softmax; its row is not used.
        return torch.nan_to_num(torch.softmax(scores, dim=-1)) @ self.linear_value(vehicles)


class BatEncoder(GatedEncoder):
    """Encodes the target's past, the mean of its neighbours after attention, and the behaviour of all cells."""

    def __init__(self) -> None:
        super().__init__(features=8, encoded=_VEHICLE)
        self.linear_behavior = nn.Linear(_BEHAVIOURS, _BEHAVIOUR_EMBEDDED)
        self.lstm_behavior = nn.LSTM(_BEHAVIOUR_EMBEDDED * CELLS, ENCODED)
        self.pre_glu_proj = nn.Linear(ATTENDED // 2, ATTENDED)
        self.attention = _Attention()
        self.behaviour_activation = nn.LeakyReLU(0.1)

    def forward(self, given: BatInput) -> Tensor:
        """Encode the past, shape ``(B, 16, 64)``."""
        encoded = torch.cat((self.encoded(given.history), self._pooled(given), self._behaviour(given)), dim=-1)
        return self.first_glu(self.pre_glu_proj(encoded))

    def _pooled(self, given: BatInput) -> Tensor:
        """Mean over the neighbours of each sample, zero without neighbours; shape ``(B, 16, 16)``."""
        neighbours = given.neighbours
        pooled = given.history.new_zeros((neighbours.samples, given.history.shape[0], _VEHICLE))
        if neighbours.sample.numel() == 0:
            return pooled
        groups = Groups.of(given.scene[neighbours.sample], int(given.scene[-1]) + 1)
        spread = groups.spread(self.encoded(given.neighbour_history)).transpose(1, 2)
        attended = groups.gather(self.attention(spread, groups.filled).transpose(1, 2))
        count = torch.bincount(neighbours.sample, minlength=neighbours.samples).clamp(min=1)
        return pooled.index_add(0, neighbours.sample, attended) / count.view(-1, 1, 1)

    def _behaviour(self, given: BatInput) -> Tensor:
        """Encode the behaviour of all cells, shape ``(B, 16, 64)``; the LSTM runs over the samples of a scene."""
        embedded = self.behaviour_activation(self.linear_behavior(given.behaviour.transpose(0, 1))).flatten(2)
        groups = Groups.of(given.scene, int(given.scene[-1]) + 1)
        sequences = groups.spread(embedded).transpose(0, 1)
        hidden, _ = self.lstm_behavior(sequences.flatten(1, 2))
        return groups.gather(hidden.unflatten(1, sequences.shape[1:3]).transpose(0, 1))


class Bat(nn.Module):
    """BAT with encoder ``gd`` and generator ``g``; it gives one mode per combination of manoeuvres."""

    def __init__(self) -> None:
        super().__init__()
        self.gd = BatEncoder()
        self.g = ManoeuvreGenerator()

    def forward(self, given: BatInput) -> tuple[Tensor, Tensor, Tensor]:
        """Modes ``(9, 25, B, 5)`` with **polar** means, and the probabilities of the manoeuvres, each ``(B, 3)``.

        Mode l + 3 k has the lateral manoeuvre l and the longitudinal manoeuvre k.
        """
        encoded = self.gd(given)
        lateral, longitudinal = self.g.recognise(encoded)
        modes = one_hot_modes(len(encoded), LATERAL, LONGITUDINAL)
        return torch.stack([self.g.decode(encoded, mode, mode) for mode in modes]), lateral, longitudinal
