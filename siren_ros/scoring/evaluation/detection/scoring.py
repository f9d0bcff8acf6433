"""Scores one detector, also on subsets of labels: nuScenes' code gives the tables, the jackknife the intervals."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from types import MappingProxyType
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Flags, Floats, Rows
from siren_ros.base.tables import NOTHING, Interval
from siren_ros.scoring.evaluation.detection.boxes import (
    CAR,
    CLASS_NAMES,
    PERSON_NAMES,
    Boxes,
    FoundBoxes,
    FoundSet,
    TruthBoxes,
    attributes_of,
    labels_named,
    names_kinds,
)
from siren_ros.scoring.evaluation.detection.frames import RANGE_M, EpisodeFrames, Frames
from siren_ros.scoring.evaluation.detection.metrics import (
    DISTANCES_M,
    ERRORS,
    DevkitScore,
    Matches,
    average_precision,
    class_range_m,
    match,
)
from siren_ros.scoring.evaluation.scores import ALL, TEMPLATE, Score, single
from siren_ros.scoring.evaluation.statistics import Estimate, jackknife
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.scenario.episode import Split, counted_standings
from siren_ros.simulation.world.actors import FIRST_PARKED_ID, PEOPLE_CLASSES, VEHICLE_CLASSES, ActorClass, Mode

_HELD: Final = (Mode.YIELD_HOLD, Mode.STOPPED)
_YIELDING: Final = (*(mode for mode in Mode if mode.is_yielding and mode not in _HELD), Mode.REJOIN)
_DISTANCES_M: Final = (0.0, 15.0, 30.0, RANGE_M)
_POINTS: Final = (1.0, 5.0, 20.0, 100.0, np.inf)
_VISIBLE: Final = (0.0, 0.4, 0.6, 0.8, np.inf)


@dataclass(frozen=True)
class Subset:
    """Labels with a common property. Other labels are ignored: they are neither missed nor false alarms."""

    group: str
    name: str
    labels: Callable[[Frames, TruthBoxes], Flags]
    detections: Callable[[Frames, Boxes], Flags] | None = None
    """Detections that can be false alarms in this subset; None for all."""


def _parked(truth: TruthBoxes) -> Flags:
    return np.asarray(truth.actor_id >= FIRST_PARKED_ID)


def _of_modes(name: str, modes: tuple[Mode, ...]) -> Subset:
    return Subset("behaviour", name, lambda _, truth: np.isin(truth.mode, modes) & ~_parked(truth))


_SIZE_M: Final = 0.02


def _of_class_size(truth: TruthBoxes) -> Flags:
    """Whether labels have exactly their class's size, as all vehicles have in episodes without ``size_spread``."""
    known = load_vehicle_parameters()
    sizes = {kind: (one.length_m, one.width_m, one.height_m) for kind, one in known.items()}
    own = np.array([sizes[ActorClass(kind)] for kind in truth.actor_class.tolist()]).reshape(-1, 3)
    return np.asarray((abs(truth.size_m - own) < _SIZE_M).all(axis=1))


def _of_distance(low_m: float, high_m: float) -> Subset:
    def within(frames: Frames, boxes: Boxes) -> Flags:
        away = frames.distance_m(boxes)
        return np.asarray((away >= low_m) & (away < high_m))

    return Subset("distance", f"{low_m:.0f}-{high_m:.0f} m", within, within)


def _of_points(low: float, high: float) -> Subset:
    name = f"{low:.0f} and more" if np.isinf(high) else f"{low:.0f} to {high - 1.0:.0f}"
    return Subset("LiDAR points", name, lambda _, truth: (truth.lidar_points >= low) & (truth.lidar_points < high))


def _of_visibility(low: float, high: float) -> Subset:
    name = f"{100.0 * low:.0f}-{min(100.0 * high, 100.0):.0f} %"
    return Subset("visible", name, lambda _, truth: (truth.visible >= low) & (truth.visible < high))


def _novelty(episode: EpisodeFrames, detected: FoundSet) -> str:
    known = {True: "known from the training", False: "new to the detector"}
    return known[episode.map_name in detected.seen.maps] if detected.seen else ""


