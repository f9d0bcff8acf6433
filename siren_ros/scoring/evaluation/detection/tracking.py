"""Tracks any detector's boxes with the common tracker, and scores the tracks: AMOTA, AMOTP (devkit) and HOTA."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Rows
from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.tables.interval import Interval
from siren_ros.scoring.evaluation.detection.boxes import (
    CLASS_NAMES,
    PERSON_NAMES,
    FoundBoxes,
    TruthBoxes,
    labels_named,
    names_kinds,
)
from siren_ros.scoring.evaluation.detection.devkit_score import class_range_m
from siren_ros.scoring.evaluation.detection.devkit_tracking import DevkitTracking
from siren_ros.scoring.evaluation.detection.frames import RANGE_M, Frames
from siren_ros.scoring.evaluation.detection.hota import TrackTable, hota_sums
from siren_ros.scoring.evaluation.detection.inputs.stated_boxes import FoundSet
from siren_ros.scoring.evaluation.detection.tracker import Tracker
from siren_ros.scoring.evaluation.statistics import jackknife
from siren_ros.simulation.world.actors import PEOPLE_CLASSES

ALL_VEHICLES: Final = "vehicle"
"""Name of the class of all vehicles, like the paper's ``Car``."""

Run = Callable[[Sequence[tuple[TrackTable, TrackTable, Sequence[Sequence[int]]]]], Sequence[DevkitTracking]]
"""Scores several classes by nuScenes' code, in parallel on several processors."""


@dataclass(frozen=True)
class Tracks:
    """Boxes with their tracks."""

    boxes: FoundBoxes
    """Boxes sorted by frame; each has the class name of its track's most confident box."""
    track: Rows
    """Number of the track, unique over all episodes, shape ``(N,)``."""
    velocity_mps: Floats
    """Velocity over ground of the track at the box, shape ``(N, 2)``."""

    def at(self, rows: Rows | Flags) -> "Tracks":
        """Select some of the boxes."""
        return Tracks(self.boxes.at(rows), self.track[rows], self.velocity_mps[rows])


@dataclass(frozen=True)
class TrackingScore:
    """Tracking scores of one class, over all episodes."""

    devkit: DevkitTracking
    amota: Interval
    amotp_m: Interval
    hota: Interval
    """HOTA at the confidence with the best MOTA."""
    detection: float
    """DetA, a part of HOTA."""
    association: float
    """AssA, the other part."""


def tracks_of(frames: Frames, detected: FoundBoxes) -> Tracks:
    """Track boxes from frame to frame of each episode, without regard to their class names."""
    boxes = detected.at(np.argsort(detected.frame, kind="stable").astype(np.intp))
    track, velocity = np.zeros(len(boxes), dtype=np.intp), np.zeros((len(boxes), 2))
    given = 0
    edges = np.searchsorted(boxes.frame, np.arange(len(frames) + 1))
    for first, last in zip(frames.first[:-1].tolist(), frames.first[1:].tolist(), strict=True):
        tracker = Tracker(step=int(frames.step[first]))
        for frame in range(first, last):
            rows = slice(edges[frame], edges[frame + 1])
            stated = boxes.velocity_mps[rows]
            followed = tracker.follow(int(frames.step[frame]), boxes.centre_m[rows, :2], STEP_S, stated)
            track[rows], velocity[rows] = given + followed.track, followed.velocity_mps
        given += tracker.tracks
    names, name = np.unique(boxes.label, return_inverse=True)
    weight = np.zeros((given, len(names)))
    np.add.at(weight, (track, name), boxes.score)
    label = names[weight.argmax(axis=1)[track]] if len(names) else boxes.label
    return Tracks(replace(boxes, label=label), track, velocity)


