"""The driver who is examined: what it did at each step, which emergency vehicles asked it to make way, its effects.

What it does to others follows from the same episode with it and with the paper's driver in its place. Conditions over
the past are those of past-time temporal logic over conditions that are sampled at every step (Lichtenstein, Pnueli and
Zuck 1985).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, TypeAlias

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.base.numerics.units import STEP_S, steps_from_s
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.data.tracks import ALIGNED_RAD, LanePlaces, ahead_and_left_m, common_rows, places_of
from siren_ros.errors import InputError
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.scoring.evaluation.yielding.encounters import LaneOffsets, lane_offsets
from siren_ros.scoring.judging.surrogate_safety import (
    Encounters,
    Encroachment,
    PairMeasures,
    PredictedContacts,
    conflict_series,
    pair_measures,
)
from siren_ros.simulation.behaviour.driving.lane_path import road_limits
from siren_ros.simulation.roads.road_network import NO_LANE, Connection, LaneKind
from siren_ros.simulation.roads.routing import is_leftmost_of_several, is_plain_joint
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.world.actors import Lights


def once(holds: Flags, within: int | None = None) -> Flags:
    """Whether a condition holds now or held at one of the last ``within`` steps; at any step before without a bound."""
    last = _last(holds)
    return np.asarray(last >= 0 if within is None else (last >= 0) & (np.arange(len(holds)) - last <= within))


def historically(holds: Flags, within: int | None = None) -> Flags:
    """Whether a condition holds now and held at the last ``within`` steps, as far as there were any; or at all."""
    return ~once(~holds, within)


def since(holds: Flags, begin: Flags) -> Flags:
    """Whether a condition has held at every step since ``begin`` was last true; false if ``begin`` never was."""
    return np.asarray((_last(begin) >= 0) & (_last(begin) >= _last(~holds)))


def rises(holds: Flags) -> Flags:
    """Whether a condition holds and did not hold at the step before."""
    return np.asarray(holds & ~np.concatenate(([False], holds[:-1])))


def held_for(holds: Flags, steps: int) -> Flags:
    """Whether a condition has held at this step and at so many steps before it, which all were there."""
    return np.asarray(historically(holds, steps) & (np.arange(len(holds)) >= steps))


def stretches(holds: Flags) -> list[tuple[int, int]]:
    """Rows at which stretches of a condition begin, and the rows after their last ones."""
    begins, ends = np.flatnonzero(rises(holds)), np.flatnonzero(rises(holds[::-1])[::-1]) + 1
    return [*zip(begins.tolist(), ends.tolist(), strict=True)]


def _last(holds: Flags) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """The last step, this one included, at which a condition held; −1 where there is none."""
    steps = np.arange(len(holds))
    return np.maximum.accumulate(np.where(holds, steps, -1)) if len(holds) else steps


ASIDE_M: Final = 8.0
"""An EMV farther to the side is on another road, or beyond two lanes."""

_NEAR_M: Final = 25.0
_BESIDE_M: Final = 3.0
"""Gap along the road below which other vehicles count as beside the driver, now or as soon as it moves aside."""
_TO_THE_RIGHT_M: Final = 1.0
_OVERLAP_M: Final = 0.6
"""Vehicles whose overlap along the road is shorter than this count as behind or ahead, not as beside."""
_STANDS_MPS: Final = 0.5
_SIDE_M: Final = 0.25
"""Lateral distance that the driver keeps from vehicles that it passes."""
_PACE_MPS: Final = 1.5
_TURN_OUT_M: Final = 6.0
"""Way ahead that a standing car needs to turn out into the next lane."""


@dataclass(frozen=True)
class Room:
    """The free space of a driver to its right and ahead; arrays of shape ``(M,)``, one value for each row."""

    right_m: Floats
    """Space to the right edge of the road or to a vehicle in between. It is 0 in junctions, where an EMV comes on the
    right, and where the driver stands and cannot turn out."""
    ahead_m: Floats
    """Space to the next vehicle in the driver's way, or to the end of its lane."""
    ahead_mps: Floats
    """Speed of that vehicle; infinite where there is none within 25 m."""
    hemmed: Flags
    """Whether the driver is at walking pace and cannot turn out past the vehicle ahead."""


