"""The reference that sees pictures: a small network on each second frame of a video."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from siren_ros.errors import InputError
from siren_ros.evaluation.network_file import NetworkFile, open_network
from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.evaluation.risk.sequence.small_frames import SmallFrames, read_small_frames
from siren_ros.evaluation.risk.video_set import VideoSet
from siren_ros.params.resources import params_dir

SHIPPED: Final = Path("risk", "sequence.onnx")
"""Place of the weights below the parameter files."""
INPUT: Final = "frames"
OUTPUT: Final = "probability"
FRAMES_VERSION: Final = 1
"""Of what the network is given; weights of another version are refused."""


@dataclass(frozen=True)
class SequenceModel:
    """Tells how likely a film shows a near-miss or worse, and how likely a collision."""

    network: NetworkFile

    def probabilities(self, frames: SmallFrames) -> tuple[float, float]:
        """Of one film, shape ``(T, HEIGHT, WIDTH)``: of a near-miss or worse, and of a collision."""
        (found,) = self.network.session.run([OUTPUT], {INPUT: frames[None]})
        return float(found[0, 0]), float(found[0, 1])

    def answer(self, frames: SmallFrames) -> RiskClass:
        """The more severe class first: each probability is held against one half."""
        near, hit = self.probabilities(frames)
        if hit > 0.5:
            return RiskClass.COLLISION
        return RiskClass.NEAR_MISS if near > 0.5 else RiskClass.NORMAL

    def answers(self, videos: VideoSet, told: Callable[[str], None] = lambda _: None) -> dict[str, RiskClass | None]:
        """The answers to all videos of a set.

        Args:
            videos: The set; it holds the files.
            told: Called with each video's id.

        Raises:
            InputError: A video is missing or of another length.
        """
        found: dict[str, RiskClass | None] = {}
        for key, video in sorted(videos.videos.items()):
            found[key] = self.answer(read_small_frames(videos.folder / video.file, video.frames))
            told(key)
        return found


def load_sequence_model(path: Path | None = None) -> SequenceModel:
    """The model that ships with the project, or one of ``siren train risk``.

    Raises:
        InputError: No such file, or not a network of this task.
    """
    file = path or params_dir() / SHIPPED
    network = open_network(file)
    if network.card.get("frames_version") != FRAMES_VERSION:
        version = network.card.get("frames_version")
        raise InputError(
            "checkpoint", str(file), f"a sequence model for frames of version {FRAMES_VERSION}, not {version}"
        )
    return SequenceModel(network)
