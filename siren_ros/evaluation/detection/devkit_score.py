"""Scores of nuScenes' own code (nuscenes-devkit)."""

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from siren_ros.errors import InputError
from siren_ros.evaluation.detection.average_precision import DISTANCES_M
from siren_ros.evaluation.detection.boxes import ATTRIBUTES, Boxes, FoundBoxes, TruthBoxes
from siren_ros.numerics.arrays import Floats

ERRORS: Final = MappingProxyType(
    {"ATE": "trans_err", "ASE": "scale_err", "AOE": "orient_err", "AVE": "vel_err", "AAE": "attr_err"}
)
"""The devkit's names of the true-positive errors: metres, 1 − IoU, radians, m/s, 1 − share of right attributes."""
_NEEDED: Final = {
    "common.config": ("config_factory",),
    "common.data_classes": ("EvalBoxes",),
    "detection.algo": ("accumulate", "calc_ap", "calc_tp"),
    "detection.data_classes": ("DetectionBox", "DetectionMetrics"),
}
_CLASS: Final = "car"
_CONFIG: Final = "detection_cvpr_2019"


@dataclass(frozen=True)
class DevkitScore:
    """What the devkit says of one class."""

    labels: int
    detections: int
    average_precision: Mapping[float, float]
    """By distance in metres."""
    errors: Mapping[str, float]
    """By the names of ``ERRORS``."""
    mean_average_precision: float
    nds: float
    precision: Floats
    """At the recalls 0, 0.01, … 1, shape ``(4, 101)``: one row for each distance."""


def devkit_score(truth: TruthBoxes, found: FoundBoxes) -> DevkitScore:
    """Scores detections of one class. Both tables hold only what counts: near boxes, labels with LiDAR points.

    Raises:
        InputError: nuscenes-devkit is not installed.
    """
    kit = _devkit()
    labels, detections = _eval_boxes(truth, kit), _eval_boxes(found, kit)
    config = kit["config_factory"](_CONFIG)
    metrics = kit["DetectionMetrics"](_of_one_class(config))
    curves = []
    for distance_m in config.dist_ths:
        data = kit["accumulate"](labels, detections, _CLASS, _centre_distance, distance_m)
        curves.append(data.precision)
        metrics.add_label_ap(_CLASS, distance_m, kit["calc_ap"](data, config.min_recall, config.min_precision))
        if distance_m == config.dist_th_tp:
            for name in ERRORS.values():
                metrics.add_label_tp(_CLASS, name, kit["calc_tp"](data, config.min_recall, name))
    return DevkitScore(
        labels=len(truth),
        detections=len(found),
        average_precision={one: float(metrics.get_label_ap(_CLASS, one)) for one in DISTANCES_M},
        errors={short: float(metrics.get_label_tp(_CLASS, name)) for short, name in ERRORS.items()},
        mean_average_precision=metrics.mean_ap,
        nds=float(metrics.nd_score),
        precision=np.array(curves),
    )


@cache
def _devkit() -> dict[str, Any]:
    try:
        return {
            name: getattr(import_module(f"nuscenes.eval.{module}"), name)
            for module, names in _NEEDED.items()
            for name in names
        }
    except ModuleNotFoundError as error:
        command = "`./env --with detection siren evaluate detection …`"
        raise InputError("task", "detection", f"{command}, which installs nuscenes-devkit") from error


def _of_one_class(config: Any) -> Any:
    """The devkit's configuration averages over ten classes; here all vehicles are one."""
    found = copy(config)
    found.class_range = {_CLASS: config.class_range[_CLASS]}
    found.class_names = found.class_range.keys()
    return found


def _centre_distance(label: Any, detection: Any) -> float:
    """The devkit's ``center_distance`` without making arrays: a tenth of its time."""
    one, two = label.translation, detection.translation
    return math.hypot(one[0] - two[0], one[1] - two[1])


def _eval_boxes(boxes: Boxes, kit: dict[str, Any]) -> Any:
    converted = kit["EvalBoxes"]()
    scores = boxes.score.tolist() if isinstance(boxes, FoundBoxes) else [-1.0] * len(boxes)
    half = boxes.yaw_rad / 2.0
    columns = (
        boxes.frame.tolist(),
        boxes.centre_m.tolist(),
        boxes.size_m[:, [1, 0, 2]].tolist(),
        np.cos(half).tolist(),
        np.sin(half).tolist(),
        boxes.velocity_mps.tolist(),
        scores,
        boxes.attribute.tolist(),
    )
    for frame, centre, size, cos, sin, velocity, score, attribute in zip(*columns, strict=True):
        token = str(frame)
        box = kit["DetectionBox"](
            sample_token=token,
            translation=tuple(centre),
            size=tuple(size),
            rotation=(cos, 0.0, 0.0, sin),
            velocity=tuple(velocity),
            detection_name=_CLASS,
            detection_score=score,
            attribute_name=ATTRIBUTES[attribute],
        )
        converted.boxes[token].append(box)
    return converted
