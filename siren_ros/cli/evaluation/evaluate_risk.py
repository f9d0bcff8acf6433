"""``siren evaluate risk SET --predictions NAME=FILE``: how well models judge the risk in videos."""

import argparse
import json
from pathlib import Path

from siren_ros.cli.evaluation.asked_models import add_asking, ask, file_name, models_asked
from siren_ros.cli.evaluation.named_path import named_path
from siren_ros.errors import EXIT_OK, InputError, whole_file, writing
from siren_ros.evaluation.risk.answers import Answers, checked_answers, read_answers
from siren_ros.evaluation.risk.page.risk_page import write_page
from siren_ros.evaluation.risk.references import REFERENCES
from siren_ros.evaluation.risk.reports.confusion_picture import save_confusions
from siren_ros.evaluation.risk.reports.tables import as_json, confusion_lines, csv_table, latex_table, text_table
from siren_ros.evaluation.risk.scoring import ModelScores, score_answers
from siren_ros.evaluation.risk.video_set import read_set


def add_arguments(task: argparse.ArgumentParser) -> None:
    """Describe the task, and what it takes."""
    task.description = (
        "Scores the answers of vision-language models, or of any other program, to a set of risk videos: accuracy, "
        "precision, recall and F1 of each class, with 95 % intervals over videos, and confusion matrices "
        "overall and by template. References to compare with: the most frequent class, a small network that sees each "
        "second frame, and the record's own measures."
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
    task.add_argument(
        "--references",
        nargs="*",
        choices=list(REFERENCES),
        default=list(REFERENCES),
        help=f"rows to compare with (default {' '.join(REFERENCES)})",
    )
    add_asking(task)
    task.add_argument("--allow-missing", action="store_true", help="score the videos that have an answer")
    task.add_argument("--compare-paper", action="store_true", help="print the paper's rows, too")
    task.add_argument("--out", type=Path, metavar="DIR", help="write CSV, LaTeX, JSON and pictures there")
    task.add_argument(
        "--page", type=Path, metavar="FILE", help="write an HTML page that plays each video next to all answers"
    )
    task.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Scores every file of answers."""
    videos = read_set(arguments.set)
    answers: dict[str, Answers] = {name: REFERENCES[name](videos) for name in dict.fromkeys(arguments.references)}
    for name, path in arguments.predictions:
        if name in {*answers, *REFERENCES}:
            raise InputError("predictions", name, "each name once, and none of " + ", ".join(REFERENCES))
        answers[name] = checked_answers(read_answers(path), videos.videos, allow_missing=arguments.allow_missing)
    for model in models_asked(arguments):
        if model.name in answers:
            raise InputError("model", model.name, "each name once")
        answers[model.name] = ask(arguments, videos, model)
    models = [score_answers(name, videos, given) for name, given in answers.items()]
    print("\n".join(text_table(models, compare_paper=arguments.compare_paper)))
    for scored in models:
        if scored.name not in {"majority", "oracle"}:
            print("\n" + "\n".join(confusion_lines(scored)))
    if arguments.out is not None:
        _write(arguments.out, models, compare_paper=arguments.compare_paper)
    if arguments.page is not None:
        write_page(arguments.page, videos, answers, models)
        print(f"\n{arguments.page}")
    return EXIT_OK


def _write(folder: Path, models: list[ModelScores], *, compare_paper: bool) -> None:
    with writing(folder, "folder"):
        folder.mkdir(parents=True, exist_ok=True)
        tables = {
            "scores.csv": csv_table(models),
            "scores.tex": latex_table(models, compare_paper=compare_paper),
            "scores.json": json.dumps(as_json(models), indent=1) + "\n",
        }
        for name, text in tables.items():
            with whole_file(folder / name) as file:
                file.write_text(text, encoding="utf-8")
        for model in models:
            save_confusions(model, folder / f"confusion_{file_name(model.name)}.png")
