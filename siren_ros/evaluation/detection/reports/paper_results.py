"""The paper's results of 3-D detection, for comparison."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from siren_ros.evaluation.detection.metrics.devkit_score import ERRORS

TEMPLATES: Final = ("S1", "S2", "S3", "S4", "S5", "S6", "S7")
MEAN: Final = "mean"


@dataclass(frozen=True)
class PaperDetector:
    """One row of each of the paper's two tables."""

    name: str
    ap_and_nds: Mapping[str, tuple[float, float]]
    """mAP and NDS by template, and their means as printed."""
    errors: Mapping[str, float]
    """True-positive errors, mean over the templates."""


def _row(name: str, pairs: str, errors: str) -> PaperDetector:
    cells = [tuple(map(float, pair.split("/"))) for pair in pairs.split()]
    both = {column: (cell[0], cell[1]) for column, cell in zip((*TEMPLATES, MEAN), cells, strict=True)}
    values = dict(zip(ERRORS, map(float, errors.split()), strict=True))
    return PaperDetector(name, MappingProxyType(both), MappingProxyType(values))


PAPER: Final[Mapping[str, PaperDetector]] = MappingProxyType(
    {
        "pointpillars": _row(
            "PointPillars",
            ".398/.407 .434/.436 .583/.525 .589/.549 .451/.456 .530/.540 .569/.528 .508/.492",
            "0.553 0.215 0.396 3.165 0.459",
        ),
        "second": _row(
            "SECOND",
            ".420/.420 .388/.438 .631/.563 .633/.574 .461/.480 .523/.540 .590/.556 .521/.510",
            "0.565 0.214 0.207 3.196 0.514",
        ),
        "voxelnext": _row(
            "VoxelNeXt",
            ".438/.393 .413/.434 .641/.571 .616/.558 .468/.454 .568/.540 .578/.543 .532/.499",
            "0.562 0.216 0.313 3.404 0.576",
        ),
        "transfusion-l": _row(
            "TransFusion-L",
            ".424/.411 .423/.456 .648/.566 .618/.565 .491/.481 .562/.555 .610/.571 .539/.515",
            "0.561 0.196 0.330 3.223 0.461",
        ),
    }
)
"""By lower-case name: tables "3D object detection" and "True-positive error metrics" (supplement)."""


def paper_rows(name: str) -> tuple[PaperDetector, ...]:
    """The paper's row for a detector of that name; all four for a detector that the paper does not have."""
    key = name.lower().replace("_", "-").replace("transfusion-l", "transfusion").replace("transfusion", "transfusion-l")
    return (PAPER[key],) if key in PAPER else tuple(PAPER.values())
