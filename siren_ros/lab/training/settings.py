"""Common settings of all trainings, and networks as files with cards."""

import hashlib
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from typing import Any, Final

from siren_ros.scoring.evaluation.risk.labels import RiskThresholds

_PACKAGES: Final = ("siren_ros", "eclipse-sumo", "numpy", "onnxruntime")


@dataclass(frozen=True)
class FitSettings:
    """Settings of the gradient descent of every network."""

    seed: int = 0
    learning_rate: float = 2e-3
    """Largest learning rate."""
    weight_decay: float = 1e-2
    """Weight decay of AdamW."""


ARCHITECTURES: Final = ("paths", "lstm", "transformer")
"""Networks for prediction: SIREN's own with the road's paths, and two baselines without a map."""


@dataclass(frozen=True)
class FitConfig(FitSettings):
    """Settings of the predictor's training."""

    architecture: str = ARCHITECTURES[0]

    epochs: int = 8
    """Number of epochs; in each, every sample occurs twice, without errors and with a tracker's."""
    batch: int = 512
    averaging: float = 0.995
    """Share of the old weights in their running mean, which is the final network."""
    width: int = 64
    layers: int = 2
    share_of_all: float = 0.05
    """Weight of the hypotheses that are not the nearest."""
    first_weight: float = 1.0
    """Weight of the error of the most probable hypothesis."""
    probability_weight: float = 0.3
    device: str = "cpu"


@dataclass(frozen=True)
class FilmFitConfig(FitSettings):
    """Settings of the sequence model's training."""

    epochs: int = 14
    steps: int = 20
    """Number of batches in an epoch."""
    batch: int = 12
    """Number of clips in a batch."""
    clip_frames: int = 24
    """Number of pictures in a training clip: 4.8 s."""
    near_steps: int = 12
    """A picture has the class of a conflict within this many steps before or after it (0.6 s)."""
    frame_weight: float = 1.0
    """Weight of the pictures' classes relative to the clip's."""
    focus: float = 1.5
    """Exponent of the focal loss (Lin et al. 2017), which reduces the weight of well-known clips."""
    thresholds: RiskThresholds = field(default_factory=RiskThresholds)


@dataclass(frozen=True)
class DriverFit(FitSettings):
    """Settings of the driver's training, which imitates the best of several drives (by rules or its own)."""

    learning_rate: float = 3e-3
    weight_decay: float = 1e-3
    passes: int = 400
    """Passes over all imitated decisions, in each round."""
    widths: tuple[int, ...] = (64, 64)
    episodes: tuple[int, ...] = (36, 12, 12)
    """Episodes of each round. In the first round only experts drive, later the driver too."""
    tries: int = 2
    """Drives of each episode in which the driver also tries other manoeuvres."""
    temperature: float = 1.0
    """Temperature of these drives (``NetworkPolicy``)."""
    violation: float = 3.0
    """Reward that a violated clause costs."""
    margin: float = 0.25
    """Difference of reward by which a drive must be better than an earlier one."""
    full_gap: float = 5.0
    """Difference between the best drive and the mean at which an episode gets full weight."""
    least_weight: float = 0.1
    """Weight of an episode in which all drives are equally good."""
    templates: tuple[str, ...] = ("S1", "S2")
    """Templates in which the EMV must pass the driver on a road without a free shoulder."""
    levels: tuple[int, ...] = (2, 3)
    task: Mapping[str, Any] = field(default_factory=lambda: {"decision_s": 0.5})
    """Further options of the environment."""


@dataclass(frozen=True)
class FittedNetwork:
    """A fitted network as a file."""

    onnx: bytes
    parameters: int
    made_with: str
    """Library and version that made it."""
    processor_s: float = 0.0
    """Processor time of the fitting, if it is counted over several runs."""
    plans: tuple[tuple[int, int, int], ...] = ()
    """First step, planned steps and frames of each run; several if a training continued with other numbers."""

    def card(self, config: FitSettings, **about: Any) -> dict[str, Any]:
        """Beginning of a card: what the model is, its hash and size, how it was made, its settings."""
        return {
            **about,
            "sha256": hashlib.sha256(self.onnx).hexdigest(),
            "parameters": self.parameters,
            "made_with": {"fitting": self.made_with, "python": platform.python_version()}
            | {package: version(package) for package in _PACKAGES},
            "fit": asdict(config),
        }


@dataclass(frozen=True)
class NetworkSize:
    """Widths of the layers; an output cell covers four pillars along x and along y."""

    pillar: int = 24
    stages: tuple[int, int, int] = (48, 96, 128)
    """Channels of the stages with cells of 4, 8 and 16 pillars."""
    layers: int = 3
    """Number of convolutions per stage."""
    neck: int = 32
    """Number of channels from each stage to the head."""
    head: int = 48


@dataclass(frozen=True)
class DetectionFit(FitSettings):
    """Settings of the detector's training."""

    learning_rate: float = 3e-3
    steps: int = 4000
    batch: int = 2
    averaging: float = 0.998
    """Share of the old weights in their running mean, which is the final network."""
    box_weight: float = 0.5
    class_weight: float = 0.2
    checkpoint_steps: int = 100
    device: str = "cpu"
    half: bool = True
    """Whether convolutions use bfloat16, which saves a third of the time on processors with AVX-512 BF16."""
