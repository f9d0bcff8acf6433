"""Scores one detector on all episodes: nuScenes' code for the tables, resampled episodes for the intervals."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.evaluation.detection.inputs.found_set import FoundSet
from siren_ros.evaluation.detection.metrics.average_precision import average_precision
from siren_ros.evaluation.detection.metrics.devkit_score import DevkitScore
from siren_ros.evaluation.detection.metrics.family_order import FAMILIES, FamilyOrder
from siren_ros.evaluation.detection.metrics.matching import DISTANCES_M, Matches, match
from siren_ros.evaluation.detection.metrics.named_classes import CLASS_NAMES, labels_named, names_kinds
from siren_ros.evaluation.detection.metrics.subsets import SUBSETS, Subset, subsets_of_episodes
from siren_ros.evaluation.detection.protocol.boxes import FoundBoxes, TruthBoxes, attributes_of
from siren_ros.evaluation.detection.protocol.frames import Frames, in_range
from siren_ros.evaluation.statistics.block_bootstrap import times_drawn
from siren_ros.evaluation.statistics.interval import NOTHING, Interval, percentile_interval
from siren_ros.numerics.arrays import Flags, Floats, Rows
from siren_ros.world.actors import ActorClass

RESAMPLES: Final = 1000
_NAMED: Final = "found by name"
VEHICLE_NAMES: Final = frozenset(
    {"car", "van", "truck", "bus", "trailer", "construction_vehicle", "misc", "vehicle", "emergency_vehicle"}
    | {member.name.lower() for member in ActorClass}
)
"""Class names that count as the one class of vehicles, in lower case."""

Names = npt.NDArray[np.str_]
Run = Callable[[Sequence[tuple[TruthBoxes, FoundBoxes]]], Sequence[DevkitScore]]
"""Scores several tables by nuScenes' code, side by side where there are processors."""


@dataclass(frozen=True)
class GroupScore:
    """A subset of the labels."""

    group: str
    name: str
    labels: int
    mean_ap: Interval


@dataclass(frozen=True)
class DetectorScores:
    """Everything about one detector."""

    name: str
    format: str
    has_velocity: bool
    frames: Mapping[str, int]
    """Frames that count, by template."""
    templates: Mapping[str, DevkitScore]
    template_ap: Mapping[str, Interval]
    mean_ap: Interval
    """Mean over the templates, each counted once, as in the paper."""
    families: Mapping[str, Interval]
    order: FamilyOrder | None
    """Whether the families are in the paper's order; None without all of them or without intervals."""
    groups: tuple[GroupScore, ...]
    truth: TruthBoxes
    """Labels that count."""
    found: FoundBoxes
    """Detections that count."""
    matches: Matches

    @property
    def mean_nds(self) -> float:
        """Mean over the templates."""
        return float(np.mean([score.nds for score in self.templates.values()]))

    def mean_error(self, name: str) -> float:
        """A true-positive error, mean over the templates."""
        return float(np.mean([score.errors[name] for score in self.templates.values()]))


def counted_boxes(frames: Frames, found: FoundSet, names: frozenset[str]) -> tuple[TruthBoxes, FoundBoxes]:
    """What nuScenes' protocol counts: boxes within 50 m; labels with at least one LiDAR point; vehicles."""
    truth, boxes = frames.truth, found.boxes
    if not found.has_attributes:
        truth = replace(truth, attribute=attributes_of(truth.velocity_mps))
    wanted = in_range(frames, truth.frame, truth.centre_m) & (truth.lidar_points > 0) & found.scored[truth.frame]
    near = in_range(frames, boxes.frame, boxes.centre_m) & found.scored[boxes.frame]
    return truth.at(wanted), boxes.at(near & np.isin(boxes.label, sorted(names)))


def score_detector(
    frames: Frames, found: FoundSet, names: frozenset[str], run: Run, resamples: int = RESAMPLES
) -> DetectorScores:
    """All scores of one detector.

    Args:
        frames: Frames and labels of all episodes.
        found: The detections.
        names: Class names that count.
        run: Scores tables by nuScenes' code.
        resamples: Of the episodes, within their templates.
    """
    truth, boxes = counted_boxes(frames, found, names)
    of_episode = np.array([one.template for one in frames.episodes])
    template_of_frame = of_episode[frames.episode]
    templates = sorted(set(of_episode.tolist()))
    tables = [
        (truth.at(template_of_frame[truth.frame] == one), boxes.at(template_of_frame[boxes.frame] == one))
        for one in templates
    ]
    scores = dict(zip(templates, run(tables), strict=True))
    resampled = _Resampled(frames, truth, boxes, of_episode, _weights(of_episode, resamples))
    draws = {one: resampled.mean_ap(template_of_frame, one) for one in templates}
    values = {one: score.mean_average_precision for one, score in scores.items()}
    mean = _mean_interval(values, draws, of_episode, templates)
    families = {name: members for name, members in FAMILIES.items() if set(members) <= set(templates)}
    return DetectorScores(
        name=found.name,
        format=found.format,
        has_velocity=found.has_velocity,
        frames={one: int((found.scored & (template_of_frame == one)).sum()) for one in templates},
        templates=scores,
        template_ap={one: _mean_interval(values, draws, of_episode, [one]) for one in templates},
        mean_ap=mean,
        families={name: _mean_interval(values, draws, of_episode, members) for name, members in families.items()},
        order=FamilyOrder.of({name: _mean(draws, members) for name, members in families.items()})
        if mean.bounded
        else None,
        groups=(
            *(resampled.group(subset) for subset in (*SUBSETS, *subsets_of_episodes(frames))),
            *(resampled.named(name) for name in (CLASS_NAMES if names_kinds(boxes) else ())),
        ),
        truth=truth,
        found=boxes,
        matches=resampled.matches,
    )


