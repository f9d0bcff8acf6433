"""The outcome of an episode: the verdict of its predicate, its people, residuals, the AV's response, and other figures.

The predicates decide from the record alone whether a template's interaction happened.

People (pedestrians, cyclists, motorcyclists) are counted: how many are near, how many interact. A person *meets* a
driver where their ways cross with a post-encroachment time (PET) of at most 5 s, or where they would touch within 1.5 s
if both went on as they do now (TTC). These are the limits of the surrogate safety assessment model (Gettman et al.,
FHWA-HRT-08-051, 2008); PETs up to 5 s are also the interactions of Zangenehpour et al., Accident Analysis and
Prevention 86 (2016) 161. An encounter counts with an EMV, and with a civilian while that one makes way.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Self

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Ids, Points
from siren_ros.base.numerics.units import STEP_S, steps_from_s
from siren_ros.data.interfaces.conversions import EpisodeClosing
from siren_ros.data.recording.episode_record import EpisodeRecord, RecordBuilder, StateRows
from siren_ros.data.tracks import ahead_and_left_m, common_rows, places_of
from siren_ros.errors import BagError, SirenError
from siren_ros.scoring.judging.corridor_templates import STANDING_MPS as AT_REST_MPS
from siren_ros.scoring.judging.corridor_templates import queues_split, rescue_lane
from siren_ros.scoring.judging.junction_templates import (
    red_crossing,
    red_same_direction,
    shoulder_turn,
    stop_crossing,
    stop_same_direction,
)
from siren_ros.scoring.judging.lane_clearance import lane_cleared
from siren_ros.scoring.judging.surrogate_safety import encounters_of, post_encroachment, predicted_contacts
from siren_ros.scoring.judging.traversals import find_traversals
from siren_ros.scoring.judging.verdict import (
    Moment,
    Part,
    Verdict,
    at_least,
    at_most,
    listed,
    verdict_of,
    with_sides_exchanged,
)
from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.roads.sites import middle_of_site
from siren_ros.simulation.scenario import scenario as declared
from siren_ros.simulation.scenario.episode import DEMAND_PARAMETER, EpisodeOutcome
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.traffic.demand.own_demand import NAME_START, OwnDemand
from siren_ros.simulation.world.actors import NO_ACTOR, ActorClass, EventKind, Mode, Owner, rows_of_ids

Predicate = Callable[[EpisodeRecord, Mapping[str, float]], Verdict]

PREDICATES: Final[dict[str, Predicate]] = {
    declared.QUEUES_SPLIT.name: queues_split,
    declared.LANE_CLEARED.name: lane_cleared,
    declared.RED_SAME_DIRECTION.name: red_same_direction,
    declared.RED_CROSSING.name: red_crossing,
    declared.STOP_SAME_DIRECTION.name: stop_same_direction,
    declared.STOP_CROSSING.name: stop_crossing,
    declared.SHOULDER_TURN.name: shoulder_turn,
    declared.RESCUE_LANE.name: rescue_lane,
}
"""Predicates by the name in a template's file."""
PARAMETER: Final = "predicate"
"""Key of ``EpisodeDescription.parameters`` that holds ``{"name": …, "thresholds": {…}}``."""


def predicate_of(record: EpisodeRecord) -> tuple[str, Mapping[str, float]]:
    """Name and thresholds of the record's predicate, or else those of the episode's template.

    Raises:
        BagError: The record names an unknown predicate, or a threshold is missing or not a number.
        InputError: The record names none, and its template is unknown here.
    """
    stored = record.description.parameters.get(PARAMETER)
    if stored is None:
        predicate = load_template(record.description.template).predicate
        return predicate.name, predicate.thresholds
    name = stored.get("name") if isinstance(stored, Mapping) else None
    thresholds = stored.get("thresholds") if isinstance(stored, Mapping) else None
    numbers = isinstance(thresholds, Mapping) and all(isinstance(value, int | float) for value in thresholds.values())
    if name not in PREDICATES or not isinstance(thresholds, Mapping) or not numbers:
        raise BagError(f"predicate {stored!r}", f"one of {', '.join(PREDICATES)}, with numbers as thresholds")
    for threshold in declared.DECLARED_PREDICATES[str(name)].thresholds:
        if threshold not in thresholds:
            raise BagError(f"predicate {name}", f"a threshold named {threshold}")
    return str(name), {str(key): float(value) for key, value in thresholds.items()}


