"""``siren compare-paper BAG…``: what the paper's tables say, next to the same numbers measured here."""

import argparse
import json
from pathlib import Path

from tqdm import tqdm

from siren_ros.base.tables.table import csv_text, text_of
from siren_ros.cli.command import complain
from siren_ros.cli.options import add_bags, add_named_paths, add_processes, names_in, processes_of, steps_of
from siren_ros.data.recording.bag_reader import bags_among
from siren_ros.errors import EXIT_OK, InputError, write_text
from siren_ros.scoring.evaluation.paper_comparison import (
    Compared,
    at_template_level,
    comparison_tables,
    detection_rows,
    measured,
    prediction_rows,
    risk_rows,
    stored,
)
from siren_ros.scoring.evaluation.prediction.reports.paper_results import PAPER_NAMES, maps_next_to_the_papers
from siren_ros.scoring.evaluation.prediction.reports.score_table import score_table
from siren_ros.scoring.evaluation.prediction.scoring import ScoringJob, score_bags
from siren_ros.scoring.evaluation.risk.video_set import read_set
from siren_ros.simulation.scenario.templates import load_template


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Prints the numbers of the paper's tables next to ours: errors of the trajectory predictors on the vehicles "
        "in the interaction region, numbers of samples, ranking of the templates, detection and the order of the "
        "behaviour families, and the balance of the risk videos, with 95 % intervals over episodes. Only episodes at "
        "their template's level count, as in the paper."
    )
    add_bags(verb)
    verb.add_argument("--models", default="cv,idm", metavar="NAMES", help="predictors, by commas (default %(default)s)")
    add_named_paths(verb, "--checkpoint", "NAME=PATH", "weights of a predictor")
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
        *detection_rows(_scores(arguments.detection)),
        *risk_rows(arguments.risk_set and read_set(arguments.risk_set), _scores(arguments.risk)),
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
        content = [row.to_json() for row in rows]
        if arguments.out.suffix == ".json":
            write_text(arguments.out, json.dumps(content, indent=1, allow_nan=False) + "\n")
        else:
            write_text(arguments.out, csv_text(list(content[0]), [list(row.values()) for row in content]))
    return EXIT_OK


def _scores(folder: Path | None) -> dict[str, object] | None:
    if folder is None:
        return None
    scores = stored(folder)
    if scores is None:
        raise InputError("scores", str(folder), "a folder with the scores.json that `siren evaluate` wrote")
    return dict(scores)


def _prediction(arguments: argparse.Namespace) -> list[Compared]:
    models = names_in(arguments.models)
    job = ScoringJob(models, tuple(dict(arguments.checkpoint).items()), processes=processes_of(arguments))
    bags = bags_among(arguments.bags)
    with tqdm(total=len(bags), unit="bag", disable=None, leave=False, desc="compare-paper") as bar:
        results = score_bags(job, bags, steps_of(bar))
    for result in results:
        if result.error is not None:
            complain(f"siren compare-paper: {result.error}")
    scores = [result.scores for result in results if result.scores is not None]
    counted = at_template_level(scores, lambda template: load_template(template).level.name)
    if not counted:
        raise InputError("bags", f"{len(scores)} episodes", "episodes of S1 to S7 at their own levels")
    if len(counted) < len(scores):
        print(f"{len(scores) - len(counted)} of {len(scores)} episodes are at other levels and do not count")
    print(maps_next_to_the_papers(counted))
    return list(prediction_rows(score_table(counted)))
