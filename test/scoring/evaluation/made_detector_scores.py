"""Scores of detectors made by hand, for the tests of tables and pictures."""

from collections.abc import Mapping

import numpy as np
from detection_boxes import made_boxes

from siren_ros.base.tables.interval import NOTHING, Interval
from siren_ros.scoring.evaluation.detection.devkit_score import DISTANCES_M, ERRORS, DevkitScore, match
from siren_ros.scoring.evaluation.detection.scoring import DetectorScores, FamilyOrder, GroupScore


def devkit_score_of(mean_ap: float, labels: int = 10) -> DevkitScore:
    """AP rises by 0.1 from distance to distance around the mean; precision falls from 1 to 0 with the recall."""
    by_distance = {one: mean_ap + 0.1 * (place - 1.5) for place, one in enumerate(DISTANCES_M)}
    errors = {name: mean_ap + place for place, name in enumerate(ERRORS)}
    precision = np.array([np.linspace(1.0, 0.1 * place, 101) for place in range(len(DISTANCES_M))])
    return DevkitScore(labels, 2 * labels, by_distance, errors, mean_ap, mean_ap / 2.0, precision)


def detector_scores(name: str, mean_ap: Mapping[str, float], *, bounded: bool = True) -> DetectorScores:
    """A detector with a mean AP for each template; intervals are 0.05 wide to each side, of six episodes."""

    def interval(value: float) -> Interval:
        return Interval(value, value - 0.05, value + 0.05, 6) if bounded else Interval(value, value, value, 1)

    truth, found = made_boxes([5.0, 15.0], [5.0, 40.0], [0.9, 0.5])
    mean = float(np.mean(list(mean_ap.values())))
    return DetectorScores(
        name=name,
        format="nuScenes",
        has_velocity=True,
        frames=dict.fromkeys(mean_ap, 40),
        templates={template: devkit_score_of(value) for template, value in mean_ap.items()},
        template_ap={template: interval(value) for template, value in mean_ap.items()},
        mean_ap=interval(mean),
        families={"clearance": interval(mean), "red light": NOTHING},
        order=FamilyOrder({"clearance < stop sign": 0.75}, 0.25) if bounded else None,
        groups=(
            GroupScore("behaviour", "held", 7, interval(0.25)),
            GroupScore("behaviour", "yielding", 0, NOTHING),
            GroupScore("distance", "0-15 m", 8 if bounded else 9, interval(1.0)),
        ),
        truth=truth,
        found=found,
        matches=match(truth, found),
    )