def evaluate_predicate(record: EpisodeRecord) -> Verdict:
    """Decide whether the interaction of the episode's template happened; raises as ``predicate_of``.

    It has to happen to the first EMV. Those that cross its way have to pass the junction at which they do. Where
    traffic keeps left, the mirror image is judged, and the verdict's words are mirrored again.
    """
    name, thresholds = predicate_of(record)
    verdict = _judged(record, name, thresholds)
    crossing = [_crossing(record, emv_id) for emv_id in record.description.crossed_junctions]
    if not crossing:
        return verdict
    parts = (*verdict.parts, *(part for other in crossing for part in other.parts))
    return verdict_of(parts, "; ".join((verdict.text, *(other.text for other in crossing))))


def verdicts_of_others(record: EpisodeRecord) -> dict[int, Verdict]:
    """Verdict for each EMV except the first, by its id.

    Of one that crosses the first one's way it is whether it passed the junction, of others the template's interaction.
    """
    name, thresholds = predicate_of(record)
    crossed = record.description.crossed_junctions
    return {
        emv_id: _crossing(seen, emv_id) if emv_id in crossed else _judged(seen, name, thresholds)
        for emv_id, seen in list(zip(record.emv_ids, record.by_emv(), strict=True))[1:]
    }


def _judged(record: EpisodeRecord, name: str, thresholds: Mapping[str, float]) -> Verdict:
    verdict = PREDICATES[name](record.right_hand, thresholds)
    verdict = with_sides_exchanged(verdict) if record.network.left_hand else verdict
    stands = [_stands(record, emv_id, thresholds) for emv_id in record.emv_ids[:1]]
    return verdict_of((*verdict.parts, *stands), verdict.text)


def _stands(record: EpisodeRecord, emv_id: int, thresholds: Mapping[str, float]) -> Part:
    """Whether an EMV gets through: it stands for some seconds at most, at a time."""
    track = under_way(record, emv_id)
    longest_s, row = longest_standstill(track.speed_mps)
    most_s = thresholds.get(declared.STANDS_MAX, declared.STANDS_MAX_S)
    moments = [Moment(int(track.step[row]), emv_id)] if longest_s else []
    return at_most("standstill_s", longest_s, most_s, listed(moments), *moments)


_ARRIVED_M: Final = 15.0
"""Largest distance from an EMV's centre to the end of its road at which it has arrived: half of a fire truck, and the
space that it leaves before the end."""


def under_way(record: EpisodeRecord, emv_id: int) -> StateRows:
    """An EMV's track without its last stand where its road ends at the border of the map: it has arrived there."""
    track, network = record.track(emv_id), record.network
    end = int(np.flatnonzero(track.speed_mps > AT_REST_MPS).max(initial=-1)) + 1
    place = places_of(record, track.select(np.arange(len(track))[-1:]))
    if end == len(track) or place.lane[0] == NO_LANE:
        return track
    lane = network.lanes[place.lane[0]]
    leads_on = any(network.connections_from.get(other) for other in network.edges[lane.edge].lanes)
    arrived = not leads_on and lane.length_m - float(place.arc_m[0]) <= _ARRIVED_M
    return track.select(np.arange(end)) if arrived else track


