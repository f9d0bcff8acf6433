"""How different episodes are, and what more seeds would add.

The profile of an episode has its drawn parameters, the EMV's path and the order of events. The diversity of the
episodes of each template, level and map is their coverage and the distances of their profiles, as tables and JSON.
"""

from collections import Counter
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from typing import Any, Final

import numpy as np
from scipy.special import gammaln

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.tables import Row, Table
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError, SirenError
from siren_ros.simulation.scenario.scenario import DRAWN_BY_NAME
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.world.actors import EventKind

POINT_STEPS: Final = round(1.0 / STEP_S)
"""Steps between two points of a path: one second."""
BEGIN: Final = "begin"
END: Final = "end"
_EMV_EVENTS: Final = frozenset(
    {
        EventKind.LANE_CHANGE_STARTED,
        EventKind.CORRIDOR_ENTERED,
        EventKind.CORRIDOR_LEFT,
        EventKind.GAP_ESCAPE_ENTERED,
        EventKind.GAP_ESCAPE_LEFT,
        EventKind.STOP_LINE_CROSSED,
    }
)
_CIVILIAN_EVENTS: Final = frozenset(kind for kind in EventKind if kind.startswith("yield_")) - {
    EventKind.YIELD_REQUESTED
}


@dataclass(frozen=True)
class InteractionProfile:
    """Profile of one episode."""

    bag: str
    template: str
    level: str
    seed: int
    map_name: str
    draw: str
    parameters: Mapping[str, float]
    """Values of the template's parameters, by their path in the template's file."""
    way_m: Floats
    """Positions of the EMV, one per second, in the frame of its first pose (x ahead, y left); shape ``(T, 2)``."""
    happenings: tuple[str, ...]
    """Events of the interaction in order, such as ``emv stop_line_crossed``; repeated ones are merged."""

    @property
    def group(self) -> tuple[str, str, str]:
        """Template, level and map. Episodes of one group differ in their seeds and draws."""
        return self.template, self.level, self.map_name

    @property
    def transitions(self) -> frozenset[tuple[str, str]]:
        """Pairs of events that follow each other directly."""
        return frozenset(pairwise((BEGIN, *self.happenings, END)))


def profile_of(bag: str, record: EpisodeRecord) -> InteractionProfile:
    """Compute the profile of a record.

    Raises:
        InputError: The episode has no EMV that was recorded.
    """
    described = record.description
    return InteractionProfile(
        bag,
        described.template,
        described.level.name,
        described.seed,
        described.map_name,
        described.draw,
        described.template_values,
        emv_way_m(record),
        tuple(_happenings(record)),
    )


def emv_way_m(record: EpisodeRecord) -> Floats:
    """Positions of the EMV, one per second, in the frame of its first pose; shape ``(T, 2)``."""
    track = record.track(record.emv_ids[0]) if record.emv_ids else None
    if track is None or not len(track):
        raise InputError("bag", record.description.template, "an episode with an EMV")
    apart = track.xy_m[::POINT_STEPS] - track.xy_m[0]
    cos, sin = np.cos(track.yaw_rad[0]), np.sin(track.yaw_rad[0])
    return np.asarray(apart @ np.array([[cos, -sin], [sin, cos]]), dtype=np.float64)


def _happenings(record: EpisodeRecord) -> Iterator[str]:
    emvs = frozenset(record.emv_ids)
    before = ""
    for event in record.events:
        if event.actor_id in emvs and event.kind in _EMV_EVENTS:
            name = f"emv {event.kind}"
        elif event.kind in _CIVILIAN_EVENTS:
            name = f"civilian {event.kind}"
        elif event.kind is EventKind.COLLISION:
            name = str(event.kind)
        else:
            continue
        if name != before:
            yield name
            before = name


def way_distance_m(first: InteractionProfile, second: InteractionProfile) -> float:
    """Mean distance between both EMVs at equal times, as long as both were recorded.

    The mean over pairs is the average self distance of Y. Yuan and K. Kitani (DLow, ECCV 2020), of whole episodes.
    """
    points = min(len(first.way_m), len(second.way_m))
    return float(np.hypot(*(first.way_m[:points] - second.way_m[:points]).T).mean())


def event_distance(first: InteractionProfile, second: InteractionProfile) -> float:
    """Levenshtein distance of two orders of events as a share of the longer one, 0 to 1."""
    longest = max(len(first.happenings), len(second.happenings))
    return _edits(first.happenings, second.happenings) / longest if longest else 0.0


