"""``siren leaderboard TASK FOLDER``: submissions ranked on the same episodes or videos, with paired tests."""

import argparse
import json
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

import siren_ros
from siren_ros.base.params.plain_files import sha256_of
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.base.tables import text_of
from siren_ros.cli.command import complain
from siren_ros.cli.options import add_bags, add_processes, processes_of
from siren_ros.data.episode_source import Need, bag_sha256, in_dataset_order, open_source, survey_bag
from siren_ros.data.recording.bag_reader import bags_among
from siren_ros.errors import EXIT_FAILED, EXIT_OK, InputError, SirenError, shown_text, write_text
from siren_ros.scoring.evaluation.detection.frames import frames_of, read_frames
from siren_ros.scoring.evaluation.detection.result_files import read_detections
from siren_ros.scoring.evaluation.detection.scoring import VEHICLE_NAMES, mean_ap_of_episodes
from siren_ros.scoring.evaluation.prediction.scoring import ScoringJob, score_bags
from siren_ros.scoring.evaluation.prediction.submission import most_rows, read_prediction_file, submission
from siren_ros.scoring.evaluation.risk.scoring import checked_answers, correct_by_class, read_answers
from siren_ros.scoring.evaluation.risk.video_set import read_set
from siren_ros.scoring.evaluation.scores import leaderboard, standings
from siren_ros.scoring.evaluation.statistics import BlockSums, block_sums
from siren_ros.simulation.scenario.episode import EpisodeIdentity, split_of

Submissions = Mapping[str, Path]


def _risk(arguments: argparse.Namespace, files: Submissions) -> dict[str, BlockSums]:
    videos = read_set(arguments.set)
    answers = {
        name: checked_answers(read_answers(path), videos.videos, allow_missing=False) for name, path in files.items()
    }
    return {name: correct_by_class(videos, given) for name, given in answers.items()}


def _prediction(arguments: argparse.Namespace, files: Submissions) -> dict[str, BlockSums]:
    bags = bags_among(arguments.bags)
    submitted = {name: submission(read_prediction_file(path, most_rows(bags))) for name, path in files.items()}
    job = ScoringJob((), submissions=submitted, processes=processes_of(arguments))
    results = score_bags(job, bags, lambda: None)
    for result in results:
        if result.error is not None:
            raise result.error
    episodes = [result.scores for result in results if result.scores is not None]
    stratum = np.unique([episode.template for episode in episodes], return_inverse=True)[1]
    errors = {name: [episode.models[name].values["ade_m"] for episode in episodes] for name in files}
    return {
        name: block_sums(np.concatenate(parts), np.repeat(np.arange(len(parts)), [*map(len, parts)]), stratum)
        for name, parts in errors.items()
    }


def _detection(arguments: argparse.Namespace, files: Submissions) -> dict[str, BlockSums]:
    with ProcessPool(processes_of(arguments)) as pool, tempfile.TemporaryDirectory() as scratch:
        needs = (Need.LIDAR, Need.MAP)
        surveys = pool.map(survey_bag, [(bag, "detection", needs, Path(scratch)) for bag in bags_among(arguments.bags)])
        frames = frames_of(pool.map(read_frames, in_dataset_order(surveys)))
    stratum = np.unique([episode.template for episode in frames.episodes], return_inverse=True)[1]
    sums = {}
    for name, path in files.items():
        values = mean_ap_of_episodes(frames, read_detections(name, str(path), frames), VEHICLE_NAMES)
        sums[name] = block_sums(values, np.arange(len(values)), stratum)
    return sums


@dataclass(frozen=True)
class _Task:
    """How the submissions of a task are found and scored."""

    score: str
    blocks: str
    suffixes: tuple[str, ...]
    """Suffixes of the files of submissions; empty where a submission is a folder."""
    less_is_better: bool
    sums: Callable[[argparse.Namespace, Submissions], dict[str, BlockSums]]


