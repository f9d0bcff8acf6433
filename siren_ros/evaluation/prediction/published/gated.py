"""Layers that STDAN and BAT share, with the names of the published weights."""

from typing import Final

import torch
from torch import Tensor, nn
from torch.nn.functional import one_hot

from siren_ros.evaluation.prediction.published.manoeuvres import gaussian

ENCODED: Final = 64
HEADS: Final = 4
HEAD_SIZE: Final = 48
ATTENDED: Final = HEADS * HEAD_SIZE
EMBEDDED: Final = 32
LATERAL: Final = 3
LONGITUDINAL: Final = 3
HISTORY_POINTS: Final = 16
_POINTS: Final = 25


class GatedLinear(nn.Module):
    """A linear layer whose output a second one gates."""

    def __init__(self) -> None:
        super().__init__()
        self.activation_layer = nn.Linear(ATTENDED, ENCODED)
        self.gated_layer = nn.Linear(ATTENDED, ENCODED)

    def forward(self, values: Tensor) -> Tensor:
        """Shape ``(…, 192)`` to ``(…, 64)``."""
        return self.activation_layer(values) * torch.sigmoid(self.gated_layer(values))


class AddAndNorm(nn.Module):
    """A residual connection with layer normalisation."""

    def __init__(self) -> None:
        super().__init__()
        self.normalize = nn.LayerNorm(ENCODED)

    def forward(self, first: Tensor, second: Tensor) -> Tensor:
        """The normalised sum."""
        return self.normalize(first + second)


class _Decoder(nn.Module):
    """An LSTM over the points of the future; ``lat_linear`` and ``lon_linear`` have weights and are not used."""

    def __init__(self) -> None:
        super().__init__()
        self.lstm = nn.LSTM(ENCODED, ENCODED)
        self.linear1 = nn.Linear(ENCODED, 5)
        self.lat_linear = nn.Linear(LATERAL, 8)
        self.lon_linear = nn.Linear(LONGITUDINAL, 8)
        self.dec_linear = nn.Linear(ENCODED + LATERAL + LONGITUDINAL, ENCODED)

    def forward(self, mapped: Tensor, lateral: Tensor, longitudinal: Tensor) -> Tensor:
        manoeuvre = torch.cat((lateral, longitudinal), dim=-1).expand(_POINTS, -1, -1)
        hidden, _ = self.lstm(self.dec_linear(torch.cat((mapped, manoeuvre), dim=-1)))
        return gaussian(self.linear1(hidden))


class ManoeuvreGenerator(nn.Module):
    """Recognises the manoeuvre, maps the points of the past to those of the future accordingly, and decodes them.

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
        self.mapping = nn.Parameter(torch.zeros(HISTORY_POINTS, _POINTS, LATERAL + LONGITUDINAL))
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
        """Gaussians of the future, shape ``(25, B, 5)``.

        Args:
            encoded: The encoded past, shape ``(B, 16, 64)``.
            chosen: Manoeuvres that choose the mapping, one-hot, lateral and longitudinal, each ``(B, 3)``.
            fed: What the decoder gets of the manoeuvres, of the same shapes.
        """
        # One mapping for each combination of manoeuvres, though every sample names its own.
        weights = torch.softmax(torch.einsum("hfc,bc->bfh", self.mapping, torch.cat(chosen, dim=-1)), dim=-1)
        return self.Decoder((weights @ encoded).permute(1, 0, 2), *fed)


def most_probable(probabilities: Tensor) -> Tensor:
    """The most probable manoeuvre as one-hot rows."""
    return one_hot(probabilities.argmax(dim=-1), probabilities.shape[-1]).float()
