"""A trained baseline: a small transformer over the vehicle's history and its neighbours, without a map."""

import torch
from torch import Tensor, nn

from siren_ros.lab.training.fitting.motion_network import MotionNetwork
from siren_ros.lab.training.fitting.path_network import MODES, Attention, NetworkSize, encoder, hiding
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow


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
        """As ``PathNetwork.forward``; the arguments of the road are ignored."""
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
