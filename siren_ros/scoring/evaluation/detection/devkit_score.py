"""Scores by nuScenes' rules: with nuScenes' own code (nuscenes-devkit), and a copy of it that handles subsets fast.

The devkit's code makes all printed values of the templates. The code here repeats its matching and its average
precision for subsets of episodes and labels, which the devkit cannot do in reasonable time.
"""

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Rows
from siren_ros.base.numerics.compiled import X, Y, compiled
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.boxes import ATTRIBUTES, CAR, Boxes, FoundBoxes, TruthBoxes

DISTANCES_M: Final = (0.5, 1.0, 2.0, 4.0)
"""nuScenes' distance thresholds of a match."""


@dataclass(frozen=True)
class Matches:
    """Detections sorted by confidence, each with the label that it matches."""

    order: Rows
    """Rows of the detections in this order, shape ``(N,)``."""
    label: Rows
    """Row of each detection's label, −1 without a match, shape ``(D, N)``: one row per distance threshold."""


def match(truth: TruthBoxes, detected: FoundBoxes) -> Matches:
    """Match detections to labels: in order of confidence, each takes the nearest free label of its frame."""
    # The devkit sorts pairs of (score, number) and reverses the list: of equal scores, the later one comes first.
    order = np.lexsort((np.arange(len(detected)), detected.score))[::-1].astype(np.intp)
    by_frame = np.argsort(truth.frame, kind="stable")
    frames = truth.frame[by_frame]
    frame = detected.frame[order]
    first = np.searchsorted(frames, frame, side="left")
    last = np.searchsorted(frames, frame, side="right")
    places = np.ascontiguousarray(truth.centre_m[by_frame, :2])
    rows = np.full((len(DISTANCES_M), len(order)), -1, dtype=np.intp)
    _match(np.ascontiguousarray(detected.centre_m[order, :2]), first, last, places, np.array(DISTANCES_M), rows)
    taken = rows >= 0
    rows[taken] = by_frame[rows[taken]]
    return Matches(order, rows)


@compiled
def _match(detected: Floats, first: Rows, last: Rows, truth: Floats, limits_m: Floats, rows: Rows) -> None:
    for distance in range(len(limits_m)):
        free = np.ones(len(truth), dtype=np.bool_)
        for number in range(len(detected)):
            nearest, chosen = np.inf, -1
            for row in range(first[number], last[number]):
                if free[row]:
                    away = np.hypot(detected[number, X] - truth[row, X], detected[number, Y] - truth[row, Y])
                    if away < nearest:
                        nearest, chosen = away, row
            if nearest < limits_m[distance]:
                free[chosen] = False
                rows[distance, number] = chosen


_GRID: Final = np.linspace(0.0, 1.0, 101)
"""The devkit's recall values. Some differ from hundredths in the last bit, which decides which recalls are reached."""
_MIN_RECALL_BIN: Final = 10
_MIN_PRECISION: Final = 0.1


def average_precision(hit: Flags, episode: Rows, labels: Floats, weight: Floats) -> Floats:
    """Average precision for each choice of weights, shape ``(R,)``; NaN where the weighted episodes have no label.

    Args:
        hit: Whether each detection has a label, from the most confident on, shape ``(N,)``.
        episode: Episode of each detection, shape ``(N,)``.
        labels: Number of labels of each episode, shape ``(E,)``.
        weight: Times that each episode counts, shape ``(R, E)``.
    """
    result = np.full(len(weight), np.nan)
    _average_precisions(hit, episode, labels, np.ascontiguousarray(weight), _GRID, result)
    return result


@compiled
def _precisions(hit: Flags, counted: Floats, labels: float, grid: Floats, precision: Floats) -> None:
    """Compute the precision at recalls 0, 0.01, … 1 by linear interpolation, like ``numpy.interp`` with ``right=0``."""
    precision[:] = 0.0
    hits, misses = 0.0, 0.0
    recall_before, precision_before = -1.0, 0.0
    place = 0
    for number in range(len(hit)):
        if counted[number] == 0.0:
            continue
        hits += counted[number] * hit[number]
        misses += counted[number] * (1.0 - hit[number])
        recall, value = hits / labels, hits / (hits + misses)
        slope = (value - precision_before) / (recall - recall_before) if recall > recall_before >= 0.0 else 0.0
        start = precision_before if recall_before >= 0.0 else value
        while place < len(grid) and grid[place] < recall:
            precision[place] = slope * (grid[place] - recall_before) + start
            place += 1
        recall_before, precision_before = recall, value
    if place < len(grid) and grid[place] == recall_before:
        precision[place] = precision_before


