"""BAT, in the variant of the published weights.

H. Liao, Z. Li, H. Shen, W. Zeng, D. Liao, G. Li, C. Xu, "BAT: Behavior-Aware Human-Like Trajectory Prediction for
Autonomous Driving", AAAI 2024.

The samples of a scene see each other: all their neighbours attend to each other, and the behaviours' LSTM runs from
sample to sample. The published code takes each of its random batches for a scene; here the caller says what a scene is.

The names of the layers are those of the weights. The encoder's ``qff``, ``kff``, ``vff``, ``second_glu``, ``qt``,
``kt``, ``vt``, ``addAndNorm`` and ``fc`` have weights and are not used.
"""

import math
from dataclasses import dataclass
from typing import Final

import torch
from torch import Tensor, nn

from siren_ros.datasets.ngsim import CELLS
from siren_ros.evaluation.prediction.published.layers import (
    ATTENDED,
    ENCODED,
    LATERAL,
    LONGITUDINAL,
    GatedEncoder,
    Groups,
    ManoeuvreGenerator,
    NetworkInput,
    one_hot_modes,
)

_VEHICLE: Final = 16
_BEHAVIOURS: Final = 6
_BEHAVIOUR_EMBEDDED: Final = 4


@dataclass(frozen=True)
class BatInput(NetworkInput):
    """Features: r (feet), φ, displacement x and y (feet), class, speed (ft/s), acceleration (ft/s²), lane."""

    behaviour: Tensor
    """Shape ``(16, B, 39, 6)``."""
    scene: Tensor
    """Scene of each sample, from 0 and ascending, shape ``(B,)``."""


class _Attention(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.linear_query = nn.Linear(_VEHICLE, _VEHICLE)
        self.linear_key = nn.Linear(_VEHICLE, _VEHICLE)
        self.linear_value = nn.Linear(_VEHICLE, _VEHICLE)

    def forward(self, vehicles: Tensor, there: Tensor) -> Tensor:
        """Attention among the vehicles of each group, shape ``(G, 16, S, 16)``.

        Args:
            vehicles: Encoded points by group, point and slot, of the shape of the answer.
            there: Which slots hold a vehicle, shape ``(G, S)``.
        """
        keys = self.linear_key(vehicles).transpose(-1, -2)
        scores = self.linear_query(vehicles) @ keys / math.sqrt(_VEHICLE)
        scores = scores.masked_fill(~there[:, None, None, :], -math.inf)
        # A group without a vehicle has nothing to attend to, and nobody reads its row.
        return torch.nan_to_num(torch.softmax(scores, dim=-1)) @ self.linear_value(vehicles)


class BatEncoder(GatedEncoder):
    """The target's past, the mean of its neighbours after attention, and the behaviour of all cells."""

    def __init__(self) -> None:
        super().__init__(features=8, encoded=_VEHICLE)
        self.linear_behavior = nn.Linear(_BEHAVIOURS, _BEHAVIOUR_EMBEDDED)
        self.lstm_behavior = nn.LSTM(_BEHAVIOUR_EMBEDDED * CELLS, ENCODED)
        self.pre_glu_proj = nn.Linear(ATTENDED // 2, ATTENDED)
        self.attention = _Attention()
        self.behaviour_activation = nn.LeakyReLU(0.1)

    def forward(self, given: BatInput) -> Tensor:
        """The encoded past, shape ``(B, 16, 64)``."""
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
        """The behaviours of all cells, shape ``(B, 16, 64)``; the LSTM runs over the samples of a scene."""
        embedded = self.behaviour_activation(self.linear_behavior(given.behaviour.transpose(0, 1))).flatten(2)
        groups = Groups.of(given.scene, int(given.scene[-1]) + 1)
        sequences = groups.spread(embedded).transpose(0, 1)
        hidden, _ = self.lstm_behavior(sequences.flatten(1, 2))
        return groups.gather(hidden.unflatten(1, sequences.shape[1:3]).transpose(0, 1))


class Bat(nn.Module):
    """Encoder ``gd`` and generator ``g``; a mode for each combination of manoeuvres."""

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
