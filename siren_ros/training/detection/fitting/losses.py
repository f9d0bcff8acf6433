"""CenterPoint's losses."""

from typing import Final

import torch
from torch import Tensor

from siren_ros.training.detection.fit_config import DetectionFit

_CHANNEL_WEIGHT: Final = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.2, 0.2)
"""As CenterPoint: velocities, which are larger numbers, weigh 0.2."""


def heat_loss(logit: Tensor, heat: Tensor, counts: Tensor) -> Tensor:
    """The focal loss of CornerNet for a heatmap, over the number of vehicles.

    Args:
        logit: Of a vehicle, shape ``(B, R, R)``.
        heat: 1 at centres, falling around them.
        counts: 0 at cells that teach nothing.
    """
    share = torch.sigmoid(logit)
    sure, unsure = torch.nn.functional.logsigmoid(logit), torch.nn.functional.logsigmoid(-logit)
    centre = (heat > 0.999).to(logit.dtype)
    hit = centre * (1.0 - share) ** 2 * sure
    alarm = (1.0 - centre) * (1.0 - heat) ** 4 * share**2 * unsure
    return -((hit + alarm) * counts).sum() / centre.sum().clamp(min=1.0)


def box_loss(found: Tensor, box: Tensor, weight: Tensor) -> Tensor:
    """Absolute differences, over the weights of the cells; arguments have shapes ``(T, 10)``, ``(T, 10)``, ``(T,)``."""
    channels = found.new_tensor(_CHANNEL_WEIGHT)
    return ((found - box).abs() * channels * weight[:, None]).sum() / weight.sum().clamp(min=1.0)


def losses(
    answer: tuple[Tensor, Tensor, Tensor],
    maps: tuple[Tensor, Tensor],
    boxes: tuple[Tensor, Tensor, Tensor, Tensor],
    config: DetectionFit,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The whole loss, and its parts: heat, boxes, classes.

    Args:
        answer: Of the network.
        maps: ``heat`` and ``counts`` of the targets, shape ``(B, R, R)``.
        boxes: ``cell``, ``box``, ``weight``, ``label`` of the targets of all frames; cells counted on over the frames.
        config: Weights of the parts.
    """
    logit, classes, found = answer
    cell, box, weight, label = boxes
    heat = heat_loss(logit, *maps)
    at_cells = found.permute(0, 2, 3, 1).reshape(-1, found.shape[1])[cell]
    of_class = classes.permute(0, 2, 3, 1).reshape(-1, classes.shape[1])[cell]
    boxed = box_loss(at_cells, box, weight)
    surprise = torch.nn.functional.cross_entropy(of_class, label, reduction="none")
    named = (surprise * weight).sum() / weight.sum().clamp(min=1.0)
    return heat + config.box_weight * boxed + config.class_weight * named, heat, boxed, named
