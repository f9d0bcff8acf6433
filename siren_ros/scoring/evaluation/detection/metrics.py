"""Metrics of detection and tracking: AP, errors, NDS, AMOTA and AMOTP by nuScenes' own code (devkit), and HOTA.

The devkit's code makes all printed values of the templates. The code here repeats its matching and its average
precision for subsets of episodes and labels, which the devkit cannot do in reasonable time. The devkit scores tracks of
one class at a time.

HOTA says how well tracks find vehicles and keep their ids, averaged over thresholds of a match. Source: J. Luiten et
al., "HOTA: A Higher Order Metric for Evaluating Multi-Object Tracking", IJCV 129 (2021) 548. The similarity of two
places is that of TrackEval for points: 1 at the same place, 0 from 2 m on, which is also nuScenes' limit for tracks.
``test_tracking.py`` compares with TrackEval's own code, which cannot be a dependency: on Python 3.12 it needs numpy 2,
and nuscenes-devkit needs numpy 1.
"""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from itertools import pairwise
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

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
_DETECTION_MODULES: Final = ("common.config", "common.data_classes", "detection.algo", "detection.data_classes")
_DETECTION_CONFIG: Final = "detection_cvpr_2019"


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
    config = kit["config_factory"](_DETECTION_CONFIG)
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
        modules = [import_module(f"nuscenes.eval.{module}") for module in _DETECTION_MODULES]
        return {name: value for module in modules for name, value in vars(module).items()}
    except ModuleNotFoundError as error:
        command = "`./env --with detection siren evaluate detection …`"
        raise InputError("task", "detection", f"{command}, which installs nuscenes-devkit") from error


def class_range_m(name: str) -> float:
    """NuScenes' range of a class.

    Raises:
        InputError: nuscenes-devkit is not installed.
    """
    return float(_devkit()["config_factory"](_DETECTION_CONFIG).class_range[name])


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


ZERO_M: Final = 2.0
ALPHAS: Final = np.arange(0.05, 0.99, 0.05)
"""Similarity thresholds of a match."""
_TINY: Final = float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class TrackTable:
    """Boxes of tracks, one row each, sorted by frame. Arrays have shape ``(N,)``."""

    episode: Rows
    frame: Rows
    """Number of the frame, counted over all episodes."""
    centre_m: Floats
    """Centre on the ground, shape ``(N, 2)``."""
    track: Rows
    """Number of the track, unique over all episodes."""
    score: Floats
    """Confidence of the track, equal in all of its rows; -1 for labels, as in nuScenes."""

    def at(self, rows: Rows | Flags) -> "TrackTable":
        """Select some of the rows."""
        return TrackTable(self.episode[rows], self.frame[rows], self.centre_m[rows], self.track[rows], self.score[rows])


class Hota(NamedTuple):
    """HOTA and its parts, as means over ``ALPHAS``; NaN without labels and tracks."""

    hota: float
    detection: float
    """DetA: found vehicles divided by all vehicles and false alarms."""
    association: float
    """AssA: common share of the two tracks of a match, as a mean."""


@dataclass(frozen=True)
class HotaSums:
    """Sums per episode from which HOTA follows, shape ``(E, 19)``; columns as ``ALPHAS``."""

    hits: Floats
    misses: Floats
    alarms: Floats
    common: Floats
    """Sum over all hits of the common share of their two tracks."""

    def of(self, weight: Floats) -> Hota:
        """HOTA of the episodes with weights, shape ``(E,)``."""
        hits, misses, alarms, common = (weight @ part for part in (self.hits, self.misses, self.alarms, self.common))
        every = hits + misses + alarms
        if not every.any():
            return Hota(np.nan, np.nan, np.nan)
        detection, association = hits / np.maximum(every, 1.0), common / np.maximum(hits, 1.0)
        shares = np.sqrt(detection * association), detection, association
        return Hota(*(float(share.mean()) for share in shares))


def hota_sums(labels: TrackTable, found: TrackTable, episodes: int) -> HotaSums:
    """Compute the sums for HOTA per episode; labels and tracks have the same frames."""
    parts = [_of_episode(labels.at(labels.episode == one), found.at(found.episode == one)) for one in range(episodes)]
    return HotaSums(*(np.array(column).reshape(-1, len(ALPHAS)) for column in zip(*parts, strict=True)))