@dataclass(frozen=True)
class Call:
    """An EMV that comes from behind with its siren; arrays of shape ``(M,)``, one value for each of the driver's rows.

    Where the EMV is not there the distances are infinite.
    """

    emv_id: int
    gap_m: Floats
    """Gap from the EMV's front to the driver's rear along the road; negative beside it and ahead."""
    left_m: Floats
    """Lateral distance of the EMV's centre from the driver's across the road, left positive."""
    speed_mps: Floats
    """Speed of the EMV."""
    siren: Flags
    calls: Flags
    """Whether the EMV is heard from behind or from beside the driver, so that it has not passed yet."""
    beside: Flags
    passed: Flags
    """Whether the EMV has passed the driver at this row or before."""


def lasting_deceleration_mps2(track: StateRows, lasting_s: float) -> Floats:
    """Mean deceleration over so long from each row on; no value where the track is shorter."""
    kernel = max(1, steps_from_s(lasting_s))
    if len(track) < kernel:
        return np.zeros(0)
    return np.convolve(-track.accel_mps2, np.full(kernel, 1.0 / kernel), mode="valid")


Movement: TypeAlias = tuple[int, int, Connection]
"""First row in a junction, the row after the last one there, and the movement across it."""
Crossing: TypeAlias = tuple[int, Encroachment, StateRows, Movement, Movement]
"""The other one, its encounter with the driver, its track, and the movements of the driver and of the other one."""


