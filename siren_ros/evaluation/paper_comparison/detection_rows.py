"""3-D detection: mAP, NDS and errors of the paper's detectors, and the order of the behaviour families."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from siren_ros.evaluation.detection.metrics.devkit_score import ERRORS
from siren_ros.evaluation.detection.metrics.family_order import FAMILIES
from siren_ros.evaluation.detection.reports.paper_results import MEAN, PAPER, TEMPLATES
from siren_ros.evaluation.paper_comparison.compared import Compared
from siren_ros.evaluation.paper_comparison.stored_scores import interval_in
from siren_ros.evaluation.statistics.interval import NOTHING, Interval

FAMILY: Final = "mAP of a family; paper: mean of its four"
ORDER: Final = "order of the families by mAP as in the paper"


def detection_rows(content: Mapping[str, Any] | None) -> Iterator[Compared]:
    """All rows, those without a value of ours included.

    Args:
        content: ``scores.json`` of ``siren evaluate detection``; None where it was not run.
    """
    ours = {name.lower(): one for name, one in (content or {}).items()}
    for key, paper in PAPER.items():
        one = ours.get(key)
        for template in (*TEMPLATES, MEAN):
            mean_ap, nds = paper.ap_and_nds[template]
            yield Compared("mAP", paper.name, template, mean_ap, _ap(one, template), digits=3)
            yield Compared("NDS", paper.name, template, nds, _nds(one, template), digits=3)
        for name, value in paper.errors.items():
            yield Compared(f"error {name}", paper.name, MEAN, value, _error(one, name), digits=3)
    for name, one in (content or {}).items():
        yield from _families(name, one)


def _families(detector: str, one: Mapping[str, Any]) -> Iterator[Compared]:
    """A detector of any name against the mean of the paper's four."""
    for family, templates in FAMILIES.items():
        values = [paper.ap_and_nds[template][0] for paper in PAPER.values() for template in templates]
        found = interval_in(one["families"].get(family))
        yield Compared(FAMILY, detector, family, float(np.mean(values)), found, digits=3)
    share = one.get("order_of_families_share")
    if share is not None:
        episodes = interval_in(one["mean"]["mAP"]).blocks
        ours = Interval(share, share, share, episodes, scatter_known=False)
        yield Compared(ORDER, detector, "share of the draws", 1.0, ours, relative=False)


def _ap(one: Mapping[str, Any] | None, template: str) -> Interval:
    if one is None:
        return NOTHING
    return interval_in(one["mean"]["mAP"] if template == MEAN else one["templates"].get(template, {}).get("mAP"))


def _nds(one: Mapping[str, Any] | None, template: str) -> Interval:
    found = None if one is None else one["mean"] if template == MEAN else one["templates"].get(template)
    return _single(None if found is None else found["NDS"])


def _error(one: Mapping[str, Any] | None, name: str) -> Interval:
    if one is None or name not in ERRORS:
        return NOTHING
    return _single(float(np.mean([of_template["errors"][name] for of_template in one["templates"].values()])))


def _single(value: float | None) -> Interval:
    return NOTHING if value is None else Interval(value, value, value, 1)
