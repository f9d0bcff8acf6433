"""The tables of an evaluation (for terminal, files and the page of a study), and the files of a report."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from siren_ros.base.tables import CONFIDENCE, Bounds, Cell, Row, Table, csv_text, text_of
from siren_ros.errors import shown_text, write_text, writing
from siren_ros.scoring.evaluation.prediction.metrics import BINS, METRICS, SCENE_METRICS, calibration_error
from siren_ros.scoring.evaluation.prediction.predictors import LABEL, is_simple
from siren_ros.scoring.evaluation.prediction.reports.paper_results import (
    PAPER_NAMES,
    compare_with_paper,
    maps_next_to_the_papers,
    paper_row,
)
from siren_ros.scoring.evaluation.prediction.reports.score_table import (
    GroupKind,
    SampleTable,
    ScoreTable,
    beaten,
    calibration_interval,
)
from siren_ros.scoring.evaluation.prediction.samples import Population, future_times_s
from siren_ros.scoring.evaluation.prediction.scoring import EpisodeScores
from siren_ros.scoring.evaluation.scores import Score, csv_of
from siren_ros.scoring.evaluation.statistics import RANKED_MIN
from siren_ros.simulation.scenario.episode import Split, counted_standings, overlap_warning
from siren_ros.simulation.scenario.paper import TEMPLATES
from siren_ros.simulation.scenario.scenario import REGION_TEXT

SHOWN: Final = ("ade_m", "fde_m")
"""Metrics of the tables by group, as in the paper."""
BAGS_MAX: Final = 20
"""With more bags than this, only the files have one row per bag."""
POPULATION_TEXT: Final = {
    Population.REGION: f"population: region (vehicles within {REGION_TEXT} around the EMV for the whole window)",
    Population.ALL: "population: all vehicles on the map",
}
NO_SAMPLES_TEXT: Final = {
    Population.REGION: "no vehicle was in the region around the EMV for a whole window of 8 s",
    Population.ALL: "no vehicle was logged for a whole window of 8 s",
}
"""Reason why an episode has no sample, by population."""
BY_TEMPLATE: Final[Mapping[str, tuple[Sequence[str], str]]] = {
    "prediction": (SHOWN, "ADE/FDE in m by template, [ADE's interval]"),
    "rmse": (("rmse_5s_m",), "RMSE in m at the 5-s horizon by template"),
    "best_of_six": (("min_ade_6_m", "min_fde_6_m"), "minADE6/minFDE6 in m by template, [minADE6's interval]"),
    "miss_rate": (("miss_rate_6",), "share of samples whose best of six ends more than 2 m away, by template"),
}
"""Metrics and captions of tables like the paper's, by the keys of the tables."""
_ALL: Final = GroupKind.ALL.value
_GROUPED: Final = (GroupKind.CATEGORY, GroupKind.SUBSET, GroupKind.LEVEL, GroupKind.PEOPLE)


def prediction_tables(
    scores: ScoreTable, pairs: Sequence[Score] = (), *, compare_paper: bool = False
) -> tuple[Table, ...]:
    """All tables of an evaluation; those that a terminal leaves out are folded.

    ``compare_paper`` adds the paper's rows, those of models that were not scored included.
    """
    tables = (
        _bags(scores),
        *(_by_template(scores, key, compare_paper) for key in BY_TEMPLATE),
        _metrics(scores),
        _scene(scores),
        *(_by_group(scores, kind) for kind in _GROUPED),
        _claims(scores),
        _paired(pairs),
        _seen(scores),
    )
    return tuple(table for table in tables if table.rows)


def text_report(scores: ScoreTable, tables: Sequence[Table], *, compare_paper: bool = False) -> list[str]:
    """Lines for a terminal: what was scored, the tables, and the deviation from the paper in words."""
    lines = [
        POPULATION_TEXT[scores.episodes[0].population] + _noise_text(scores),
        f"{len(scores.episodes)} episodes; [{CONFIDENCE:.0%} intervals] over whole episodes",
        "",
        *text_of([table for table in tables if not table.folded]),
    ]
    lines += [*warnings_of(scores), *_causality_lines(scores)]
    return [*lines, "", *_paper_lines(scores)] if compare_paper else lines


def _noise_text(scores: ScoreTable) -> str:
    noise = scores.episodes[0].noise
    return f"; tracks with errors: {noise}" if noise else ""