def longest_standstill(speed_mps: Floats) -> tuple[float, int]:
    """Longest uninterrupted time for which an actor stands, in seconds, and the row at which it begins.

    The speeds are those of consecutive steps. A vehicle that rolls out, below 0.3 m/s, stands.
    """
    still = np.concatenate(([False], speed_mps <= AT_REST_MPS, [False])).astype(np.int8)
    begins, ends = np.flatnonzero(np.diff(still) == 1), np.flatnonzero(np.diff(still) == -1)
    if not len(begins):
        return 0.0, 0
    longest = int(np.argmax(ends - begins))
    return float(ends[longest] - begins[longest]) * STEP_S, int(begins[longest])


def _crossing(record: EpisodeRecord, emv_id: int) -> Verdict:
    """Verdict whether an EMV has passed, and left, the junction at which it crosses the first one's path."""
    junction, last = record.description.crossed_junctions[emv_id], record.states[-1].step if record.states else 0
    passed = [
        one
        for one in find_traversals(record)
        if one.actor_id == emv_id and record.network.connections[one.connection].junction == junction
        if one.leave_step <= last
    ]
    when = ", ".join(f"from {one.enter_step * STEP_S:.1f} s to {one.leave_step * STEP_S:.1f} s" for one in passed)
    out = [Moment(one.leave_step, emv_id) for one in passed]
    part = at_least(f"crossing_emv_{emv_id}", len(out), 1, when, *out)
    return verdict_of((part,), f"EMV {emv_id} {'passed' if passed else 'did not pass'} junction {junction}")


NAMES: Final = {
    ActorClass.PEDESTRIAN: "pedestrians",
    ActorClass.BICYCLE: "cyclists",
    ActorClass.MOTORCYCLE: "motorcycles",
}
"""Names of the classes of people in a template's demand."""
PEOPLE_NEAR_M: Final = 150.0
"""A person is near an EMV within this distance of the centres; the demand places people up to this far."""
_BODIES_M: Final = 10.0
"""Larger than half the diagonals of two bodies together."""
PET_MAX_S: Final = 5.0
TTC_MAX_S: Final = 1.5


@dataclass(frozen=True)
class PeopleOfClass:
    """Counts of people of one class in an episode."""

    near: int
    """Number of people that come within ``PEOPLE_NEAR_M`` of an EMV."""
    near_median: int
    """Number of people present at once, as median over the steps."""
    with_emv: int
    """Number of people that meet an EMV."""
    with_yielding: int
    """Number of people that meet a yielding civilian."""
    met: int
    """Number of people that meet an EMV or a yielding civilian."""


def people_of(record: EpisodeRecord) -> dict[ActorClass, PeopleOfClass]:
    """Counts by class; empty for an episode without people."""
    people = _People.of(record)
    if people is None:
        return {}
    with_emv, with_yielding = set[int](), set[int]()
    near = np.zeros((len(people.ids), record.steps), np.bool_)
    for emv_id in record.emv_ids:
        if len(track := record.track(emv_id)):
            pairs = encounters_of(record, emv_id, people.ids.tolist())
            close = pairs.select(pairs.distance_m <= PEOPLE_NEAR_M)
            near[rows_of_ids(people.ids, close.actor_id), close.step - record.states[0].step] = True
            with_emv |= people.met_by(emv_id, track)
    for actor_id in sorted(record.actors.keys() - set(record.emv_ids)):
        track = record.track(actor_id)
        yields = (track.mode >= Mode.YIELD_REACTING) & (track.mode <= Mode.YIELD_HOLD)
        if yields.any():
            with_yielding |= people.met_by(actor_id, track.select(yields))
    found = {}
    for kind in NAMES:
        of_kind = np.array([record.actors[key].actor_class is kind for key in people.ids.tolist()])
        own = set(people.ids[of_kind].tolist())
        found[kind] = PeopleOfClass(
            near=int(near[of_kind].any(axis=1).sum()),
            near_median=int(np.median(near[of_kind].sum(axis=0))),
            with_emv=len(own & with_emv),
            with_yielding=len(own & with_yielding),
            met=len(own & (with_emv | with_yielding)),
        )
    return found


