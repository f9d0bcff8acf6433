"""The paper's results of trajectory prediction, and their comparison with our scores."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.scoring.evaluation.prediction.predictors import LABEL
from siren_ros.scoring.evaluation.prediction.reports.score_table import GroupKind, ScoreTable
from siren_ros.scoring.evaluation.prediction.scoring import EpisodeScores
from siren_ros.scoring.evaluation.scores import ALL
from siren_ros.scoring.evaluation.statistics import RankCorrelation, rank_correlation
from siren_ros.simulation.scenario.paper import TEMPLATES

PaperRow = Mapping[str, float]
"""One row of a table in the paper: values by template, and the mean as printed, ``all``, computed before rounding."""

PAPER_MAP: Final = "Town10HD_Opt"
"""Map of all episodes of the paper ("Benchmark Construction")."""
PAPER_SAMPLES: Final[Mapping[str, int]] = dict(zip(TEMPLATES, (914, 1371, 825, 1247, 605, 340, 1760), strict=True))
"""Number of scored samples in each template's one base episode (experimental setup, "Trajectory prediction"): 7,062 in
all."""
PAPER_NAMES: Final[Mapping[str, str]] = {
    "cv": "CV",
    "idm": "IDM",
    "csp": "CSP",
    "stdan": "STDAN",
    "bat": "BAT",
    "emp-m": "EMP-M",
    "emp-d": "EMP-D",
    "demo": "DeMo",
    "demo+realmotion": "DeMo+RealMotion",
}
"""Our names of the paper's nine models with the paper's names, in the order of its table."""

_PAIRS: Final = {
    ("ade_m", "fde_m"): """
        cv              1.63/4.30  1.17/3.11  0.96/2.40  0.68/1.65  1.95/5.03  2.86/7.56  0.85/2.08  1.44/3.73
        idm             2.23/5.14  1.58/3.75  1.18/2.69  1.04/2.18  2.68/6.49  3.29/8.34  1.06/2.55  1.86/4.45
        csp             2.63/6.12  3.57/7.79  2.92/6.65  2.54/5.83  3.25/7.10  4.63/9.69  1.82/4.02  3.05/6.74
        stdan           3.99/8.12  6.02/12.13 4.20/9.14  3.11/6.81  4.58/9.94  7.87/15.41 2.38/5.93  4.59/9.64
        bat             9.14/17.35 9.55/16.14 8.17/15.75 6.06/10.52 4.80/7.85  8.40/13.16 3.42/5.06  7.08/12.26
        emp-m           1.79/4.73  1.55/4.38  2.71/8.24  1.88/5.92  3.47/9.44  3.24/8.86  2.05/6.50  2.38/6.87
        emp-d           1.67/4.44  1.32/3.57  2.41/7.39  1.39/4.60  2.13/6.21  3.50/9.68  1.63/5.83  2.01/5.96
        demo            1.65/4.47  1.58/4.60  2.26/7.00  1.26/4.08  2.72/7.80  3.57/9.96  1.05/4.03  2.01/5.99
        demo+realmotion 1.62/4.29  1.43/4.22  2.35/6.95  1.64/4.83  2.41/7.03  2.50/6.85  1.23/3.77  1.88/5.42
    """,
    ("rmse_5s_m",): """
        cv               5.61  5.26  4.64  3.56  6.49  8.55  4.82  5.56
        idm              7.06  6.40  5.16  3.88  8.01  9.20  5.72  6.49
        csp              7.52 10.07  8.67  7.27  8.76 11.16  5.84  8.47
        stdan           10.38 16.71 11.24  9.47 12.39 21.15 10.38 13.10
        bat             18.35 17.76 20.20 14.35  9.70 14.55  8.31 14.75
        emp-m            6.39  6.34 10.54  9.24 12.19 11.05  9.14  9.27
        emp-d            5.52  4.81  9.56  7.05  7.82 12.11  7.51  7.77
        demo             5.35  5.62  9.22  6.66  9.80 12.31  5.89  7.84
        demo+realmotion  5.97  6.01 10.86 10.10  8.95  8.37  8.16  8.34
    """,
    ("min_ade_6_m", "min_fde_6_m"): """
        emp-m           0.58/1.30 0.52/1.26 0.89/2.72 0.66/2.20 1.06/2.71 0.93/2.34 0.58/2.25 0.74/2.11
        emp-d           0.58/1.21 0.48/1.07 0.81/2.44 0.52/1.58 0.81/1.96 0.80/1.96 0.37/1.30 0.62/1.65
        demo            0.53/1.12 0.47/1.24 0.67/2.18 0.39/1.34 0.90/2.31 0.99/2.58 0.32/1.60 0.61/1.77
        demo+realmotion 0.58/1.28 0.41/1.05 0.93/2.72 0.77/2.34 0.82/2.00 0.80/1.95 0.50/1.59 0.69/1.85
    """,
}
"""The paper's numbers in metres, from the tables "Trajectory Prediction on SIREN-Bench", "NGSIM-style RMSE at the 5-s
horizon" and "Multimodal best-of-six" (supplement): by metric one line per model with S1 to S7 and the mean."""


