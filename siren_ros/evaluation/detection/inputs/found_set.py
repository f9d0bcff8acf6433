"""The detections of one file with what they cover, as all formats give them."""

from dataclasses import dataclass

from siren_ros.evaluation.detection.protocol.boxes import FoundBoxes
from siren_ros.numerics.arrays import Flags


@dataclass(frozen=True)
class FoundSet:
    """Detections, and the frames that they are detections of."""

    name: str
    """The user's name for the detector."""
    format: str
    boxes: FoundBoxes
    scored: Flags
    """Frames that count: those that the format has, shape ``(F,)``."""
    has_velocity: bool
    """Whether velocities are known; without them the devkit takes 1 m/s as the velocity error."""
    has_attributes: bool = False
    """Whether the format states attributes; else those of labels and detections follow from their velocities."""
