"""The networks of trajectory prediction: the predictor's, and trained baselines without a map.

The predictor combines motion along and across the road's paths by attention. A baseline is an LSTM over the vehicle's
own past, or a transformer that sees its neighbours, too; its input is the history as a sequence, its answer the
deviation from the present velocity.
"""

from dataclasses import dataclass
from typing import Final

import torch
from torch import Tensor, nn

from siren_ros.scoring.evaluation.prediction.samples import FUTURE_POINTS, HistoryWindow, future_times_s
from siren_ros.scoring.evaluation.prediction.siren_model.columns import SPEED_SCALE_MPS

MODES: Final = 6
SPEED_UNIT_MPS: Final = 3.0
"""Unit of the output along the path: mean deviation from the present speed until each time."""
SIDEWAYS_UNIT_MPS: Final = 0.7
"""Unit of the output across the path."""


@dataclass(frozen=True)
class NetworkSize:
    """Sizes of the layers."""

    target: int
    """Number of input columns of the target."""
    neighbour: int
    path: int
    width: int = 64
    heads: int = 4
    layers: int = 2
    dropout: float = 0.05


class Attention(nn.Module):
    """Multi-head attention from tokens to other tokens, with a feed-forward part; each is normalised first."""

    def __init__(self, width: int, heads: int, dropout: float) -> None:
        super().__init__()
        self.heads = heads
        self.before_query, self.before_source = nn.LayerNorm(width), nn.LayerNorm(width)
        self.query, self.key_value = nn.Linear(width, width), nn.Linear(width, 2 * width)
        self.merge = nn.Linear(width, width)
        self.forward_part = nn.Sequential(
            nn.LayerNorm(width), nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width)
        )
        self.dropout = nn.Dropout(dropout)

    def forward(self, tokens: Tensor, source: Tensor, hidden: Tensor) -> Tensor:
        """Apply to tokens ``(N, A, width)`` and source ``(N, B, width)``.

        ``hidden`` is 0 or very negative, ``(N, B)``.
        """
        rows, wide = tokens.shape[1], tokens.shape[2] // self.heads
        query = self.query(self.before_query(tokens)).reshape(-1, rows, self.heads, wide).transpose(1, 2)
        both = (
            self.key_value(self.before_source(source))
            .reshape(-1, source.shape[1], 2, self.heads, wide)
            .permute(2, 0, 3, 1, 4)
        )
        scores = query @ both[0].transpose(-1, -2) * wide**-0.5 + hidden[:, None, None]
        seen = (torch.softmax(scores, dim=-1) @ both[1]).transpose(1, 2).reshape(-1, rows, self.heads * wide)
        tokens = tokens + self.dropout(self.merge(seen))
        return tokens + self.dropout(self.forward_part(tokens))


class FeatureNetwork(nn.Module):
    """Base class: sizes, times of the output, and mean and spread of each column, which are set before training."""

    times_s: Tensor
    target_mean: Tensor
    target_std: Tensor
    neighbour_mean: Tensor
    neighbour_std: Tensor
    path_mean: Tensor
    path_std: Tensor

    def __init__(self, size: NetworkSize) -> None:
        super().__init__()
        self.size = size
        self.register_buffer("times_s", torch.tensor(future_times_s(), dtype=torch.float32))
        for name, columns in (("target", size.target), ("neighbour", size.neighbour), ("path", size.path)):
            self.register_buffer(f"{name}_mean", torch.zeros(columns))
            self.register_buffer(f"{name}_std", torch.ones(columns))