def _of_episode(labels: TrackTable, found: TrackTable) -> tuple[Floats, Floats, Floats, Floats]:
    (truths, truth), (tracks, track) = (np.unique(table.track, return_inverse=True) for table in (labels, found))
    frames = np.union1d(labels.frame, found.frame)
    edges = np.r_[frames, np.inf]
    here = [
        [slice(*np.searchsorted(table.frame, pair).tolist()) for pair in pairwise(edges)] for table in (labels, found)
    ]
    alike = [_similarity(labels.centre_m[one], found.centre_m[other]) for one, other in zip(*here, strict=True)]
    overlap = np.zeros((len(truths), len(tracks)))
    for one, other, values in zip(*here, alike, strict=True):
        whole = values.sum(axis=0)[None] + values.sum(axis=1)[:, None] - values
        overlap[np.ix_(truth[one], track[other])] += np.where(whole > _TINY, values / np.maximum(whole, _TINY), 0.0)
    boxes = np.bincount(truth, minlength=len(truths))[:, None] + np.bincount(track, minlength=len(tracks))[None]
    alignment = overlap / np.maximum(boxes - overlap, _TINY)
    matches = np.zeros((len(ALPHAS), len(truths), len(tracks)))
    for one, other, values in zip(*here, alike, strict=True):
        row, column = linear_sum_assignment(-alignment[np.ix_(truth[one], track[other])] * values)
        for number, alpha in enumerate(ALPHAS):
            near = values[row, column] >= alpha - _TINY
            matches[number, truth[one][row[near]], track[other][column[near]]] += 1.0
    hits = matches.sum(axis=(1, 2))
    common = (matches * matches / np.maximum(boxes - matches, 1.0)).sum(axis=(1, 2))
    return hits, len(truth) - hits, len(track) - hits, common


def _similarity(first_m: Floats, second_m: Floats) -> Floats:
    way = first_m[:, None] - second_m[None]
    return np.maximum(0.0, 1.0 - np.hypot(way[..., 0], way[..., 1]) / ZERO_M)


_PARTS: Final = ("constants", "algo", "data_classes", "loaders", "mot")
_TRACKING_MODULES: Final = (
    "motmetrics",
    "nuscenes.eval.common.config",
    *(f"nuscenes.eval.tracking.{name}" for name in _PARTS),
)
_TRACKING_CONFIG: Final = "tracking_nips_2019"
_COUNTED: Final = ("MATCH", "SWITCH", "FP", "MISS")


@dataclass(frozen=True)
class DevkitTracking:
    """The devkit's scores of one class, with what intervals need."""

    labels: int
    """Number of labelled tracks."""
    amota: float
    amotp_m: float
    mota: float
    switches: float
    """Number of changed track ids at the confidence with the best MOTA, like ``mota``."""
    confidence: float
    """Confidence threshold with the best MOTA; NaN if nothing is found."""
    left_out: Mapping[str, Floats]
    """AMOTA (``amota``) and AMOTP (``amotp_m``) without each episode, at the same confidence thresholds, ``(E,)``."""


def devkit_tracking(labels: TrackTable, found: TrackTable, frames: Sequence[Sequence[int]]) -> DevkitTracking:
    """Score the tracks of one class like ``TrackingEval`` of nuscenes-devkit.

    Args:
        labels: Tracks of labels that count, at least one row.
        found: Tracks of a detector.
        frames: The keyframes of each episode.

    Raises:
        InputError: nuscenes-devkit or motmetrics is not installed.
    """
    kit = _kit()
    config = kit["config_factory"](_TRACKING_CONFIG)
    scenes = _scenes(labels, frames, kit, found=False), _scenes(found, frames, kit, found=True)
    worst = config.metric_worst
    evaluation = kit["by_episode"](
        *scenes, CAR, config.dist_fcn_callable, config.dist_th_tp, config.min_recall,
        config.num_thresholds, worst, verbose=False,
    )  # fmt: skip
    data = evaluation.accumulate()
    means = {}
    for name, of_threshold in kit["AVG_METRIC_MAP"].items():
        values = np.array(data.get_metric(of_threshold), dtype=np.float64)
        means[name] = float(np.where(np.isnan(values), worst[name], values).mean())
    best = 0 if np.isnan(data.mota).all() else int(np.nanargmax(data.mota))
    return DevkitTracking(
        labels=len(np.unique(labels.track)),
        amota=means["amota"],
        amotp_m=means["amotp"],
        mota=float(data.mota[best]),
        switches=float(data.ids[best]),
        confidence=float(data.confidence[best]),
        left_out=_left_out(evaluation.counts, data.confidence.tolist(), len(frames), worst),
    )