TASKS: Final = {
    "prediction": _Task("ADE in metres", "episodes", (".parquet",), less_is_better=True, sums=_prediction),
    "detection": _Task(
        "mAP of episodes", "episodes", (".json", ".pkl", ".npz", ""), less_is_better=False, sums=_detection
    ),
    "risk": _Task("balanced accuracy", "videos", (".json", ".csv"), less_is_better=False, sums=_risk),
}


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Ranks the submissions in a folder, one file each, named as the row shall be. All are scored on the same "
        "episodes or videos; each is compared with the best one by a test that exchanges the two within episodes."
    )
    tasks = verb.add_subparsers(title="tasks", metavar="TASK", required=True)
    for name, task in TASKS.items():
        line = tasks.add_parser(name, help=f"by {task.score}", description=f"Ranks submissions by {task.score}.")
        kinds = ", ".join(suffix or "folders of KITTI text files" for suffix in task.suffixes)
        line.add_argument("folder", type=Path, metavar="FOLDER", help=f"submissions: {kinds}")
        if name == "risk":
            line.add_argument("set", type=Path, metavar="SET", help="folder that `siren generate risk` made")
        else:
            add_bags(line)
            add_processes(line)
        line.add_argument("--out", type=Path, metavar="FILE.json", help="write the standings there, too")
        line.set_defaults(run=run, task=name)


def submissions_in(folder: Path, suffixes: tuple[str, ...]) -> dict[str, Path]:
    """The submissions by their names, without hidden files.

    Raises:
        InputError: No submission, or two of one name.
    """
    paths = sorted(path for path in folder.glob("*") if not path.name.startswith("."))
    found: dict[str, Path] = {}
    for path in paths:
        if path.suffix in suffixes if path.is_file() else "" in suffixes:
            if (name := shown_text(path.stem)) in found:
                raise InputError("folder", str(path), f"each name once, unlike {found[name].name}")
            found[name] = path
    if not found:
        raise InputError("folder", str(folder), f"a folder with submissions ({', '.join(filter(None, suffixes))})")
    return found


def run(arguments: argparse.Namespace) -> int:
    """Scores and ranks every submission that can be scored; the others are named, and the exit code is then 1."""
    task = TASKS[arguments.task]
    files = submissions_in(arguments.folder, task.suffixes)
    sums, refused = _scored(partial(task.sums, arguments), files)
    rows = standings(sums, task.score, less_is_better=task.less_is_better)
    print("\n".join(text_of((leaderboard(rows, task.blocks),))))
    for name, error in refused.items():
        complain(f"siren leaderboard: {name} is not ranked: {error}")
    if arguments.out is not None:
        values, differences = ([row.json() for row in rows if bool(row.against) == asked] for asked in (False, True))
        content = {
            "task": arguments.task,
            "version": siren_ros.__version__,
            "rows": values,
            "differences": differences,
            "refused": {name: str(error) for name, error in refused.items()},
            "submissions": {name: sha256_of(path) for name, path in files.items()},
            "scored_on": _set_of(arguments) if arguments.task == "risk" else _bags_of(arguments),
        }
        write_text(arguments.out, json.dumps(content, indent=1) + "\n")
    return EXIT_FAILED if refused else EXIT_OK


def _scored(
    sums: Callable[[Submissions], dict[str, BlockSums]], files: Submissions
) -> tuple[dict[str, BlockSums], dict[str, SirenError]]:
    """The sums of all submissions, and the errors of those that cannot be scored; an error that all have is raised."""
    try:
        return sums(files), {}
    except SirenError as error:
        if len(files) == 1:
            raise
        first = error
    found: dict[str, BlockSums] = {}
    refused: dict[str, SirenError] = {}
    for name, path in files.items():
        try:
            found |= sums({name: path})
        except SirenError as error:
            refused[name] = error
    if not found:
        raise first
    return found, refused


def _set_of(arguments: argparse.Namespace) -> list[dict[str, str | int]]:
    return [{"set": shown_text(arguments.set.name), "sha256": sha256_of(arguments.set)}]


def _bags_of(arguments: argparse.Namespace) -> list[dict[str, str | int]]:
    """What the episodes of the ranking are, so that nobody chooses seeds, or those of the training, unseen."""
    rows: list[dict[str, str | int]] = []
    for bag in bags_among(arguments.bags):
        with open_source(bag) as source:
            episode = source.description
        of_map = {"map": episode.map_name, "map_sha256": episode.map_sha256}
        named = {"bag": shown_text(bag.name), "template": episode.template, "level": episode.level.name}
        split = split_of(EpisodeIdentity.of(episode)).value
        rows.append({**named, "seed": episode.seed, "split": split, **of_map, "sha256": bag_sha256(bag)})
    return rows
