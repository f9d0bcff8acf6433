"""Template S7: the EMV executes a right turn on the shoulder."""

from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.judging.junction_traversal import Traversal, find_traversals
from siren_ros.judging.verdict import Verdict, at_least, closest_of, verdict_of
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.geometry import wrap_angle
from siren_ros.numerics.units import STEP_S
from siren_ros.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.roads.road_network import LaneKind, RoadNetwork

RIGHT_TURNS: Final = frozenset({"r", "R"})
"""SUMO's letters of right turns and of slight right turns."""
TURN_MIN_DEG: Final = 45.0
"""Least heading change to the right of what counts as a turn."""
NEAR_M: Final = 50.0
"""Largest distance before and after the junction at which the approach and the exit belong to the turn."""


def shoulder_turn(record: EpisodeRecord, thresholds: Mapping[str, float]) -> Verdict:
    """The EMV's centre is on a shoulder for at least ``shoulder_min_s`` while it turns right at a junction.

    The turn lasts from the approach edge to the exit edge, at most 50 m before and after the junction. The shoulder
    is the area of the shoulder lanes and of their paths across the junction, in their direction.
    """
    needed_s = thresholds["shoulder_min_s"]
    verdicts = []
    for traversal in find_traversals(record):
        connection = record.network.connections[traversal.connection]
        if traversal.actor_id in record.emv_ids and connection.direction in RIGHT_TURNS:
            verdicts.append(_of_turn(record, traversal, needed_s))
    nowhere = (
        at_least("right_turn_deg", 0, TURN_MIN_DEG, "the EMV turns right nowhere"),
        at_least("shoulder_s", 0, needed_s),
    )
    return closest_of(verdicts) or verdict_of(nowhere, "the EMV turned right nowhere")


def _of_turn(record: EpisodeRecord, traversal: Traversal, needed_s: float) -> Verdict:
    rows = _turn_rows(record, traversal)
    turned_deg = float(np.degrees(turned_right_rad(rows.yaw_rad)))
    on_shoulder = on_shoulder_area(record.network, rows)
    shoulder_s = float(on_shoulder.sum()) * STEP_S
    junction = record.network.connections[traversal.connection].junction
    first_s, last_s = rows.step[0] * STEP_S, rows.step[-1] * STEP_S
    parts = (
        at_least(
            "right_turn_deg",
            turned_deg,
            TURN_MIN_DEG,
            f"EMV {traversal.actor_id} at junction {junction} from {first_s:.1f} s to {last_s:.1f} s",
        ),
        at_least("shoulder_s", shoulder_s, needed_s, _stretches(rows, on_shoulder)),
    )
    text = f"the EMV was on the shoulder for {shoulder_s:.1f} s of its turn by {turned_deg:.0f}° to the right"
    return verdict_of(parts, text)


def turned_right_rad(yaw_rad: Floats) -> float:
    """The largest turn to the right within a course of headings. Bends to the left before and after it do not count."""
    turned = np.concatenate(([0.0], np.cumsum(wrap_angle(np.diff(yaw_rad)))))
    return float((np.maximum.accumulate(turned) - turned).max())


def _turn_rows(record: EpisodeRecord, traversal: Traversal) -> StateRows:
    """The EMV's states from the approach edge to the exit edge, not further than ``NEAR_M`` from the junction."""
    track = record.track(traversal.actor_id)
    driven = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(track.x_m), np.diff(track.y_m)))))
    enter, leave = np.searchsorted(track.step, [traversal.enter_step, traversal.leave_step])
    leave = min(leave, len(track) - 1)
    on_edges = (track.step >= traversal.approach_step) & (track.step < traversal.exit_step)
    near = (driven >= driven[enter] - NEAR_M) & (driven <= driven[leave] + NEAR_M)
    return track.select(np.flatnonzero(on_edges & near))


def on_shoulder_area(network: RoadNetwork, rows: StateRows) -> npt.NDArray[np.bool_]:
    """Whether each centre lies on a shoulder, or on a shoulder's path across a junction, in its direction (±90°)."""
    found = np.zeros(len(rows), dtype=bool)
    xy = rows.xy_m
    for index in _shoulder_lanes(network):
        lane = network.lanes[index]
        s, left = lane.centre.project(xy)
        turned = np.abs(wrap_angle(lane.centre.heading_rad(s) - rows.yaw_rad))
        inside = (s >= 0.0) & (s <= lane.length_m) & (np.abs(left) <= lane.width_m / 2.0)
        found |= inside & (turned < np.pi / 2.0)
    return found


def _shoulder_lanes(network: RoadNetwork) -> list[int]:
    lanes = [lane.index for lane in network.lanes if lane.kind is LaneKind.SHOULDER]
    across = [
        via
        for connection in network.connections
        if network.lanes[connection.from_lane].kind is LaneKind.SHOULDER
        for via in connection.via
    ]
    return list(dict.fromkeys([*lanes, *across]))


def _stretches(rows: StateRows, holds: npt.NDArray[np.bool_]) -> str:
    """The intervals of time in which a condition holds, as text."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], holds, [False])).astype(np.int8)))
    times = [
        f"{rows.step[first] * STEP_S:.1f} s to {(rows.step[last - 1] + 1) * STEP_S:.1f} s"
        for first, last in zip(edges[::2], edges[1::2], strict=True)
    ]
    return ", ".join(times)