def _left_out(
    counts: Mapping[float, Floats], confidence: Sequence[float], episodes: int, worst: Mapping[str, float]
) -> dict[str, Floats]:
    """Scores without each episode.

    They follow from the episodes' counts by confidence, shape ``(E, 5)``: ``_COUNTED`` and the sum of distances.
    """
    columns: dict[str, list[Floats]] = {"amota": [], "amotp": []}
    for threshold in confidence:
        if threshold not in counts:
            columns["amota"].append(np.full(episodes, worst["amota"]))
            columns["amotp"].append(np.full(episodes, worst["amotp"]))
            continue
        others = counts[threshold].sum(axis=0) - counts[threshold]
        match, switch, alarm, miss, distance_m = others.T
        every = match + switch + miss
        with np.errstate(divide="ignore", invalid="ignore"):
            motar = 1.0 - (miss + switch + alarm - (every - match)) / match
            motp = distance_m / (match + switch)
        columns["amota"].append(np.where(np.isfinite(motar), np.maximum(motar, 0.0), worst["amota"]))
        columns["amotp"].append(np.where(np.isfinite(motp), motp, worst["amotp"]))
    means = {name: np.mean(values, axis=0) for name, values in columns.items()}
    return {"amota": means["amota"], "amotp_m": means["amotp"]}


@cache
def _kit() -> dict[str, Any]:
    """Functions and classes of the devkit by name, with an evaluation that keeps the counts of each episode."""
    try:
        modules = [import_module(name) for name in _TRACKING_MODULES]
    except ModuleNotFoundError as error:
        command = "`./env --with detection siren evaluate detection …`"
        raise InputError("task", "tracking", f"{command}, which installs nuscenes-devkit and motmetrics") from error
    kit = {name: value for module in modules for name, value in vars(module).items()}
    return {**kit, "by_episode": _by_episode(kit["TrackingEvaluation"], kit["MOTAccumulatorCustom"])}


def _by_episode(evaluation: Any, accumulator: Any) -> Any:
    """A subclass of the devkit's evaluation that scores episode by episode and keeps the counts of each."""

    class ByEpisode(evaluation):  # type: ignore[misc]
        tracks_gt: dict[str, Any]

        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            self.counts: dict[float, Floats] = {}

        def accumulate_threshold(self, threshold: float | None = None) -> tuple[Any, list[float]]:
            every, parts, scores, counts = self.tracks_gt, [], [], []
            for scene, tracks in every.items():
                self.tracks_gt = {scene: tracks}
                events, of_scene = super().accumulate_threshold(threshold)
                types = events["Type"].value_counts()
                paired = events["Type"].isin(["MATCH", "SWITCH"])
                counts.append([*(types.get(name, 0) for name in _COUNTED), events["D"].where(paired).sum()])
                parts.append(events)
                scores += of_scene
            self.tracks_gt = every
            if threshold is not None:
                self.counts[threshold] = np.array(counts, dtype=np.float64)
            return accumulator.merge_event_dataframes(parts), scores

    return ByEpisode


def _scenes(table: TrackTable, frames: Sequence[Sequence[int]], kit: dict[str, Any], *, found: bool) -> Any:
    """Tracks in the form that the devkit's loaders make: mean confidences, missing boxes of a track interpolated."""
    scenes: dict[str, Any] = {}
    for episode, numbers in enumerate(frames):
        scenes[str(episode)] = defaultdict(list, {number: [] for number in numbers})
    columns = table.episode.tolist(), table.frame.tolist(), table.centre_m.tolist(), table.track.tolist()
    for episode, frame, centre, track, score in zip(*columns, table.score.tolist(), strict=True):
        box = kit["TrackingBox"](
            sample_token=str(frame),
            translation=(*centre, 0.0),
            size=(1.0, 1.0, 1.0),
            rotation=(1.0, 0.0, 0.0, 0.0),
            tracking_id=str(track),
            tracking_name=CAR,
            tracking_score=score if found else -1.0,
        )
        scenes[str(episode)][frame].append(box)
    return {scene: kit["interpolate_tracks"](tracks) for scene, tracks in scenes.items()}
