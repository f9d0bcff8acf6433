"""The complete training of the detector: frames, weights, figures as of ``siren evaluate detection``, card."""

import hashlib
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.base.params.plain_files import write_network
from siren_ros.data.episode_source import BagSurvey, Need, survey_bag
from siren_ros.data.recording.bag_reader import bags_among
from siren_ros.lab.training.detection.samples import FrameDraws, about_episode, check_apart, frames_among
from siren_ros.lab.training.settings import DetectionFit, FittedNetwork
from siren_ros.scoring.evaluation.detection.boxes import (
    CLASS_NAMES,
    FoundBoxes,
    FoundSet,
    TruthBoxes,
    joined,
    labels_named,
)
from siren_ros.scoring.evaluation.detection.frames import EpisodeFrames, Frames, frames_of, read_frames
from siren_ros.scoring.evaluation.detection.metrics import average_precision, match
from siren_ros.scoring.evaluation.detection.pillar_detector import FORM_VERSION, PillarGrid, detect_pillars
from siren_ros.scoring.evaluation.detection.scoring import VEHICLE_NAMES, counted_boxes
from siren_ros.simulation.scenario.episode import Split

MEAN: Final = "mean"


@dataclass(frozen=True)
class JudgedEpisode:
    """One judged episode with its detections."""

    survey: BagSurvey
    frames: EpisodeFrames
    detections: FoundBoxes
    processor_s: float
    """Processor time for all frames, including reading the bag."""


def judged_episode(bag: Path, weights: Path, scratch: Path) -> JudgedEpisode:
    """Run a detector on an episode.

    Raises:
        BagError: The bag is damaged or has no LiDAR.
        InputError: The weights cannot be used.
    """
    survey = survey_bag(bag, "detection", (Need.LIDAR, Need.MAP), scratch)
    frames = read_frames(survey, survey.name)
    start = time.process_time()
    detections = detect_pillars(frames, weights)
    return JudgedEpisode(survey, frames, detections, time.process_time() - start)


def figures_of(episodes: Sequence[JudgedEpisode]) -> dict[str, Any]:
    """Figures: mAP by template and its mean, by kind of emergency vehicle, and the cost."""
    frames = frames_of([episode.frames for episode in episodes])
    parts = [
        replace(episode.detections, frame=episode.detections.frame + first)
        for episode, first in zip(episodes, frames.first.tolist(), strict=False)
    ]
    detections = FoundSet("pillars", "run here", joined(parts), frames.scored, has_velocity=True)
    truth, boxes = counted_boxes(frames, detections, VEHICLE_NAMES)
    template = np.array([episode.template for episode in frames.episodes])[frames.episode]
    by_template = {
        name: mean_ap(frames, truth.at(template[truth.frame] == name), boxes.at(template[boxes.frame] == name))
        for name in sorted(set(template.tolist()))
    }
    labels = {name: labels_named(truth, name) for name in CLASS_NAMES}
    by_kind = {
        name: mean_ap(frames, truth.at(of_kind), boxes.at(boxes.label == name))
        for name, of_kind in labels.items()
        if of_kind.any()
    }
    return {
        "episodes": len(episodes),
        "frames": len(frames),
        "labels": len(truth),
        "mAP": {**_rounded(by_template), MEAN: round(float(np.mean(list(by_template.values()))), 3)},
        "mAP_of_kind": _rounded(by_kind),
        "processor_s_per_frame": round(sum(episode.processor_s for episode in episodes) / len(frames), 4),
    }


def mean_ap(frames: Frames, truth: TruthBoxes, detections: FoundBoxes) -> float:
    """NuScenes' mAP of some labels and detections; NaN without labels."""
    matches = match(truth, detections)
    episode, count = frames.episode[detections.at(matches.order).frame], len(frames.episodes)
    labels = np.bincount(frames.episode[truth.frame], minlength=count).astype(np.float64)
    weights = np.ones((1, count))
    return float(np.mean([average_precision(hit >= 0, episode, labels, weights)[0] for hit in matches.label]))


def _rounded(values: dict[str, float]) -> dict[str, float]:
    return {name: round(value, 3) for name, value in values.items()}


Fitter = Callable[[FrameDraws, DetectionFit, int, Path, Callable[[str], bool]], FittedNetwork | None]
CHECKPOINT: Final = "checkpoint.pt"
TEST_SEEDS: Final = "test_seeds"
TEST_MAPS: Final = "test_maps"


