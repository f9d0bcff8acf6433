"""A trained baseline: an LSTM over the vehicle's own history, without neighbours and map."""

import torch
from torch import Tensor, nn

from siren_ros.lab.training.fitting.motion_network import MotionNetwork
from siren_ros.lab.training.fitting.path_network import MODES, NetworkSize


class LstmNetwork(MotionNetwork):
    """LSTM over the points of the history; each mode has its own learned vector."""

    def __init__(self, size: NetworkSize) -> None:
        super().__init__(size)
        self.reader = nn.LSTM(4, size.width, batch_first=True)

    def forward(self, target: Tensor, *_others: Tensor) -> tuple[Tensor, Tensor]:
        """As ``PathNetwork.forward``; the other arguments are ignored."""
        history, other = self.history(target)
        read = self.reader(history)[0][:, -1]
        vehicle = (read + other)[:, None].expand(-1, MODES, -1)
        return self.motion(target, torch.cat((vehicle, self.modes.expand(target.shape[0], -1, -1)), dim=-1))