def movements_of(record: EpisodeRecord, track: StateRows, places: LanePlaces) -> list[Movement]:
    """The ways of a vehicle across junctions, by its rows; joints of two pieces of one road are none."""
    network, lanes, found = record.network, places.lane.tolist(), []
    inside = [lane != NO_LANE and network.lanes[lane].kind is LaneKind.INTERNAL for lane in lanes]
    edge = [NO_LANE if lane == NO_LANE else network.lanes[lane].edge for lane in lanes]
    for begin, end in stretches(np.array(inside, np.bool_)):
        ends = edge[begin - 1] if begin else NO_LANE, edge[end] if end < len(track) else NO_LANE
        over = network.connections_over.get(lanes[(begin + end) // 2], ())
        fits = [
            sum(network.lanes[lane].edge == end for lane, end in zip((one.from_lane, one.to_lane), ends, strict=True))
            for one in over
        ]
        if over and not is_plain_joint(network, one := over[int(np.argmax(fits))]):
            found.append((begin, end, one))
    return found


class Examinee:
    """A driver of a record, where traffic keeps right: records of left-hand traffic are examined as mirror images."""

    def __init__(
        self,
        record: EpisodeRecord,
        actor_id: int,
        heard_m: float,
        reaction_s: float,
        paper: "Examinee | None" = None,
    ) -> None:
        """Selects the driver.

        Args:
            record: The episode.
            actor_id: The driver.
            heard_m: Gap at which a driver has to notice the siren of an EMV behind it.
            reaction_s: Time after which the driver has to respond.
            paper: The paper's driver in its place, in the same episode; None where there is none.

        Raises:
            InputError: The episode has no such civilian vehicle, or no state of it.
        """
        record = record.right_hand
        actor = record.actors.get(actor_id)
        if actor is None or actor.is_emv or actor_id in record.walker_ids:
            raise InputError("actor", actor_id, "a civilian vehicle of the episode")
        self.record, self.actor = record, actor
        self.heard_m, self.reaction_steps, self.paper = heard_m, steps_from_s(reaction_s), paper
        self.track: StateRows = record.track(actor_id)
        if not len(self.track):
            raise InputError("actor", actor_id, "a vehicle with states in the record")

    @cached_property
    def places(self) -> LanePlaces:
        """The lanes on which the driver is at its rows."""
        return places_of(self.record, self.track)

    @cached_property
    def offsets(self) -> LaneOffsets:
        """The driver's lateral place in its lane and on its road."""
        return lane_offsets(self.record, self.track)

    @cached_property
    def aside_mps(self) -> Floats:
        """Speed to the side at each row, left positive."""
        lateral = self.offsets.lateral_m
        return np.gradient(lateral, STEP_S) if len(lateral) > 1 else np.zeros(len(lateral))

    @cached_property
    def lane_kinds(self) -> np.ndarray[tuple[int], np.dtype[np.object_]]:
        """Kind of the lane at each row; None off the lanes."""
        lanes = self.record.network.lanes
        return np.array([None if lane == NO_LANE else lanes[lane].kind for lane in self.places.lane], object)

    @cached_property
    def in_junction(self) -> Flags:
        """Whether the driver's centre is on a path across a junction."""
        return np.asarray(self.lane_kinds == LaneKind.INTERNAL, np.bool_)

    @cached_property
    def to_right_edge_m(self) -> Floats:
        """Space from the driver's right side to the road's right edge, shoulder included.

        NaN in junctions and off lanes.
        """
        return np.where(self.in_junction, np.nan, self._across_m(self.places) - 0.5 * self.actor.width_m)

    @cached_property
    def to_left_line_m(self) -> Floats:
        """Space from the driver's left side to the left line of the leftmost of several lanes; infinite elsewhere."""
        network, found = self.record.network, np.full(len(self.track), np.inf)
        for index in set(self.places.lane.tolist()) - {NO_LANE}:
            if is_leftmost_of_several(network, index):
                rows = self.places.lane == index
                spare_m = network.lanes[index].width_m - self.actor.width_m
                found[rows] = 0.5 * spare_m - self.places.offset_m[rows]
        return found

    @cached_property
    def room(self) -> Room:
        """The room that the driver has to its right and ahead."""
        right = self.to_right_edge_m.copy()
        ahead, passable, leader_mps = (np.full(len(self.track), np.inf) for _ in range(3))
        lanes, bodies = self.record.network.lanes, self.record.actors
        half_length, half_width = 0.5 * self.actor.length_m, 0.5 * self.actor.width_m
        first = self.record.states[0].step if self.record.states else 0
        for row, (step, x, y) in enumerate(zip(self.track.step.tolist(), self.track.x_m, self.track.y_m, strict=True)):
            lane = int(self.places.lane[row])
            if lane != NO_LANE:
                ahead[row] = max(lanes[lane].length_m - float(self.places.arc_m[row]) - half_length, 0.0)
            states = self.record.states[step - first]
            near = np.flatnonzero(
                (np.hypot(states.x_m - x, states.y_m - y) < _NEAR_M) & (states.actor_id != self.actor.actor_id)
            )
            yaw, nearest = float(self.along_road.yaw_rad[row]), np.inf
            for k in near.tolist():
                dx, dy = float(states.x_m[k] - x), float(states.y_m[k] - y)
                along, left = dx * np.cos(yaw) + dy * np.sin(yaw), dy * np.cos(yaw) - dx * np.sin(yaw)
                body = bodies[int(states.actor_id[k])]
                gap = abs(along) - half_length - 0.5 * body.length_m
                aside = abs(left) - half_width - 0.5 * body.width_m
                if gap < _BESIDE_M and left < 0.0 and aside > -_OVERLAP_M:
                    right[row] = min(right[row], max(aside, 0.0))
                if along > 0.0 and aside < _SIDE_M:
                    passable[row] = min(passable[row], gap)
                if along > 0.0 and aside < 0.0:
                    if max(gap, 0.0) < nearest:
                        nearest = max(gap, 0.0)
                        leader_mps[row] = np.hypot(states.vx_mps[k], states.vy_mps[k])
                    ahead[row] = min(ahead[row], nearest)
        for call in self.calls:  # where an EMV passes on the right, a driver who moved there would cut in before it
            right[call.calls & (call.gap_m < _NEAR_M) & (call.left_m < -_TO_THE_RIGHT_M)] = 0.0
        stuck = (self.track.speed_mps < _STANDS_MPS) & (ahead < _TURN_OUT_M)
        hemmed = (self.track.speed_mps < _PACE_MPS) & (passable < _TURN_OUT_M)
        return Room(np.where(stuck | np.isnan(right), 0.0, right), ahead, leader_mps, hemmed)

    @cached_property
    def along_road(self) -> StateRows:
        """The driver's rows with the heading of its lane in place of its own, which turns as it moves aside."""
        yaw = self.track.yaw_rad.copy()
        for lane in set(self.places.lane.tolist()) - {NO_LANE}:
            rows = self.places.lane == lane
            yaw[rows] = self.record.network.lanes[lane].centre.heading_rad(self.places.arc_m[rows])
        return replace(self.track, yaw_rad=yaw)

    @cached_property
    def calls(self) -> tuple[Call, ...]:
        """Every EMV that comes from behind with its siren while the driver is there."""
        found = (self._call(emv_id) for emv_id in self.record.emv_ids)
        return tuple(call for call in found if call.calls.any())

    @cached_property
    def _edge_of_lane(self) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """Edge of each lane of the map."""
        return np.array([lane.edge for lane in self.record.network.lanes], np.int64)

    def _across_m(self, places: LanePlaces) -> Floats:
        """Distance of each row from the right edge of its road; NaN off the lanes."""
        right = {lane: road_limits(self.record.network, lane).right_m for lane in set(places.lane.tolist()) - {NO_LANE}}
        return np.asarray(places.offset_m - np.array([right.get(lane, np.nan) for lane in places.lane.tolist()]))

    def named(self, actor_id: int) -> str:
        """Class and id of another actor, for people; empty where the record does not describe it."""
        known = self.record.actors.get(actor_id)
        return f"{known.actor_class.name.lower().replace('_', ' ')} {actor_id}" if known else ""

    def with_emv(self, emv_id: int) -> tuple[Flags, StateRows, StateRows]:
        """At which of the driver's rows an EMV is there, and the rows of both at these steps, along the road."""
        own, emv = common_rows(self.along_road, self.record.track(emv_id))
        return np.isin(self.track.step, own.step), own, emv

    def distance_m(self, emv_id: int) -> Floats:
        """Distance of the centres to an EMV at each row; infinite where its siren is silent."""
        there, own, emv = self.with_emv(emv_id)
        far = np.full(len(self.track), np.inf)
        apart = np.hypot(own.x_m - emv.x_m, own.y_m - emv.y_m)
        far[there] = np.where((emv.lights & Lights.SIREN) != 0, apart, np.inf)
        return far

    @cached_property
    def crossings(self) -> "tuple[Crossing, ...]":
        """Everybody whose way crosses the driver's in a junction, or meets it there from another road."""
        own = movements_of(self.record, self.track, self.places)
        found: list[Crossing] = []
        for pair in self.conflicts if own else ():
            if pair.encroachment is None or pair.actor_id in self.record.walker_ids:
                continue
            other = self.record.track(pair.actor_id)
            theirs = movements_of(self.record, other, places_of(self.record, other))
            met = [(mine, its) for mine in own for its in theirs if self._meet(mine[2], its[2])]
            met.sort(key=lambda pair_of: abs(int(self.track.step[pair_of[0][0]]) - int(other.step[pair_of[1][0]])))
            found += [(pair.actor_id, pair.encroachment, other, *met[0])] if met else []
        return tuple(found)

    def _meet(self, one: Connection, other: Connection) -> bool:
        edges = self._edge_of_lane
        return one.junction == other.junction and edges[one.from_lane] != edges[other.from_lane]

    def _call(self, emv_id: int) -> Call:
        there, own, emv = self.with_emv(emv_id)
        ahead, left = ahead_and_left_m(own, emv)
        own_lane, own_m = (column[there] for column in (self.places.lane, self._across_m(self.places)))
        emv_places = places_of(self.record, emv)
        edges = self._edge_of_lane
        same = (own_lane != NO_LANE) & (emv_places.lane != NO_LANE) & (edges[own_lane] == edges[emv_places.lane])
        # Measured from the right edge of the road, the lateral distance is also right in bends.
        left = np.where(same, self._across_m(emv_places) - own_m, left)
        reach = 0.5 * (self.actor.length_m + self.record.actors[emv_id].length_m)
        aligned = np.abs(wrap_angle(emv.yaw_rad - own.yaw_rad)) < ALIGNED_RAD
        near_line = np.abs(left) < ASIDE_M
        gap, passed = -ahead - reach, np.maximum.accumulate(aligned & near_line & (ahead > reach))
        siren = (emv.lights & Lights.SIREN) != 0
        calls = siren & aligned & near_line & (gap <= self.heard_m) & ~passed & (ahead <= reach)

        def spread(values: Floats | Flags, missing: float | bool) -> np.ndarray[tuple[int], np.dtype[np.generic]]:
            whole = np.full(len(self.track), missing)
            whole[there] = values
            return whole

        return Call(
            emv_id,
            np.asarray(spread(gap, np.inf), np.float64),
            np.asarray(spread(left, np.inf), np.float64),
            np.asarray(spread(emv.speed_mps, 0.0), np.float64),
            np.asarray(spread(siren, False), np.bool_),
            np.asarray(spread(calls, False), np.bool_),
            np.asarray(spread(calls & (gap <= 0.0), False), np.bool_),
            np.maximum.accumulate(np.asarray(spread(passed, False), np.bool_)),
        )

    @cached_property
    def called(self) -> Flags:
        """Whether any EMV calls at each row."""
        return np.any([np.zeros(len(self.track), np.bool_), *(call.calls for call in self.calls)], axis=0)

    @cached_property
    def nearest_gap_m(self) -> Floats:
        """Gap to the nearest EMV that calls; infinite where none does."""
        gaps = [np.where(call.calls, np.maximum(call.gap_m, 0.0), np.inf) for call in self.calls]
        return np.min([*gaps, np.full(len(self.track), np.inf)], axis=0)

    @cached_property
    def conflict_series(self) -> tuple[Encounters, PredictedContacts]:
        """Encounters with everybody next to the driver, and the contacts that the present motion leads to."""
        return conflict_series(self.record, self.actor.actor_id)

    @cached_property
    def conflicts(self) -> tuple[PairMeasures, ...]:
        """Surrogate safety measures with everybody else."""
        return pair_measures(*self.conflict_series)


PAPER: Final = "siren"
"""Name of the paper's driver: the model's own, in an episode without an AV."""
HARD_MPS2: Final = 4.0
"""Others who brake harder than this were forced to (ISO 15622 allows automatic systems 3.5 m/s² at speed, and 5 m/s²
below)."""
LASTING_S: Final = 0.3
"""Shortest time for which braking counts."""
OTHERS: Final[Mapping[str, str]] = {
    "emv_delay_s": "later arrival of the first emergency vehicle, s",
    "braked_hard": f"others who braked harder than {HARD_MPS2:g} m/s²",
}
"""The figures by their names in a certificate, with their meaning."""


def actor_in_seat(record: EpisodeRecord) -> int:
    """The civilian that would be the AV under test in an episode without one.

    Raises:
        InputError: The episode has no civilians around its EMV, or its map cannot be found.
    """
    request = EpisodeRequest(**{**record.description.asked, "av": "civilian"})  # type: ignore[arg-type] # its own fields
    name = set_up_episode(request, record.description.files).plan.av
    found = [actor_id for actor_id, actor in record.actors.items() if actor.name == name]
    if not found:
        raise InputError("episode", record.description.template, f"one with the vehicle {name}")
    return found[0]


def compared_with_paper(record: EpisodeRecord, actor_id: int, paper: EpisodeRecord, paper_id: int) -> dict[str, float]:
    """The figures of ``OTHERS``: those of an episode less those of the same one with the paper's driver.

    Args:
        record: The episode with the driver.
        actor_id: The driver.
        paper: The same episode with the paper's driver.
        paper_id: Whom that one drives.
    """
    ways = [_way_m(one) for one in (record, paper)]
    common_m = min(way[-1] for way in ways)
    here_s, paper_s = (float(np.searchsorted(way, common_m)) * STEP_S for way in ways)
    braked = braked_hard(record, actor_id) - braked_hard(paper, paper_id)
    return {"emv_delay_s": here_s - paper_s, "braked_hard": float(braked)}


def _way_m(record: EpisodeRecord) -> Floats:
    """Distance that the first EMV has driven at each of its steps."""
    track = record.track(record.emv_ids[0])
    return np.cumsum(np.hypot(np.diff(track.x_m, prepend=track.x_m[:1]), np.diff(track.y_m, prepend=track.y_m[:1])))


def braked_hard(record: EpisodeRecord, actor_id: int) -> int:
    """Number of others, EMVs left out, who braked harder than ``HARD_MPS2`` for 0.3 s."""
    others = record.actors.keys() - {actor_id, *record.emv_ids, *record.walker_ids}
    lasting = (lasting_deceleration_mps2(record.track(other), LASTING_S) for other in others)
    return sum(bool((one > HARD_MPS2).any()) for one in lasting)
