"""Tracks any detector's boxes with the common tracker, and scores the tracks: AMOTA, AMOTP (devkit) and HOTA.

The tracker finds which boxes of successive sweeps are the same vehicle, and its velocity.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from siren_ros.base.numerics.arrays import Flags, Floats, Rows
from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.tables import Interval
from siren_ros.scoring.evaluation.detection.boxes import (
    CLASS_NAMES,
    PERSON_NAMES,
    FoundBoxes,
    FoundSet,
    TruthBoxes,
    labels_named,
    names_kinds,
)
from siren_ros.scoring.evaluation.detection.frames import RANGE_M, Frames
from siren_ros.scoring.evaluation.detection.metrics import DevkitTracking, TrackTable, class_range_m, hota_sums
from siren_ros.scoring.evaluation.scores import Score, single
from siren_ros.scoring.evaluation.statistics import jackknife
from siren_ros.simulation.world.actors import PEOPLE_CLASSES

_GATE_M: Final = 2.5
"""A box farther than this from a track's predicted place belongs to another track."""
_FORGET_STEPS: Final = 20
_GAIN_PLACE: Final = 0.5
_GAIN_VELOCITY: Final = 0.15


class Followed(NamedTuple):
    """The tracker's result for the boxes of one sweep, in their order."""

    velocity_mps: Floats
    """Velocity over ground, shape ``(N, 2)``."""
    sweeps: Rows
    """Number of sweeps in which each vehicle has been seen, shape ``(N,)``."""
    track: Rows
    """Number of the track of each box, shape ``(N,)``; each occurs once in a sweep."""


@dataclass
class Tracker:
    """An alpha-beta filter for each vehicle, in the ``map`` frame."""

    place_m: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    velocity_mps: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    sweeps: Rows = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """Number of sweeps in which each track has been seen."""
    last_step: Rows = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    track: Rows = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """Numbers of the tracks; a number is never used again."""
    step: int = 0
    tracks: int = 0
    """Number of tracks so far."""

    def follow(self, step: int, place_m: Floats, step_s: float, stated_mps: Floats | None = None) -> Followed:
        """Add the boxes of a step's sweep, given by their centres, shape ``(N, 2)``.

        A new track begins with the velocity that the detector states for its box, shape ``(N, 2)``; without one, or
        where it is NaN, at rest.
        """
        passed_s = (step - self.step) * step_s
        self.step = step
        kept = step - self.last_step <= _FORGET_STEPS
        self.velocity_mps = self.velocity_mps[kept]
        self.place_m = self.place_m[kept] + self.velocity_mps * passed_s
        self.sweeps, self.last_step, self.track = self.sweeps[kept], self.last_step[kept], self.track[kept]
        track, box, away = self._pairs(place_m)
        self.sweeps[track] += 1
        if passed_s > 0.0:
            place, velocity = _gains(self.sweeps[track])
            self.place_m[track] += place[:, None] * away
            self.velocity_mps[track] += velocity[:, None] * away / passed_s
        self.last_step[track] = step
        new = np.setdiff1d(np.arange(len(place_m)), box)
        rows = np.zeros(len(place_m), dtype=np.intp)
        rows[box], rows[new] = track, len(self.sweeps) + np.arange(len(new))
        begin_mps = np.zeros((len(new), 2)) if stated_mps is None else np.nan_to_num(stated_mps[new])
        self.place_m = np.vstack((self.place_m, place_m[new]))
        self.velocity_mps = np.vstack((self.velocity_mps, begin_mps))
        self.sweeps = np.r_[self.sweeps, np.ones(len(new), dtype=np.intp)]
        self.last_step = np.r_[self.last_step, np.full(len(new), step, dtype=np.intp)]
        self.track = np.r_[self.track, self.tracks + np.arange(len(new))]
        self.tracks += len(new)
        return Followed(self.velocity_mps[rows], self.sweeps[rows], self.track[rows])

    def _pairs(self, place_m: Floats) -> tuple[Rows, Rows, Floats]:
        way = place_m[None] - self.place_m[:, None]
        distance = np.hypot(way[..., 0], way[..., 1])
        track, box = linear_sum_assignment(np.minimum(distance, _GATE_M))
        near = distance[track, box] < _GATE_M
        return track[near], box[near], way[track[near], box[near]]


def _gains(sweeps: Rows) -> tuple[Floats, Floats]:
    """Gains for position and velocity: a straight line through all boxes of a short track, then constant values.

    Source: E. Brookner, "Tracking and Kalman Filtering Made Easy", 1998, section 1.2.10, the growing-memory filter. The
    numbers of sweeps, shape ``(N,)``, are at least 2.
    """
    pairs = sweeps * (sweeps + 1.0)
    return np.maximum(2.0 * (2.0 * sweeps - 1.0) / pairs, _GAIN_PLACE), np.maximum(6.0 / pairs, _GAIN_VELOCITY)


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


def score_tracking(frames: Frames, detected: FoundSet, names: frozenset[str], run: Run) -> tuple[Score, ...]:
    """Score tracks by class, where labels exist: all vehicles together, each kind by its name, and people.

    The rows are of the kind ``tracking``; their samples are labelled tracks. HOTA is at the confidence with the best
    MOTA, which is a row, too; DetA and AssA are its parts.

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
    return tuple(
        Score(detected.name, "tracking", name, figure, value, score.labels)
        for (name, pair), score in zip(tables.items(), scores, strict=True)
        for figure, value in _figures(frames, *pair, score).items()
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


def _figures(frames: Frames, labels: TrackTable, found: TrackTable, devkit: DevkitTracking) -> Mapping[str, Interval]:
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

    return {
        "AMOTA": interval(devkit.amota, devkit.left_out["amota"][episodes]),
        "AMOTP": interval(devkit.amotp_m, devkit.left_out["amotp_m"][episodes]),
        "HOTA": interval(value.hota, without),
        "DetA": single(value.detection),
        "AssA": single(value.association),
        "MOTA": single(devkit.mota),
        "switches": single(devkit.switches),
        "confidence": single(devkit.confidence),
    }
