"""``siren evaluate detection BAG… --detections NAME=FILE --out DIR``: how well detectors find vehicles."""

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from siren_ros.cli.options import add_processes, named_path, names_in, processes_of
from siren_ros.errors import EXIT_OK, InputError, whole_file, writing
from siren_ros.evaluation.detection.boxes import joined
from siren_ros.evaluation.detection.detectors.table import DETECTORS, run_detector
from siren_ros.evaluation.detection.devkit_score import devkit_score
from siren_ros.evaluation.detection.frames import Frames, frames_of, read_frames
from siren_ros.evaluation.detection.inputs.formats import read_detections, self_test_sets
from siren_ros.evaluation.detection.inputs.stated_boxes import FoundSet
from siren_ros.evaluation.detection.pictures import draw_curves, draw_worst_frame
from siren_ros.evaluation.detection.scoring import VEHICLE_NAMES, DetectorScores, score_detector
from siren_ros.evaluation.detection.tables import scores_as_json, tables_of
from siren_ros.processes.process_pool import ProcessPool
from siren_ros.record.bag_survey import Need, in_dataset_order, survey_bag
from siren_ros.recording.bag_reader import bags_among
from siren_ros.tables.table import text_of


def add_arguments(task: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    task.description = (
        "Scores 3-D detection with nuScenes' code and the paper's protocol: one class for all vehicles, labels within "
        "50 m with at least one LiDAR point, matches by the distance of centres on the ground."
    )
    task.add_argument(
        "bags", type=Path, metavar="BAG", nargs="+", help="folder of a recorded episode, or a folder of such folders"
    )
    task.add_argument(
        "--detections",
        action="append",
        default=[],
        metavar="NAME=FILE",
        help="a detector's boxes: nuScenes results (.json), OpenPCDet results (.pkl), a folder of KITTI text files, or "
        "topic:/NAME, recorded in the bags; may be repeated",
    )
    task.add_argument(
        "--detectors",
        metavar="NAMES",
        default="",
        help=f"detectors to run, separated by commas: {', '.join(DETECTORS)} (classical: `./env --with classical …`)",
    )
    task.add_argument(
        "--checkpoint",
        type=named_path,
        action="append",
        default=[],
        metavar="pillars=FILE.onnx",
        help="weights of `siren train detection` in place of the shipped weights",
    )
    task.add_argument(
        "--self-test", action="store_true", help="score the labels themselves through every format: mAP 1, errors 0"
    )
    task.add_argument(
        "--names",
        metavar="NAMES",
        default="",
        help="class names that count as vehicles, separated by commas (default: every name of a vehicle)",
    )
    task.add_argument("--compare-paper", action="store_true", help="also print the paper's rows")
    task.add_argument("--out", type=Path, metavar="DIR", help="write tables, scores.json, curves and pictures there")
    add_processes(task)
    task.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Scores every detector on all bags."""
    named = [_named(text) for text in arguments.detections]
    own = list(names_in(arguments.detectors))
    for unknown in set(own) - set(DETECTORS):
        raise InputError("detectors", unknown, f"one of {', '.join(DETECTORS)}")
    if not named and not own and not arguments.self_test:
        raise InputError("detections", "", "NAME=FILE at least once, or --detectors, or --self-test")
    weights = dict(arguments.checkpoint)
    for unknown in set(weights) - set(own):
        raise InputError("checkpoint", unknown, f"one of --detectors: {', '.join(own) or 'none is given'}")
    every = [*(name for name, _ in named), *own]
    if len(set(every)) < len(every):
        raise InputError("detections", ", ".join(every), "each name once")
    names = frozenset(names_in(arguments.names.lower())) or VEHICLE_NAMES
    with ProcessPool(processes_of(arguments)) as pool, tempfile.TemporaryDirectory() as scratch:
        frames = _frames(bags_among(arguments.bags), pool, Path(scratch))
        sets = [read_detections(name, source, frames) for name, source in named]
        costs = {}
        for name in own:
            found, costs[name] = _detected(name, weights.get(name), frames, pool)
            sets.append(found)
        if arguments.self_test:
            sets += self_test_sets(frames, Path(scratch))
        for found in sets:
            _check_names(found, names)
        scores = [score_detector(frames, found, names, lambda tables: pool.map(devkit_score, tables)) for found in sets]
    content = scores_as_json(scores)
    tables = tables_of(content, compare_paper=arguments.compare_paper)
    print("\n".join([*text_of(tables), "", *_remarks(frames, scores, costs)]))
    if arguments.out is not None:
        files = {"scores.json": json.dumps(content, indent=2) + "\n"}
        for table in tables:
            files |= {f"{table.key}.csv": table.csv(), f"{table.key}.tex": table.latex()}
        _write(arguments.out, files, frames, scores)
    return EXIT_OK


def _named(text: str) -> tuple[str, str]:
    name, equals, source = text.partition("=")
    if not (name and equals and source):
        raise InputError("detections", text, "NAME=FILE")
    return name, source


def _check_names(found: FoundSet, names: frozenset[str]) -> None:
    """Refuses detections of which none would count: their score of 0 would say nothing about the detector."""
    there = set(found.boxes.label.tolist())
    if there and not there & names:
        told = ", ".join(sorted(names)) if names != VEHICLE_NAMES else "names of vehicles"
        raise InputError("names", told, f"names that {found.name} gives: {', '.join(sorted(there))}")


def _frames(bags: Sequence[Path], pool: ProcessPool, scratch: Path) -> Frames:
    needs = (Need.LIDAR, Need.MAP)
    surveys = pool.map(survey_bag, [(bag, "detection", needs, scratch) for bag in bags])
    return frames_of(pool.map(read_frames, in_dataset_order(surveys)))


def _detected(name: str, weights: Path | None, frames: Frames, pool: ProcessPool) -> tuple[FoundSet, float]:
    """The detections, and the seconds of processor time for a frame."""
    parts = pool.map(run_detector, [(name, episode, weights) for episode in frames.episodes])
    boxes = [replace(found, frame=found.frame + first) for (found, _), first in zip(parts, frames.first, strict=False)]
    cost_s = sum(processor_s for _, processor_s in parts) / len(frames)
    return FoundSet(name, "run here", joined(boxes), frames.scored, has_velocity=True), cost_s


def _remarks(frames: Frames, scores: Sequence[DetectorScores], costs: Mapping[str, float]) -> list[str]:
    """What a reader of the tables has to know."""
    episodes = len(frames.episodes)
    lines = [
        f"{episodes} episode{'s' if episodes > 1 else ''}; "
        + ", ".join(f"{one.name}: {sum(one.frames.values())} frames ({one.format})" for one in scores)
    ]
    lines += [
        f"{name}: {cost_s:.3f} s of processor time for a frame, reading included" for name, cost_s in costs.items()
    ]
    without = [one.name for one in scores if not one.has_velocity]
    if without:
        lines.append(f"no velocities, so AVE and AAE count as 1: {', '.join(without)}")
    if any(episode.camera_from_lidar is None for episode in frames.episodes):
        lines.append("no front camera in some bags, so these have no KITTI frames")
    return lines + [f"{one.name}: {one.order.sentence()}" for one in scores if one.order is not None]


def _write(out: Path, files: Mapping[str, str], frames: Frames, scores: Sequence[DetectorScores]) -> None:
    with writing(out, "place"):
        out.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            with whole_file(out / name) as file:
                file.write_text(text, encoding="utf-8")
        for one in scores:
            stem = "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in one.name)
            draw_curves(one, out / f"curves_{stem}.png")
            for template in one.templates:
                draw_worst_frame(one, frames, template, out / f"birdseye_{stem}_{template}.png")