def people_measures(record: EpisodeRecord) -> dict[str, int]:
    """Counts as an episode's outcome stores them; empty for an episode without people."""
    found = people_of(record)
    measures = {f"people.{NAMES[kind]}.{name}": n for kind, own in found.items() for name, n in asdict(own).items()}
    return measures | ({"people.met": sum(own.met for own in found.values())} if found else {})


@dataclass(frozen=True)
class _People:
    """All people of a record, with each one's bounding box and top speed."""

    record: EpisodeRecord
    ids: Ids
    low_m: Points
    high_m: Points
    top_mps: Floats

    @classmethod
    def of(cls, record: EpisodeRecord) -> Self | None:
        """Collect the people of a record; None if there are none."""
        rows = record.rows.select(np.isin(record.rows.actor_id, record.people_ids))
        ids, first = np.unique(rows.actor_id, return_index=True)
        if not len(ids):
            return None
        low, high = (function.reduceat(rows.xy_m, first) for function in (np.minimum, np.maximum))
        return cls(record, ids, low, high, np.maximum.reduceat(rows.speed_mps, first))

    def met_by(self, subject_id: int, mine: StateRows) -> set[int]:
        """People whom a driver meets on a part of its own track."""
        body = self.record.actors[subject_id]
        size_m, xy = (body.length_m, body.width_m), mine.xy_m
        gap_m = np.maximum(xy.min(axis=0) - self.high_m, self.low_m - xy.max(axis=0)).max(axis=1)
        way_m = (self.top_mps + mine.speed_mps.max()) * TTC_MAX_S
        around = (gap_m <= _BODIES_M + way_m) & (self.ids != subject_id)
        if not around.any():
            return set()
        pairs = encounters_of(self.record, subject_id, self.ids[around].tolist())
        on_course = pairs.distance_m <= pairs.reach_m + pairs.fastest_mps * TTC_MAX_S
        course = pairs.select(on_course & np.isin(pairs.step, mine.step))
        met = set(course.actor_id[predicted_contacts(course).time_s <= TTC_MAX_S].tolist())
        moves = _moving(mine)
        for actor_id in set(self.ids[around & (gap_m <= _BODIES_M)].tolist()) - met:
            other = self.record.actors[actor_id]
            track = _moving(self.record.track(actor_id))
            pet = post_encroachment(moves, track, size_m, (other.length_m, other.width_m))
            if pet is not None and pet.time_s <= PET_MAX_S:
                met.add(actor_id)
        return met


def _moving(track: StateRows) -> StateRows:
    """A track without the inner steps of each standstill, which add no new position."""
    moved = np.hypot(np.diff(track.x_m), np.diff(track.y_m)) > 0.0
    return track.select(np.append(True, moved) | np.append(moved, True))


HEARD_M: Final = 40.0
"""The AV hears the siren within this distance between the centres (paper: response distance)."""
STANDING_MPS: Final = 1.0
ARRIVAL_M: Final = 30.0
"""An EMV that never comes nearer than this to the conflict point does not arrive."""
QUEUE_RANGE_M: Final = 50.0
"""Standing vehicles within this radius of the EMV are its queue (paper: outer radius of the interaction region)."""
BEFORE_ARRIVAL_S: Final = 3.0
"""The queue is counted this long before the EMV arrives, when it is still ahead."""


@dataclass(frozen=True)
class ResidualSummary:
    """Statistics of the residuals over all actors and steps; zeros if SUMO owns no actor."""

    median_m: float
    p99_m: float
    max_m: float


def summarise_residuals(record: EpisodeRecord) -> ResidualSummary:
    """Median, 99th percentile and largest value of an episode's residuals."""
    rows = record.rows
    residual_m = rows.residual_m[rows.owner == Owner.SUMO]
    if not len(residual_m):
        return ResidualSummary(0.0, 0.0, 0.0)
    median_m, p99_m = np.percentile(residual_m, (50, 99))
    return ResidualSummary(float(median_m), float(p99_m), float(residual_m.max()))


