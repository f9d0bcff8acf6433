"""The table of detectors by name, and how one of them runs on an episode."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.boxes import FoundBoxes
from siren_ros.scoring.evaluation.detection.detectors.classical import detect_classical
from siren_ros.scoring.evaluation.detection.detectors.pillar_detector import detect_pillars, seen_in_training
from siren_ros.scoring.evaluation.detection.frames import EpisodeFrames
from siren_ros.simulation.scenario.splits import SeenEpisodes

Detect = Callable[[EpisodeFrames, Path | None], FoundBoxes]
"""Detects vehicles in all labelled sweeps of an episode. The path gives other weights than the detector's own."""


def _classical(episode: EpisodeFrames, weights: Path | None) -> FoundBoxes:
    if weights is not None:
        raise InputError("checkpoint", f"classical={weights}", "a detector that has weights: pillars")
    return detect_classical(episode)


DETECTORS: Final[Mapping[str, Detect]] = MappingProxyType(
    {
        "classical": _classical,
        "pillars": detect_pillars,
    }
)

SEEN: Final[Mapping[str, Callable[[Path | None], SeenEpisodes | None]]] = MappingProxyType(
    {"pillars": seen_in_training}
)
"""For learned detectors: gives the episodes in their training, from their weights."""


def run_detector(name: str, episode: EpisodeFrames, weights: Path | None) -> tuple[FoundBoxes, float]:
    """Run one of ``DETECTORS``; returns its boxes and its processor time in seconds, including the reading of sweeps.

    Raises:
        InputError: The detector cannot run here, or not with these weights.
        BagError: The bag is damaged.
    """
    start = time.process_time()
    boxes = DETECTORS[name](episode, weights)
    return boxes, time.process_time() - start
