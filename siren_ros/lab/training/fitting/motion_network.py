"""Trained baselines without a map: an LSTM over the vehicle's own past, a transformer that sees its neighbours, too.

Their base has the history as a sequence, and motion as deviation from the present velocity.
"""

from typing import Final

import torch
from torch import Tensor, nn

from siren_ros.lab.training.fitting.path_network import (
    MODES,
    SIDEWAYS_UNIT_MPS,
    SPEED_UNIT_MPS,
    Attention,
    FeatureNetwork,
    NetworkSize,
    answer_layers,
    encoder,
    hiding,
)
from siren_ros.scoring.evaluation.prediction.samples import FUTURE_POINTS, HistoryWindow
from siren_ros.scoring.evaluation.prediction.siren_model.columns import SPEED_SCALE_MPS

_POINTS: Final = HistoryWindow().points
_SEQUENCE: Final = 2 * (_POINTS - 1) + 2 * _POINTS
"""Number of sequence columns at the start of a target: positions x and y without the present, velocities x and y
(``target_columns``)."""


class MotionNetwork(FeatureNetwork):
    """Base class: six hypotheses from a token of the vehicle. Before training, each keeps the present velocity."""

    def __init__(self, size: NetworkSize) -> None:
        super().__init__(size)
        width = size.width
        self.other_in = encoder(size.target - _SEQUENCE, width)
        self.modes = nn.Parameter(torch.randn(MODES, width))
        self.drive, self.likely = answer_layers(2 * width, width)

    def history(self, target: Tensor) -> tuple[Tensor, Tensor]:
        """Positions and velocities of the history, ``(N, points, 4)``, and a token of the rest, ``(N, width)``."""
        known = (target - self.target_mean) / self.target_std
        before = _POINTS - 1
        x, y, vx, vy, other = torch.split(known, [before, before, _POINTS, _POINTS, known.shape[1] - _SEQUENCE], dim=1)
        here = torch.zeros_like(x[:, :1])
        places = torch.cat((x, here), dim=1), torch.cat((y, here), dim=1)
        return torch.stack((*places, vx, vy), dim=-1), self.other_in(other)

    def motion(self, target: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
        """Paths and logits as of ``PathNetwork``, from contexts of the modes, ``(N, MODES, 2 · width)``."""
        answer = self.drive(context).reshape(-1, MODES, 2, FUTURE_POINTS)
        last = _SEQUENCE - _POINTS - 1
        velocity = SPEED_SCALE_MPS * torch.stack((target[:, last], target[:, _SEQUENCE - 1]), dim=-1)
        along = self.times_s * (velocity[:, 0, None, None] + SPEED_UNIT_MPS * answer[:, :, 0])
        across = self.times_s * (velocity[:, 1, None, None] + SIDEWAYS_UNIT_MPS * answer[:, :, 1])
        return torch.stack((along, across), dim=-1), self.likely(context)[..., 0]


class LstmNetwork(MotionNetwork):
    """LSTM over the points of the history; each mode has its own learned vector."""

    def __init__(self, size: NetworkSize) -> None:
        super().__init__(size)
        self.reader = nn.LSTM(4, size.width, batch_first=True)

    def forward(self, target: Tensor, *_others: Tensor) -> tuple[Tensor, Tensor]:
        """Implements ``PathNetwork.forward``; the other arguments are ignored."""
        history, other = self.history(target)
        read = self.reader(history)[0][:, -1]
        vehicle = (read + other)[:, None].expand(-1, MODES, -1)
        return self.motion(target, torch.cat((vehicle, self.modes.expand(target.shape[0], -1, -1)), dim=-1))


class TransformerNetwork(MotionNetwork):
    """Points of the history, the vehicle and its neighbours are tokens of one sequence; each mode attends to them."""

    def __init__(self, size: NetworkSize) -> None:
        super().__init__(size)
        self.point_in = nn.Linear(4, size.width)
        self.place = nn.Parameter(0.1 * torch.randn(HistoryWindow().points, size.width))
        self.neighbour_in = encoder(size.neighbour, size.width)
        self.layers = nn.ModuleList(Attention(size.width, size.heads, size.dropout) for _ in range(size.layers))
        self.ask = Attention(size.width, size.heads, size.dropout)

    def forward(
        self, target: Tensor, speed_mps: Tensor, neighbours: Tensor, neighbour_there: Tensor, *_road: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Implements ``PathNetwork.forward``; the arguments of the road are ignored."""
        history, other = self.history(target)
        points = self.point_in(history) + self.place
        around = self.neighbour_in((neighbours - self.neighbour_mean) / self.neighbour_std)
        tokens = torch.cat((other[:, None], points, around), dim=1)
        own = torch.zeros_like(speed_mps)[:, None].expand(-1, 1 + points.shape[1])
        hidden = torch.cat((own, hiding(neighbour_there)), dim=1)
        for layer in self.layers:
            tokens = layer(tokens, tokens, hidden)
        modes = self.modes.expand(target.shape[0], -1, -1)
        asked = self.ask(modes + tokens[:, :1], tokens, hidden)
        return self.motion(target, torch.cat((tokens[:, :1].expand(-1, MODES, -1), asked), dim=-1))