@compiled
def _average_precisions(
    hit: Flags, episode: Rows, labels: Floats, weight: Floats, grid: Floats, result: Floats
) -> None:
    precision = np.zeros(len(grid))
    for draw in range(len(weight)):
        total = (weight[draw] * labels).sum()
        if total == 0.0:
            continue
        _precisions(hit, weight[draw][episode], total, grid, precision)
        clipped = np.maximum(precision[_MIN_RECALL_BIN + 1 :] - _MIN_PRECISION, 0.0)
        result[draw] = clipped.mean() / (1.0 - _MIN_PRECISION)


ERRORS: Final = MappingProxyType(
    {"ATE": "trans_err", "ASE": "scale_err", "AOE": "orient_err", "AVE": "vel_err", "AAE": "attr_err"}
)
"""True-positive errors with the devkit's names: metres, 1 − IoU, radians, m/s, 1 − share of correct attributes."""
_MODULES: Final = ("common.config", "common.data_classes", "detection.algo", "detection.data_classes")
_CONFIG: Final = "detection_cvpr_2019"


@dataclass(frozen=True)
class DevkitScore:
    """The devkit's scores of one class."""

    labels: int
    detections: int
    average_precision: Mapping[float, float]
    """Average precision by distance threshold in metres."""
    errors: Mapping[str, float]
    """True-positive errors by the names of ``ERRORS``."""
    mean_average_precision: float
    nds: float
    precision: Floats
    """Precision at recalls 0, 0.01, … 1, shape ``(4, 101)``: one row per distance threshold."""


def devkit_score(truth: TruthBoxes, detected: FoundBoxes, name: str = CAR) -> DevkitScore:
    """Score detections of one class.

    Both tables must contain only boxes that count: near ones, labels with LiDAR points.

    The class has nuScenes' name.

    Raises:
        InputError: nuscenes-devkit is not installed.
    """
    kit = _devkit()
    labels, detections = _eval_boxes(truth, kit, name), _eval_boxes(detected, kit, name)
    config = kit["config_factory"](_CONFIG)
    metrics = kit["DetectionMetrics"](_of_one_class(config, name))
    curves = []
    for distance_m in config.dist_ths:
        data = kit["accumulate"](labels, detections, name, _centre_distance, distance_m)
        curves.append(data.precision)
        metrics.add_label_ap(name, distance_m, kit["calc_ap"](data, config.min_recall, config.min_precision))
        if distance_m == config.dist_th_tp:
            for error in ERRORS.values():
                metrics.add_label_tp(name, error, kit["calc_tp"](data, config.min_recall, error))
    return DevkitScore(
        labels=len(truth),
        detections=len(detected),
        average_precision={distance: float(metrics.get_label_ap(name, distance)) for distance in DISTANCES_M},
        errors={short: float(metrics.get_label_tp(name, error)) for short, error in ERRORS.items()},
        mean_average_precision=metrics.mean_ap,
        nds=float(metrics.nd_score),
        precision=np.array(curves),
    )


@cache
def _devkit() -> dict[str, Any]:
    """Functions and classes of the devkit, by name."""
    try:
        modules = [import_module(f"nuscenes.eval.{module}") for module in _MODULES]
        return {name: value for module in modules for name, value in vars(module).items()}
    except ModuleNotFoundError as error:
        command = "`./env --with detection siren evaluate detection …`"
        raise InputError("task", "detection", f"{command}, which installs nuscenes-devkit") from error


def class_range_m(name: str) -> float:
    """NuScenes' range of a class.

    Raises:
        InputError: nuscenes-devkit is not installed.
    """
    return float(_devkit()["config_factory"](_CONFIG).class_range[name])


def _of_one_class(config: Any, name: str) -> Any:
    """The devkit's configuration for a single class; by default it averages over ten."""
    single = copy(config)
    single.class_range = {name: config.class_range[name]}
    single.class_names = single.class_range.keys()
    return single


def _centre_distance(label: Any, detection: Any) -> float:
    """The devkit's ``center_distance`` without temporary arrays, in a tenth of the time."""
    first, second = label.translation, detection.translation
    return math.hypot(first[0] - second[0], first[1] - second[1])


def _eval_boxes(boxes: Boxes, kit: dict[str, Any], name: str) -> Any:
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
            detection_name=name,
            detection_score=score,
            attribute_name=ATTRIBUTES[attribute],
        )
        converted.boxes[token].append(box)
    return converted