EPISODE_GROUPS: Final[Mapping[str, Callable[[EpisodeFrames, FoundSet], str]]] = MappingProxyType(
    {
        "weather": lambda episode, _: episode.look,
        "sensors": lambda episode, _: episode.suite,
        "map": lambda episode, _: episode.map_name,
        "maps that are": _novelty,
    }
)
"""Properties by which episodes are grouped, each with a function that gives its value for an episode."""


def subsets_of_episodes(frames: Frames, detected: FoundSet) -> tuple[Subset, ...]:
    """Subsets for each of ``EPISODE_GROUPS`` in which the episodes differ."""
    groups = {
        group: np.array([kind_of(episode, detected) for episode in frames.episodes])
        for group, kind_of in EPISODE_GROUPS.items()
    }
    return tuple(
        _of_episodes(group, kind, of_episode == kind)
        for group, of_episode in groups.items()
        for kind in sorted(set(of_episode.tolist()))
        if not (of_episode == kind).all()
    )


def _of_episodes(group: str, name: str, chosen: Flags) -> Subset:
    def within(frames: Frames, boxes: Boxes) -> Flags:
        return np.asarray(chosen[frames.episode[boxes.frame]])

    return Subset(group, name, within, within)


def _of_class(member: ActorClass) -> Subset:
    name = member.name.lower().replace("_", " ")
    return Subset("emergency vehicles", name, lambda _, truth: truth.actor_class == member)


SUBSETS: Final = (
    _of_modes("nominal", tuple(mode for mode in Mode if mode not in (*_HELD, *_YIELDING))),
    _of_modes("yielding", _YIELDING),
    _of_modes("held", _HELD),
    Subset("behaviour", "parked", lambda _, truth: _parked(truth)),
    Subset("size", "of their class", lambda _, truth: _of_class_size(truth)),
    Subset("size", "another one", lambda _, truth: ~_of_class_size(truth)),
    *(_of_distance(low, high) for low, high in pairwise(_DISTANCES_M)),
    *(_of_points(low, high) for low, high in pairwise(_POINTS)),
    *(_of_visibility(low, high) for low, high in pairwise(_VISIBLE)),
    *(_of_class(member) for member in (ActorClass.AMBULANCE, ActorClass.FIRE_TRUCK, ActorClass.POLICE)),
)
"""The subsets, in the order of the tables."""


FAMILIES: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {"clearance": ("S1", "S2"), "stop sign": ("S5", "S6"), "shoulder": ("S7",), "red light": ("S3", "S4")}
)
"""Templates of the paper's families, in the paper's order of increasing mAP."""


def order_of_families(families: Mapping[str, Floats]) -> dict[str, float]:
    """How certain the paper's order of families is: shares of random draws in which it holds.

    Takes the mAP of each family in each draw around it, with the spread of its episodes, shape ``(R,)``.

    Returns:
        The share of draws in which a family is below the next one, by ``clearance < stop sign`` and so on, and in which
        the whole order holds, by ``all``; chance gives 1 in 24. Empty if a family is missing.
    """
    if set(families) != set(FAMILIES):
        return {}
    rises = {f"{low} < {high}": families[low] < families[high] for low, high in pairwise(FAMILIES)}
    return {name: float(rise.mean()) for name, rise in {**rises, ALL: np.all(list(rises.values()), axis=0)}.items()}


def sentence_of_order(shares: Mapping[str, float]) -> str:
    """The shares of ``order_of_families`` as a sentence for readers of the tables."""
    steps = ", ".join(f"{name} in {share:.0%}" for name, share in shares.items() if name != ALL)
    return f"{steps} of the draws; the paper's whole order in {shares[ALL]:.0%}, by chance 4%"


_DRAWS: Final = 1000
"""Number of draws for the order of the families."""
MEAN_AP: Final = "mAP"
_NAMED: Final = "found by name"
VEHICLE_NAMES: Final = frozenset(
    {"car", "van", "truck", "bus", "trailer", "construction_vehicle", "misc", "vehicle", "emergency_vehicle"}
    | {member.name.lower() for member in VEHICLE_CLASSES if member not in PEOPLE_CLASSES}
)
"""Lower-case class names that count as vehicles."""