@dataclass(frozen=True)
class AvResponse:
    """How the AV under test responds to the EMV."""

    heard_s: float = -1.0
    """Simulated time at which the EMV came within ``HEARD_M`` from behind; −1 if it never did."""
    passed_after_s: float = -1.0
    """Time from ``heard_s`` until the EMV's centre was ahead of the AV's; −1 if it did not pass."""
    speed_drop_mps: float = 0.0
    """Speed at ``heard_s`` minus the lowest speed until the EMV had passed."""
    moved_right_m: float = 0.0
    """Largest displacement to the right of the AV's line of travel at ``heard_s``; to the left in left-hand traffic."""
    closest_m: float = 0.0
    """Smallest distance between the two centres."""
    collisions: int = 0
    """Number of collisions of the AV with any vehicle."""

    def measures(self) -> dict[str, float | int | str]:
        """The values as an episode's outcome stores them."""
        return {f"av.{name}": value for name, value in vars(self).items()}


def av_response(record: EpisodeRecord) -> AvResponse | None:
    """Response of the AV under test to the first EMV, which comes from behind; None in episodes without an AV."""
    av_id = record.description.av_id
    if av_id == NO_ACTOR or not record.emv_ids:
        return None
    record = record.right_hand
    av, emv = common_rows(record.track(av_id), record.track(record.emv_ids[0]))
    collisions = sum(av_id in {event.actor_id, event.other_id} for event in record.events_of(EventKind.COLLISION))
    if not len(av):
        return AvResponse(collisions=collisions)
    away = emv.xy_m - av.xy_m
    distance = np.hypot(away[:, 0], away[:, 1])
    ahead = ahead_and_left_m(av, emv)[0] > 0.0
    within = np.flatnonzero((distance <= HEARD_M) & ~ahead)
    if not len(within):
        return AvResponse(closest_m=float(distance.min()), collisions=collisions)
    first = int(within[0])
    passed = first + int(np.argmax(ahead[first:])) if ahead[first:].any() else -1
    until = slice(first, passed + 1 if passed >= 0 else None)
    yaw = float(av.yaw_rad[first])
    line = av.xy_m[until] - av.xy_m[first]
    right = line[:, 0] * np.sin(yaw) - line[:, 1] * np.cos(yaw)
    return AvResponse(
        heard_s=float(av.time_s[first]),
        passed_after_s=(passed - first) * STEP_S if passed >= 0 else -1.0,
        speed_drop_mps=float(av.speed_mps[first] - av.speed_mps[until].min()),
        moved_right_m=float(right.max()),
        closest_m=float(distance.min()),
        collisions=collisions,
    )


@dataclass(frozen=True)
class Realisation:
    """Figures of one episode that differ between seeds; the EMV is the first one."""

    arrival_s: float
    """Time at which the EMV is nearest to the site's conflict point; NaN if it never comes within 30 m."""
    queue: int
    """Number of civilians that stand around the EMV before it arrives."""
    yielding: int
    """Number of civilians that begin to yield."""
    emv_speed_mps: float
    """Mean speed of the EMV over the episode."""


def realisation_of(record: EpisodeRecord) -> Realisation:
    """Compute these figures; the conflict point is the site's junction, or the middle of its road."""
    track = record.track(record.emv_ids[0])
    conflict = middle_of_site(record.network, record.description.site)
    distance = np.hypot(*(track.xy_m - conflict).T) if conflict is not None else np.full(len(track), np.inf)
    nearest = int(np.argmin(distance))
    arrives = bool(distance[nearest] < ARRIVAL_M)
    counted = max(nearest - steps_from_s(BEFORE_ARRIVAL_S), 0)
    states = record.states[int(track.step[counted]) - record.states[0].step]
    near = np.hypot(states.x_m - track.x_m[counted], states.y_m - track.y_m[counted]) < QUEUE_RANGE_M
    civilian = ~np.isin(states.actor_id, record.emv_ids)
    return Realisation(
        arrival_s=float(track.step[nearest]) * STEP_S if arrives else float("nan"),
        queue=int(np.count_nonzero(near & civilian & (states.speed_mps < STANDING_MPS))),
        yielding=len({event.actor_id for event in record.events_of(EventKind.YIELD_STARTED)}),
        emv_speed_mps=float(track.speed_mps.mean()),
    )