@dataclass(frozen=True)
class DetectorTraining:
    """Settings of a training: data, outputs and limits."""

    bags: tuple[Path, ...]
    held_out: tuple[Path, ...]
    out: Path
    """Path of the ONNX file."""
    cache: Path
    """Folder of frames and checkpoint."""
    config: DetectionFit
    threads: int = 1
    minutes: float | None = None
    """Time limit: fitting stops at the first checkpoint after it; the same training can continue later."""


def train_detector(training: DetectorTraining, fitter: Fitter, report: Callable[[str], None]) -> dict[str, Any] | None:
    """Train a detector, and write the ONNX file and its card; returns the card, or None if time was up first.

    ``report`` is called with lines on the progress.

    Raises:
        InputError: Training and judging share an episode's seed and map, or a file cannot be used.
        BagError: A bag is damaged or has no LiDAR.
    """
    grid = PillarGrid()
    judging = bags_among(training.held_out)
    trained = frames_among(training.bags, training.cache, grid, report)
    abouts = [episode.about for episode in trained]
    check_apart(abouts, map(about_episode, judging))
    draws = FrameDraws(trained, grid, training.config.seed, training.config.batch)
    report(f"{len(draws)} frames of {len(trained)} episodes")
    start = time.monotonic()

    def goes_on(line: str) -> bool:
        report(line)
        return training.minutes is None or time.monotonic() - start < 60.0 * training.minutes

    fitted = fitter(draws, training.config, training.threads, training.cache / CHECKPOINT, goes_on)
    if fitted is None:
        return None
    card = {
        **fitted.card(
            training.config,
            model="pillars",
            summary="PointPillars with a centre head: ten sweeps in, boxes with velocities out",
            form_version=FORM_VERSION,
            grid=grid.to_json(),
            class_names=list(CLASS_NAMES),
        ),
        "command": f"siren train detection BAGS --held-out BAGS --steps {training.config.steps} "
        f"--seed {training.config.seed} --out pillars.onnx",
        "training": {
            **_episodes_json(abouts),
            "frames": len(draws),
            "frames_sha256": hashlib.sha256(b"".join(episode.digest() for episode in trained)).hexdigest(),
        },
        "data": {
            Split.TRAIN.value: {
                "keys": sorted({str(about["key"]) for about in abouts}),
                "contents": sorted({str(about.get("content", "")) for about in abouts} - {""}),
            }
        },
        "fitting": {
            "processor_s": round(fitted.processor_s),
            "plans": [{"from_step": first, "steps": steps, "frames": frames} for first, steps, frames in fitted.plans],
        },
    }
    write_network(training.out, fitted.onnx, card)
    card = {**card, **judged_card(training.out, judging, {about["map"] for about in abouts}, report)}
    write_network(training.out, fitted.onnx, card)
    return card


def judged_card(
    weights: Path, bags: Sequence[Path], trained_maps: set[str], report: Callable[[str], None]
) -> dict[str, Any]:
    """Parts of a card that tell how the detector performs on bags outside its training."""
    splits: dict[str, list[JudgedEpisode]] = {TEST_SEEDS: [], TEST_MAPS: []}
    with tempfile.TemporaryDirectory() as scratch:
        for bag in bags:
            episode = judged_episode(bag, weights, Path(scratch))
            splits[TEST_SEEDS if episode.survey.episode["map"] in trained_maps else TEST_MAPS].append(episode)
            report(f"{bag}: mAP {figures_of([episode])['mAP'][MEAN]:.3f}")
    filled = {name: episodes for name, episodes in splits.items() if episodes}
    return {
        "judged": {name: _episodes_json([each.survey.episode for each in part]) for name, part in filled.items()},
        "figures": {name: figures_of(part) for name, part in filled.items()},
    }


def _episodes_json(abouts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Numbers of episodes, and their templates, maps and seeds."""
    maps = sorted({str(about["map"]) for about in abouts})
    return {
        "episodes": len(abouts),
        "templates": dict(sorted(Counter(str(about["template"]) for about in abouts).items())),
        "seeds_by_map": {name: sorted({int(each["seed"]) for each in abouts if each["map"] == name}) for name in maps},
    }
