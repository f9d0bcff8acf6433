"""STDAN, in the variant of the published weights.

X. Chen, H. Zhang, F. Zhao, Y. Hu, C. Tan, J. Yang, "Intention-Aware Vehicle Trajectory Prediction Based on
Spatial-Temporal Dynamic Attention Network for Internet of Vehicles", IEEE T-ITS 23 (2022) 19471.

The names of the layers are those of the published weights; ``fc`` of the encoder has weights and is not used.
"""

import math

import torch
from torch import Tensor, nn

from siren_ros.datasets.ngsim import CELLS
from siren_ros.evaluation.prediction.published.layers import (
    ENCODED,
    HEAD_SIZE,
    HEADS,
    GatedEncoder,
    Groups,
    ManoeuvreGenerator,
    NetworkInput,
    most_probable,
)


class StdanEncoder(GatedEncoder):
    """Attention over the cells at each point of the past, then over the points.

    Features: x, y (feet), class, speed (ft/s), acceleration (ft/s²).
    """

    def __init__(self) -> None:
        super().__init__(features=5, encoded=ENCODED)

    def forward(self, given: NetworkInput) -> Tensor:
        """The encoded past, shape ``(B, 16, 64)``."""
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
        seen = groups.spread(self.encoded(given.neighbour_history)) if groups.group.numel() else None
        count = groups.count.to(target.dtype)
        empty = (query @ self.kff.bias.view(HEADS, HEAD_SIZE, 1)) / math.sqrt(ENCODED)
        empty = empty + torch.log(CELLS - count).view(-1, 1, 1, 1, 1)
        empty_value = self.vff.bias.view(HEADS, 1, HEAD_SIZE)
        if seen is None:
            return _joined((torch.softmax(empty, dim=-1) @ empty_value).squeeze(-2))
        # (B, S, 16, …) to (B, 16, heads, S, …)
        keys = _heads(self.kff(seen)).permute(0, 2, 3, 1, 4)
        values = _heads(self.vff(seen)).permute(0, 2, 3, 1, 4)
        scores = (query @ keys.transpose(-1, -2)) / math.sqrt(ENCODED)
        scores = scores.masked_fill(~groups.filled[:, None, None, None, :], -math.inf)
        weights = torch.softmax(torch.cat((scores, empty), dim=-1), dim=-1)
        return _joined((weights[..., :-1] @ values + weights[..., -1:] @ empty_value).squeeze(-2))

    def _over_time(self, social: Tensor) -> Tensor:
        """Attention of the points of the past to each other, shape ``(B, 16, 192)``."""
        query, key, value = (_heads(layer(social)).transpose(1, 2) for layer in (self.qt, self.kt, self.vt))
        weights = torch.softmax((query @ key.transpose(-1, -2)) / math.sqrt(ENCODED), dim=-1)
        return _joined((weights @ value).transpose(1, 2))


class Stdan(nn.Module):
    """Encoder ``gd`` and generator ``g``; one hypothesis for each sample."""

    def __init__(self) -> None:
        super().__init__()
        self.gd = StdanEncoder()
        self.g = ManoeuvreGenerator()

    def forward(self, given: NetworkInput) -> tuple[Tensor, Tensor, Tensor]:
        """Gaussians ``(25, B, 5)``, and the probabilities of lateral and longitudinal manoeuvres, each ``(B, 3)``.

        The most probable manoeuvres choose the mapping; the decoder gets all probabilities.
        """
        encoded = self.gd(given)
        probabilities = self.g.recognise(encoded)
        lateral, longitudinal = probabilities
        chosen = most_probable(lateral), most_probable(longitudinal)
        return self.g.decode(encoded, chosen, probabilities), lateral, longitudinal


def _heads(values: Tensor) -> Tensor:
    return values.unflatten(-1, (HEADS, HEAD_SIZE))


def _joined(values: Tensor) -> Tensor:
    return values.flatten(-2)
