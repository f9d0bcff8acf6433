"""The whole training of the detector: frames, weights, figures, card."""

import hashlib
import platform
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from siren_ros.datasets.sources.episode_source import open_source
from siren_ros.evaluation.detection.metrics.named_classes import CLASS_NAMES
from siren_ros.evaluation.detection.pillars.grid import PillarGrid
from siren_ros.evaluation.detection.pillars.network_file import FORM_VERSION
from siren_ros.evaluation.network_file import write_network
from siren_ros.recording.bag_folders import bags_among
from siren_ros.training.detection.assessment import JudgedEpisode, figures_of, judged_episode
from siren_ros.training.detection.fit_config import DetectionFit, FittedDetector
from siren_ros.training.detection.frame_draws import FrameDraws
from siren_ros.training.detection.frame_files import check_apart, frames_among

Fitter = Callable[[FrameDraws, DetectionFit, int, Path, Callable[[str], bool]], FittedDetector | None]
CHECKPOINT: Final = "checkpoint.pt"
TEST_SEEDS: Final = "test_seeds"
TEST_MAPS: Final = "test_maps"
_PACKAGES: Final = ("siren_ros", "numpy", "onnxruntime")


@dataclass(frozen=True)
class DetectorTraining:
    """What is trained on what."""

    bags: tuple[Path, ...]
    held_out: tuple[Path, ...]
    out: Path
    """The ONNX file."""
    cache: Path
    """Folder of frames and checkpoint."""
    config: DetectionFit
    threads: int = 1
    minutes: float | None = None
    """Stops the fitting at the first checkpoint after this time; the same training then goes on from there."""


def train_detector(training: DetectorTraining, fitter: Fitter, told: Callable[[str], None]) -> dict[str, Any] | None:
    """Trains a detector, and writes the ONNX file and its card.

    Args:
        training: What is trained on what.
        fitter: Fits and exports a network.
        told: Called with lines on the progress.

    Returns:
        The card; None where the time was up before.

    Raises:
        InputError: Training and judging share an episode's seed and map, or a file cannot be used.
        BagError: A bag is damaged or has no LiDAR.
    """
    grid = PillarGrid()
    judging = bags_among(training.held_out)
    trained = frames_among(training.bags, training.cache, grid, told)
    check_apart([one.about for one in trained], [_about(bag) for bag in judging])
    draws = FrameDraws(trained, grid, training.config.seed, training.config.batch)
    told(f"{len(draws)} frames of {len(trained)} episodes")
    start = time.monotonic()

    def tell(line: str) -> bool:
        told(line)
        return training.minutes is None or time.monotonic() - start < 60.0 * training.minutes

    fitted = fitter(draws, training.config, training.threads, training.cache / CHECKPOINT, tell)
    if fitted is None:
        return None
    card = {
        **_card(fitted, grid, training.config),
        "command": f"siren train detection BAGS --held-out BAGS --steps {training.config.steps} "
        f"--seed {training.config.seed} --out pillars.onnx",
        "training": {
            **_episodes_json([one.about for one in trained]),
            "frames": len(draws),
            "frames_sha256": hashlib.sha256(b"".join(one.digest() for one in trained)).hexdigest(),
        },
        "fitting": {
            "processor_s": round(fitted.processor_s),
            "plans": [{"from_step": first, "steps": steps, "frames": frames} for first, steps, frames in fitted.plans],
        },
    }
    write_network(training.out, fitted.onnx, card)
    card = {**card, **judged_card(training.out, judging, {one.about["map"] for one in trained}, told)}
    write_network(training.out, fitted.onnx, card)
    return card


def judged_card(
    weights: Path, bags: Sequence[Path], trained_maps: set[str], told: Callable[[str], None]
) -> dict[str, Any]:
    """The parts of a card that say how the detector does on bags that it was not trained on."""
    splits: dict[str, list[JudgedEpisode]] = {TEST_SEEDS: [], TEST_MAPS: []}
    with tempfile.TemporaryDirectory() as scratch:
        for bag in bags:
            one = judged_episode(bag, weights, Path(scratch))
            splits[TEST_SEEDS if one.survey.episode["map"] in trained_maps else TEST_MAPS].append(one)
            told(f"{bag}: mAP {figures_of([one])['mAP']['mean']:.3f}")
    made = {name: episodes for name, episodes in splits.items() if episodes}
    return {
        "judged": {name: _episodes_json([one.survey.episode for one in episodes]) for name, episodes in made.items()},
        "figures": {name: figures_of(episodes) for name, episodes in made.items()},
    }


def _about(bag: Path) -> dict[str, Any]:
    with open_source(bag) as source:
        description = source.description
    return {"template": description.template, "map": description.map_name, "seed": description.seed}


def _card(fitted: FittedDetector, grid: PillarGrid, config: DetectionFit) -> dict[str, Any]:
    return {
        "model": "pillars",
        "summary": "PointPillars with a centre head: ten sweeps in, boxes with velocities out",
        "form_version": FORM_VERSION,
        "sha256": hashlib.sha256(fitted.onnx).hexdigest(),
        "parameters": fitted.parameters,
        "grid": grid.to_json(),
        "class_names": list(CLASS_NAMES),
        "made_with": {"fitting": fitted.made_with, "python": platform.python_version()}
        | {package: version(package) for package in _PACKAGES},
        "fit": asdict(config),
    }


def _episodes_json(abouts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """How many episodes of which templates, maps and seeds."""
    seeds: dict[str, set[int]] = {}
    for about in abouts:
        seeds.setdefault(str(about["map"]), set()).add(int(about["seed"]))
    return {
        "episodes": len(abouts),
        "templates": dict(sorted(Counter(str(about["template"]) for about in abouts).items())),
        "seeds_by_map": {name: sorted(found) for name, found in sorted(seeds.items())},
    }
