"""The yield metrics: one function per measure of a driver, the EMV, the traffic behind it and safety; their table."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats
from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.tables import Measure
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.tracks import places_of, sumo_lanes
from siren_ros.scoring.evaluation.yielding.encounters import (
    CorridorSeries,
    EmvLine,
    Encounter,
    YieldThresholds,
    corridor_continuity,
    corridor_series,
    corridor_width_m,
    encounters_of,
)
from siren_ros.scoring.judging.outcome import NAMES
from siren_ros.scoring.judging.surrogate_safety import HORIZON_S, PairMeasures, conflict_series, pair_measures
from siren_ros.simulation.roads.road_network import NO_LANE, LaneKind
from siren_ros.simulation.roads.sites import middle_of_site
from siren_ros.simulation.scenario.paper import PAPER_SPEEDS
from siren_ros.simulation.world.actors import ActorClass, EventKind, Mode

_NOT_IN_THE_WAY = "the driver was not in the EMV's way"


def _why_not_asked(encounter: Encounter) -> str:
    """Reason why a driver need not make way (no EMV comes, no siren); empty if it must."""
    if not encounter.was_in_the_way:
        return _NOT_IN_THE_WAY
    return "" if encounter.with_siren else "no siren sounded"


def responds(encounter: Encounter, limits: YieldThresholds) -> Flags:
    """Whether the driver has responded, at each row before the EMV has passed; see ``response_time_s``."""
    speed = encounter.driver.track.speed_mps[encounter.until_passed]
    return np.asarray(shifted(encounter, limits.shift_m) | (speed <= speed[0] - limits.slowed_mps))


def shifted(encounter: Encounter, by_m: float) -> Flags:
    """Whether the driver is aside by so much of where it was first, at each row before the EMV has passed."""
    lateral = encounter.offsets.lateral_m
    return np.asarray(np.abs(lateral - lateral[0])[encounter.until_passed] >= by_m)


def response_time_s(encounter: Encounter, limits: YieldThresholds) -> Measure:
    """Time from the beginning of the encounter to the driver's first response.

    A response is a lateral shift of ``shift_m`` on the road, or a drop of the speed by ``slowed_mps``. Slowing for
    another reason counts too: the record does not say why somebody brakes. Without a siren nobody is asked.
    """
    if reason := _why_not_asked(encounter):
        return Measure.lacking(reason)
    responded = responds(encounter, limits)
    if not responded.any():
        return Measure.lacking("the driver did not respond")
    return Measure(int(np.argmax(responded)) * STEP_S)


def clearance_time_s(encounter: Encounter, _limits: YieldThresholds) -> Measure:
    """Time from the beginning of the encounter until the driver has left the EMV's strip.

    A driver that drives on ahead of the EMV until its line ends has not cleared it.
    """
    if reason := _why_not_asked(encounter):
        return Measure.lacking(reason)
    cleared = _cleared_row(encounter)
    if cleared < 0:
        return Measure((len(encounter.gap_m) - 1) * STEP_S, at_least=True)
    return Measure(cleared * STEP_S)


def complied(encounter: Encounter, limits: YieldThresholds) -> Measure:
    """1 if the way was clear before the EMV was ``clear_before_m`` behind the driver, otherwise 0."""
    if reason := _why_not_asked(encounter):
        return Measure.lacking(reason)
    close = encounter.gap_m <= limits.clear_before_m
    cleared = _cleared_row(encounter)
    if not close.any():
        return Measure(1.0) if cleared >= 0 else Measure.lacking("the EMV did not come up to the driver")
    return Measure(float(0 <= cleared <= int(np.argmax(close))))


def held_up_s(encounter: Encounter, limits: YieldThresholds) -> Measure:
    """Time in which the EMV stood or drove very slowly close behind the driver, while the driver was in its way."""
    if not encounter.was_in_the_way:
        return Measure.lacking(_NOT_IN_THE_WAY)
    close = (encounter.gap_m >= 0.0) & (encounter.gap_m <= limits.held_gap_m)
    slow = encounter.emv.track.speed_mps < limits.moving_mps
    return Measure(float(np.count_nonzero(close & slow & encounter.in_the_way)) * STEP_S)


def made_way_m(encounter: Encounter, _limits: YieldThresholds) -> Measure:
    """Largest lateral shift on the road before the EMV has passed, in metres, to either side."""
    lateral = encounter.offsets.lateral_m[encounter.until_passed]
    return Measure(float(np.abs(lateral - lateral[0]).max()))


def passing_gap_m(encounter: Encounter, _limits: YieldThresholds) -> Measure:
    """Smallest lateral gap between the two bodies while the EMV passes the driver."""
    next_to = np.abs(encounter.driver.arc_m - encounter.emv.arc_m) <= (
        encounter.driver.half_along_m + encounter.emv.half_along_m
    )
    if encounter.passed_row < 0 or not next_to.any():
        return Measure.lacking("the EMV did not pass the driver")
    apart = np.abs(encounter.driver.left_m - encounter.emv.left_m)
    gap = apart - encounter.driver.half_across_m - encounter.emv.half_across_m
    return Measure(float(gap[next_to].min()))


def recovery_time_s(encounter: Encounter, limits: YieldThresholds) -> Measure:
    """Time from the EMV's passing until the driver is back in its lane and at its earlier speed."""
    if encounter.passed_row < 0:
        return Measure.lacking("the EMV did not pass the driver")
    after = disturbed_rows(encounter, limits)[encounter.passed_row :]
    if after[-1]:
        return Measure((len(after) - 1) * STEP_S, at_least=True)
    return Measure(float(np.flatnonzero(after)[-1] + 1) * STEP_S if after.any() else 0.0)


