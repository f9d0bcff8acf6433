"""The report that a terminal shows."""

from collections.abc import Iterator, Sequence
from typing import Final

from siren_ros.evaluation.aligned_text import aligned
from siren_ros.evaluation.prediction.metrics import METRICS, calibration_error
from siren_ros.evaluation.prediction.reports.paper_results import (
    PAPER_NAMES,
    compare_with_paper,
    maps_next_to_the_papers,
    paper_row,
)
from siren_ros.evaluation.prediction.reports.score_table import Difference, Group, GroupKind, ScoreTable
from siren_ros.evaluation.prediction.samples import Population
from siren_ros.evaluation.statistics.interval import CONFIDENCE, Interval, lack_of_bounds
from siren_ros.evaluation.statistics.rank_correlation import RANKED_MIN
from siren_ros.scenario.interaction_region import REGION_TEXT
from siren_ros.scenario.paper import TEMPLATES

NONE: Final = "-"
"""Where there is no value."""


def number(value: float | None, digits: int = 2) -> str:
    """A value, or a dash."""
    return NONE if value is None else f"{value:.{digits}f}"


def pair(values: Sequence[float | None]) -> str:
    """``1.44/3.73``."""
    return "/".join(number(value) for value in values)


def bounds(interval: Interval) -> str:
    """``[1.20, 1.66]``, a dash where episodes are too few."""
    if not interval.valid:
        return NONE
    return f"[{interval.low:.2f}, {interval.high:.2f}]" if interval.bounded else f"[{NONE}]"


SHOWN: Final = ("ade_m", "fde_m")
"""Metrics of the tables by group, as in the paper."""
BAGS_MAX: Final = 20
"""With more bags than this, only the files have a row for each."""
POPULATION_TEXT: Final = {
    Population.REGION: f"population: region (vehicles within {REGION_TEXT} around the EMV for the whole window)",
    Population.ALL: "population: all vehicles on the map",
}
_ALL: Final = GroupKind.ALL.value


def text_report(table: ScoreTable, found: Sequence[Difference], compare_paper: bool) -> list[str]:
    """Lines of the report.

    Args:
        table: The scores.
        found: Differences between the models.
        compare_paper: Also show the paper's rows, those of models that were not scored included.
    """
    sections = [
        [
            POPULATION_TEXT[table.episodes[0].population],
            f"{len(table.episodes)} episodes; [{CONFIDENCE:.0%} intervals] over whole episodes",
        ],
        _bags(table) if 1 < len(table.episodes) <= BAGS_MAX else [],
        ["ADE/FDE in m by template", *_main_table(table, compare_paper)],
        ["all metrics, mean over the templates", *_metrics(table)],
        *(_by_group(table, kind) for kind in (GroupKind.CATEGORY, GroupKind.LEVEL)),
        _differences(found),
        list(_paper_lines(table)) if compare_paper else [],
    ]
    lines = [line for section in sections if section for line in (*section, "")]
    every = [*(cell.interval for cell in table.cells.values()), *(one.difference for one in found)]
    return [*lines, *lack_of_bounds(every)] if lack_of_bounds(every) else lines[:-1]


def _bags(table: ScoreTable) -> list[str]:
    rows = [["bag", "template", "samples", *table.models]]
    for episode in table.episodes:
        head = [episode.name.rstrip("/").rpartition("/")[2], f"{episode.template} {episode.level.name}"]
        values = []
        for scores in episode.models.values():
            metrics = [scores[metric] for metric in SHOWN]
            values.append(pair([one.value if one.valid else None for one in metrics]))
        rows.append([*head, str(episode.samples), *values])
    return aligned(rows)


