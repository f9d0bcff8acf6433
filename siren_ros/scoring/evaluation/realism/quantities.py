"""What an episode shows of the quantities that were measured on streets: one function a quantity, and their table.

A function returns samples, NaN-free, as many as the episode has; none is an answer too. Shares have samples of 0 and 1.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Final, Self

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.tracks import places_of, sumo_lanes
from siren_ros.scoring.evaluation.realism import road_tracks
from siren_ros.scoring.evaluation.realism.road_tracks import RoadTracks
from siren_ros.scoring.evaluation.yielding.encounters import (
    CorridorSeries,
    EmvLine,
    Encounter,
    YieldThresholds,
    corridor_series,
    encounters_of,
    lane_offsets,
)
from siren_ros.scoring.evaluation.yielding.metrics import clearance_time_s, responds, shifted, site_time_s
from siren_ros.scoring.judging.surrogate_safety import conflict_series, pair_measures
from siren_ros.scoring.judging.traversals import RED, Traversal, find_traversals, signal_letter
from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.roads.routing import crossing_connections
from siren_ros.simulation.roads.sites import SiteKind
from siren_ros.simulation.scenario.presets import load_preset
from siren_ros.simulation.scenario.templates import own_level
from siren_ros.simulation.world.actors import EventKind, Lights

HEARD_M: Final = 150.0
"""Gap at which drivers are looked at first: three times the range at which a siren is heard, so that a driver who makes
way far too early is seen, too."""
SEEN_M: Final = 400.0
"""Gap in a motorway's jam at which drivers are looked at first: farther than a mirror shows blue lights."""
CRITICAL_TTC_S: Final = 1.5
"""Time to collision of a serious conflict (FHWA-HRT-08-051, Surrogate Safety Assessment Model)."""
CRITICAL_PET_S: Final = 1.0
"""Post-encroachment time of a serious conflict (Allen, Shin and Cooper, Transp. Res. Rec. 667 (1978) 67)."""
CRITICAL_BRAKE_MPS2: Final = 3.5
"""Deceleration that drivers of emergency vehicles feel as hard: the comfortable one of stopping sight distance is
3.4 m/s² (AASHTO Green Book)."""
_SITUATION_APART_S: Final = 2.0
"""Moments with less time between them belong to one situation."""
_SETTLED_MPS: Final = 0.1
_CHANGED_M: Final = 2.0
"""Lateral way of a lane change: more than half of a lane."""


class RealismScene:
    """An episode with everything that the quantities share; each part is computed once, when it is first needed."""

    def __init__(self, record: EpisodeRecord) -> None:
        self.record = record.right_hand

    @cached_property
    def line(self) -> EmvLine | None:
        """The first EMV's line; None if it does not move."""
        return EmvLine.of(self.record) if self.record.emv_ids else None

    @cached_property
    def seen(self) -> tuple[Encounter, ...]:
        """Drivers ahead of the EMV from a gap of 150 m on, in a motorway's jam of 400 m."""
        limits = YieldThresholds(encounter_m=SEEN_M if self.in_rescue_lane else HEARD_M)
        return () if self.line is None else tuple(encounters_of(self.record, self.line, limits))

    @cached_property
    def heard(self) -> tuple[Encounter, ...]:
        """Drivers ahead of an EMV whose siren sounds, from a gap of 150 m on."""
        return _with_siren(self.seen, HEARD_M)

    @cached_property
    def near(self) -> tuple[Encounter, ...]:
        """Drivers ahead of an EMV whose siren sounds, from the gap of the paper's region, 40 m, on."""
        return _with_siren(self.seen, YieldThresholds.encounter_m)

    @cached_property
    def traversals(self) -> tuple[Traversal, ...]:
        """Passages of all vehicles over junctions."""
        return find_traversals(self.record)

    @cached_property
    def corridor(self) -> CorridorSeries | None:
        """The way through the traffic ahead of the EMV."""
        return None if self.line is None else corridor_series(self.record, self.line, YieldThresholds())

    @cached_property
    def ordinary(self) -> RoadTracks:
        """Tracks of the traffic that no siren is near."""
        return RoadTracks.of_record(self.record)

    @cached_property
    def situations(self) -> tuple[int, float, float]:
        """Number of critical situations, time in them, and time of driving with the siren."""
        return _situations(self)

    @property
    def in_rescue_lane(self) -> bool:
        """Whether the template is one of the motorway's jam."""
        return self.record.description.site.get("kind") == SiteKind.MOTORWAY_STRETCH.value

    @property
    def siren_sounds(self) -> bool:
        """Whether the EMV drives with its siren at any time."""
        return self.line is not None and bool((self.line.emv.track.lights & Lights.SIREN).any())