def _edits(first: Sequence[str], second: Sequence[str]) -> int:
    row = list(range(len(second) + 1))
    for count, left in enumerate(first, start=1):
        before, row[0] = row[0], count
        for place, right in enumerate(second, start=1):
            kept = before + (left != right)
            before = row[place]
            row[place] = min(kept, before + 1, row[place - 1] + 1)
    return row[-1]


def distance_matrix(
    profiles: Sequence[InteractionProfile], distance: Callable[[InteractionProfile, InteractionProfile], float]
) -> Floats:
    """Distances between all pairs, shape ``(N, N)``, zero on the diagonal."""
    matrix = np.zeros((len(profiles), len(profiles)))
    for row, profile in enumerate(profiles):
        for column in range(row):
            matrix[row, column] = matrix[column, row] = distance(profile, profiles[column])
    return matrix


def _log_choices(total: Floats, chosen: Floats) -> Floats:
    """Logarithm of the binomial coefficient; −∞ where it is zero."""
    possible = (chosen >= 0) & (chosen <= total)
    safe = np.where(possible, chosen, 0.0)
    log = gammaln(total + 1.0) - gammaln(safe + 1.0) - gammaln(total - safe + 1.0)
    return np.asarray(np.where(possible, log, -np.inf), dtype=np.float64)


def expected_kinds(incidences: Sequence[int], episodes: int) -> Floats:
    """Expected number of kinds among n episodes, n = 1 … N (rarefaction; S. Hurlbert, Ecology 52 (1971) 577).

    ``incidences`` are the numbers of episodes, of all N, in which each kind occurs, 1 to N. Returns shape ``(N,)``.
    """
    chosen = np.arange(1, episodes + 1, dtype=np.float64)
    without = episodes - np.array(incidences, dtype=np.float64)[:, None]
    total = np.full_like(chosen, episodes)
    without = np.broadcast_to(without, (len(incidences), episodes))
    missed = np.exp(_log_choices(without, chosen) - _log_choices(total, chosen))
    return np.asarray((1.0 - missed).sum(axis=0), dtype=np.float64)


def expected_nearest(distances: Floats) -> Floats:
    """Expected distance of an episode to the nearest of n others, n = 1 … N − 1, as mean over the N episodes.

    Takes the distances between all pairs, shape ``(N, N)``. Returns shape ``(N - 1,)``, empty for a single episode.
    """
    others = len(distances) - 1
    if others < 1:
        return np.zeros(0)
    ordered = np.sort(distances + np.diag(np.full(others + 1, np.inf)), axis=1)[:, :others].mean(axis=0)
    chosen = np.arange(1, others + 1, dtype=np.float64)[:, None]
    farther = np.arange(others - 1, -1, -1, dtype=np.float64)[None, :]
    # The neighbour at rank r is the nearest of n if it is chosen and the other n - 1 are farther away.
    weight = np.exp(
        _log_choices(np.broadcast_to(farther, (others, others)), np.broadcast_to(chosen - 1.0, (others, others)))
        - _log_choices(np.full((others, 1), float(others)), chosen)
    )
    return np.asarray(weight @ ordered, dtype=np.float64)


@dataclass(frozen=True)
class KindCoverage:
    """How many kinds were seen, and an estimate of how many were not."""

    seen: int
    once: int
    """Number of kinds that occur in a single episode."""
    next_adds: float
    """Number of new kinds expected from one more episode: kinds that occur once, divided by the number of episodes (I.
    J. Good, Biometrika 40 (1953) 237). It means nothing for a single episode."""
    coverage: float
    """Estimated share of the next episode's kinds that were seen already (A. Chao, L. Jost, Ecology 93 (2012) 2533)."""
    curve: Floats
    """Expected number of kinds among n episodes, as ``expected_kinds``."""


def kind_coverage(episodes: Sequence[Collection[Hashable]]) -> KindCoverage:
    """Coverage of the kinds that occur in episodes; there must be at least one episode."""
    count = len(episodes)
    incidences = list(Counter(kind for episode in episodes for kind in set(episode)).values())
    once, twice, total = incidences.count(1), incidences.count(2), sum(incidences)
    missing = 0.0
    if total and once and count > 1:
        ahead = (count - 1) * once
        share = ahead / (ahead + 2.0 * twice) if twice else (ahead - (count - 1)) / (ahead - (count - 1) + 2.0)
        missing = once / total * share
    elif total and count == 1:
        missing = 1.0
    return KindCoverage(len(incidences), once, once / count, 1.0 - missing, expected_kinds(incidences, count))