def score_tracking(frames: Frames, detected: FoundSet, names: frozenset[str], run: Run) -> Mapping[str, TrackingScore]:
    """Score tracks by class, where labels exist: all vehicles together, each kind by its name, and people.

    Labels and boxes are those that count for detections, at the keyframes of the nuScenes export. Kinds of vehicles
    are scored where the detector names them.

    Args:
        frames: Frames with labels.
        detected: Detections of one detector.
        names: Names that count as vehicles.
        run: Runs ``devkit_tracking``.

    Raises:
        InputError: nuscenes-devkit or motmetrics is not installed.
    """
    vehicles = tracks_of(frames, detected.boxes.at(np.isin(detected.boxes.label, sorted(names))))
    truth = frames.truth.at(~np.isin(frames.truth.actor_class, [*PEOPLE_CLASSES]))
    pairs = {ALL_VEHICLES: (truth, vehicles, RANGE_M)}
    if names_kinds(vehicles.boxes):
        for name in CLASS_NAMES:
            kind = vehicles.at(vehicles.boxes.label == name)
            pairs[name] = truth.at(labels_named(truth, name)), kind, RANGE_M
    for member, (name, *others) in PERSON_NAMES.items():
        people = detected.boxes.at(np.isin(detected.boxes.label, (name, *others)))
        if len(people):
            labels = frames.truth.at(frames.truth.actor_class == member)
            pairs[name] = labels, tracks_of(frames, people), class_range_m(name)
    counted = frames.keyframe & detected.scored
    tables = {
        name: (_labelled(frames, labels, counted, range_m), _followed(frames, tracks, counted, range_m))
        for name, (labels, tracks, range_m) in pairs.items()
    }
    tables = {name: pair for name, pair in tables.items() if len(pair[0].track)}
    numbers = [part.tolist() for part in np.split(np.arange(len(frames)), frames.first[1:-1])]
    scenes = [[number for number in part if counted[number]] for part in numbers]
    scores = run([(*pair, scenes) for pair in tables.values()])
    return MappingProxyType(
        {name: _score(frames, *pair, score) for (name, pair), score in zip(tables.items(), scores, strict=True)}
    )


def _labelled(frames: Frames, labels: TruthBoxes, counted: Flags, range_m: float) -> TrackTable:
    kept = counted[labels.frame] & (labels.lidar_points > 0) & (frames.distance_m(labels) < range_m)
    near = labels.at(kept).at(np.argsort(labels.frame[kept], kind="stable").astype(np.intp))
    _, track = np.unique([frames.episode[near.frame], near.actor_id], axis=1, return_inverse=True)
    return TrackTable(
        frames.episode[near.frame], near.frame, near.centre_m[:, :2], track.reshape(-1), np.full(len(near), -1.0)
    )


def _followed(frames: Frames, tracks: Tracks, counted: Flags, range_m: float) -> TrackTable:
    near = tracks.at(counted[tracks.boxes.frame] & (frames.distance_m(tracks.boxes) < range_m))
    _, track, count = np.unique(near.track, return_inverse=True, return_counts=True)
    score = np.bincount(track, near.boxes.score, minlength=len(count)) / count
    frame = near.boxes.frame
    return TrackTable(frames.episode[frame], frame, near.boxes.centre_m[:, :2], near.track, score[track])


def _score(frames: Frames, labels: TrackTable, found: TrackTable, devkit: DevkitTracking) -> TrackingScore:
    """Scores of one class, with intervals over the episodes that have labels or tracks."""
    template = np.array([episode.template for episode in frames.episodes])
    episodes = np.unique(labels.episode)
    _, stratum = np.unique(template[episodes], return_inverse=True)
    confident = found.at(found.score >= devkit.confidence)  # empty if the confidence is NaN
    sums, every = hota_sums(labels, confident, len(template)), np.ones(len(template))
    value = sums.of(every)
    without = np.array([sums.of(every - (np.arange(len(every)) == one)).hota for one in episodes])

    def interval(of_all: float, left_out: Floats) -> Interval:
        return jackknife(of_all, left_out, stratum).interval()

    return TrackingScore(
        devkit=devkit,
        amota=interval(devkit.amota, devkit.left_out["amota"][episodes]),
        amotp_m=interval(devkit.amotp_m, devkit.left_out["amotp_m"][episodes]),
        hota=interval(value.hota, without),
        detection=value.detection,
        association=value.association,
    )
