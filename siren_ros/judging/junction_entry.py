"""Templates S3 to S6: the EMV passes a red signal or a stop sign while other vehicles are inside the junction."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.judging.junction_traversal import Traversal, find_traversals
from siren_ros.judging.stop_line_approach import least_free_speed_mps
from siren_ros.judging.verdict import Part, Verdict, at_least, closest_of, more_than, verdict_of
from siren_ros.numerics.geometry import wrap_angle
from siren_ros.numerics.units import STEP_S
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.roads.movements import crossing_connections, movement_path
from siren_ros.roads.road_network import RoadNetwork

RED: Final = frozenset("ru")
"""SUMO's letters that forbid entering: red, and red with yellow."""
SAME_DIRECTION_RAD: Final = np.pi / 6.0
"""Largest difference of heading, at entry and at exit, between movements of the same direction."""


def red_same_direction(record: EpisodeRecord, _thresholds: Mapping[str, float]) -> Verdict:
    """S3: the EMV enters against red, and a vehicle of its direction is inside during its traversal."""
    return _judge(record, _RedLine(record), "same_direction_inside")


def red_crossing(record: EpisodeRecord, _thresholds: Mapping[str, float]) -> Verdict:
    """S4: the EMV enters against red, and a vehicle on a crossing path is inside during its traversal."""
    return _judge(record, _RedLine(record), "crossing_inside")


def stop_same_direction(record: EpisodeRecord, thresholds: Mapping[str, float]) -> Verdict:
    """S5: the EMV passes a stop line faster than ``speed_min_mps`` while a vehicle of its direction is inside."""
    return _judge(record, _StopLine(record, thresholds["speed_min_mps"]), "same_direction_inside")


def stop_crossing(record: EpisodeRecord, thresholds: Mapping[str, float]) -> Verdict:
    """S6: the EMV passes a stop line faster than ``speed_min_mps`` while a vehicle on a crossing path is inside."""
    return _judge(record, _StopLine(record, thresholds["speed_min_mps"]), "crossing_inside")


@dataclass(frozen=True)
class _RedLine:
    """Entering against red."""

    record: EpisodeRecord
    wanted: str = "a junction with a signal"

    def applies(self, traversal: Traversal) -> bool:
        return self.record.network.connections[traversal.connection].signal_id is not None

    def part(self, traversal: Traversal | None) -> Part:
        """1 where the signal was red as the front passed the stop line, else 0."""
        if traversal is None:
            return at_least("against_red", 0, 1, f"the EMV crosses {self.wanted} nowhere")
        letter = signal_letter(self.record, traversal)
        return at_least("against_red", letter in RED, 1, f"{_where(self.record, traversal)} on {letter or 'no signal'}")


@dataclass(frozen=True)
class _StopLine:
    """Passing a stop line without stopping."""

    record: EpisodeRecord
    speed_min_mps: float
    wanted: str = "a stop line"

    def applies(self, traversal: Traversal) -> bool:
        return self.record.network.connections[traversal.connection].must_stop

    def part(self, traversal: Traversal | None) -> Part:
        """The least speed on the free approach and at the line: one who obeys the sign stops somewhere there."""
        if traversal is None:
            return more_than("stop_line_mps", 0, self.speed_min_mps, f"the EMV crosses {self.wanted} nowhere")
        speed = least_free_speed_mps(self.record, traversal)
        return more_than("stop_line_mps", speed, self.speed_min_mps, _where(self.record, traversal))


def _judge(record: EpisodeRecord, line: _RedLine | _StopLine, others: str) -> Verdict:
    """The verdict on the EMV's traversal that comes closest to the predicate."""
    traversals = find_traversals(record)
    emv_ids = frozenset(record.emv_ids)
    civilians = [item for item in traversals if item.actor_id not in emv_ids]
    verdicts = []
    for traversal in traversals:
        if traversal.actor_id in emv_ids and line.applies(traversal):
            inside = _inside(record.network, traversal, civilians, crossing=others == "crossing_inside")
            parts = (line.part(traversal), _count(others, inside))
            verdicts.append(verdict_of(parts, _sentence(record, parts, traversal)))
    nowhere = (line.part(None), at_least(others, 0, 1))
    return closest_of(verdicts) or verdict_of(nowhere, f"the EMV crosses {line.wanted} nowhere")


def _inside(network: RoadNetwork, traversal: Traversal, civilians: list[Traversal], crossing: bool) -> list[Traversal]:
    """Civilians' traversals that meet the EMV's: on crossing paths, or in its direction."""
    own = network.connections[traversal.connection]
    meeting = [
        item
        for item in civilians
        if network.connections[item.connection].junction == own.junction and traversal.meets(item)
    ]
    if crossing:
        wanted = frozenset(crossing_connections(network, own))
        return [item for item in meeting if item.connection in wanted]
    return [item for item in meeting if is_same_direction(network, traversal.connection, item.connection)]


def is_same_direction(network: RoadNetwork, first: int, second: int) -> bool:
    """Whether two movements (connection indices) have the same approach edge, or the same headings at both ends."""
    movements = [network.connections[index] for index in (first, second)]
    if network.lanes[movements[0].from_lane].edge == network.lanes[movements[1].from_lane].edge:
        return True
    paths = [movement_path(network, movement) for movement in movements]
    ends = np.array([path.heading_rad([0.0, path.length_m]) for path in paths])
    return bool(np.all(np.abs(wrap_angle(ends[1] - ends[0])) <= SAME_DIRECTION_RAD))


def signal_letter(record: EpisodeRecord, traversal: Traversal) -> str:
    """SUMO's letter of the movement's signal as the front passed the stop line; empty if it is unknown."""
    connection = record.network.connections[traversal.connection]
    states = record.signal_states(connection.signal_id) if connection.signal_id is not None else {}
    state = states.get(traversal.enter_step, "")
    return state[connection.signal_link] if 0 <= connection.signal_link < len(state) else ""


def _count(name: str, inside: list[Traversal]) -> Part:
    ids = dict.fromkeys(item.actor_id for item in inside)
    detail = ", ".join(
        f"{item.actor_id} from {item.centre_steps[0] * STEP_S:.1f} s to {item.centre_steps[1] * STEP_S:.1f} s"
        for item in inside
    )
    return at_least(name, len(ids), 1, detail)


def _where(record: EpisodeRecord, traversal: Traversal) -> str:
    junction = record.network.connections[traversal.connection].junction
    enter, leave = traversal.enter_step * STEP_S, traversal.leave_step * STEP_S
    return f"EMV {traversal.actor_id} in junction {junction} from {enter:.1f} s to {leave:.1f} s"


def _sentence(record: EpisodeRecord, parts: tuple[Part, Part], traversal: Traversal) -> str:
    line, others = parts
    if line.name == "against_red":
        how = "against red" if line.holds else "not against red"
    else:
        how = f"over the stop line, never slower than {line.value:.1f} m/s,"
    junction = record.network.connections[traversal.connection].junction
    kind = "of its direction" if others.name == "same_direction_inside" else "on crossing paths"
    return f"the EMV entered junction {junction} {how} with {others.value:.0f} vehicles {kind} inside"