def disturbed_rows(encounter: Encounter, limits: YieldThresholds) -> Flags:
    """Rows at which the driver is off its lane's centre line, or slower than before the encounter."""
    speed = encounter.driver.track.speed_mps
    slow = speed < limits.recovered_share * speed[0]
    return np.asarray(slow | (np.abs(encounter.offsets.offset_m) > limits.recovered_offset_m))


def _cleared_row(encounter: Encounter) -> int:
    """First row from which the driver stays out of the strip until the EMV passes; −1 if there is none."""
    before = encounter.in_the_way[encounter.until_passed]
    blocked = np.flatnonzero(before)
    cleared = int(blocked[-1]) + 1 if len(blocked) else 0
    return cleared if cleared < len(before) else -1


_AT_SITE_M = 30.0
"""An EMV that never comes nearer than this to the middle of its site does not pass it."""


def free_speed_mps(record: EpisodeRecord) -> Floats:
    """Speed that the EMV would drive on an empty road, at each of its steps, shape ``(M,)``.

    It is the template's target speed, on paths across junctions at most the speed at which the turn can be driven, and
    the same at all levels: the delay at L0 includes what obeying the limit and the signals costs.
    """
    target = record.description.template_values.get("emv.speed_mps", PAPER_SPEEDS.emv_route_follow_mps)
    track = record.track(record.emv_ids[0])
    free = np.full(len(track), target)
    for row, lane in enumerate(places_of(record, track).lane.tolist()):
        if lane != NO_LANE and record.network.lanes[lane].kind is LaneKind.INTERNAL:
            free[row] = min(target, record.network.lanes[lane].speed_limit_mps)
    return free


def lost_shares(record: EpisodeRecord) -> Floats:
    """Share of each step that the EMV loses against free flow, 1 − v / v_free; negative where it is faster."""
    return np.asarray(1.0 - record.track(record.emv_ids[0]).speed_mps / free_speed_mps(record))


def emv_delay_s(record: EpisodeRecord, _line: EmvLine, _limits: YieldThresholds) -> Measure:
    """Time that the EMV lost against free flow over its driven path: the integral of ``lost_shares``.

    As SUMO's time loss. The acceleration from its start counts, at all levels alike.
    """
    return Measure(float(np.sum(lost_shares(record)) * STEP_S))


def emv_stops(_record: EpisodeRecord, line: EmvLine, limits: YieldThresholds) -> Measure:
    """Number of stops of the EMV: it becomes slower than ``stop_mps`` after it was faster than ``moving_mps``."""
    stops, moving = 0, False
    for speed in line.emv.track.speed_mps.tolist():
        if moving and speed < limits.stop_mps:
            stops, moving = stops + 1, False
        elif speed > limits.moving_mps:
            moving = True
    return Measure(float(stops))


