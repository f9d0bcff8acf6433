"""The networks of CSP, STDAN and BAT in the published variants; layer names are those of the weights.

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
from dataclasses import dataclass
from typing import Final

import torch
from torch import Tensor, nn

from siren_ros.data.datasets.ngsim import CELLS, CELLS_ALONG, COLUMNS
from siren_ros.scoring.evaluation.prediction.published.layers import (
    ATTENDED,
    ENCODED,
    HEAD_SIZE,
    HEADS,
    LATERAL,
    LONGITUDINAL,
    GatedEncoder,
    Groups,
    ManoeuvreGenerator,
    NetworkInput,
    gaussian,
    most_probable,
    one_hot_modes,
)
from siren_ros.scoring.evaluation.prediction.samples import FUTURE_POINTS

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
        grid = grid.view(-1, COLUMNS, CELLS_ALONG, ENCODED).permute(0, 3, 2, 1)
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