def demand_measures(record: EpisodeRecord) -> dict[str, int | str]:
    """The user's own traffic as an episode's outcome names it; empty for an episode with the template's."""
    own = OwnDemand.of_json(record.description.parameters.get(DEMAND_PARAMETER))
    if own is None:
        return {}
    ids = [key for key, actor in record.actors.items() if actor.name.startswith(NAME_START)]
    pairs = [encounters_of(record, emv_id, ids) for emv_id in record.emv_ids]
    near = {key for one in pairs for key in one.actor_id[one.distance_m <= PEOPLE_NEAR_M].tolist()}
    return {
        "demand.source": f"{own.source} (SHA-256 {own.sha256})",
        "demand.left_out": "; ".join(own.left_out) or "nothing",
        "demand.vehicles": len(ids),
        "demand.near_emv": len(near),
    }


def _drive_of(record: EpisodeRecord, emv_id: int) -> dict[str, float]:
    """Distance, mean speed and standing of an EMV; empty if it was never present."""
    emv = record.track(emv_id)
    if not len(emv):
        return {}
    distance_m = float(np.sum(np.hypot(np.diff(emv.x_m), np.diff(emv.y_m))))
    return {
        "distance_m": distance_m,
        "mean_speed_mps": float(np.mean(emv.speed_mps)),
        "standing_share": float(np.mean(emv.speed_mps <= AT_REST_MPS)),
        "standstill_s": longest_standstill(under_way(record, emv_id).speed_mps)[0],
    }


def judge(builder: RecordBuilder, closing: EpisodeClosing) -> EpisodeOutcome:
    """Judge an episode that has just ended; ``predicate_holds`` is None if it cannot be judged."""
    try:
        return outcome_of(builder.build(), closing)
    except SirenError as error:
        return EpisodeOutcome(closing.end, closing.reason, closing.steps, None, {"predicate": str(error)})


def outcome_of(record: EpisodeRecord, closing: EpisodeClosing) -> EpisodeOutcome:
    """The outcome of a record; raises as ``evaluate_predicate``."""
    verdict = evaluate_predicate(record)
    residual = summarise_residuals(record)
    measures: dict[str, Any] = {
        "predicate": verdict.text,
        **{f"predicate.{name}": value for name, value in verdict.measures().items()},
        "actors": len(record.actors),
        "collisions": len(record.events_of(EventKind.COLLISION)),
        "yields_started": len(record.events_of(EventKind.YIELD_STARTED)),
        "yields_completed": len(record.events_of(EventKind.YIELD_COMPLETED)),
        "yields_deferred": len(record.events_of(EventKind.YIELD_DEFERRED)),
        "residual_p99_m": residual.p99_m,
        "residual_max_m": residual.max_m,
    }
    for emv_id in record.emv_ids[:1]:
        measures |= {f"emv_{name}": value for name, value in _drive_of(record, emv_id).items()}
    for emv_id, other in verdicts_of_others(record).items():
        told = {"predicate": other.text, "predicate_holds": int(other.holds), **_drive_of(record, emv_id)}
        measures |= {f"emv{emv_id}.{name}": value for name, value in told.items()}
    if (response := av_response(record)) is not None:
        measures.update(response.measures())
    measures |= people_measures(record) | demand_measures(record)
    return EpisodeOutcome(closing.end, closing.reason, closing.steps, verdict.holds, measures)