def emv_standstill_s(_record: EpisodeRecord, line: EmvLine, limits: YieldThresholds) -> Measure:
    """Time in which the EMV stood still."""
    return Measure(float(np.count_nonzero(line.emv.track.speed_mps < limits.stop_mps)) * STEP_S)


def emv_gap_escape_s(_record: EpisodeRecord, line: EmvLine, _limits: YieldThresholds) -> Measure:
    """Time in which the EMV drove in the mode ``gap_escape``."""
    return Measure(float(np.count_nonzero(line.emv.track.mode == Mode.GAP_ESCAPE)) * STEP_S)


def site_time_s(record: EpisodeRecord, line: EmvLine, _limits: YieldThresholds) -> Measure:
    """Time until the EMV reaches the middle of its site: of its junction, or half way along its road."""
    middle = middle_of_site(record.network, record.description.site)
    if middle is None:
        return Measure.lacking("the record names no site")
    track = line.emv.track
    distance = np.hypot(*(track.xy_m - middle).T)
    nearest = int(np.argmin(distance))
    if distance[nearest] > _AT_SITE_M or nearest == len(distance) - 1:
        return Measure(len(track) * STEP_S, at_least=True)
    return Measure(float(track.time_s[nearest]))


_NOBODY = "the EMV passed nobody"


def wake_duration_s(encounters: Sequence[Encounter], limits: YieldThresholds) -> Measure:
    """Longest time from the EMV's passing until a driver has recovered; a lower bound if the episode ends before."""
    times = [recovery_time_s(encounter, limits) for encounter in encounters if encounter.passed_row >= 0]
    if not times:
        return Measure.lacking(_NOBODY)
    longest = max(times, key=lambda time: time.value)
    return Measure(longest.value, at_least=any(time.at_least for time in times))


def wake_length_m(encounters: Sequence[Encounter], limits: YieldThresholds) -> Measure:
    """Largest distance along the line between the EMV and a driver behind it that has not recovered."""
    farthest_m = []
    for passed in (encounter for encounter in encounters if encounter.passed_row >= 0):
        after = slice(passed.passed_row, None)
        behind = (passed.emv.arc_m - passed.driver.arc_m)[after]
        farthest_m.append(float(np.max(behind, where=disturbed_rows(passed, limits)[after], initial=0.0)))
    return Measure(max(farthest_m)) if farthest_m else Measure.lacking(_NOBODY)


def civilian_delay_s(record: EpisodeRecord) -> Measure:
    """Vehicle-seconds that the civilians lost against the speed limit: the sum of ∫ (1 − v / v_limit) dt.

    Of those who are there at the first step: they are the same at all levels of a seed. People on two wheels do not
    count: no limit says how fast they go. As SUMO's time loss, with the limit of the lane and not the driver's own
    wish, which the record does not hold. Most of it is queues and signals; what counts is the difference between
    levels.
    """
    if not record.states:
        return Measure.lacking("the record has no step")
    rows = record.rows
    present = np.isin(rows.actor_id, record.states[0].actor_id)
    rows = rows.select(present & ~np.isin(rows.actor_id, [*record.emv_ids, *record.people_ids]))
    lane = sumo_lanes(record, rows)
    known = lane != NO_LANE
    if not known.any():
        return Measure.lacking("nobody was on a lane")
    limits = np.array([lane.speed_limit_mps for lane in record.network.lanes])
    lost = 1.0 - rows.speed_mps[known] / limits[lane[known]]
    return Measure(float(lost.sum() * STEP_S))


def min_ttc_s(conflicts: Sequence[PairMeasures]) -> Measure:
    """Least time to collision."""
    times = [pair.time_to_collision_s.value for pair in conflicts if pair.time_to_collision_s is not None]
    return Measure(min(times)) if times else Measure.lacking(f"no contact was ahead within {HORIZON_S:g} s")


