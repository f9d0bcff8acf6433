"""The fitted network as an ONNX file."""

import io
import warnings
from dataclasses import fields
from typing import Final

import onnx
import torch
from torch import nn

from siren_ros.evaluation.prediction.siren_model.features import SHAPES, Features
from siren_ros.evaluation.prediction.siren_model.network_file import OUTPUTS
from siren_ros.training.fitting.network import PathNetwork

_OPSET: Final = 17


class _Answer(nn.Module):
    """Probabilities in place of logits."""

    def __init__(self, network: PathNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, *features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        xy_m, logits = self.network(*features)
        return xy_m, torch.softmax(logits, dim=-1)


def onnx_bytes(network: PathNetwork) -> bytes:
    """The network with any number of samples; inputs are named like the fields of ``Features``."""
    samples, size = 2, network.size
    shapes = {
        "target": (samples, size.target),
        "speed_mps": (samples,),
        "neighbours": (samples, SHAPES["neighbours"], size.neighbour),
        "neighbour_there": (samples, SHAPES["neighbours"]),
        "path_points_m": (samples, SHAPES["paths"], SHAPES["path_points"], 2),
        "path_spacing_m": (samples,),
        "paths": (samples, SHAPES["paths"], size.path),
        "path_there": (samples, SHAPES["paths"]),
    }
    names = [field.name for field in fields(Features)]
    example = tuple(
        torch.ones(shapes[name], dtype=torch.bool if name.endswith("_there") else torch.float32) for name in names
    )
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        # The exporter that traces is announced to go; its successor needs three packages more.
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.onnx.export(
            _Answer(network).eval(),
            example,
            buffer,
            dynamo=False,
            opset_version=_OPSET,
            input_names=names,
            output_names=list(OUTPUTS),
            dynamic_axes={name: {0: "samples"} for name in (*names, *OUTPUTS)},
        )
    written = buffer.getvalue()
    onnx.checker.check_model(onnx.load_from_string(written))
    return written
