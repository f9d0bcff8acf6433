"""``siren evaluate detection BAG… --detections NAME=FILE --out DIR``: how well detectors find vehicles."""

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.base.tables import counted, text_of
from siren_ros.cli.options import add_bags, add_named_paths, add_processes, names_in, processes_of
from siren_ros.data.episode_source import Need, in_dataset_order, survey_bag
from siren_ros.data.recording.bag_reader import bags_among
from siren_ros.errors import EXIT_OK, InputError, shown_text, write_text, writing
from siren_ros.scoring.evaluation.detection.boxes import FoundSet, joined
from siren_ros.scoring.evaluation.detection.detectors import DETECTORS, SEEN, run_detector
from siren_ros.scoring.evaluation.detection.frames import Frames, frames_of, read_frames
from siren_ros.scoring.evaluation.detection.metrics import devkit_score, devkit_tracking
from siren_ros.scoring.evaluation.detection.pictures import draw_curves, draw_worst_frame
from siren_ros.scoring.evaluation.detection.result_files import read_detections, self_test_sets, write_nuscenes_tracks
from siren_ros.scoring.evaluation.detection.scoring import (
    VEHICLE_NAMES,
    DetectorScores,
    score_detector,
    sentence_of_order,
)
from siren_ros.scoring.evaluation.detection.tables import scores_as_json, tables_of
from siren_ros.scoring.evaluation.detection.tracking import score_tracking, tracks_of
from siren_ros.simulation.scenario.episode import overlap_warning