def min_pet_s(conflicts: Sequence[PairMeasures]) -> Measure:
    """Least post-encroachment time."""
    times = [pair.encroachment.time_s for pair in conflicts if pair.encroachment is not None]
    return Measure(min(times)) if times else Measure.lacking("nobody crossed its way")


def min_gap_m(conflicts: Sequence[PairMeasures]) -> Measure:
    """Least gap between the bodies; negative where they overlap."""
    return Measure(min(pair.gap_m.value for pair in conflicts)) if conflicts else Measure.lacking("nobody was there")


def collisions(record: EpisodeRecord, actor_id: int | None = None) -> Measure:
    """Number of collisions of one actor, or of all."""
    pairs = [(event.actor_id, event.other_id) for event in record.events_of(EventKind.COLLISION)]
    return Measure(float(sum(actor_id is None or actor_id in pair for pair in pairs)))


class YieldScene:
    """An episode whose EMV moves. Each part is computed once, when a metric first needs it."""

    def __init__(self, record: EpisodeRecord, line: EmvLine, limits: YieldThresholds) -> None:
        self.record, self.line, self.limits = record, line, limits
        self._conflicts: dict[int, tuple[PairMeasures, ...]] = {}

    @cached_property
    def encounters(self) -> tuple[Encounter, ...]:
        """Encounters of the EMV with drivers."""
        return tuple(encounters_of(self.record, self.line, self.limits))

    @cached_property
    def corridor(self) -> CorridorSeries:
        """The corridor over time."""
        return corridor_series(self.record, self.line, self.limits)

    def conflicts_of(self, actor_id: int | None = None) -> tuple[PairMeasures, ...]:
        """Surrogate safety measures of an actor, or of the EMV, with all other actors."""
        subject = self.record.emv_ids[0] if actor_id is None else actor_id
        if subject not in self._conflicts:
            self._conflicts[subject] = pair_measures(*conflict_series(self.record, subject))
        return self._conflicts[subject]


@dataclass(frozen=True)
class Metric:
    """A metric of an episode, or of one driver's encounter with the EMV."""

    name: str
    meaning: str
    compute: Callable[..., Measure]
    """Computes the metric from the ``YieldScene``, and for a driver from the ``Encounter``."""


_DriverMark = Callable[[Encounter, YieldThresholds], Measure]


def _of_driver(mark: _DriverMark) -> Callable[[YieldScene, Encounter], Measure]:
    return lambda scene, encounter: mark(encounter, scene.limits)


DRIVER_METRICS: Final = (
    Metric("response_time_s", "time until the driver first shifted or slowed down", _of_driver(response_time_s)),
    Metric("clearance_time_s", "time until the driver was out of the EMV's way", _of_driver(clearance_time_s)),
    Metric("compliance", "1 if the way was clear before the EMV came close, otherwise 0", _of_driver(complied)),
    Metric("held_up_s", "time for which the EMV was stuck behind the driver", _of_driver(held_up_s)),
    Metric("made_way_m", "lateral shift before the EMV passed", _of_driver(made_way_m)),
    Metric("passing_gap_m", "lateral gap as the EMV passed", _of_driver(passing_gap_m)),
    Metric(
        "recovery_time_s",
        "time from the passing until the driver was back at its speed and in its lane",
        _of_driver(recovery_time_s),
    ),
    Metric("min_ttc_s", "least TTC with any vehicle", lambda scene, met: min_ttc_s(scene.conflicts_of(met.actor_id))),
    Metric("min_pet_s", "least PET with any vehicle", lambda scene, met: min_pet_s(scene.conflicts_of(met.actor_id))),
    Metric("collisions", "collisions of the driver", lambda scene, met: collisions(scene.record, met.actor_id)),
)


def _of_emv(mark: Callable[[EpisodeRecord, EmvLine, YieldThresholds], Measure]) -> Callable[[YieldScene], Measure]:
    return lambda scene: mark(scene.record, scene.line, scene.limits)


def of_drivers(
    scene: YieldScene, mark: _DriverMark, statistic: Callable[[list[float]], np.floating[Any] | float]
) -> Measure:
    """A statistic of a driver metric over all drivers for whom it has a value."""
    measures = [mark(encounter, scene.limits) for encounter in scene.encounters]
    known = [measure for measure in measures if measure.valid]
    if not known:
        return Measure.lacking("no driver had to make way")
    value = float(statistic([measure.value for measure in known]))
    return Measure(value, at_least=any(measure.at_least for measure in known))


