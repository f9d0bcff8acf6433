"""The fitted network as an ONNX file that finds boxes, not only maps."""

import io
import warnings
from typing import Final

import onnx
import torch
from torch import Tensor, nn

from siren_ros.evaluation.detection.pillars.network_file import INPUTS, OUTPUTS
from siren_ros.evaluation.detection.pillars.pillars import FEATURES
from siren_ros.training.detection.fitting.network import PillarNetwork
from siren_ros.training.detection.targets import STRIDE

_OPSET: Final = 17
_MOST_BOXES: Final = 150


class BoxesOf(nn.Module):
    """The network with CenterPoint's decoding: cells that are the highest among their neighbours."""

    def __init__(self, network: PillarNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, points: Tensor, cell: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """One frame's pillars, to the outputs of ``DetectorNetwork``."""
        logit, classes, box = self.network(points, cell)
        heat = torch.sigmoid(logit)
        highest = nn.functional.max_pool2d(heat[:, None], 3, stride=1, padding=1)[:, 0]
        peaks = torch.where(heat == highest, heat, torch.zeros_like(heat)).reshape(-1)
        rows = logit.shape[-1]
        score, place = torch.topk(peaks, min(_MOST_BOXES, rows * rows))
        values = box.reshape(box.shape[1], -1)[:, place].T
        share = torch.softmax(classes.reshape(classes.shape[1], -1)[:, place].T, dim=-1)
        grid = self.network.grid
        at = torch.stack((place % rows, torch.div(place, rows, rounding_mode="floor")), dim=-1)
        middle = (at.to(values.dtype) + 0.5) * (STRIDE * grid.cell_m) - grid.half_width_m
        centre = torch.cat((middle + values[:, :2], values[:, 2:3]), dim=-1)
        table = torch.cat((centre, torch.exp(values[:, 3:6]), values[:, 6:]), dim=-1)
        return table, score, share


def onnx_bytes(network: PillarNetwork) -> bytes:
    """The network for one frame with any number of pillars."""
    grid, pillars = network.grid, 7
    example = (
        torch.rand(pillars, grid.points, len(FEATURES)),
        torch.arange(pillars, dtype=torch.int64) * 3 % grid.cells**2,
    )
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        # The exporter that traces is announced to go; its successor needs three packages more.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            BoxesOf(network).cpu().eval(),
            example,
            buffer,
            dynamo=False,
            opset_version=_OPSET,
            input_names=list(INPUTS),
            output_names=list(OUTPUTS),
            dynamic_axes={name: {0: "pillars"} for name in INPUTS},
        )
    written = buffer.getvalue()
    onnx.checker.check_model(onnx.load_from_string(written))
    return written
