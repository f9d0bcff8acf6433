"""What the three models share about manoeuvres: modes, and the Gaussian of each predicted point."""

from collections.abc import Iterator

import torch
from torch import Tensor
from torch.nn.functional import one_hot


def one_hot_modes(samples: int, lateral: int, longitudinal: int) -> Iterator[tuple[Tensor, Tensor]]:
    """The lateral ``(B, lateral)`` and longitudinal ``(B, longitudinal)`` manoeuvres of every mode, as one-hot rows.

    Lateral manoeuvres change fastest.
    """
    for mode in range(lateral * longitudinal):
        along, across = divmod(mode, lateral)
        yield (
            one_hot(torch.full((samples,), across), lateral).float(),
            one_hot(torch.full((samples,), along), longitudinal).float(),
        )


def gaussian(raw: Tensor) -> Tensor:
    """A decoder's last layer as μx, μy, two positive scales and a correlation; shape ``(25, B, 5)``."""
    return torch.cat((raw[..., :2], raw[..., 2:4].exp(), raw[..., 4:].tanh()), dim=-1)


def mode_probabilities(lateral: Tensor, longitudinal: Tensor) -> Tensor:
    """Probability of every mode, shape ``(B, modes)``: the manoeuvres are taken as independent, as in training."""
    return (longitudinal[:, :, None] * lateral[:, None, :]).flatten(1)
