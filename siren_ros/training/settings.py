"""Settings of the fittings, and the networks as files that come out of them."""

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


@dataclass(frozen=True)
class NetworkSize:
    """Widths of the layers; the output has a cell for every four pillars along x and along y."""

    pillar: int = 24
    stages: tuple[int, int, int] = (48, 96, 128)
    """Channels at 4, 8 and 16 pillars for a cell."""
    layers: int = 3
    """Convolutions of each stage."""
    neck: int = 32
    """Channels that each stage gives to the head."""
    head: int = 48


@dataclass(frozen=True)
class DetectionFit:
    """How a network is fitted."""

    seed: int = 0
    steps: int = 4000
    batch: int = 2
    learning_rate: float = 3e-3
    weight_decay: float = 1e-2
    averaging: float = 0.998
    """Share of the old weights in their running mean, which is what is kept."""
    box_weight: float = 0.5
    class_weight: float = 0.2
    checkpoint_steps: int = 100
    device: str = "cpu"
    half: bool = True
    """Convolutions in bfloat16: a third less time on processors with AVX-512 BF16."""


@dataclass(frozen=True)
class FittedDetector:
    """A network as a file."""

    onnx: bytes
    parameters: int
    made_with: str
    """Library and version."""
    processor_s: float
    """Processor time of the fitting."""
    plans: tuple[tuple[int, int, int], ...] = ()
    """From which step, of how many, on how many frames: several where a training went on with other numbers."""