def _mean(draws: Mapping[str, Floats], templates: Sequence[str]) -> Floats:
    found: Floats = np.mean([draws[one] for one in templates], axis=0)
    return found


def _mean_interval(
    values: Mapping[str, float], draws: Mapping[str, Floats], of_episode: Names, templates: Sequence[str]
) -> Interval:
    """Mean over some templates, from the episodes of these."""
    value = float(np.mean([values[one] for one in templates]))
    return _interval(value, _mean(draws, templates), of_episode[np.isin(of_episode, templates)])


def _interval(value: float, resampled: Floats, of_episode: Names) -> Interval:
    known = resampled[np.isfinite(resampled)]
    _, stratum = np.unique(of_episode, return_inverse=True)
    return percentile_interval(value, known if len(known) else np.array([value]), stratum.astype(np.intp))


def _weights(template: Names, resamples: int) -> Floats:
    """How often each episode counts: once, then as drawn within its template, shape ``(1 + R, E)``."""
    _, stratum = np.unique(template, return_inverse=True)
    drawn = times_drawn(stratum.astype(np.intp), resamples, np.random.default_rng(0))
    return np.vstack((np.ones((1, len(template))), drawn))


class _Resampled:
    """Average precisions over resampled episodes."""

    def __init__(self, frames: Frames, truth: TruthBoxes, found: FoundBoxes, template: Names, weight: Floats) -> None:
        self._frames, self._truth, self._every = frames, truth, found
        self.matches = match(truth, found)
        self._found = found.at(self.matches.order)
        self._template, self._weight = template, weight
        self._episode_of_found: Rows = frames.episode[self._found.frame]
        self._episode_of_label: Rows = frames.episode[truth.frame]

    def _mean_ap(self, labels: Flags, counted: Sequence[Flags]) -> Floats:
        """Mean over the distances: first of all episodes, then of each resample, shape ``(1 + R,)``."""
        per_episode = np.bincount(self._episode_of_label[labels], minlength=len(self._frames.episodes)).astype(float)
        found = []
        for row, kept in enumerate(counted):
            hit = self.matches.label[row][kept] >= 0
            found.append(average_precision(hit, self._episode_of_found[kept], per_episode, self._weight))
        mean: Floats = np.mean(found, axis=0)
        return mean

    def mean_ap(self, template_of_frame: Names, template: str) -> Floats:
        """Of one template, from each resample, shape ``(R,)``."""
        kept = template_of_frame[self._found.frame] == template
        labels = template_of_frame[self._truth.frame] == template
        return self._mean_ap(labels, [kept] * len(DISTANCES_M))[1:]

    def group(self, subset: Subset) -> GroupScore:
        """Of a subset of the labels: detections of other labels do not count, false alarms do."""
        labels = subset.labels(self._frames, self._truth)
        alarm = np.ones(len(self._found), dtype=np.bool_)
        if subset.detections is not None:
            alarm = subset.detections(self._frames, self._found)
        counted = []
        for matched in self.matches.label:
            inside = labels[matched] if len(labels) else np.zeros(len(matched), dtype=np.bool_)
            counted.append(np.where(matched >= 0, inside, alarm))
        if not labels.any():
            return GroupScore(subset.group, subset.name, 0, NOTHING)
        return self._scored(subset.group, subset.name, labels, counted)

    def named(self, name: str) -> GroupScore:
        """Of a class by its name: a detection with another name does not find its labels."""
        own = labels_named(self._truth, name)
        if not own.any():
            return GroupScore(_NAMED, name, 0, NOTHING)
        found = self._every.at(self._every.label == name)
        alone = _Resampled(self._frames, self._truth.at(own), found, self._template, self._weight)
        every = np.ones(len(found), dtype=np.bool_)
        return alone._scored(_NAMED, name, np.ones(int(own.sum()), dtype=np.bool_), [every] * len(DISTANCES_M))

    def _scored(self, group: str, name: str, labels: Flags, counted: Sequence[Flags]) -> GroupScore:
        values = self._mean_ap(labels, counted)
        episodes = np.unique(self._episode_of_label[labels])
        interval = _interval(float(values[0]), values[1:], self._template[episodes])
        return GroupScore(group, name, int(labels.sum()), interval)
