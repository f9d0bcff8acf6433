"""``siren compare-paper BAG…``: what the paper's tables say, next to the same numbers measured here."""

import argparse
import csv
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from siren_ros.cli.options import add_processes, named_path, names_in, processes_of, steps_of
from siren_ros.errors import EXIT_OK, InputError, whole_file, writing
from siren_ros.evaluation.paper_comparison import (
    Compared,
    at_template_level,
    comparison_tables,
    detection_rows,
    measured,
    prediction_rows,
    risk_rows,
    stored,
)
from siren_ros.evaluation.prediction.reports.paper_results import PAPER_NAMES, maps_next_to_the_papers
from siren_ros.evaluation.prediction.reports.score_table import score_table
from siren_ros.evaluation.prediction.scoring import ScoringJob, score_bags
from siren_ros.evaluation.risk.video_set import read_set
from siren_ros.recording.bag_reader import bags_among
from siren_ros.scenario.templates import load_template
from siren_ros.tables.table import text_of


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Prints the numbers of the paper's tables next to ours: errors of the trajectory predictors on the vehicles "
        "in the interaction region, numbers of samples, ranking of the templates, detection and the order of the "
        "behaviour families, and the balance of the risk videos, with 95 % intervals over episodes. Only episodes at "
        "their template's level count, as in the paper."
    )
    verb.add_argument("bags", type=Path, metavar="BAG", nargs="+", help="bags, or folders with bags at any depth")
    verb.add_argument("--models", default="cv,idm", metavar="NAMES", help="predictors, by commas (default %(default)s)")
    verb.add_argument(
        "--checkpoint",
        type=named_path,
        action="append",
        default=[],
        metavar="NAME=PATH",
        help="weights of a predictor; may be given several times",
    )
    verb.add_argument("--detection", type=Path, metavar="DIR", help="folder of `siren evaluate detection --out`")
    verb.add_argument("--risk", type=Path, metavar="DIR", help="folder of `siren evaluate risk --out`")
    verb.add_argument("--risk-set", type=Path, metavar="SET", help="folder that `siren generate risk` made")
    verb.add_argument("--all", action="store_true", help="also print the paper's numbers that were not measured here")
    verb.add_argument("--out", type=Path, metavar="FILE", help="write all rows to this .json or .csv file")
    add_processes(verb)
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Scores the bags and prints the rows."""
    if arguments.out is not None and arguments.out.suffix not in {".json", ".csv"}:
        raise InputError("out", str(arguments.out), "a file name that ends in .json or .csv")
    rows = [
        *_prediction(arguments),
        *detection_rows(None if arguments.detection is None else _needed(arguments.detection)),
        *risk_rows(
            None if arguments.risk_set is None else read_set(arguments.risk_set),
            None if arguments.risk is None else _needed(arguments.risk),
        ),
    ]
    shown = rows if arguments.all else measured(rows)
    print("\n".join(text_of(comparison_tables(shown))))
    print("a star: the paper's value lies in our interval; NDS and errors of detection have none")
    for model in names_in(arguments.models):
        if model not in PAPER_NAMES:
            command = f"siren evaluate prediction --models {model}"
            print(f"{model} has no row in the paper's tables, and so none here; `{command}` prints its errors")
    if len(shown) < len(rows):
        print(f"{len(rows) - len(shown)} further numbers of the paper were not measured here; --all prints them")
    if arguments.out is not None:
        _write(arguments.out, rows)
    return EXIT_OK


def _needed(folder: Path) -> dict[str, object]:
    found = stored(folder)
    if found is None:
        raise InputError("scores", str(folder), "a folder with the scores.json that `siren evaluate` wrote")
    return dict(found)


def _prediction(arguments: argparse.Namespace) -> list[Compared]:
    models = names_in(arguments.models)
    job = ScoringJob(models, tuple(dict(arguments.checkpoint).items()), processes=processes_of(arguments))
    bags = bags_among(arguments.bags)
    with tqdm(total=len(bags), unit="bag", disable=None, leave=False, desc="compare-paper") as bar:
        results = score_bags(job, bags, steps_of(bar))
    for result in results:
        if result.error is not None:
            print(f"siren compare-paper: {result.error}", file=sys.stderr)
    scores = [result.scores for result in results if result.scores is not None]
    counted = at_template_level(scores, lambda template: load_template(template).level.name)
    if not counted:
        raise InputError("bags", f"{len(scores)} episodes", "episodes of S1 to S7 at their own levels")
    if len(counted) < len(scores):
        print(f"{len(scores) - len(counted)} of {len(scores)} episodes are at other levels and do not count")
    print(maps_next_to_the_papers(counted))
    return list(prediction_rows(score_table(counted)))


def _write(file: Path, rows: Sequence[Compared]) -> None:
    content = [row.to_json() for row in rows]
    with writing(file), whole_file(file) as new:
        if file.suffix == ".json":
            new.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
        else:
            with new.open("w", encoding="utf-8", newline="") as opened:
                writer = csv.DictWriter(opened, list(content[0]), lineterminator="\n")
                writer.writeheader()
                writer.writerows(content)
