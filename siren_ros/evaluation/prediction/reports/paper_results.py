"""The paper's results of trajectory prediction, for comparison."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

TEMPLATES: Final = ("S1", "S2", "S3", "S4", "S5", "S6", "S7")


@dataclass(frozen=True)
class PaperRow:
    """One row of a table of the paper."""

    by_template: Mapping[str, float]
    mean: float
    """As printed; the paper computed it before rounding."""


def _row(mean: float, *values: float) -> PaperRow:
    return PaperRow(MappingProxyType(dict(zip(TEMPLATES, values, strict=True))), mean)


PAPER: Final[Mapping[tuple[str, str], PaperRow]] = MappingProxyType(
    {
        ("cv", "ade_m"): _row(1.44, 1.63, 1.17, 0.96, 0.68, 1.95, 2.86, 0.85),
        ("cv", "fde_m"): _row(3.73, 4.30, 3.11, 2.40, 1.65, 5.03, 7.56, 2.08),
        ("cv", "rmse_5s_m"): _row(5.56, 5.61, 5.26, 4.64, 3.56, 6.49, 8.55, 4.82),
        ("idm", "ade_m"): _row(1.86, 2.23, 1.58, 1.18, 1.04, 2.68, 3.29, 1.06),
        ("idm", "fde_m"): _row(4.45, 5.14, 3.75, 2.69, 2.18, 6.49, 8.34, 2.55),
        ("idm", "rmse_5s_m"): _row(6.49, 7.06, 6.40, 5.16, 3.88, 8.01, 9.20, 5.72),
    }
)
"""By model and metric: tables "Trajectory Prediction on SIREN-Bench" (ADE and FDE) and
"NGSIM-style RMSE at the 5-s horizon" (supplement), in metres."""


def paper_value(model: str, metric: str, template: str) -> float | None:
    """The paper's value, None where it has none."""
    row = PAPER.get((model, metric))
    return None if row is None else row.by_template.get(template)