def _with_siren(seen: Iterable[Encounter], gap_m: float) -> tuple[Encounter, ...]:
    nearer = (one.nearer(YieldThresholds(encounter_m=gap_m)) for one in seen)
    return tuple(one for one in nearer if one is not None and one.with_siren)


def time_to_site_s(scene: RealismScene) -> Floats:
    """Time until the EMV is at its site; that of the whole episode where it does not come there."""
    if scene.line is None:
        return np.empty(0)
    time = site_time_s(scene.record, scene.line, YieldThresholds())
    return np.array([time.value]) if time.valid else np.empty(0)


def moved(scene: RealismScene) -> Floats:
    """Whether each driver whom the EMV met from behind changed its lateral position before the EMV had passed."""
    return np.array([float(shifted(one, YieldThresholds.shift_m).any()) for one in scene.near if one.passed_row >= 0])


def lane_change_distance_m(scene: RealismScene) -> Floats:
    """Gap to the EMV at which drivers in its way who changed lane began to: at the first shift of 0.3 m."""
    changed = (one for one in scene.heard if one.was_in_the_way and shifted(one, _CHANGED_M).any())
    return np.array([float(one.gap_m[int(np.argmax(shifted(one, YieldThresholds.shift_m)))]) for one in changed])


def response_distance_m(scene: RealismScene) -> Floats:
    """Gap to the EMV at which drivers in its way first shifted or slowed down by 1.5 m/s."""
    asked = [(one, responds(one, YieldThresholds())) for one in scene.heard if one.was_in_the_way]
    return np.array([float(one.gap_m[int(np.argmax(responded))]) for one, responded in asked if responded.any()])


def hinder_time_s(scene: RealismScene) -> Floats:
    """Time for which each driver in the EMV's way, once it was within 40 m, stayed there."""
    times = (clearance_time_s(one, YieldThresholds()) for one in scene.near)
    return np.array([time.value for time in times if time.valid and not time.at_least])


def return_distance_m(scene: RealismScene) -> Floats:
    """Gap behind the EMV at which drivers who had made way for it drove or moved back again."""
    found = []
    for one in (one for one in scene.near if one.passed_row >= 0 and shifted(one, YieldThresholds.shift_m).any()):
        after = slice(one.passed_row, None)
        lateral, speed = one.offsets.lateral_m[after], one.driver.track.speed_mps[after]
        back = np.abs(lateral - lateral[0]) >= YieldThresholds.shift_m
        back |= speed >= speed[0] + YieldThresholds.slowed_mps
        if back.any():
            behind_m = (one.emv.arc_m - one.emv.half_along_m - one.driver.arc_m - one.driver.half_along_m)[after]
            found.append(float(behind_m[int(np.argmax(back))]))
    return np.array(found)


def crossed_against_signal(scene: RealismScene) -> Floats:
    """Whether each driver ahead of the EMV drove over a red line before the EMV had passed."""
    red = {(one.actor_id, one.enter_step) for one in scene.traversals if signal_letter(scene.record, one) in RED}
    found = []
    for one in scene.near:
        steps = one.driver.track.step[one.until_passed]
        found.append(float(any(actor == one.actor_id and step in steps for actor, step in red)))
    return np.array(found)