PARTS: Final = 10
"""Number of equal parts of a range; a whole-number parameter with fewer values has one part per value."""


@dataclass(frozen=True)
class DrawnRange:
    """The range from which a parameter is drawn."""

    low: float
    high: float
    whole: bool

    @property
    def parts(self) -> int:
        """Number of parts."""
        return min(PARTS, round(self.high - self.low) + 1) if self.whole else PARTS

    def part_of(self, values: Floats) -> Floats:
        """Part of each value, from 0; values outside belong to the first or last part."""
        width = (self.high - self.low + (1.0 if self.whole else 0.0)) / self.parts
        return np.clip(np.floor((values - self.low) / width), 0, self.parts - 1)


@dataclass(frozen=True)
class ParameterCoverage:
    """Coverage of one parameter's range."""

    path: str
    drawn: DrawnRange
    counts: tuple[int, ...]
    """Number of episodes in each part."""
    curve: Floats
    """Expected share of parts that n episodes reach, n = 1 … N; shape ``(N,)``."""

    @property
    def share(self) -> float:
        """Share of parts that contain an episode."""
        return sum(count > 0 for count in self.counts) / len(self.counts)


def parameter_coverage(
    episodes: Sequence[Mapping[str, float]], ranges: Mapping[str, DrawnRange]
) -> tuple[ParameterCoverage, ...]:
    """Coverage of every parameter that has a range and a value in all episodes, by its path."""
    covered = []
    for path, drawn in sorted(ranges.items()):
        if drawn.high <= drawn.low or not all(path in episode for episode in episodes):
            continue
        part = drawn.part_of(np.array([episode[path] for episode in episodes], dtype=np.float64)).astype(np.intp)
        counts = np.bincount(part, minlength=drawn.parts)
        reached = [int(count) for count in counts if count]
        curve = expected_kinds(reached, len(episodes)) / drawn.parts
        covered.append(ParameterCoverage(path, drawn, tuple(counts.tolist()), curve))
    return tuple(covered)


def drawn_ranges(profiles: Iterable[InteractionProfile]) -> dict[str, dict[str, DrawnRange]]:
    """Ranges by template and parameter; a template that is not shipped has none.

    Episodes whose values a study drew have the template's whole ranges; the others those that every seed draws from.
    """
    some_drawn: dict[str, bool] = {}
    for profile in profiles:
        some_drawn[profile.template] = bool(profile.draw) or some_drawn.get(profile.template, False)
    ranges: dict[str, dict[str, DrawnRange]] = {}
    for name, drawn in some_drawn.items():
        try:
            template = load_template(name)
        except SirenError:
            continue
        limits = template.drawn
        if drawn:
            limits = {path: limit for path, limit in template.ranges.items() if path not in DRAWN_BY_NAME}
        ranges[name] = {path: DrawnRange(one.minimum, one.maximum, one.integer) for path, one in limits.items()}
    return ranges


@dataclass(frozen=True)
class Distances:
    """Distances of one kind among N episodes."""

    mean: float
    """Mean over all pairs; 0 for a single episode."""
    nearest: Floats
    """Distance of each episode to its nearest other one, shape ``(N,)``; NaN for a single episode."""
    curve: Floats
    """Expected distance of one more episode to the nearest of n, n = 1 … N − 1."""


@dataclass(frozen=True)
class GroupDiversity:
    """Diversity of the episodes of one template, level and map."""

    group: tuple[str, str, str]
    profiles: tuple[InteractionProfile, ...]
    """Profiles, sorted by seed and draw."""
    parameters: tuple[ParameterCoverage, ...]
    ways: Distances
    """Distances of the EMV's paths in metres."""
    events: Distances
    """Distances of the orders of events, as shares of the longer one."""
    transitions: KindCoverage

    @property
    def parameter_share(self) -> float | None:
        """Mean share of parts of the parameters' ranges that were reached; None if nothing is drawn."""
        return float(np.mean([parameter.share for parameter in self.parameters])) if self.parameters else None