Names = npt.NDArray[np.str_]
Run = Callable[[Sequence[tuple[TruthBoxes, FoundBoxes, str]]], Sequence[DevkitScore]]
"""Scores several tables, each with its class's name, by nuScenes' code, in parallel on several processors."""


@dataclass(frozen=True)
class DetectorScores:
    """All scores of one detector."""

    name: str
    format: str
    has_velocity: bool
    frames: Mapping[str, int]
    """Number of scored frames by template."""
    templates: Mapping[str, DevkitScore]
    """The devkit's scores, with the curves, by template."""
    people: Mapping[str, DevkitScore]
    """The devkit's scores of people by nuScenes' name, if there is a label; they are part of no other score."""
    rows: tuple[Score, ...]
    """mAP, NDS and errors of all (the mean over the templates, which count equally, as in the paper), of each template
    and of people; mAP of families and of parts of the labels; the order of the families; scores of tracks."""
    order: Mapping[str, float]
    """As ``order_of_families``; empty without all families or without intervals."""
    truth: TruthBoxes
    """Labels that are scored."""
    found: FoundBoxes
    """Detections that are scored."""
    matches: Matches
    seen: Mapping[Split, int] = field(default_factory=dict)
    """Number of episodes by their relation to the detector's training; empty if that is unknown or there was none."""


def counted_boxes(frames: Frames, detected: FoundSet, names: frozenset[str]) -> tuple[TruthBoxes, FoundBoxes]:
    """Boxes that nuScenes' protocol counts: vehicles within 50 m; labels need at least one LiDAR point."""
    return _near(frames, detected, frames.truth.at(~np.isin(frames.truth.actor_class, [*PEOPLE_CLASSES])), names)


def counted_people(frames: Frames, detected: FoundSet, kind: ActorClass) -> tuple[TruthBoxes, FoundBoxes]:
    """Boxes of a class of people that nuScenes' protocol counts, within nuScenes' range for it.

    Raises:
        InputError: nuscenes-devkit is not installed.
    """
    if not detected.has_attributes:
        attribute = attributes_of(detected.boxes.velocity_mps, kind)
        detected = replace(detected, boxes=replace(detected.boxes, attribute=attribute))
    names = PERSON_NAMES[kind]
    labels = frames.truth.at(frames.truth.actor_class == kind)
    return _near(frames, detected, labels, frozenset(names), class_range_m(names[0]))


def _near(
    frames: Frames, detected: FoundSet, truth: TruthBoxes, names: frozenset[str], range_m: float = RANGE_M
) -> tuple[TruthBoxes, FoundBoxes]:
    boxes = detected.boxes
    if not detected.has_attributes:
        truth = replace(truth, attribute=attributes_of(truth.velocity_mps, truth.actor_class))
    counted = (frames.distance_m(truth) < range_m) & (truth.lidar_points > 0) & detected.scored[truth.frame]
    near = (frames.distance_m(boxes) < range_m) & detected.scored[boxes.frame]
    return truth.at(counted), boxes.at(near & np.isin(boxes.label, sorted(names)))


def mean_ap_of_episodes(frames: Frames, detected: FoundSet, names: frozenset[str]) -> Floats:
    """Average precision (mAP) of each episode, ``(E,)``; NaN without a label. Arguments as of ``score_detector``."""
    truth, boxes = counted_boxes(frames, detected, names)
    matches, count = match(truth, boxes), len(frames.episodes)
    labels = np.bincount(frames.episode[truth.frame], minlength=count).astype(np.float64)
    episode = frames.episode[boxes.at(matches.order).frame]
    each = [average_precision(matched >= 0, episode, labels, np.eye(count)) for matched in matches.label]
    return np.asarray(np.mean(each, axis=0))


