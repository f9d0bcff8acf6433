"""CSP: N. Deo, M. M. Trivedi, "Convolutional Social Pooling for Vehicle Trajectory Prediction", CVPR Workshops 2018.

The names of the layers are those of the published weights.
"""

from typing import Final

import torch
from torch import Tensor, nn

from siren_ros.datasets.ngsim import CELLS, CELLS_ALONG, COLUMNS
from siren_ros.evaluation.prediction.published.layers import NetworkInput, gaussian, one_hot_modes

LATERAL: Final = 3
LONGITUDINAL: Final = 2
_EMBEDDED: Final = 32
_ENCODED: Final = 64
_DYNAMICS: Final = 32
_CONVOLVED: Final = 64
_POOLED: Final = 16
_DECODED: Final = 128
_POINTS: Final = 25
_SOCIAL: Final = 5 * _POOLED
"""13 cells along, after convolutions of 3 and 3: 9; pooled by two, with one more at either end: 5."""


class Csp(nn.Module):
    """An LSTM for every vehicle, convolutions over the social grid, an LSTM that decodes each manoeuvre.

    Features: x to the right and y ahead of the target at the present, in feet.
    """

    def __init__(self) -> None:
        super().__init__()
        self.ip_emb = nn.Linear(2, _EMBEDDED)
        self.enc_lstm = nn.LSTM(_EMBEDDED, _ENCODED)
        self.dyn_emb = nn.Linear(_ENCODED, _DYNAMICS)
        self.soc_conv = nn.Conv2d(_ENCODED, _CONVOLVED, 3)
        self.conv_3x1 = nn.Conv2d(_CONVOLVED, _POOLED, (3, 1))
        self.soc_maxpool = nn.MaxPool2d((2, 1), padding=(1, 0))
        self.dec_lstm = nn.LSTM(_SOCIAL + _DYNAMICS + LATERAL + LONGITUDINAL, _DECODED)
        self.op = nn.Linear(_DECODED, 5)
        self.op_lat = nn.Linear(_SOCIAL + _DYNAMICS, LATERAL)
        self.op_lon = nn.Linear(_SOCIAL + _DYNAMICS, LONGITUDINAL)
        self.activation = nn.LeakyReLU(0.1)

    def forward(self, given: NetworkInput) -> tuple[Tensor, Tensor, Tensor]:
        """Modes ``(6, 25, B, 5)``, and the probabilities of lateral ``(B, 3)`` and longitudinal ``(B, 2)`` manoeuvres.

        Mode l + 3 k has the lateral manoeuvre l and the longitudinal manoeuvre k.
        """
        dynamics = self.activation(self.dyn_emb(self._encoded(given.history)))
        encoded = torch.cat((self._pooled(given), dynamics), dim=1)
        lateral = torch.softmax(self.op_lat(encoded), dim=1)
        longitudinal = torch.softmax(self.op_lon(encoded), dim=1)
        modes = one_hot_modes(len(encoded), LATERAL, LONGITUDINAL)
        decoded = [self._decoded(torch.cat((encoded, *mode), dim=1)) for mode in modes]
        return torch.stack(decoded), lateral, longitudinal

    def _encoded(self, history: Tensor) -> Tensor:
        _, (last, _) = self.enc_lstm(self.activation(self.ip_emb(history)))
        return last[0]

    def _pooled(self, given: NetworkInput) -> Tensor:
        grid = given.history.new_zeros((given.neighbours.samples * CELLS, _ENCODED))
        if given.neighbour_history.shape[1]:
            grid[given.neighbours.place] = self._encoded(given.neighbour_history)
        # Channels, cells along the road, columns of lanes.
        grid = grid.view(-1, COLUMNS, CELLS_ALONG, _ENCODED).permute(0, 3, 2, 1)
        convolved = self.activation(self.conv_3x1(self.activation(self.soc_conv(grid))))
        return self.soc_maxpool(convolved).reshape(-1, _SOCIAL)

    def _decoded(self, encoded: Tensor) -> Tensor:
        hidden, _ = self.dec_lstm(encoded.expand(_POINTS, -1, -1))
        return gaussian(self.op(hidden))
