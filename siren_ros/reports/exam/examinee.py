"""The driver who is examined: what it did at each step, and which emergency vehicles asked it to make way."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.base.numerics.units import STEP_S, steps_from_s
from siren_ros.data.record.vehicle_location import ALIGNED_RAD, LanePlaces, ahead_and_left_m, common_rows, places_of
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.yielding.encounters import LaneOffsets, lane_offsets
from siren_ros.scoring.judging.surrogate_safety import (
    Encounters,
    PairMeasures,
    PredictedContacts,
    conflict_series,
    pair_measures,
)
from siren_ros.simulation.behaviour.paths.lane_path import road_limits
from siren_ros.simulation.roads.road_network import NO_LANE, LaneKind
from siren_ros.simulation.roads.routing import is_leftmost_of_several
from siren_ros.simulation.world.actors import Lights

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


class Examinee:
    """A driver of a record, where traffic keeps right: records of left-hand traffic are examined as mirror images."""

    def __init__(self, record: EpisodeRecord, actor_id: int, heard_m: float, reaction_s: float) -> None:
        """Selects the driver.

        Args:
            record: The episode.
            actor_id: The driver.
            heard_m: Gap at which a driver has to notice the siren of an EMV behind it.
            reaction_s: Time after which the driver has to respond.

        Raises:
            InputError: The episode has no such civilian vehicle, or no state of it.
        """
        record = record.right_hand
        actor = record.actors.get(actor_id)
        if actor is None or actor.is_emv or actor_id in record.walker_ids:
            raise InputError("actor", actor_id, "a civilian vehicle of the episode")
        self.record, self.actor = record, actor
        self.heard_m, self.reaction_steps = heard_m, steps_from_s(reaction_s)
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

    def _call(self, emv_id: int) -> Call:
        emv_track = self.record.track(emv_id)
        own, emv = common_rows(self.along_road, emv_track)
        there = np.isin(self.track.step, own.step)
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
