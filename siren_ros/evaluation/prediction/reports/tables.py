"""The tables of an evaluation, which the terminal, the files and the page of a study show."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from siren_ros.evaluation.prediction.metrics import METRICS, calibration_error
from siren_ros.evaluation.prediction.reports.paper_results import (
    PAPER_NAMES,
    compare_with_paper,
    maps_next_to_the_papers,
    paper_row,
)
from siren_ros.evaluation.prediction.reports.score_table import Difference, GroupKind, ScoreTable
from siren_ros.evaluation.prediction.samples import Population
from siren_ros.evaluation.statistics.rank_correlation import RANKED_MIN
from siren_ros.scenario.interaction_region import REGION_TEXT
from siren_ros.scenario.paper import TEMPLATES
from siren_ros.tables.interval import CONFIDENCE, Bounds
from siren_ros.tables.table import Cell, Row, Table, text_of

SHOWN: Final = ("ade_m", "fde_m")
"""Metrics of the tables by group, as in the paper."""
BAGS_MAX: Final = 20
"""With more bags than this, only the files have a row for each."""
POPULATION_TEXT: Final = {
    Population.REGION: f"population: region (vehicles within {REGION_TEXT} around the EMV for the whole window)",
    Population.ALL: "population: all vehicles on the map",
}
BY_TEMPLATE: Final[Mapping[str, tuple[Sequence[str], str]]] = {
    "prediction": (SHOWN, "ADE/FDE in m by template, [ADE's interval]"),
    "rmse": (("rmse_5s_m",), "RMSE in m at the 5-s horizon by template"),
    "best_of_six": (("min_ade_6_m", "min_fde_6_m"), "minADE6/minFDE6 in m by template, [minADE6's interval]"),
    "miss_rate": (
        ("miss_rate_6",),
        "share of samples whose best of six ends more than 2 m away, by template",
    ),
}
"""Metrics and captions of the tables that are like the paper's, by the keys of the tables."""
_ALL: Final = GroupKind.ALL.value


def prediction_tables(
    scores: ScoreTable, pairs: Sequence[Difference] = (), *, compare_paper: bool = False
) -> tuple[Table, ...]:
    """All tables of an evaluation; those that a terminal leaves out are folded.

    Args:
        scores: The scores.
        pairs: Differences between the models, pair by pair.
        compare_paper: Also show the paper's rows, those of models that were not scored included.
    """
    tables = (
        _bags(scores),
        *(_by_template(scores, key, compare_paper) for key in BY_TEMPLATE),
        _metrics(scores),
        *(_by_group(scores, kind) for kind in (GroupKind.CATEGORY, GroupKind.LEVEL)),
        _differences(pairs),
    )
    return tuple(table for table in tables if table.rows)


def text_report(scores: ScoreTable, tables: Sequence[Table], *, compare_paper: bool = False) -> list[str]:
    """The lines that a terminal shows: what was scored, the tables, and in words how far we are from the paper."""
    lines = [
        POPULATION_TEXT[scores.episodes[0].population],
        f"{len(scores.episodes)} episodes; [{CONFIDENCE:.0%} intervals] over whole episodes",
        "",
        *text_of([table for table in tables if not table.folded]),
    ]
    return [*lines, "", *_paper_lines(scores)] if compare_paper else lines


def no_samples_text(population: Population) -> str:
    """Why an episode has no sample."""
    return {
        Population.REGION: "no vehicle was in the region around the EMV for a whole window of 8 s",
        Population.ALL: "no vehicle was logged for a whole window of 8 s",
    }[population]


def _bags(scores: ScoreTable) -> Table:
    rows: list[Row] = []
    for episode in scores.episodes if 1 < len(scores.episodes) <= BAGS_MAX else ():
        cells = [tuple(model[metric].known for metric in SHOWN) for model in episode.models.values()]
        bag = episode.name.rstrip("/").rpartition("/")[2]
        rows.append((bag, f"{episode.template} {episode.level.name}", episode.samples, *cells))
    return Table("prediction_bags", "ADE/FDE in m by bag", ("bag", "template", "samples", *scores.models), tuple(rows))


def _by_template(scores: ScoreTable, key: str, compare_paper: bool) -> Table:
    metrics, caption = BY_TEMPLATE[key]
    templates = [group.name for group in scores.of_kind(GroupKind.TEMPLATE)]
    if compare_paper:
        templates = [*TEMPLATES, *(name for name in templates if name not in TEMPLATES)]
    rows: list[Row] = []
    for model, samples in scores.samples.items():
        cells = (tuple(scores.value(model, name, metric) for metric in metrics) for name in templates)
        coverage = f"{samples.coverage:.1%}" if len(samples) < samples.population_size else "all"
        rows.append((model, *cells, _mean(scores, model, _ALL, metrics), len(samples), coverage))
    paper: list[Row] = []
    for model, name in PAPER_NAMES.items() if compare_paper else ():
        known = [row for metric in metrics if (row := paper_row(model, metric)) is not None]
        if known:
            values = (tuple(row.by_template.get(template) for row in known) for template in templates)
            paper.append((f"{name} (paper)", *values, tuple(row.mean for row in known), "", ""))
    head = ("model", *templates, "mean", "samples", "coverage")
    return Table(key, caption, head, tuple(rows), reference=tuple(paper), folded=metrics is not SHOWN)


def _metrics(scores: ScoreTable) -> Table:
    rows = tuple(
        (
            model,
            *(scores.value(model, _ALL, metric.name) for metric in METRICS),
            calibration_error(samples.reliability).known,
        )
        for model, samples in scores.samples.items()
    )
    head = ("model", *(metric.label for metric in METRICS), "calibration error")
    return Table("prediction_metrics", "all metrics, mean over the templates", head, rows)


def _by_group(scores: ScoreTable, kind: GroupKind) -> Table:
    rows: list[Row] = []
    for group in scores.of_kind(kind):
        samples = max(scores.cells[model, group.name, SHOWN[0]].samples for model in scores.models)
        if samples:
            rows.append((group.name, samples, *(_mean(scores, model, group.name, SHOWN) for model in scores.models)))
    head = (kind.value, "samples", *scores.models)
    return Table(f"prediction_{kind.value}", f"ADE/FDE in m by {kind.value}, [ADE's interval]", head, tuple(rows))


def _mean(scores: ScoreTable, model: str, group: str, metrics: Sequence[str]) -> Cell:
    """The values of a group, with the interval of the first."""
    bounds = Bounds(scores.cells[model, group, metrics[0]].interval)
    return (*(scores.value(model, group, metric) for metric in metrics), bounds)


def _differences(pairs: Sequence[Difference]) -> Table:
    rows = tuple(
        (f"{each.first} - {each.second}", each.difference, each.adjusted_p_value, each.samples)
        for each in pairs
        if each.metric == SHOWN[0] and each.group == _ALL and each.difference.valid
    )
    return Table(
        "prediction_differences",
        "differences of ADE in m, on the samples that both models have",
        ("models", "difference", "p (Holm)", "common samples"),
        rows,
        specs={"difference": "+.2f", "p (Holm)": ".3g"},
    )


def _paper_lines(scores: ScoreTable) -> Iterator[str]:
    """The maps, and for each model the mean ADE against the paper's, and the ranking of the templates."""
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