class PathNetwork(FeatureNetwork):
    """Six hypotheses as motion along and across a mixture of the sample's paths and its straight heading.

    Before training, every hypothesis keeps the present speed along the likeliest paths.
    """

    def __init__(self, size: NetworkSize) -> None:
        super().__init__(size)
        width = size.width
        self.target_in = encoder(size.target, width)
        self.neighbour_in = encoder(size.neighbour, width)
        self.path_in = encoder(size.path + 2 * len(_SHOWN_POINTS), width)
        self.heading = nn.Parameter(0.1 * torch.randn(1, 1, width))
        self.over_neighbours = nn.ModuleList(Attention(width, size.heads, size.dropout) for _ in range(size.layers))
        self.over_road = nn.ModuleList(Attention(width, size.heads, size.dropout) for _ in range(size.layers))
        self.modes = nn.Parameter(torch.randn(MODES, width))
        self.merge = nn.Sequential(nn.Linear(2 * width, 2 * width), nn.GELU(), nn.Linear(2 * width, width), nn.GELU())
        self.choose = nn.Linear(width, width)
        self.drive, self.likely = answer_layers(3 * width, width)

    def forward(
        self,
        target: Tensor,
        speed_mps: Tensor,
        neighbours: Tensor,
        neighbour_there: Tensor,
        path_points_m: Tensor,
        path_spacing_m: Tensor,
        paths: Tensor,
        path_there: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Paths in the samples' frames, ``(N, MODES, FUTURE_POINTS, 2)`` in metres, and logits ``(N, MODES)``.

        The arguments are the fields of ``Features``.
        """
        vehicle = self.target_in((target - self.target_mean) / self.target_std)[:, None]
        others = self.neighbour_in((neighbours - self.neighbour_mean) / self.neighbour_std)
        road = self.path_in(torch.cat((_shapes(path_points_m), (paths - self.path_mean) / self.path_std), dim=-1))
        heading = self.heading.expand(target.shape[0], 1, -1)
        tokens = torch.cat((vehicle, heading, road), dim=1)
        hide_others = torch.cat((torch.zeros_like(speed_mps)[:, None], hiding(neighbour_there)), dim=1)
        hide_road = torch.cat((torch.zeros_like(speed_mps)[:, None].expand(-1, 2), hiding(path_there)), dim=1)
        for over_neighbours, over_road in zip(self.over_neighbours, self.over_road, strict=True):
            tokens = over_neighbours(tokens, torch.cat((tokens[:, :1], others), dim=1), hide_others)
            tokens = over_road(tokens, tokens, hide_road)
        return self._drive(tokens, hide_road[:, 1:], speed_mps, path_points_m, path_spacing_m)

    def _drive(
        self, tokens: Tensor, hidden: Tensor, speed_mps: Tensor, path_points_m: Tensor, path_spacing_m: Tensor
    ) -> tuple[Tensor, Tensor]:
        vehicle, ways = tokens[:, :1].expand(-1, MODES, -1), tokens[:, 1:]
        intent = self.merge(torch.cat((vehicle, self.modes.expand(tokens.shape[0], -1, -1)), dim=-1))
        scores = self.choose(intent) @ ways.transpose(-1, -2) * ways.shape[-1] ** -0.5
        share = torch.softmax(scores + hidden[:, None], dim=-1)
        context = torch.cat((vehicle, intent, share @ ways), dim=-1)
        answer = self.drive(context).reshape(-1, MODES, 2, FUTURE_POINTS)
        along = self.times_s * (speed_mps[:, None, None] + SPEED_UNIT_MPS * answer[:, :, 0])
        across = self.times_s * SIDEWAYS_UNIT_MPS * answer[:, :, 1]
        straight = torch.stack((along, across), dim=-1)
        on_paths = _on_paths(path_points_m, path_spacing_m, along, across)
        mixed = (share.transpose(1, 2)[:, 1:, :, None, None] * on_paths).sum(dim=1)
        return share[:, :, :1, None] * straight + mixed, self.likely(context)[..., 0]


def answer_layers(columns: int, width: int) -> tuple[nn.Sequential, nn.Sequential]:
    """Layers for a mode's motion (initially zero) and its logit, from a context."""
    drive = nn.Sequential(nn.Linear(columns, 2 * width), nn.GELU(), nn.Linear(2 * width, 2 * FUTURE_POINTS))
    likely = nn.Sequential(nn.Linear(columns, width), nn.GELU(), nn.Linear(width, 1))
    nn.init.zeros_(drive[-1].weight)
    nn.init.zeros_(drive[-1].bias)
    return drive, likely


def encoder(columns: int, width: int) -> nn.Sequential:
    """Two layers that convert columns to a token."""
    return nn.Sequential(nn.Linear(columns, 2 * width), nn.GELU(), nn.Linear(2 * width, width))


_SHOWN_POINTS: Final = (2, 5, 8, 11, 15, 19, 23, 27, 31)
_SHAPE_SCALE_M: Final = 30.0


def _shapes(points_m: Tensor) -> Tensor:
    """Some points of each path as columns."""
    shown = points_m[:, :, list(_SHOWN_POINTS)] / _SHAPE_SCALE_M
    return shown.reshape(-1, points_m.shape[1], 2 * len(_SHOWN_POINTS))


def hiding(there: Tensor) -> Tensor:
    """Mask for ``Attention``: 0 where a token exists, else a large negative number."""
    return (there.to(torch.float32) - 1.0) * 1e4


def _on_paths(points_m: Tensor, spacing_m: Tensor, along_m: Tensor, across_m: Tensor) -> Tensor:
    """Positions along paths with lateral offset, ``(N, P, M, T, 2)``; paths are extended straight at both ends.

    Args:
        points_m: Points of the paths, ``(N, P, K, 2)``.
        spacing_m: Between consecutive points, ``(N,)``.
        along_m: Arc lengths, ``(N, M, T)``.
        across_m: Offsets to the left, ``(N, M, T)``.
    """
    paths, points = points_m.shape[1], points_m.shape[2]
    position = along_m / spacing_m[:, None, None]
    index = torch.clamp(torch.floor(position.detach()), 0, points - 2)
    within = (position - index)[:, None, ..., None]
    flat = index.to(torch.int64).reshape(-1, 1, MODES * FUTURE_POINTS, 1).expand(-1, paths, -1, 2)
    shape = (-1, paths, MODES, FUTURE_POINTS, 2)
    start = torch.gather(points_m, 2, flat).reshape(shape)
    delta = torch.gather(points_m, 2, flat + 1).reshape(shape) - start
    length = torch.sqrt((delta * delta).sum(dim=-1, keepdim=True) + 1e-6)
    normal = torch.stack((-delta[..., 1], delta[..., 0]), dim=-1) / length
    return start + within * delta + across_m[:, None, ..., None] * normal


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