def add_arguments(task: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    task.description = (
        "Scores 3-D detection with nuScenes' code and the paper's protocol: one class for all vehicles, labels within "
        "50 m with at least one LiDAR point, matches by the distance of centres on the ground."
    )
    add_bags(task)
    task.add_argument(
        "--detections",
        action="append",
        default=[],
        metavar="NAME=FILE",
        help="a detector's boxes: nuScenes results (.json), OpenPCDet results (.pkl, .npz), a folder of KITTI text "
        "files, or topic:/NAME, recorded in the bags; may be repeated",
    )
    task.add_argument(
        "--detectors",
        metavar="NAMES",
        default="",
        help=f"detectors to run, separated by commas: {', '.join(DETECTORS)} (classical: `./env --with classical …`)",
    )
    meaning = "weights of `siren train detection` in place of the shipped weights"
    add_named_paths(task, "--checkpoint", "pillars=FILE.onnx", meaning)
    task.add_argument(
        "--self-test", action="store_true", help="score the labels themselves through every format: mAP 1, errors 0"
    )
    task.add_argument(
        "--names",
        metavar="NAMES",
        default="",
        help="class names that count as vehicles, separated by commas (default: every name of a vehicle)",
    )
    task.add_argument(
        "--tracking", action="store_true", help="also follow the vehicles of each detector, and score the tracks"
    )
    task.add_argument("--compare-paper", action="store_true", help="also print the paper's rows")
    task.add_argument("--out", type=Path, metavar="DIR", help="write tables, scores.json, curves and pictures there")
    add_processes(task)
    task.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Scores every detector on all bags."""
    named, weights = _asked(arguments)
    detectors, names = names_in(arguments.detectors), frozenset(names_in(arguments.names.lower())) or VEHICLE_NAMES
    with ProcessPool(processes_of(arguments)) as pool, tempfile.TemporaryDirectory() as scratch:
        needs = (Need.LIDAR, Need.MAP)
        surveys = pool.map(survey_bag, [(bag, "detection", needs, Path(scratch)) for bag in bags_among(arguments.bags)])
        frames = frames_of(pool.map(read_frames, in_dataset_order(surveys)))
        sets = [read_detections(name, source, frames) for name, source in named]
        costs = {}
        for name in detectors:
            detections, costs[name] = _detected(name, weights.get(name), frames, pool)
            sets.append(detections)
        if arguments.self_test:
            sets += self_test_sets(frames, Path(scratch))
        for detections in sets:
            _check_names(detections, names)
        scores = [_scored(frames, part, names, pool, tracking=arguments.tracking) for part in sets]
    content = scores_as_json(scores)
    tables = tables_of(content, compare_paper=arguments.compare_paper)
    print("\n".join([*text_of(tables), "", *_remarks(frames, scores, costs)]))
    if arguments.out is not None:
        files = {"scores.json": json.dumps(content, indent=2) + "\n"}
        for table in tables:
            files |= {f"{table.key}.csv": table.csv(), f"{table.key}.tex": table.latex()}
        _write(arguments.out, files, frames, scores)
        if arguments.tracking:
            _write_tracks(arguments.out, sets, names, frames)
    return EXIT_OK


def _asked(arguments: argparse.Namespace) -> tuple[list[tuple[str, str]], dict[str, Path]]:
    """Detections from files, and weights by detector; raises InputError where they do not fit together."""
    named = [_named(text) for text in arguments.detections]
    detectors = list(names_in(arguments.detectors))
    for unknown in set(detectors) - set(DETECTORS):
        raise InputError("detectors", unknown, f"one of {', '.join(DETECTORS)}")
    if not named and not detectors and not arguments.self_test:
        raise InputError("detections", "", "NAME=FILE at least once, or --detectors, or --self-test")
    weights = dict(arguments.checkpoint)
    for unknown in set(weights) - set(detectors):
        raise InputError("checkpoint", unknown, f"one of --detectors: {', '.join(detectors) or 'none is given'}")
    rows = [*(name for name, _ in named), *detectors]
    if len(set(rows)) < len(rows):
        raise InputError("detections", ", ".join(rows), "each name once")
    return named, weights


def _named(text: str) -> tuple[str, str]:
    name, equals, source = text.partition("=")
    if not (name and equals and source):
        raise InputError("detections", text, "NAME=FILE")
    return shown_text(name), source


def _check_names(detections: FoundSet, names: frozenset[str]) -> None:
    """Refuses detections in which no box has a known class: a score of 0 would then say nothing about the detector."""
    given = set(detections.boxes.label.tolist())
    if given and not given & names:
        counted = ", ".join(sorted(names)) if names != VEHICLE_NAMES else "names of vehicles"
        raise InputError("names", counted, f"names that {detections.name} gives: {', '.join(sorted(given))}")


def _detected(name: str, weights: Path | None, frames: Frames, pool: ProcessPool) -> tuple[FoundSet, float]:
    """The detections, and the seconds of processor time for a frame."""
    parts = pool.map(run_detector, [(name, episode, weights) for episode in frames.episodes])
    boxes = [replace(part, frame=part.frame + first) for (part, _), first in zip(parts, frames.first, strict=False)]
    cost_s = sum(processor_s for _, processor_s in parts) / len(frames)
    seen = SEEN[name](weights) if name in SEEN else None
    return FoundSet(name, "run here", joined(boxes), frames.scored, has_velocity=True, seen=seen), cost_s


def _remarks(frames: Frames, scores: Sequence[DetectorScores], costs: Mapping[str, float]) -> list[str]:
    """What a reader of the tables has to know."""
    formats = [f"{score.name}: {sum(score.frames.values())} frames ({score.format})" for score in scores]
    lines = [
        f"{counted(len(frames.episodes), 'episode')}; {', '.join(formats)}",
        *(f"{name}: {cost_s:.3f} s of processor time for a frame, reading included" for name, cost_s in costs.items()),
    ]
    without = [score.name for score in scores if not score.has_velocity]
    if without:
        lines.append(f"no velocities, so AVE and AAE count as 1: {', '.join(without)}")
    if any(episode.camera_from_lidar is None for episode in frames.episodes):
        lines.append("no front camera in some bags, so these have no KITTI frames")
    lines += [line for score in scores if (line := overlap_warning(score.name, score.seen))]
    return lines + [f"{score.name}: {sentence_of_order(score.order)}" for score in scores if score.order]


def _scored(
    frames: Frames, part: FoundSet, names: frozenset[str], pool: ProcessPool, *, tracking: bool
) -> DetectorScores:
    score = score_detector(frames, part, names, lambda tables: pool.map(devkit_score, tables))
    if not tracking:
        return score
    tracks = score_tracking(frames, part, names, lambda tables: pool.map(devkit_tracking, tables))
    return replace(score, rows=(*score.rows, *tracks))


def _write_tracks(out: Path, sets: Sequence[FoundSet], names: frozenset[str], frames: Frames) -> None:
    with writing(out, "place"):
        for part in sets:
            tracks = tracks_of(frames, part.boxes.at(np.isin(part.boxes.label, sorted(names))))
            write_nuscenes_tracks(out / f"tracks_{_stem(part.name)}.json", tracks.boxes, tracks.track, frames)


def _stem(name: str) -> str:
    """A detector's name as a part of names of files."""
    return "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in name)


def _write(out: Path, files: Mapping[str, str], frames: Frames, scores: Sequence[DetectorScores]) -> None:
    with writing(out, "place"):
        out.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            write_text(out / name, text)
        for score in scores:
            stem = _stem(score.name)
            draw_curves(score, out / f"curves_{stem}.png")
            for template in score.templates:
                draw_worst_frame(score, frames, template, out / f"birdseye_{stem}_{template}.png")