def green_stop_distance_m(scene: RealismScene) -> Floats:
    """Distance to the stop line at which drivers with green stood while the EMV came across or was inside.

    Those count who stand on a lane that crosses the EMV's way, within 30 m of the line, with nobody ahead up to it.
    """
    record, network = scene.record, scene.record.network
    found: dict[int, float] = {}
    for crossing in scene.traversals:
        if crossing.actor_id != record.emv_ids[0] or not scene.siren_sounds:
            continue
        indices = crossing_connections(network, network.connections[crossing.connection])
        ways = [way for way in (network.connections[index] for index in indices) if way.signal_id is not None]
        first = crossing.enter_step - round(_BEFORE_S / STEP_S)
        for traffic in record.traffic:
            if not first <= traffic.step < crossing.leave_step or traffic.step % round(road_tracks.EVERY_S / STEP_S):
                continue
            for way in ways:
                on = np.flatnonzero(traffic.lane == way.from_lane)
                state = record.signal_states(str(way.signal_id)).get(traffic.step, "")
                if not len(on) or way.letter_in(state) not in _GREEN:
                    continue
                row = on[np.argmax(traffic.lane_position_m[on])]
                left_m = network.lanes[way.from_lane].length_m - float(traffic.lane_position_m[row])
                if float(traffic.speed_mps[row]) < YieldThresholds.stop_mps and left_m <= _AT_LINE_M:
                    found.setdefault(int(traffic.actor_id[row]), left_m)
    return np.array(list(found.values()))


_BEFORE_S: Final = 5.0
_AT_LINE_M: Final = 30.0
_GREEN: Final = frozenset("gG")


def time_per_situation_s(scene: RealismScene) -> Floats:
    """Time of driving with lights and siren for each critical situation; all of it where there is none."""
    starts, _, driving_s = scene.situations
    return np.full(max(starts, 1), driving_s / max(starts, 1)) if driving_s else np.empty(0)


def time_in_situations(scene: RealismScene) -> Floats:
    """Share of the time of driving with lights and siren within critical situations."""
    _, within_s, driving_s = scene.situations
    return np.array([within_s / driving_s]) if driving_s else np.empty(0)


def _situations(scene: RealismScene) -> tuple[int, float, float]:
    """As ``RealismScene.situations``.

    A moment is critical with a TTC below 1.5 s, a PET below 1 s at the second vehicle's coming, or hard braking of the
    EMV.
    """
    if scene.line is None or not scene.siren_sounds:
        return 0, 0.0, 0.0
    track = scene.line.emv.track
    encounters, contacts = conflict_series(scene.record, scene.record.emv_ids[0])
    steps = set(encounters.step[contacts.time_s < CRITICAL_TTC_S].tolist())
    steps |= {
        pair.encroachment.step
        for pair in pair_measures(encounters, contacts)
        if pair.encroachment is not None and pair.encroachment.time_s < CRITICAL_PET_S
    }
    steps |= set(track.step[track.accel_mps2 < -CRITICAL_BRAKE_MPS2].tolist())
    marked = np.array(sorted(steps), dtype=np.int64)
    breaks = np.flatnonzero(np.diff(marked) * STEP_S > _SITUATION_APART_S)
    first, last = np.append(0, breaks + 1), np.append(breaks, len(marked) - 1)
    within_s = float(np.sum(marked[last] - marked[first] + 1) * STEP_S) if len(marked) else 0.0
    return (len(first) if len(marked) else 0), within_s, len(track) * STEP_S


def lane_change_s(scene: RealismScene) -> Floats:
    """Time of each lane change of drivers whom no siren is near: from standing still across to standing still again."""
    record, met = scene.record, {one.actor_id for one in scene.heard}
    edges = np.array([known.edge for known in record.network.lanes])
    found: list[float] = []
    for actor_id in sorted(set(scene.ordinary.track_id.tolist()) - met):
        track = record.track(actor_id)
        offsets = lane_offsets(record, track)
        lane = sumo_lanes(record, track)
        same = (lane[1:] != lane[:-1]) & (lane[1:] != NO_LANE) & (lane[:-1] != NO_LANE)
        same &= (edges[lane[1:]] == edges[lane[:-1]]) & (track.speed_mps[1:] > road_tracks.MOVES_MPS)
        changes = np.flatnonzero(same)
        across = np.abs(np.gradient(offsets.lateral_m) / STEP_S) if len(track) > 1 else np.zeros(len(track))
        quiet = np.flatnonzero(across < _SETTLED_MPS)
        for change in changes.tolist():
            before, after = quiet[quiet <= change], quiet[quiet > change]
            if len(before) and len(after):
                found.append(float(after[0] - before[-1]) * STEP_S)
    return np.array([value for value in found if value > STEP_S])


