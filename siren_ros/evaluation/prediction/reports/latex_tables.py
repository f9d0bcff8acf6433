"""Tables like the paper's, in LaTeX with booktabs."""

from collections.abc import Iterator, Sequence
from typing import Final

from siren_ros.evaluation.prediction.reports.groups import GroupKind
from siren_ros.evaluation.prediction.reports.paper_results import PAPER_NAMES, TEMPLATES, paper_row
from siren_ros.evaluation.prediction.reports.score_table import ScoreTable
from siren_ros.evaluation.prediction.reports.text_table import pair

_TABLES: Final = {
    "prediction.tex": (("ade_m", "fde_m"), "ADE/FDE (m) over a 5-s prediction horizon"),
    "rmse.tex": (("rmse_5s_m",), "RMSE (m) at the 5-s horizon"),
    "best_of_six.tex": (("min_ade_6_m", "min_fde_6_m"), "minADE$_6$/minFDE$_6$ (m)"),
    "miss_rate.tex": (("miss_rate_6",), "share of samples whose best of six hypotheses ends more than 2 m away"),
}
_ESCAPED: Final = str.maketrans({"_": r"\_", "%": r"\%", "&": r"\&", "#": r"\#", "$": r"\$"})


def latex_tables(table: ScoreTable, compare_paper: bool) -> dict[str, str]:
    """Content by file name: a table for each file, without a float around it."""
    return {name: _tabular(table, *about, compare_paper) for name, about in _TABLES.items()}


def _tabular(table: ScoreTable, metrics: Sequence[str], what: str, compare_paper: bool) -> str:
    own = [group.name for group in table.of_kind(GroupKind.TEMPLATE)]
    templates = [*TEMPLATES, *(name for name in own if name not in TEMPLATES)] if compare_paper else own
    lines = [
        f"% {what}; population: {table.episodes[0].population.value}; {len(table.episodes)} episodes",
        rf"\begin{{tabular}}{{l{'c' * (len(templates) + 1)}}}",
        r"\toprule",
        _row("Model", [*map(_text, templates), "Mean"]),
        r"\midrule",
    ]
    for model in table.models:
        names = (*templates, GroupKind.ALL.value)
        lines.append(
            _row(_text(_shown(model)), [pair([table.value(model, name, one) for one in metrics]) for name in names])
        )
    papers = list(_paper_lines(templates, metrics)) if compare_paper else []
    if papers:
        lines += [r"\midrule", *papers]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])


def _paper_lines(templates: Sequence[str], metrics: Sequence[str]) -> Iterator[str]:
    """The paper's rows; none where it has no such metric."""
    for model, name in PAPER_NAMES.items():
        rows = [row for metric in metrics if (row := paper_row(model, metric)) is not None]
        if rows:
            cells = [pair([row.by_template.get(template) for row in rows]) for template in templates]
            yield _row(f"{name} (paper)", [*cells, pair([row.mean for row in rows])])


def _shown(model: str) -> str:
    kind, colon, label = model.partition(":")
    return PAPER_NAMES.get(kind, kind) + (f" {label}" if colon else "")


def _text(text: str) -> str:
    return text.translate(_ESCAPED)


def _row(head: str, cells: Sequence[str]) -> str:
    return " & ".join([head, *cells]) + r" \\"