def score_detector(frames: Frames, detected: FoundSet, names: frozenset[str], run: Run) -> DetectorScores:
    """All scores of one detector; ``names`` are the class names that count."""
    truth, boxes = counted_boxes(frames, detected, names)
    of_episode = np.array([episode.template for episode in frames.episodes])
    of_frame = of_episode[frames.episode]
    templates = sorted(set(of_episode.tolist()))
    tables = [
        (truth.at(of_frame[truth.frame] == name), boxes.at(of_frame[boxes.frame] == name), CAR) for name in templates
    ]
    scores = dict(zip(templates, run(tables), strict=True))
    jackknifed = _Jackknifed(detected.name, frames, truth, boxes, of_episode)
    whole, order = _rows_of_templates(
        detected.name, scores, {name: jackknifed.mean_ap(of_frame, name) for name in scores}
    )
    of_people, people = _people(frames, detected, of_episode, run)
    rows = (
        *(*whole, *of_people),
        *(jackknifed.group(subset) for subset in (*SUBSETS, *subsets_of_episodes(frames, detected))),
        *(jackknifed.named(name) for name in (CLASS_NAMES if names_kinds(boxes) else ())),
    )
    return DetectorScores(
        name=detected.name,
        format=detected.format,
        has_velocity=detected.has_velocity,
        frames={name: int((detected.scored & (of_frame == name)).sum()) for name in templates},
        templates=scores,
        people=people,
        rows=rows,
        order=order,
        truth=truth,
        found=boxes,
        matches=jackknifed.matches,
        seen=counted_standings(
            [detected.seen.split_of(episode.identity) for episode in frames.episodes] if detected.seen else []
        ),
    )


def _rows_of_templates(
    name: str, scores: Mapping[str, DevkitScore], left_out: Mapping[str, Floats]
) -> tuple[list[Score], dict[str, float]]:
    """Rows of the mean over the templates, of each one, of the families and their order; and that order's shares."""
    values = {template: score.mean_average_precision for template, score in scores.items()}
    means = {figure: float(np.mean([_figures(score)[figure] for score in scores.values()])) for figure in _FIGURES}
    mean = _mean(values, left_out, list(scores)).interval()
    rows = [*_rows(name, (ALL, ALL), mean, means, sum(score.labels for score in scores.values()))]
    for template, score in scores.items():
        mean_ap = _mean(values, left_out, [template]).interval()
        rows += _rows(name, (TEMPLATE, template), mean_ap, _figures(score), score.labels)
    complete = {family: members for family, members in FAMILIES.items() if set(members) <= set(scores)}
    families = {family: _mean(values, left_out, members) for family, members in complete.items()}
    for family, estimate in families.items():
        labels = sum(scores[template].labels for template in complete[family])
        rows += _rows(name, ("family", family), estimate.interval(), {}, labels)
    rng = np.random.default_rng(0)
    draws = {family: estimate.draws(_DRAWS, rng) for family, estimate in families.items()}
    order = order_of_families(draws) if mean.bounded else {}
    rows += [Score(name, "order", step, "share", single(share, mean.blocks), _DRAWS) for step, share in order.items()]
    return rows, order


_FIGURES: Final = ("NDS", *ERRORS)


def _figures(score: DevkitScore) -> dict[str, float]:
    return {"NDS": score.nds, **score.errors}


def _rows(
    name: str, group: tuple[str, str], mean_ap: Interval, figures: Mapping[str, float], labels: int
) -> Iterator[Score]:
    """Rows of mAP with its interval, and of figures without one."""
    yield Score(name, *group, MEAN_AP, mean_ap, labels)
    for figure, value in figures.items():
        yield Score(name, *group, figure, single(value, mean_ap.blocks), labels)


def _people(
    frames: Frames, detected: FoundSet, template: Names, run: Run
) -> tuple[list[Score], dict[str, DevkitScore]]:
    """Rows of each class of people with a label, and the devkit's scores by nuScenes' name."""
    there = [kind for kind in PERSON_NAMES if (frames.truth.actor_class == kind).any()]
    counted = [(*counted_people(frames, detected, kind), PERSON_NAMES[kind][0]) for kind in there]
    tables = [table for table in counted if len(table[0])]
    scores = run(tables) if tables else ()
    rows: list[Score] = []
    for (truth, boxes, name), score in zip(tables, scores, strict=True):
        whole = _Jackknifed(detected.name, frames, truth, boxes, template).whole("people", name)
        rows += _rows(detected.name, ("people", name), whole.interval, _figures(score), score.labels)
    return rows, {name: score for (*_, name), score in zip(tables, scores, strict=True)}