def rescue_lane_formed(scene: RealismScene) -> Floats:
    """Whether the EMV fitted through for nine tenths of the time with vehicles ahead, in a motorway's jam."""
    if not scene.in_rescue_lane or scene.corridor is None or not scene.corridor.contested.any():
        return np.empty(0)
    return np.array([float(scene.corridor.passable[scene.corridor.contested].mean() >= _FORMED)])


_FORMED: Final = 0.9


def rescue_lane_unasked(scene: RealismScene) -> Floats:
    """Whether a rescue lane was formed, and at most a tenth of its drivers waited for the EMV."""
    late = rescue_lane_late(scene)
    return rescue_lane_formed(scene) * float(not len(late) or late.mean() <= 1.0 - _FORMED)


def rescue_lane_stop(scene: RealismScene) -> Floats:
    """Whether the EMV came to a standstill in a motorway's jam."""
    if not scene.in_rescue_lane or scene.line is None:
        return np.empty(0)
    return np.array([float((scene.line.emv.track.speed_mps < YieldThresholds.stop_mps).any())])


def rescue_lane_late(scene: RealismScene) -> Floats:
    """Whether each driver in a motorway's jam who moved aside did so only with the EMV within 100 m."""
    if not scene.in_rescue_lane or scene.line is None:
        return np.empty(0)
    found = []
    for one in scene.seen:
        centred = np.abs(one.offsets.offset_m[0]) < YieldThresholds.recovered_offset_m
        aside = shifted(one, YieldThresholds.shift_m)
        if one.passed_row >= 0 and (aside.any() or not centred):
            found.append(float(centred and one.gap_m[int(np.argmax(aside))] < _LATE_M))
    return np.array(found)


def rescue_lane_forgotten(scene: RealismScene) -> Floats:
    """Whether each driver whom the EMV passed in a motorway's jam stood in the middle of its lane until then."""
    if not scene.in_rescue_lane:
        return np.empty(0)
    passed = (one for one in scene.near if one.passed_row >= 0)
    half_m = YieldThresholds.recovered_offset_m
    return np.array([float(np.abs(one.offsets.offset_m[one.until_passed]).max() < half_m) for one in passed])


_LATE_M: Final = 100.0
"""The EMV is near: it will have come in 5 to 10 s at the 10 to 20 m/s at which EMVs drive through; an assumption."""


def speed_in_30_zone(scene: RealismScene) -> Floats:
    """The EMV's mean speed on roads with a limit up to 30 km/h, as a share of the limit."""
    if scene.line is None or not scene.siren_sounds:
        return np.empty(0)
    track = scene.line.emv.track
    lane = places_of(scene.record, track).lane
    limits = np.array([known.speed_limit_mps for known in scene.record.network.lanes])
    slow = (lane != NO_LANE) & (limits[lane] <= _LIMIT_30_MPS) & (track.speed_mps > road_tracks.STANDING_MPS)
    return np.array([float(np.mean(track.speed_mps[slow] / limits[lane[slow]]))]) if slow.any() else np.empty(0)


_LIMIT_30_MPS: Final = 8.5


def emv_contact(scene: RealismScene) -> Floats:
    """Whether the EMV of an episode with its siren on touched anybody."""
    if not scene.siren_sounds:
        return np.empty(0)
    return np.array([float(any(scene.record.emv_ids[0] in pair for pair in _contacts(scene)))])


def emv_contact_per_km(scene: RealismScene) -> Floats:
    """Contacts of the EMV for each kilometre with its siren on."""
    if not scene.siren_sounds or scene.line is None:
        return np.empty(0)
    return np.array([sum(scene.record.emv_ids[0] in pair for pair in _contacts(scene)) / scene.line.driven_m * 1e3])


def wake_share(scene: RealismScene) -> Floats:
    """For each contact of an episode with a siren, whether the EMV had no part in it."""
    if not scene.siren_sounds:
        return np.empty(0)
    return np.array([float(scene.record.emv_ids[0] not in pair) for pair in _contacts(scene)])


def _contacts(scene: RealismScene) -> Iterator[tuple[int, int]]:
    for event in scene.record.events_of(EventKind.COLLISION):
        yield event.actor_id, event.other_id