def _seen(scores: ScoreTable) -> Table:
    """Table that shows whether scored episodes were part of each trained model's training."""
    rows: list[Row] = [(model, *counts.values()) for model, counts in _standings(scores).items()]
    caption = "scored episodes by what the model's card says of them: train are its own training episodes"
    return Table("prediction_seen", caption, ("model", *(split.value for split in Split)), tuple(rows), folded=True)


def _standings(scores: ScoreTable) -> dict[str, dict[Split, int]]:
    known = {model: [of.standing[model] for of in scores.episodes if model in of.standing] for model in scores.models}
    return {model: counts for model, of in known.items() if (counts := counted_standings(of))}


def warnings_of(scores: ScoreTable) -> list[str]:
    """Warnings, one line for each model that is scored on episodes of its own training."""
    return [line for model, counts in _standings(scores).items() if (line := overlap_warning(model, counts))]


def _causality_lines(scores: ScoreTable) -> list[str]:
    """Lines that tell which models were checked without later frames, and which cannot be checked."""
    known = [model for model in scores.models if any(model in of.causal_frames for of in scores.episodes)]
    frames = {model: sum(of.causal_frames.get(model, 0) for of in scores.episodes) for model in known}
    parts = [
        f"{model} {count} frames" if count else f"{model} not: nobody can ask it again"
        for model, count in frames.items()
    ]
    return [f"asked again without the later frames, with the same answer: {', '.join(parts)}"] if parts else []


def _bags(scores: ScoreTable) -> Table:
    rows: list[Row] = []
    for episode in scores.episodes if 1 < len(scores.episodes) <= BAGS_MAX else ():
        cells = [tuple(model[metric].value for metric in SHOWN) for model in episode.models.values()]
        bag = episode.name.rstrip("/").rpartition("/")[2]
        rows.append((bag, f"{episode.template} {episode.level.name}", episode.samples, *cells))
    return Table("prediction_bags", "ADE/FDE in m by bag", ("bag", "template", "samples", *scores.models), tuple(rows))


def _by_template(scores: ScoreTable, key: str, compare_paper: bool) -> Table:
    metrics, caption = BY_TEMPLATE[key]
    scored = templates = [group.name for group in scores.of_kind(GroupKind.TEMPLATE)]
    if compare_paper:
        templates = [*TEMPLATES, *(name for name in scored if name not in TEMPLATES)]
    rows: list[Row] = []
    for model, samples in scores.samples.items():
        cells = (
            tuple(scores.value(model, name, metric) for metric in metrics) if name in scored else (None,) * len(metrics)
            for name in templates
        )
        coverage = f"{samples.coverage:.1%}" if len(samples) < samples.population_size else "all"
        rows.append((model, *cells, _mean(scores, model, _ALL, metrics), len(samples), coverage))
    paper: list[Row] = []
    for model, name in PAPER_NAMES.items() if compare_paper else ():
        known = [row for metric in metrics if (row := paper_row(model, metric))]
        if known:
            values = (tuple(row.get(template) for row in known) for template in templates)
            paper.append((f"{name} (paper)", *values, tuple(row[_ALL] for row in known), "", ""))
    head = ("model", *templates, "mean", "samples", "coverage")
    return Table(key, caption, head, tuple(rows), reference=tuple(paper), folded=metrics is not SHOWN)


def _metrics(scores: ScoreTable) -> Table:
    rows = []
    for model, samples in scores.samples.items():
        values = (scores.value(model, _ALL, metric.name) for metric in _OF_SAMPLES)
        rows.append((model, *values, calibration_error(samples.reliability).value))
    head = ("model", *(metric.label for metric in _OF_SAMPLES), "calibration error")
    return Table("prediction_metrics", "metrics of samples, mean over the templates", head, tuple(rows))


_OF_SAMPLES: Final = tuple(metric for metric in METRICS if metric not in SCENE_METRICS)


def _scene(scores: ScoreTable) -> Table:
    rows: list[Row] = [
        (model, *(_mean(scores, model, _ALL, (metric.name,)) for metric in SCENE_METRICS))
        for model in scores.models
        if any(scores.value(model, _ALL, metric.name) is not None for metric in SCENE_METRICS)
    ]
    caption = "metrics of frames, of the road and of what vehicles can do, [intervals]"
    return Table("prediction_scene", caption, ("model", *(metric.label for metric in SCENE_METRICS)), tuple(rows))


