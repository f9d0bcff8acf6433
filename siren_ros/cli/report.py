"""``siren report``, ``compare-paper`` and ``reproduce``: results as a page, next to the paper's, and in documents."""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Final

from tqdm import tqdm

from siren_ros.base.params.folders import params_dir
from siren_ros.base.tables import csv_text, text_of
from siren_ros.cli.command import complain
from siren_ros.cli.options import add_bags, add_named_paths, add_processes, names_in, processes_of, steps_of
from siren_ros.data.recording.bag_reader import bags_among
from siren_ros.errors import EXIT_FAILED, EXIT_OK, InputError, write_text, writing
from siren_ros.lab.reproduction.make import Reproduction, read_parts
from siren_ros.reports.study_report.build import build_page
from siren_ros.reports.study_report.page import html_of
from siren_ros.reports.study_report.study import DETECTION, MODELS, PAGES, RISK, PageOptions
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
        "Writes one HTML file about a study: its episodes, pictures and films of the templates, yield metrics, "
        "effects of siren and level, the tables of the three tasks, diversity, and the commands that repeat each "
        "number. A browser needs no network. Its links lead to pages of episodes in a folder next to the file."
    )
    verb.add_argument("dir", type=Path, metavar="DIR", help="folder that `siren generate` made")
    verb.add_argument("--out", type=Path, required=True, metavar="FILE.html", help="page to write")
    verb.add_argument(
        "--models",
        default=",".join(MODELS),
        metavar="NAMES",
        help="predictors to score, by commas (default %(default)s)",
    )
    verb.add_argument(
        "--detection",
        type=Path,
        metavar="DIR",
        help=f"folder that `siren evaluate detection --out` wrote (default: DIR/{DETECTION})",
    )
    verb.add_argument(
        "--risk", type=Path, metavar="DIR", help=f"folder that `siren evaluate risk --out` wrote (default: DIR/{RISK})"
    )
    verb.add_argument(
        "--pages",
        type=int,
        default=PAGES,
        metavar="N",
        help="most episodes with a page of their own, about 2 MB each, in the folder FILE_pages (default %(default)s)",
    )
    add_processes(verb)
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Measures all bags and writes the page."""
    if arguments.out.suffix.lower() not in {".html", ".htm"}:
        raise InputError("out", str(arguments.out), "a file name that ends in .html")
    jobs = processes_of(arguments)
    models = names_in(arguments.models)
    if not models:
        raise InputError("models", arguments.models, "one or several predictors, by commas")
    if arguments.pages < 0:
        raise InputError("pages", arguments.pages, "a number of episodes, 0 for none")
    folder = arguments.out.with_name(f"{arguments.out.stem}_pages")
    options = PageOptions(models, arguments.detection, arguments.risk, jobs, pages=arguments.pages, pages_folder=folder)
    with tqdm(unit="bag", desc="report", disable=None) as bar:
        page, pages = build_page(arguments.dir, options, bar.reset, steps_of(bar))
    content = html_of(page)
    with writing(arguments.out):
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
    write_text(arguments.out, content)
    print(f"{arguments.out}: {len(page.sections)} sections, {len(content) / 1e6:.1f} MB")
    written, size_bytes, missing = pages.write(jobs)
    if written:
        print(f"{folder}: {written} pages of episodes, {size_bytes / 1e6:.1f} MB")
    for text in missing:
        complain(f"siren report: no page of {text}")
    return EXIT_OK


def add_paper(verb: argparse.ArgumentParser) -> None:
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
    verb.set_defaults(run=compare_with_paper)


def compare_with_paper(arguments: argparse.Namespace) -> int:
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


_RESULTS: Final = Path("docs", "results.json")
_WRITE_DOCUMENTS: Final = Path("tools", "write_documents.py")


def add_reproduction(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Makes every measured figure, table, picture and film of the documents, part by part, and writes "
        "docs/results.json and the documents. It says first how long each part takes. It makes a part again only if "
        "its commands, its code or a part that it needs has changed. The same command continues an interrupted run. It "
        "needs a checkout of the repository."
    )
    verb.add_argument("--only", nargs="+", default=(), metavar="PART", help="only these parts and those that they need")
    verb.add_argument("--list", action="store_true", help="only list what would be made")
    verb.add_argument("--out", type=Path, default=Path("reproduction"), metavar="DIR", help="folder for the work")
    add_processes(verb)
    verb.set_defaults(run=reproduce)


def reproduce(arguments: argparse.Namespace) -> int:
    """Makes the parts that are due."""
    repository = Path.cwd()
    if not (repository / "docs").is_dir() or not (repository / "siren_ros").is_dir():
        raise InputError("folder", str(repository), "the top folder of a checkout of the repository")
    if arguments.workers < 1:
        raise InputError("workers", arguments.workers, "1 or more")
    parts = read_parts(params_dir() / "reproduction.yaml", repository)
    work = Reproduction(repository, arguments.out.resolve(), repository / _RESULTS, arguments.workers)
    steps = work.plan(parts, arguments.only)
    if arguments.list:
        print(*steps, sep="\n")
        return EXIT_OK
    failed = work.make(steps, lambda line: print(line, flush=True))
    for line in failed:
        print(f"failed: {line}")
    written = subprocess.run([sys.executable, str(repository / _WRITE_DOCUMENTS)], check=False)  # noqa: S603 - a file of the checkout
    return EXIT_FAILED if failed or written.returncode else EXIT_OK