def _mean(values: Mapping[str, float], left_out: Mapping[str, Floats], templates: Sequence[str]) -> Estimate:
    """Mean over some templates; each episode affects only its own template."""
    value = float(np.mean([values[name] for name in templates]))
    changed = [left_out[name] / len(templates) for name in templates]
    stratum = np.repeat(np.arange(len(templates)), [*map(len, changed)])
    return jackknife(value, np.concatenate(changed), stratum)


class _Jackknifed:
    """Average precisions without each episode, for the jackknife."""

    def __init__(self, name: str, frames: Frames, truth: TruthBoxes, boxes: FoundBoxes, template: Names) -> None:
        self._name, self._frames, self._truth, self._given, self._template = name, frames, truth, boxes, template
        self.matches = match(truth, boxes)
        self._boxes = boxes.at(self.matches.order)
        _, self._stratum = np.unique(template, return_inverse=True)
        self._episode_of_box: Rows = frames.episode[self._boxes.frame]
        self._episode_of_label: Rows = frames.episode[truth.frame]

    def _mean_ap(self, labels: Flags, counted: Sequence[Flags], episodes: Rows) -> Floats:
        """Mean over the distance thresholds: of all episodes, then without each of some.

        Shape ``(1 + len(episodes),)``.
        """
        weight = np.ones((1 + len(episodes), len(self._frames.episodes)))
        weight[np.arange(1, len(weight)), episodes] = 0.0
        per_episode = np.bincount(self._episode_of_label[labels], minlength=len(self._frames.episodes)).astype(float)
        values = [
            average_precision(matched[kept] >= 0, self._episode_of_box[kept], per_episode, weight)
            for matched, kept in zip(self.matches.label, counted, strict=True)
        ]
        return np.asarray(np.mean(values, axis=0))

    def mean_ap(self, template_of_frame: Names, template: str) -> Floats:
        """Average precision (mAP) of one template, without each of its episodes."""
        kept = template_of_frame[self._boxes.frame] == template
        labels = template_of_frame[self._truth.frame] == template
        return self._mean_ap(labels, [kept] * len(DISTANCES_M), np.flatnonzero(self._template == template))[1:]

    def group(self, subset: Subset) -> Score:
        """Score of a subset: detections of other labels are ignored, false alarms count."""
        labels = subset.labels(self._frames, self._truth)
        if not labels.any():
            return Score(self._name, subset.group, subset.name, MEAN_AP, NOTHING, 0)
        alarm = np.ones(len(self._boxes), dtype=np.bool_)
        if subset.detections is not None:
            alarm = subset.detections(self._frames, self._boxes)
        counted = [np.where(matched >= 0, labels[matched], alarm) for matched in self.matches.label]
        return self._scored(subset.group, subset.name, labels, counted)

    def named(self, name: str) -> Score:
        """Score of a class by name: a detection with another name does not find its labels."""
        truth = self._truth.at(labels_named(self._truth, name))
        if not len(truth):
            return Score(self._name, _NAMED, name, MEAN_AP, NOTHING, 0)
        boxes = self._given.at(self._given.label == name)
        return _Jackknifed(self._name, self._frames, truth, boxes, self._template).whole(_NAMED, name)

    def whole(self, group: str, name: str) -> Score:
        """Score of all labels and detections."""
        labels, counted = (np.ones(len(table), dtype=np.bool_) for table in (self._truth, self._boxes))
        return self._scored(group, name, labels, [counted] * len(DISTANCES_M))

    def _scored(self, group: str, name: str, labels: Flags, counted: Sequence[Flags]) -> Score:
        episodes = np.unique(self._episode_of_label[labels])
        value, *left_out = self._mean_ap(labels, counted, episodes).tolist()
        estimate = jackknife(value, np.array(left_out), self._stratum[episodes])
        return Score(self._name, group, name, MEAN_AP, estimate.interval(), int(labels.sum()))