def _by_group(scores: ScoreTable, kind: GroupKind) -> Table:
    rows: list[Row] = []
    for group in scores.of_kind(kind):
        samples = max(scores.cells[model, group.name, SHOWN[0]].samples for model in scores.models)
        if samples:
            rows.append((group.name, samples, *(_mean(scores, model, group.name, SHOWN) for model in scores.models)))
    head = (kind.value, "samples", *scores.models)
    return Table(f"prediction_{kind.value}", f"ADE/FDE in m by {kind.value}, [ADE's interval]", head, tuple(rows))


def _mean(scores: ScoreTable, model: str, group: str, metrics: Sequence[str]) -> Cell:
    """Values of a group, with the interval of the first metric."""
    bounds = Bounds(scores.cells[model, group, metrics[0]].interval)
    return (*(scores.value(model, group, metric) for metric in metrics), bounds)


def _paired(pairs: Sequence[Score]) -> Table:
    """Table of differences between models. Pairs of simple baselines are left out if other models were scored."""
    shown = [pair for pair in pairs if pair.metric == SHOWN[0] and pair.group == _ALL and pair.interval.valid]
    others = [pair for pair in shown if not (is_simple(pair.model) and is_simple(pair.against))]
    rows = tuple(
        (f"{pair.model} - {pair.against}", pair.interval, pair.p_adjusted, pair.samples) for pair in others or shown
    )
    caption = "differences of ADE in m, on the samples that both models have"
    head = ("models", "difference", "p (Holm)", "common samples")
    return Table("prediction_differences", caption, head, rows, specs={"difference": "+.2f", "p (Holm)": ".3g"})


def _claims(scores: ScoreTable) -> Table:
    rows: list[Row] = []
    for claim in (claim for claim in scores.claims if claim.metric == SHOWN[0]):
        error, share = beaten(scores, claim)
        named = claim.model, claim.group, claim.against
        rows.append((*named, error, claim.interval, f"{share:+.0%}", claim.p_adjusted))
    caption = "ADE in m against the best simple baseline: the model minus the baseline, [interval]"
    head = ("model", "template", "best simple", "its ADE", "difference", "share", "p (Holm)")
    return Table("prediction_claims", caption, head, tuple(rows), specs={"difference": "+.2f", "p (Holm)": ".3g"})


def _paper_lines(scores: ScoreTable) -> Iterator[str]:
    """Lines with the maps, each model's mean ADE against the paper's, and the ranking of the templates."""
    yield maps_next_to_the_papers(scores.episodes)
    for model in scores.models:
        compared = compare_with_paper(scores, model, SHOWN[0])
        if compared is None or compared.mean is None or compared.deviation is None:
            continue
        paper_mean, same = compared.paper_mean, compared.paper_mean_same_templates
        parts = [f"mean ADE {compared.mean:.2f} m, {compared.deviation:+.0%} from the paper's {paper_mean:.2f} m"]
        if same is not None and same != paper_mean:
            parts.append(f"{compared.deviation_same_templates:+.0%} from its {same:.2f} m over the same templates")
        ranking = compared.ranking
        text = f"needs {RANKED_MIN} templates" if ranking is None else f"{ranking.rho:.2f} (p {ranking.p_value:.2g})"
        yield f"{model}: {', '.join(parts)}; Spearman rank correlation over the templates: {text}"


def csv_files(table: ScoreTable, pairs: Sequence[Score]) -> dict[str, str]:
    """CSV files: content by file name, one line per value."""
    episodes: list[Sequence[Any]] = []
    for episode in table.episodes:
        about = (shown_text(episode.name), episode.template, episode.level.name, episode.seed, episode.map_name)
        for model, scores in episode.models.items():
            episodes += [(*about, model, metric.name, *scores[metric.name]) for metric in METRICS]
    horizon: list[Sequence[Any]] = []
    calibration: list[Sequence[Any]] = []
    for model, samples in table.samples.items():
        horizon += [(model, time_s, distance_m) for time_s, distance_m in _over_time(samples).items()]
        for place, (count, probability, best) in enumerate(samples.reliability.T.tolist()):
            if count:
                shares = probability / count, best / count
                calibration.append((model, place / BINS, (place + 1) / BINS, int(count), *shares))
    about_episode = ("episode", "template", "level", "seed", "map", "model", "metric", "value", "samples")
    about_bin = ("model", "from", "to", "hypotheses", "mean_probability", "share_best")
    return {
        "scores.csv": csv_of(table.cells.values()),
        "differences.csv": csv_of(pairs, differences=True),
        "claims.csv": csv_of(table.claims, differences=True),
        "episodes.csv": csv_text(about_episode, episodes),
        "horizon.csv": csv_text(("model", "time_s", "distance_m"), horizon),
        "calibration.csv": csv_text(about_bin, calibration),
    }


