"""Template S2: civilians leave the EMV's lane, and it passes them in that lane."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.tracks import Drive, ahead_and_left_m, in_same_direction, lanes_ahead, places_of
from siren_ros.scoring.judging.verdict import Moment, Verdict, at_least, listed, verdict_of
from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.world.actors import EventKind, Lights

REACH_M: Final = 200.0
"""Vehicles within this distance along the lane count as ahead in the EMV's lane; larger than any siren's range."""
BODY_MARGIN_M: Final = 0.3
"""A lane change is complete when at most this much of the body is over the line."""
LATERAL_REACH_M: Final = 12.0
"""Largest lateral distance of a vehicle that counts as passed: some lanes, but not the next street."""
SEAM_M: Final = 30.0
"""Length of the old lane that is followed to find a lane change across the end of an edge."""


@dataclass(frozen=True)
class LaneClearing:
    """One civilian that left the EMV's lane while the siren was on."""

    actor_id: int
    left_lane: int
    start_step: int
    """Last step with its centre in the old lane."""
    end_step: int
    """First step at which its body is clear of the old lane."""
    passed_step: int | None
    """First step with the EMV's rear ahead of its front, after a pass in the cleared lane; None if it does not pass."""


def lane_cleared(record: EpisodeRecord, thresholds: Mapping[str, float]) -> Verdict:
    """S2: at least ``lane_changes_min`` civilians leave the EMV's lane, and it passes ``passed_min`` of them there."""
    clearings = find_clearings(record)
    changes = [Moment(clearing.end_step, clearing.actor_id) for clearing in clearings]
    passes = [Moment(item.passed_step, item.actor_id) for item in clearings if item.passed_step is not None]
    parts = (
        at_least("lane_changes", len(changes), thresholds["lane_changes_min"], listed(changes), *changes),
        at_least("passed", len(passes), thresholds["passed_min"], listed(passes), *sorted(passes)),
    )
    text = f"{len(clearings)} civilians left the EMV's lane while the siren was on, and it passed {len(passes)} there"
    return verdict_of(parts, text)


def find_clearings(record: EpisodeRecord) -> tuple[LaneClearing, ...]:
    """Find each civilian's first lane change out of the first EMV's lane, in the order of completion.

    Only drivers who have noticed a siren count: others change lanes for reasons of their own.
    """
    places = places_of(record, record.rows)
    drives = {key: _Drive(record, places, key) for key in record.actors if len(record.rows_of(key))}
    civilians = [drive for drive in drives.values() if not drive.actor.is_emv]
    heard = {event.actor_id: event.step for event in reversed(record.events_of(EventKind.YIELD_REQUESTED))}
    changes = [
        civilian.clearing(drives[emv], heard[civilian.actor.actor_id])
        for emv in record.emv_ids[:1]
        for civilian in civilians
        if emv in drives and civilian.actor.actor_id in heard
    ]
    clearings = [change for change in changes if change is not None]
    return tuple(sorted(clearings, key=lambda clearing: (clearing.end_step, clearing.actor_id)))


