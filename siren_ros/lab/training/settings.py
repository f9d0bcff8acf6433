"""What the three trainings share: settings of the fittings, and networks as files with cards."""

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
    """What the descent of every network needs."""

    seed: int = 0
    learning_rate: float = 2e-3
    """The highest one."""
    weight_decay: float = 1e-2
    """Of AdamW."""


ARCHITECTURES: Final = ("paths", "lstm", "transformer")
"""Networks of the prediction task: SIREN's own along the roads, and two baselines without a map."""


@dataclass(frozen=True)
class FitConfig(FitSettings):
    """How the predictor's network is fitted."""

    architecture: str = ARCHITECTURES[0]

    epochs: int = 8
    """Each sample comes twice, without errors and with those of a tracker."""
    batch: int = 512
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
class FilmFitConfig(FitSettings):
    """How the sequence model is fitted."""

    epochs: int = 14
    steps: int = 20
    """Batches of an epoch."""
    batch: int = 12
    """Clips at once."""
    clip_frames: int = 24
    """Pictures of a training clip: 4.8 s."""
    near_steps: int = 12
    """A picture is of a class if the conflict is within so many steps before or after it: 0.6 s."""
    frame_weight: float = 1.0
    """Weight of the pictures' classes against that of the clip's."""
    focus: float = 1.5
    """Exponent of the focal loss (Lin et al. 2017): clips that the network knows well already count less."""
    thresholds: RiskThresholds = field(default_factory=RiskThresholds)


@dataclass(frozen=True)
class DriverFit(FitSettings):
    """How the driver is trained: it imitates the best of several drives of each episode, of rules and of its own."""

    learning_rate: float = 3e-3
    weight_decay: float = 1e-3
    passes: int = 400
    """Over all imitated decisions, in each round."""
    widths: tuple[int, ...] = (64, 64)
    episodes: tuple[int, ...] = (36, 12, 12)
    """Of each round. In the first one teachers drive alone, then the driver drives too."""
    tries: int = 2
    """Drives of each episode in which the driver tries other manoeuvres too."""
    temperature: float = 1.0
    """Of those (``Pupil``)."""
    violation: float = 3.0
    """Reward that a violated clause costs."""
    margin: float = 0.25
    """Reward by which a drive is better than an earlier one."""
    full_gap: float = 5.0
    """Reward by which the best drive is above the mean of all from which on an episode counts fully…"""
    least_weight: float = 0.1
    """…and what one counts in which all drives are alike."""
    templates: tuple[str, ...] = ("S1", "S2")
    """Those in which the EMV has to pass the driver on a road without a free shoulder."""
    levels: tuple[int, ...] = (2, 3)
    task: Mapping[str, Any] = field(default_factory=lambda: {"decision_s": 0.5})
    """Further options of the environment."""


@dataclass(frozen=True)
class FittedNetwork:
    """A network as a file."""

    onnx: bytes
    parameters: int
    made_with: str
    """Library and version."""
    processor_s: float = 0.0
    """Processor time of the fitting, where it is counted over several programs."""
    plans: tuple[tuple[int, int, int], ...] = ()
    """From which step, of how many, on how many frames: several where a training went on with other numbers."""

    def card(self, config: FitSettings, **about: Any) -> dict[str, Any]:
        """The beginning of a card: what the model is, its hash and size, what it was made with, and its settings."""
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
class DetectionFit(FitSettings):
    """How the detector's network is fitted."""

    learning_rate: float = 3e-3
    steps: int = 4000
    batch: int = 2
    averaging: float = 0.998
    """Share of the old weights in their running mean, which is what is kept."""
    box_weight: float = 0.5
    class_weight: float = 0.2
    checkpoint_steps: int = 100
    device: str = "cpu"
    half: bool = True
    """Convolutions in bfloat16: a third less time on processors with AVX-512 BF16."""