def _over_time(samples: SampleTable) -> dict[str, float]:
    """Mean distance of the most probable paths from the truth in metres, by the time in seconds."""
    if not len(samples):
        return {}
    means_m = (samples.distance_sum_m / len(samples)).tolist()
    return {f"{time_s:.1f}": mean_m for time_s, mean_m in zip(future_times_s(), means_m, strict=True)}


def json_report(table: ScoreTable, pairs: Sequence[Score]) -> dict[str, Any]:
    """The whole evaluation as JSON types; null where there is no value."""
    return {
        "task": "prediction",
        "population": table.episodes[0].population.value,
        "noise": table.episodes[0].noise,
        "intervals": {"confidence": CONFIDENCE, "method": "jackknife", "block": "episode", "stratum": "template"},
        "episodes": [_episode(episode) for episode in table.episodes],
        "models": {model: _model(table, model) for model in table.models},
        "warnings": warnings_of(table),
        "rows": [cell.json() for cell in table.cells.values()],
        "differences": [pair.json() for pair in pairs],
        "claims": [
            claim.json() | dict(zip(("against_value", "share"), beaten(table, claim), strict=True))
            for claim in table.claims
        ],
    }


def _episode(episode: EpisodeScores) -> dict[str, Any]:
    models = {}
    for model, scores in episode.models.items():
        paper = {metric.name: paper_row(model, metric.name).get(episode.template) for metric in METRICS}
        models[model] = {
            "samples": len(scores),
            "wanted": scores.population_size,
            **{metric.name: scores[metric.name].value for metric in METRICS},
            "paper": {metric: value for metric, value in paper.items() if value is not None},
        }
    return {
        "name": shown_text(episode.name),
        "template": episode.template,
        "level": episode.level.name,
        "seed": episode.seed,
        "map": episode.map_name,
        "parameters": dict(episode.parameters),
        "models": models,
    }


def _model(table: ScoreTable, model: str) -> dict[str, Any]:
    samples = table.samples[model]
    compared = {metric.name: compare_with_paper(table, model, metric.name) for metric in METRICS}
    return {
        "samples": len(samples),
        "wanted": samples.population_size,
        "coverage": samples.coverage,
        "seen": {split.value: count for split, count in _standings(table).get(model, {}).items()},
        "causal_frames": sum(of.causal_frames.get(model, 0) for of in table.episodes),
        "calibration_error": calibration_error(samples.reliability).value,
        "calibration_interval": calibration_interval(table, model).json(),
        "distance_over_time_m": _over_time(samples),
        "paper": {
            name: {**vars(result), "ranking": None if result.ranking is None else vars(result.ranking)}
            for name, result in compared.items()
            if result is not None
        },
    }


def latex_files(tables: Iterable[Table], about: str) -> dict[str, str]:
    """LaTeX tables: content by file name. They are like the paper's, with its model names, without a float.

    The comment above a table says what was scored (``about``).
    """
    files = {}
    for table in tables:
        if table.key in BY_TEMPLATE:
            rows = tuple((_paper_name(str(model)), *cells) for model, *cells in table.rows)
            files[f"{table.key}.tex"] = replace(table, caption=f"{table.caption}; {about}", rows=rows).latex()
    return files


def _paper_name(model: str) -> str:
    kind, colon, label = model.partition(LABEL)
    return PAPER_NAMES.get(kind, kind) + (f" {label}" if colon else "")


def new_folder(path: Path) -> None:
    """Make the folder of a report; an older report in it is replaced.

    Raises:
        InputError: It cannot be made.
    """
    with writing(path, "folder"):
        path.mkdir(parents=True, exist_ok=True)


def write_report(path: Path, scores: ScoreTable, pairs: Sequence[Score], tables: Sequence[Table], text: str) -> None:
    """Write ``report.txt``, ``scores.json``, CSV files and LaTeX tables.

    Raises:
        InputError: The folder cannot be written.
    """
    about = f"population: {scores.episodes[0].population.value}; {len(scores.episodes)} episodes"
    files = {
        "report.txt": text + "\n",
        "scores.json": json.dumps(json_report(scores, pairs), indent=2, allow_nan=False) + "\n",
        **csv_files(scores, pairs),
        **latex_files(tables, about),
    }
    with writing(path, "folder"):
        for name, content in files.items():
            write_text(path / name, content)
