"""How a detector does on episodes that it was not trained on: by the protocol of ``siren evaluate detection``."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.datasets.exporting.survey import BagSurvey, survey_bag
from siren_ros.datasets.sources.needs import Need
from siren_ros.evaluation.detection.inputs.found_set import FoundSet
from siren_ros.evaluation.detection.metrics.average_precision import average_precision
from siren_ros.evaluation.detection.metrics.matching import match
from siren_ros.evaluation.detection.metrics.named_classes import CLASS_NAMES, labels_named
from siren_ros.evaluation.detection.pillars.detector import detect_pillars
from siren_ros.evaluation.detection.protocol.boxes import FoundBoxes, TruthBoxes, joined
from siren_ros.evaluation.detection.protocol.episode_reading import read_frames
from siren_ros.evaluation.detection.protocol.frames import EpisodeFrames, Frames, frames_of
from siren_ros.evaluation.detection.scoring import VEHICLE_NAMES, counted_boxes

MEAN: Final = "mean"


@dataclass(frozen=True)
class JudgedEpisode:
    """One episode, with what was found in it."""

    survey: BagSurvey
    frames: EpisodeFrames
    found: FoundBoxes
    processor_s: float
    """For all its frames, reading the bag included."""


def judged_episode(bag: Path, weights: Path, scratch: Path) -> JudgedEpisode:
    """Runs a detector on an episode.

    Raises:
        BagError: The bag is damaged or has no LiDAR.
        InputError: The weights cannot be used.
    """
    survey = survey_bag(bag, "detection", (Need.LIDAR, Need.MAP), scratch)
    frames = read_frames(survey, survey.name)
    start = time.process_time()
    found = detect_pillars(frames, weights)
    return JudgedEpisode(survey, frames, found, time.process_time() - start)


def figures_of(episodes: Sequence[JudgedEpisode]) -> dict[str, Any]:
    """The mAP of the one class, by template and the mean over them; by kind of emergency vehicle; the cost."""
    frames = frames_of([one.frames for one in episodes])
    parts = [
        replace(one.found, frame=one.found.frame + first)
        for one, first in zip(episodes, frames.first.tolist(), strict=False)
    ]
    found = FoundSet("pillars", "run here", joined(parts), frames.scored, has_velocity=True)
    truth, boxes = counted_boxes(frames, found, VEHICLE_NAMES)
    template = np.array([one.template for one in frames.episodes])[frames.episode]
    by_template = {
        name: mean_ap(frames, truth.at(template[truth.frame] == name), boxes.at(template[boxes.frame] == name))
        for name in sorted(set(template.tolist()))
    }
    return {
        "episodes": len(episodes),
        "frames": len(frames),
        "labels": len(truth),
        "mAP": {**_rounded(by_template), MEAN: round(float(np.mean(list(by_template.values()))), 3)},
        "mAP_of_kind": _rounded(_by_kind(frames, truth, boxes)),
        "processor_s_per_frame": round(sum(one.processor_s for one in episodes) / len(frames), 4),
    }


def mean_ap(frames: Frames, truth: TruthBoxes, found: FoundBoxes) -> float:
    """NuScenes' mAP of some labels and detections; NaN without labels."""
    matches = match(truth, found)
    ordered = found.at(matches.order)
    labels = np.bincount(frames.episode[truth.frame], minlength=len(frames.episodes)).astype(np.float64)
    every = np.ones((1, len(frames.episodes)))
    values = [average_precision(label >= 0, frames.episode[ordered.frame], labels, every)[0] for label in matches.label]
    return float(np.mean(values))


def _by_kind(frames: Frames, truth: TruthBoxes, found: FoundBoxes) -> dict[str, float]:
    """The mAP of each class by its name, where there are labels of it."""
    result = {}
    for name in CLASS_NAMES:
        own = labels_named(truth, name)
        if own.any():
            result[name] = mean_ap(frames, truth.at(own), found.at(found.label == name))
    return result


def _rounded(values: dict[str, float]) -> dict[str, float]:
    return {name: round(value, 3) for name, value in values.items()}
