"""Tracking scores AMOTA and AMOTP by nuScenes' own code (nuscenes-devkit), for one class at a time."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.boxes import CAR
from siren_ros.scoring.evaluation.detection.hota import TrackTable

_PARTS: Final = ("constants", "algo", "data_classes", "loaders", "mot")
_MODULES: Final = ("motmetrics", "nuscenes.eval.common.config", *(f"nuscenes.eval.tracking.{name}" for name in _PARTS))
_CONFIG: Final = "tracking_nips_2019"
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
    config = kit["config_factory"](_CONFIG)
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
        modules = [import_module(name) for name in _MODULES]
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