def _read() -> dict[tuple[str, str], PaperRow]:
    rows: dict[tuple[str, str], PaperRow] = {}
    for metrics, text in _PAIRS.items():
        for line in text.strip().splitlines():
            model, *cells = line.split()
            for position, metric in enumerate(metrics):
                values = (float(cell.split("/")[position]) for cell in cells)
                rows[model, metric] = dict(zip((*TEMPLATES, ALL), values, strict=True))
    # The remaining models have one hypothesis: their minima equal ADE and FDE, as the paper says.
    for model in PAPER_NAMES:
        rows.setdefault((model, "min_ade_6_m"), rows[model, "ade_m"])
        rows.setdefault((model, "min_fde_6_m"), rows[model, "fde_m"])
    return rows


PAPER: Final[Mapping[tuple[str, str], PaperRow]] = _read()
"""The paper's rows by model and metric."""


def paper_row(model: str, metric: str) -> PaperRow:
    """The paper's row of a model, with or without a label (``csp:mine``); empty if it has none."""
    return PAPER.get((model.partition(LABEL)[0], metric), {})


def maps_next_to_the_papers(episodes: Iterable[EpisodeScores]) -> str:
    """Text with the maps of some episodes beside the paper's, because other maps give other errors."""
    counts = Counter(episode.map_name for episode in episodes)
    if list(counts) == [PAPER_MAP]:
        return f"map: {PAPER_MAP}, the paper's"
    named = ", ".join(f"{name} ({count})" for name, count in sorted(counts.items()))
    return f"{'map' if len(counts) == 1 else 'maps, pooled'}: {named}; the paper's is {PAPER_MAP}"


@dataclass(frozen=True)
class PaperComparison:
    """Comparison of one metric of one model with the paper; None where a value is missing."""

    mean: float | None
    """Our mean over all our templates."""
    paper_mean: float
    """The paper's mean over all its templates."""
    paper_mean_same_templates: float | None
    """The paper's mean over the templates that were scored here."""
    deviation: float | None
    """Relative deviation of our mean from the paper's: +0.4 is 40 % above."""
    deviation_same_templates: float | None
    """Relative deviation over the common templates only."""
    ranking: RankCorrelation | None
    """Rank correlation over the common templates, if there are at least three."""


def compare_with_paper(table: ScoreTable, model: str, metric: str) -> PaperComparison | None:
    """Compare one metric of one model with the paper; None if the paper has no such row."""
    row = paper_row(model, metric)
    if not row:
        return None
    ours = {group.name: table.value(model, group.name, metric) for group in table.of_kind(GroupKind.TEMPLATE)}
    common = {name: value for name, value in ours.items() if value is not None and name in row}
    papers = [row[name] for name in common]
    mean = table.value(model, GroupKind.ALL, metric)
    same = row[ALL] if len(papers) == len(TEMPLATES) else float(np.mean(papers)) if papers else None
    return PaperComparison(
        mean=mean,
        paper_mean=row[ALL],
        paper_mean_same_templates=same,
        deviation=None if mean is None else mean / row[ALL] - 1.0,
        deviation_same_templates=None if same is None else float(np.mean(list(common.values()))) / same - 1.0,
        ranking=rank_correlation(list(common.values()), papers),
    )
