"""``siren evaluate prediction BAG… --models cv,idm``: how well models predict where vehicles go."""

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from siren_ros.cli.command import complain
from siren_ros.cli.options import add_bags, add_named_paths, add_processes, names_in, processes_of, steps_of
from siren_ros.data.interfaces.topics import PREDICTIONS
from siren_ros.data.recording.bag_reader import bags_among
from siren_ros.errors import EXIT_FAILED, EXIT_OK, InputError
from siren_ros.scoring.evaluation.detection.detectors import DETECTORS
from siren_ros.scoring.evaluation.prediction.charts import write_charts, write_sample_pictures
from siren_ros.scoring.evaluation.prediction.predictors import PREDICTORS
from siren_ros.scoring.evaluation.prediction.reported_tracks import NOISES
from siren_ros.scoring.evaluation.prediction.reports.report import (
    NO_SAMPLES_TEXT,
    new_folder,
    prediction_tables,
    text_report,
    write_report,
)
from siren_ros.scoring.evaluation.prediction.reports.score_table import differences, score_table
from siren_ros.scoring.evaluation.prediction.samples import Population
from siren_ros.scoring.evaluation.prediction.scoring import EpisodeScores, ScoringJob, score_bags
from siren_ros.scoring.evaluation.prediction.submission import most_rows, read_prediction_file, submission
from siren_ros.simulation.scenario.scenario import REGION_TEXT


def add_arguments(task: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    task.description = (
        "Scores trajectory prediction with the paper's protocol: 3 s of history, 5 s of future every 0.2 s, one "
        "sample for each vehicle and each frame at 10 Hz with a complete window. Prints ADE/FDE in metres by "
        "template, category and level, with intervals over the episodes. The exit code is 1 if an episode gives no "
        "sample."
    )
    add_bags(task)
    task.add_argument(
        "--models",
        default="cv,idm,siren",
        metavar="NAMES",
        help=f"models among {', '.join(PREDICTORS)}, by commas; NAME:LABEL adds another row of the same model; "
        "none scores --predictions alone (default %(default)s)",
    )
    add_named_paths(task, "--checkpoint", "NAME=PATH", "trained weights of a model")
    source = f"a Parquet file, or {PREDICTIONS.name} for this topic of the bags"
    add_named_paths(task, "--predictions", "NAME=FILE", f"predictions of another program: {source}")
    task.add_argument(
        "--allow-missing", action="store_true", help="score only samples that a file has; tables name their share"
    )
    task.add_argument(
        "--population",
        choices=[population.value for population in Population],
        default=Population.REGION.value,
        help=f"vehicles to score: those in the interaction region ({REGION_TEXT}), as in the paper, or all "
        "(default %(default)s)",
    )
    task.add_argument(
        "--noise",
        choices=[*NOISES, *DETECTORS],
        default="",
        help="tracks with errors for the models: a tracker's, or of velocities alone; or a detector's, for bags "
        "with LiDAR (default: the logged states)",
    )
    task.add_argument("--compare-paper", action="store_true", help="also print the paper's nine rows")
    task.add_argument("--out", type=Path, metavar="DIR", help="write the report there: text, JSON, CSV, LaTeX")
    task.add_argument(
        "--pictures",
        action="store_true",
        help="also write pictures of the best, the median and the worst sample of each template and model to --out",
    )
    add_processes(task)
    task.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Scores every bag; one that cannot be read does not keep the others from being scored."""
    if arguments.pictures and arguments.out is None:
        raise InputError("pictures", "--pictures", "together with --out DIR")
    bags = bags_among(arguments.bags)
    job = _job(arguments, bags)
    if arguments.out is not None:
        new_folder(arguments.out)
    with tqdm(total=len(bags), unit="bag", disable=None, leave=False, desc="evaluate") as bar:
        results = score_bags(job, bags, steps_of(bar))
    worst, scores = EXIT_OK, []
    for result in results:
        if result.error is not None:
            complain(f"siren evaluate: {result.error}")
            worst = max(worst, result.error.exit_code)
        elif result.scores is not None:
            scores.append(result.scores)
            if result.scores.samples == 0:
                complain(f"siren evaluate: {result.bag}: {NO_SAMPLES_TEXT[job.population]}")
                worst = max(worst, EXIT_FAILED)
    if scores:
        _report(arguments, job, scores)
    return worst


def _job(arguments: argparse.Namespace, bags: Sequence[Path]) -> ScoringJob:
    files = _by_name("predictions", arguments.predictions)
    recorded = [name for name, path in files.items() if str(path) == PREDICTIONS.name]
    if len(recorded) > 1:
        raise InputError("predictions", recorded[1], f"{PREDICTIONS.name} once")
    models = names_in("" if arguments.models == "none" and files else arguments.models)
    if not models and not files:
        raise InputError("models", arguments.models, f"one or several of {', '.join(PREDICTORS)}")
    for name in files:
        if name in models:
            raise InputError("predictions", name, f"a name that no model has, unlike {', '.join(models)}")
    return ScoringJob(
        models=models,
        checkpoints=tuple(_by_name("checkpoint", arguments.checkpoint).items()),
        submissions={
            name: submission(read_prediction_file(path, most_rows(bags)), arguments.allow_missing)
            for name, path in files.items()
            if name not in recorded
        },
        recorded=next(iter(recorded), ""),
        allow_missing=arguments.allow_missing,
        population=Population(arguments.population),
        noise=arguments.noise,
        processes=processes_of(arguments),
    )


def _by_name(parameter: str, given: Sequence[tuple[str, Path]]) -> dict[str, Path]:
    for name, count in Counter(name for name, _ in given).items():
        if count > 1:
            raise InputError(parameter, name, "each name once")
    return dict(given)


def _report(arguments: argparse.Namespace, job: ScoringJob, scores: Sequence[EpisodeScores]) -> None:
    table = score_table(scores)
    paired = differences(table)
    tables = prediction_tables(table, paired, compare_paper=arguments.compare_paper)
    text = "\n".join(text_report(table, tables, compare_paper=arguments.compare_paper))
    print(text)
    if arguments.out is not None:
        write_report(arguments.out, table, paired, tables, text)
        write_charts(arguments.out, table)
        if arguments.pictures:
            write_sample_pictures(arguments.out, table, job)