def hardest_brake_mps2(scene: RealismScene) -> Floats:
    """Hardest braking of each driver who met the EMV from ahead, positive."""
    return np.array([max(0.0, -float(one.driver.track.accel_mps2[one.until_passed].min())) for one in scene.near])


TRAFFIC: Final[Mapping[str, Callable[[RoadTracks], Floats]]] = {
    "standing_gap_m": road_tracks.standing_gaps_m,
    "following_headway_s": road_tracks.following_headways_s,
    "start_mps2": road_tracks.starts_mps2,
    "stop_mps2": road_tracks.stops_mps2,
    "discharge_headway_s": road_tracks.discharge_headways_s,
    "following_gap_m": road_tracks.following_gaps_m,
    "crossing_lag_s": road_tracks.crossing_lags_s,
    "moving_speed_mps": road_tracks.moving_speeds_mps,
    "acceleration_mps2": partial(road_tracks.changes_of_speed, order=1),
    "jerk_mps3": partial(road_tracks.changes_of_speed, order=2),
}
"""Measures of ordinary traffic, which tracks of real traffic have too."""


def _of_ordinary(measure: Callable[[RoadTracks], Floats], scene: RealismScene) -> Floats:
    return measure(scene.ordinary)


Statistic = Callable[[Floats], float]
MEAN: Final[Statistic] = lambda values: float(np.mean(values))  # noqa: E731 - a table of functions
MEDIAN: Final[Statistic] = lambda values: float(np.median(values))  # noqa: E731
SPREAD: Final[Statistic] = lambda values: float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")  # noqa: E731


def percentile(share: float) -> Statistic:
    """The percentile of samples, from 0 to 100."""
    return lambda values: float(np.percentile(values, share))


SAMPLES: Final[Mapping[str, Callable[[RealismScene], Floats]]] = {
    "time_to_site_s": time_to_site_s,
    "moved": moved,
    "lane_change_distance_m": lane_change_distance_m,
    "response_distance_m": response_distance_m,
    "hinder_time_s": hinder_time_s,
    "return_distance_m": return_distance_m,
    "crossed_against_signal": crossed_against_signal,
    "green_stop_distance_m": green_stop_distance_m,
    "time_per_situation_s": time_per_situation_s,
    "time_in_situations": time_in_situations,
    "lane_change_s": lane_change_s,
    "rescue_lane_formed": rescue_lane_formed,
    "rescue_lane_unasked": rescue_lane_unasked,
    "rescue_lane_stop": rescue_lane_stop,
    "rescue_lane_late": rescue_lane_late,
    "rescue_lane_forgotten": rescue_lane_forgotten,
    "speed_in_30_zone": speed_in_30_zone,
    "emv_contact": emv_contact,
    "emv_contact_per_km": emv_contact_per_km,
    "wake_share": wake_share,
    "hardest_brake_mps2": hardest_brake_mps2,
    **{name: partial(_of_ordinary, measure) for name, measure in TRAFFIC.items()},
}
"""Samples of an episode, by the name that the ledger uses."""
ORDINARY: Final = (*TRAFFIC, "lane_change_s")
"""Samples of traffic that no siren is near; those of episodes at L0 count too."""


STREET: Final = "street"
MOTORWAY: Final = "motorway"
ROADS: Final = (STREET, MOTORWAY)


@dataclass(frozen=True)
class RealismEpisode:
    """Samples of one episode."""

    level: str
    at_own_level: bool
    situation: tuple[str, ...]
    """Template, map, seed and draw: what the levels of one seed have in common."""
    samples: Mapping[str, Floats]
    fitted_to: tuple[str, ...] = ()
    """Lines of the ledger to which the preset of its drivers was fitted."""
    road: str = STREET
    """One of ``ROADS``."""

    @classmethod
    def of(cls, record: EpisodeRecord) -> Self:
        """Measure a record for its first EMV."""
        described, scene = record.description, RealismScene(record)
        level = described.level.name
        situation = (described.template, described.map_name, str(described.seed), described.pinned)
        samples = {name: measure(scene) for name, measure in SAMPLES.items()}
        fitted_to = load_preset(described.preset, described.files).fitted_to
        road = MOTORWAY if scene.in_rescue_lane else STREET
        return cls(level, level == own_level(described.template), situation, samples, fitted_to, road)