def _main_table(table: ScoreTable, compare_paper: bool) -> list[str]:
    own = [group.name for group in table.of_kind(GroupKind.TEMPLATE)]
    templates = [*TEMPLATES, *(name for name in own if name not in TEMPLATES)] if compare_paper else own
    rows = [["model", *templates, "mean", "ADE's interval", "samples", "coverage"]]
    for model in table.models:
        samples = table.samples[model]
        rows.append(
            [
                model,
                *(pair([table.value(model, name, metric) for metric in SHOWN]) for name in (*templates, _ALL)),
                bounds(table.cells[model, _ALL, SHOWN[0]].interval),
                str(len(samples)),
                f"{samples.coverage:.1%}" if len(samples) < samples.wanted else "all",
            ]
        )
        if compare_paper and paper_row(model, SHOWN[0]):
            rows.append(_paper_cells("  paper", model, templates))
    if compare_paper:
        scored = {model.partition(":")[0] for model in table.models}
        rows += [
            _paper_cells(f"{name} (paper)", key, templates) for key, name in PAPER_NAMES.items() if key not in scored
        ]
    return aligned(rows)


def _paper_cells(head: str, model: str, templates: Sequence[str]) -> list[str]:
    found = [paper_row(model, metric) for metric in SHOWN]
    cells = [pair([row.by_template.get(name) if row else None for row in found]) for name in templates]
    return [head, *cells, pair([row.mean if row else None for row in found]), "", "", ""]


def _metrics(table: ScoreTable) -> list[str]:
    rows = [["model", *(metric.label for metric in METRICS), "calibration error"]]
    for model in table.models:
        error = calibration_error(table.samples[model].reliability)
        values = [table.value(model, _ALL, metric.name) for metric in METRICS]
        rows.append([model, *map(number, values), number(error.value if error.valid else None)])
    return aligned(rows)


def _by_group(table: ScoreTable, kind: GroupKind) -> list[str]:
    rows = [[kind.value, "samples", *table.models]]
    for group in table.of_kind(kind):
        samples = _samples(table, group)
        if samples:
            values = [
                f"{pair([table.value(model, group.name, metric) for metric in SHOWN])} "
                f"{bounds(table.cells[model, group.name, SHOWN[0]].interval)}"
                for model in table.models
            ]
            rows.append([group.name, str(samples), *values])
    return [f"ADE/FDE in m by {kind.value}, [ADE's interval]", *aligned(rows)] if len(rows) > 1 else []


def _samples(table: ScoreTable, group: Group) -> int:
    return max(table.cells[model, group.name, SHOWN[0]].samples for model in table.models)


def _differences(found: Sequence[Difference]) -> list[str]:
    shown = [one for one in found if one.metric == SHOWN[0] and one.group == _ALL and one.difference.valid]
    if not shown:
        return []
    rows = [["models", "difference", "interval", "p (Holm)", "common samples"]]
    rows += [
        [
            f"{one.first} - {one.second}",
            f"{one.difference.value:+.2f}",
            bounds(one.difference),
            f"{one.adjusted_p_value:.3g}",
            str(one.samples),
        ]
        for one in shown
    ]
    return ["differences of ADE in m, on the samples that both models have", *aligned(rows)]


def _paper_lines(table: ScoreTable) -> Iterator[str]:
    """The maps, and for each model the mean ADE against the paper's, and the ranking of the templates."""
    yield maps_next_to_the_papers(table.episodes)
    for model in table.models:
        found = compare_with_paper(table, model, SHOWN[0])
        if found is None or found.mean is None or found.deviation is None:
            continue
        parts = [f"mean ADE {found.mean:.2f} m, {found.deviation:+.0%} from the paper's {found.paper_mean:.2f} m"]
        same = found.paper_mean_same_templates
        if same is not None and same != found.paper_mean:
            parts.append(f"{found.deviation_same_templates:+.0%} from its {same:.2f} m over the same templates")
        ranking = found.ranking
        text = f"needs {RANKED_MIN} templates" if ranking is None else f"{ranking.rho:.2f} (p {ranking.p_value:.2g})"
        yield f"{model}: {', '.join(parts)}; Spearman rank correlation over the templates: {text}"


def no_samples_text(population: Population) -> str:
    """Why an episode has no sample."""
    return {
        Population.REGION: "no vehicle was in the region around the EMV for a whole window of 8 s",
        Population.ALL: "no vehicle was logged for a whole window of 8 s",
    }[population]