class _Drive(Drive):
    """A drive with its lane changes."""

    def row_at(self, step: int) -> int | None:
        """Row of a step; None if the actor is absent."""
        row = int(np.searchsorted(self.rows.step, step))
        return row if row < len(self.rows) and self.rows.step[row] == step else None

    def clearing(self, emv: "_Drive", heard_step: int) -> LaneClearing | None:
        """This civilian's first change out of the EMV's lane that the EMV then passes; otherwise the first change.

        It has to begin after the driver has noticed the siren.
        """
        unpassed = None
        for start, end in self._lane_changes():
            siren_on = all(emv.has_siren_on(int(self.rows.step[row])) for row in (start, end))
            if int(self.rows.step[start]) < heard_step or not siren_on or not self._is_ahead_of(emv, start):
                continue
            left_lane = int(self.lane[start])
            start_step, end_step = (int(self.rows.step[row]) for row in (start, end))
            passed = self._passed_step(emv, left_lane, end_step)
            clearing = LaneClearing(self.actor.actor_id, left_lane, start_step, end_step, passed)
            if passed is not None:
                return clearing
            unpassed = unpassed or clearing
        return unpassed

    def has_siren_on(self, step: int) -> bool:
        """Whether the actor is present at a step with its siren on."""
        row = self.row_at(step)
        return row is not None and bool(int(self.rows.lights[row]) & Lights.SIREN)

    def _lane_changes(self) -> list[tuple[int, int]]:
        """Rows of each completed lane change: the last in the old lane, and the first clear of it.

        The change may also cross the end of an edge or happen inside a junction: the new lane is then a neighbour of
        a lane that follows the old one.
        """
        changes = []
        inside = np.flatnonzero(self.lane != NO_LANE)
        for before, after in pairwise(inside[_ends_of_runs(self.lane[inside])].tolist()):
            old, new = int(self.lane[before]), self.network.lanes[self.lane[after]]
            follows = lanes_ahead(self.network, old, SEAM_M)
            neighbours = {side: self.network.neighbour(new, side) for side in (1, -1)}
            old_sides = [side for side, lane in neighbours.items() if lane is not None and lane.index in follows]
            if new.index in follows or not old_sides:
                continue
            first_new = int(inside[np.searchsorted(inside, before) + 1])
            clear = self._first_clear_row(first_new, float(old_sides[0]))
            if clear is not None:
                changes.append((before, clear))
        return changes

    def _first_clear_row(self, first: int, old_side: float) -> int | None:
        """First row from which the body is clear of the lane on ``old_side`` (+1 left), before another lane change."""
        lane = self.network.lanes[self.lane[first]]
        for row in range(first, len(self.lane)):
            current = int(self.lane[row])
            if current != lane.index:
                if current == NO_LANE or self.network.lanes[current].edge == lane.edge:
                    return None
                lane = self.network.lanes[current]
            heading = float(lane.centre.heading_rad(self.arc_m[row]))
            turned = abs(float(wrap_angle(self.rows.yaw_rad[row] - heading)))
            half = self.actor.width_m / 2.0 * np.cos(turned) + self.actor.length_m / 2.0 * np.sin(turned)
            if self.offset_m[row] * old_side + half <= lane.width_m / 2.0 + BODY_MARGIN_M:
                return row
        return None

    def _is_ahead_of(self, emv: "_Drive", row: int) -> bool:
        """Whether this civilian is ahead in the EMV's lane or its continuation, at the civilian's row."""
        emv_row = emv.row_at(int(self.rows.step[row]))
        if emv_row is None or emv.lane[emv_row] == NO_LANE:
            return False
        emv_lane, lane = int(emv.lane[emv_row]), int(self.lane[row])
        if emv_lane == lane:
            return bool(self.arc_m[row] > emv.arc_m[emv_row])
        return lane in lanes_ahead(self.network, emv_lane, REACH_M)

    def _passed_step(self, emv: "_Drive", left_lane: int, from_step: int) -> int | None:
        """First step with the EMV's rear ahead of this civilian's front; None unless it passed in the cleared lane."""
        steps, emv_rows, rows = np.intersect1d(emv.rows.step, self.rows.step, return_indices=True)
        later = steps > from_step
        steps, emv_rows, rows = steps[later], emv_rows[later], rows[later]
        emv_then, then = emv.rows.select(emv_rows), self.rows.select(rows)
        ahead_m, left_m = ahead_and_left_m(emv_then, then)
        near = in_same_direction(emv_then, then) & (np.abs(left_m) < LATERAL_REACH_M)
        line = lanes_ahead(self.network, left_lane, REACH_M)
        reach = (emv.actor.length_m + self.actor.length_m) / 2.0
        for crossing in np.flatnonzero((ahead_m[:-1] > 0.0) & (ahead_m[1:] <= 0.0) & near[:-1] & near[1:]):
            lane = int(emv.lane[emv_rows[crossing + 1]])
            if lane not in line or lane == int(self.lane[rows[crossing + 1]]):
                continue
            done = np.flatnonzero(ahead_m[crossing:] <= -reach)
            if len(done):
                return int(steps[crossing + done[0]])
        return None


def _ends_of_runs(values: npt.NDArray[np.int32]) -> npt.NDArray[np.intp]:
    """Last index of every run of equal values."""
    return np.append(np.flatnonzero(np.diff(values)), len(values) - 1)[: len(values)]