def diversity(
    profiles: Sequence[InteractionProfile], ranges: Mapping[str, Mapping[str, DrawnRange]]
) -> tuple[GroupDiversity, ...]:
    """Diversity of every group; ``ranges`` are the ranges of each template's parameters."""
    groups: dict[tuple[str, str, str], list[InteractionProfile]] = {}
    for profile in profiles:
        groups.setdefault(profile.group, []).append(profile)
    return tuple(_group(group, members, ranges.get(group[0], {})) for group, members in sorted(groups.items()))


def _group(
    group: tuple[str, str, str], members: Sequence[InteractionProfile], ranges: Mapping[str, DrawnRange]
) -> GroupDiversity:
    profiles = tuple(sorted(members, key=lambda profile: (profile.seed, profile.draw, profile.bag)))
    parameters = parameter_coverage([profile.parameters for profile in profiles], ranges)
    ways, events = (_distances(distance_matrix(profiles, kind)) for kind in (way_distance_m, event_distance))
    transitions = kind_coverage([profile.transitions for profile in profiles])
    return GroupDiversity(group, profiles, parameters, ways, events, transitions)


def _distances(matrix: Floats) -> Distances:
    count = len(matrix)
    if count < 2:
        return Distances(0.0, np.full(count, np.nan), np.zeros(0))
    others = matrix + np.diag(np.full(count, np.inf))
    return Distances(float(matrix.sum() / (count * (count - 1))), others.min(axis=1), expected_nearest(matrix))


_GROUP: Final = ("template", "level", "map")


def diversity_tables(diversities: Sequence[GroupDiversity]) -> tuple[Table, Table]:
    """Tables of the groups, and of the novelty of each episode. A single episode has no distances and no forecast."""
    distances = ("ways apart, m", "nearest way, m", "events apart", "nearest events")
    groups = Table(
        "groups",
        "Diversity by template, level and map",
        (*_GROUP, "episodes", "ranges tried", *distances, "transitions", "next adds", "coverage"),
        tuple(map(_row, diversities)),
        specs={"ranges tried": ".0%", "coverage": ".0%", **dict.fromkeys((*distances[:2], "next adds"), ".1f")},
    )
    novelty = Table(
        "novelty",
        "Novelty of each episode: distance to the nearest other one",
        (*_GROUP, "seed", "draw", "nearest way, m", "nearest order of events"),
        tuple(
            (*profile.group, str(profile.seed), profile.draw, float(way), float(event))
            for group in diversities
            for profile, way, event in zip(group.profiles, group.ways.nearest, group.events.nearest, strict=True)
        ),
        specs={"nearest way, m": ".1f"},
        folded=True,
    )
    return groups, novelty


def _row(group: GroupDiversity) -> Row:
    seen, adds, coverage = group.transitions.seen, group.transitions.next_adds, group.transitions.coverage
    named = *group.group, len(group.profiles), group.parameter_share
    if len(group.profiles) == 1:
        return *named, *[None] * 4, seen, None, None
    distances = ((kind.mean, float(np.mean(kind.nearest))) for kind in (group.ways, group.events))
    return *named, *chain.from_iterable(distances), seen, adds, coverage


def diversity_as_json(diverse: GroupDiversity) -> dict[str, Any]:
    """One group as JSON types, with the novelty of each episode."""
    transitions = diverse.transitions
    novelty = zip(diverse.profiles, diverse.ways.nearest.tolist(), diverse.events.nearest.tolist(), strict=True)
    return {
        **dict(zip(_GROUP, diverse.group, strict=True)),
        "episodes": len(diverse.profiles),
        "parameters": {
            parameter.path: {
                "share": parameter.share,
                "episodes_by_part": list(parameter.counts),
                "share_by_episodes": parameter.curve.tolist(),
            }
            for parameter in diverse.parameters
        },
        "ways_m": _distances_as_json(diverse.ways),
        "events": _distances_as_json(diverse.events),
        "transitions": {
            "seen": transitions.seen,
            "in_one_episode": transitions.once,
            "next_episode_adds": transitions.next_adds,
            "coverage": transitions.coverage,
            "seen_by_episodes": transitions.curve.tolist(),
        },
        "novelty": [
            {
                "bag": profile.bag,
                "seed": profile.seed,
                "draw": profile.draw,
                "way_m": None if np.isnan(way) else way,
                "events": None if np.isnan(event) else event,
            }
            for profile, way, event in novelty
        ],
    }


def _distances_as_json(kind: Distances) -> dict[str, Any]:
    return {"mean": kind.mean if len(kind.curve) else None, "nearest_by_episodes": kind.curve.tolist()}
