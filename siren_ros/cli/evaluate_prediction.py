"""``siren evaluate prediction BAG… --models cv,idm``: how well models predict where vehicles go."""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from siren_ros.cli.named_path import named_path
from siren_ros.errors import EXIT_FAILED, EXIT_OK, InputError, SirenError
from siren_ros.evaluation.prediction.metrics.displacement import MetricValue
from siren_ros.evaluation.prediction.predictors import PREDICTORS, predictors_named
from siren_ros.evaluation.prediction.protocol.predictor import Predictor
from siren_ros.evaluation.prediction.protocol.samples import Population
from siren_ros.evaluation.prediction.reports.paper_results import paper_value
from siren_ros.evaluation.prediction.reports.summary import Summary, as_json, summarise
from siren_ros.evaluation.prediction.scoring import EpisodeScores, score_episode
from siren_ros.evaluation.statistics.rank_correlation import RANKED_MIN
from siren_ros.recording.bag_folders import bags_among
from siren_ros.recording.bag_reader import read_episode

_SHOWN = ("ade_m", "fde_m")
"""Metrics of the printed table; the JSON file has all."""
_NO_WINDOW = {
    Population.REGION: "no vehicle was in the region around the EMV for a whole window of 8 s",
    Population.ALL: "no vehicle was logged for a whole window of 8 s",
}
_POPULATION = {
    Population.REGION: "population: region (vehicles within 40 m in, 50 m out around the EMV for the whole window)",
    Population.ALL: "population: all vehicles on the map",
}


def add_arguments(task: argparse.ArgumentParser) -> None:
    """Describe the task, and what it takes."""
    task.description = (
        "Trajectory prediction by the paper's protocol: 3 s of history, 5 s of future every 0.2 s, one sample for each "
        "vehicle and each frame at 10 Hz whose whole window was logged. Prints ADE/FDE in metres next to the paper's "
        "values. Exit code 1 where an episode gives no sample."
    )
    task.add_argument(
        "bags", type=Path, metavar="BAG", nargs="+", help="folder of a recorded episode, or a folder of such folders"
    )
    task.add_argument(
        "--models",
        default="cv,idm",
        metavar="NAMES",
        help=f"of {', '.join(PREDICTORS)}, by commas; NAME:LABEL is the same model in a row of its own "
        "(default %(default)s)",
    )
    task.add_argument(
        "--checkpoint",
        type=named_path,
        action="append",
        default=[],
        metavar="NAME=PATH",
        help="trained weights of a model; may be given several times",
    )
    task.add_argument(
        "--population",
        choices=[one.value for one in Population],
        default=Population.REGION.value,
        help="whose windows count: vehicles in the region of 40 m in, 50 m out around the EMV, as in the paper, or all "
        "(default %(default)s)",
    )
    task.add_argument("--out", type=Path, metavar="DIR", help="write every metric of every bag to scores.json there")
    task.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Scores every bag; one that cannot be read does not keep the others from being scored."""
    names = [name.strip() for name in arguments.models.split(",") if name.strip()]
    predictors = predictors_named(names, _by_name("checkpoint", arguments.checkpoint))
    population = Population(arguments.population)
    worst, scores = EXIT_OK, []
    for bag in bags_among(arguments.bags):
        try:
            scores.append(_score(bag, predictors, population))
        except SirenError as error:
            print(f"siren evaluate: {error}", file=sys.stderr)
            worst = max(worst, error.exit_code)
            continue
        if scores[-1].samples == 0:
            print(f"siren evaluate: {bag}: {_NO_WINDOW[population]}", file=sys.stderr)
            worst = max(worst, EXIT_FAILED)
    if scores:
        summary = summarise(scores)
        print("\n".join([_POPULATION[population], "", *_table(scores, summary), "", *_comparison(summary)]))
        if arguments.out is not None:
            _write_json(arguments.out / "scores.json", scores, summary)
    return worst


def _by_name(parameter: str, given: Sequence[tuple[str, Path]]) -> dict[str, Path]:
    for name, count in Counter(name for name, _ in given).items():
        if count > 1:
            raise InputError(parameter, name, "each name once")
    return dict(given)


def _score(bag: Path, predictors: dict[str, Predictor], population: Population) -> EpisodeScores:
    return score_episode(str(bag), read_episode(bag), predictors, population)


def _table(scores: Sequence[EpisodeScores], summary: Summary) -> list[str]:
    """One row for each bag, one for each template of several bags, and the mean over the templates."""
    rows = [["", "", "", *(cell for model in summary for cell in (model, "paper"))]]
    rows += [["bag", "template", "samples", *("ADE/FDE m" for _ in summary for _ in range(2))]]
    for episode in scores:
        values = [
            [(_known(episode.models[model][metric]), paper_value(model, metric, episode.template)) for metric in _SHOWN]
            for model in summary
        ]
        head = [Path(episode.name).name, f"{episode.template} {episode.level.name}", str(episode.samples)]
        rows.append([*head, *_cells(values)])
    bags = Counter(episode.template for episode in scores if episode.samples)
    for template in sorted(template for template, count in bags.items() if count > 1):
        values = [
            [
                (summary[model][metric].by_template.get(template), paper_value(model, metric, template))
                for metric in _SHOWN
            ]
            for model in summary
        ]
        samples = sum(episode.samples for episode in scores if episode.template == template)
        rows.append([f"mean of {bags[template]} bags", template, str(samples), *_cells(values)])
    values = [
        [(summary[model][metric].mean, summary[model][metric].paper_mean_same_templates) for metric in _SHOWN]
        for model in summary
    ]
    name = f"mean of {len(bags)} template{'s' if len(bags) != 1 else ''}"
    rows.append([name, "", str(sum(episode.samples for episode in scores)), *_cells(values)])
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return ["  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def _known(value: MetricValue) -> float | None:
    return value.value if value.valid else None


def _cells(values: Sequence[Sequence[tuple[float | None, float | None]]]) -> list[str]:
    """Two cells for each model, here and the paper, of one pair (here, paper) for each metric shown."""
    sides = [[pair[side] for pair in pairs] for pairs in values for side in (0, 1)]
    return ["/".join("-" if value is None else f"{value:.2f}" for value in side) for side in sides]


def _comparison(summary: Summary) -> list[str]:
    """One line for each model: the mean ADE against the paper's, and the ranking of the templates."""
    lines = []
    for model, metrics in summary.items():
        ade = metrics["ade_m"]
        if ade.mean is None or ade.paper_mean is None:
            continue
        parts = [f"mean ADE {ade.mean:.2f} m, {ade.deviation:+.0%} from the paper's {ade.paper_mean:.2f} m"]
        same = ade.paper_mean_same_templates
        if same is not None and same != ade.paper_mean:
            parts.append(f"{ade.deviation_same_templates:+.0%} from its {same:.2f} m over the same templates")
        ranked = f"needs {RANKED_MIN} templates" if ade.spearman is None else f"{ade.spearman:.2f}"
        lines.append(f"{model}: {', '.join(parts)}; Spearman rank correlation over the templates: {ranked}")
    return lines


def _write_json(path: Path, scores: Sequence[EpisodeScores], summary: Summary) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(as_json(scores, summary), indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError("out", str(path.parent), f"a place that can be written ({error.strerror or error})") from error
