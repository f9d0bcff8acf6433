"""``siren evaluate risk SET --predictions NAME=FILE``: how well models judge the risk in videos."""

import argparse
import json
from pathlib import Path

from siren_ros.cli.evaluation.named_path import named_path
from siren_ros.errors import EXIT_OK, InputError
from siren_ros.evaluation.risk.answers import checked_answers, read_answers
from siren_ros.evaluation.risk.references import REFERENCES
from siren_ros.evaluation.risk.reports.confusion_picture import save_confusions
from siren_ros.evaluation.risk.reports.tables import as_json, confusion_lines, csv_table, latex_table, text_table
from siren_ros.evaluation.risk.scoring import ModelScores, score_answers
from siren_ros.evaluation.risk.video_set import read_set


def add_arguments(task: argparse.ArgumentParser) -> None:
    """Describe the task, and what it takes."""
    task.description = (
        "Scores the answers of vision-language models, or of any other program, to a set of risk videos: accuracy, "
        "precision, recall and F1 of each class, with 95 % intervals by bootstrap over videos, and confusion matrices "
        "overall and by template. The rows majority and oracle are always there to compare with."
    )
    task.add_argument("set", type=Path, metavar="SET", help="folder that `siren generate risk` made")
    task.add_argument(
        "--predictions",
        type=named_path,
        action="append",
        default=[],
        metavar="NAME=FILE",
        help='answers, JSON {"S1_000": "Normal", …} or CSV with the columns video and class; may be repeated',
    )
    task.add_argument("--allow-missing", action="store_true", help="score the videos that have an answer")
    task.add_argument("--compare-paper", action="store_true", help="print the paper's rows, too")
    task.add_argument("--out", type=Path, metavar="DIR", help="write CSV, LaTeX, JSON and pictures there")
    task.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Scores every file of answers."""
    videos = read_set(arguments.set)
    models = [score_answers(name, videos, reference(videos)) for name, reference in REFERENCES.items()]
    for name, path in arguments.predictions:
        if name in {model.name for model in models}:
            raise InputError("predictions", name, "each name once, and none of " + ", ".join(REFERENCES))
        answers = checked_answers(read_answers(path), videos.videos, allow_missing=arguments.allow_missing)
        models.append(score_answers(name, videos, answers))
    print("\n".join(text_table(models, compare_paper=arguments.compare_paper)))
    for model in models[len(REFERENCES) :]:
        print("\n" + "\n".join(confusion_lines(model)))
    if arguments.out is not None:
        _write(arguments.out, models, compare_paper=arguments.compare_paper)
    return EXIT_OK


def _write(folder: Path, models: list[ModelScores], *, compare_paper: bool) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        folder.joinpath("scores.csv").write_text(csv_table(models), encoding="utf-8")
        folder.joinpath("scores.tex").write_text(latex_table(models, compare_paper=compare_paper), encoding="utf-8")
        folder.joinpath("scores.json").write_text(json.dumps(as_json(models), indent=1) + "\n", encoding="utf-8")
        for model in models:
            save_confusions(model, folder / f"confusion_{model.name}.png")
    except OSError as error:
        raise InputError("out", str(folder), f"a folder that can be written ({error.strerror or error})") from error