def _with(scene: YieldScene, kind: ActorClass) -> tuple[PairMeasures, ...]:
    """Surrogate safety measures of the EMV with the people of a class."""
    return tuple(pair for pair in scene.conflicts_of() if scene.record.actors[pair.actor_id].actor_class is kind)


def max_drac_mps2(conflicts: Sequence[PairMeasures]) -> Measure:
    """Largest required deceleration."""
    needed = [pair.required_deceleration_mps2.value for pair in conflicts if pair.required_deceleration_mps2]
    if np.inf in needed:
        return Measure.lacking("they touched")
    return Measure(max(needed)) if needed else Measure.lacking(f"no contact was ahead within {HORIZON_S:g} s")


_MEASURES_WITH: Final = (
    ("min_ttc_s", "least TTC of the EMV", min_ttc_s),
    ("max_drac_mps2", "greatest DRAC of the EMV", max_drac_mps2),
    ("min_pet_s", "least PET of the EMV", min_pet_s),
)
PEOPLE_METRICS: Final = tuple(
    Metric(f"{name}_{people}", f"{meaning} with {people}", lambda scene, k=kind, m=measure: m(_with(scene, k)))
    for kind, people in NAMES.items()
    for name, meaning, measure in _MEASURES_WITH
)
"""Metrics with people; tables show those that have a value."""
EPISODE_METRICS: Final = (
    Metric("site_time_s", "time until the EMV is at the middle of its site", _of_emv(site_time_s)),
    Metric("emv_delay_s", "time that the EMV lost against free flow", _of_emv(emv_delay_s)),
    Metric("emv_stops", "stops of the EMV", _of_emv(emv_stops)),
    Metric("emv_standstill_s", "time for which the EMV stood", _of_emv(emv_standstill_s)),
    Metric("emv_gap_escape_s", "time for which the EMV was in gap escape", _of_emv(emv_gap_escape_s)),
    Metric(
        "corridor_width_m",
        "median width of the way ahead through the traffic",
        lambda scene: corridor_width_m(scene.corridor),
    ),
    Metric(
        "corridor_continuity",
        "share of the time at which the EMV fitted through, 30 m ahead",
        lambda scene: corridor_continuity(scene.corridor),
    ),
    Metric(
        "drivers_in_the_way",
        "drivers who had to make way",
        lambda scene: Measure(float(sum(encounter.was_in_the_way for encounter in scene.encounters))),
    ),
    Metric(
        "response_time_s",
        "median time until those drivers first shifted or slowed down",
        lambda scene: of_drivers(scene, response_time_s, np.median),
    ),
    Metric(
        "clearance_time_s",
        "median time until they were out of the way",
        lambda scene: of_drivers(scene, clearance_time_s, np.median),
    ),
    Metric(
        "compliance", "share of them that cleared the way in time", lambda scene: of_drivers(scene, complied, np.mean)
    ),
    Metric(
        "held_up_s", "time for which the EMV was stuck behind them", lambda scene: of_drivers(scene, held_up_s, sum)
    ),
    Metric(
        "wake_duration_s",
        "longest recovery of a driver after the passing",
        lambda scene: wake_duration_s(scene.encounters, scene.limits),
    ),
    Metric(
        "wake_length_m",
        "farthest disturbed driver behind the EMV",
        lambda scene: wake_length_m(scene.encounters, scene.limits),
    ),
    Metric("civilian_delay_s", "vehicle-seconds that the civilians lost", lambda scene: civilian_delay_s(scene.record)),
    Metric("min_ttc_s", "least TTC of the EMV", lambda scene: min_ttc_s(scene.conflicts_of())),
    Metric("min_pet_s", "least PET of the EMV", lambda scene: min_pet_s(scene.conflicts_of())),
    Metric("collisions", "collisions of all vehicles", lambda scene: collisions(scene.record)),
    *PEOPLE_METRICS,
)
