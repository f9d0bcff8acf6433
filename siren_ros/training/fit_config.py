"""Settings of the fitting, and what comes out of it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class FitConfig:
    """How a network is fitted."""

    seed: int = 0
    epochs: int = 16
    batch: int = 512
    learning_rate: float = 2e-3
    weight_decay: float = 1e-2
    averaging: float = 0.995
    """Share of the old weights in their running mean, which is what is kept."""
    width: int = 64
    layers: int = 2
    share_of_all: float = 0.05
    """Weight of the hypotheses that are not the nearest."""
    first_weight: float = 1.0
    """Weight of the error of the most probable hypothesis."""
    probability_weight: float = 0.3
    device: str = "cpu"


@dataclass(frozen=True)
class FittedNetwork:
    """A network as a file."""

    onnx: bytes
    parameters: int
    made_with: str
    """Library and version."""
