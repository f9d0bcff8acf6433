"""Ways of vehicles over junctions: each one's movement, and the steps inside the junction, from its poses alone."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Rows
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.tracks import Drive, LanePlaces, places_of
from siren_ros.simulation.roads.road_network import NO_LANE, Connection, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import Indices

RED: Final = frozenset("ru")
"""SUMO's letters that forbid entering: red, and red with yellow."""
_BESIDE_M: Final = 15.0
"""Lateral range of an exit lane: a vehicle within it left the junction by that exit."""
_NEVER: Final = -1
_MARGIN_M: Final = 2.0
"""Margin added to the vehicle's length where the search for the crossing of the stop line begins."""


@dataclass(frozen=True)
class Traversal:
    """One vehicle's traversal of one junction. Pairs of steps are half-open: the second step is outside."""

    actor_id: int
    connection: int
    """Index of the movement in ``RoadNetwork.connections``."""
    enter_step: int
    """First step with the front bumper beyond the stop line, the end of the approach lane."""
    enter_speed_mps: float
    leave_step: int
    """First step with the rear bumper on the exit lane; the step after the last if the record ends earlier."""
    centre_steps: tuple[int, int]
    """Steps in which the footprint's centre is between the stop line and the exit lane."""
    approach_step: int
    """First step on the approach edge."""
    exit_step: int
    """First step after the exit edge; the step after the last if the record ends earlier."""

    def meets(self, other: "Traversal") -> bool:
        """Whether the other vehicle's centre is inside the junction during some step of this traversal."""
        first, last = other.centre_steps
        return max(first, self.enter_step) < min(last, self.leave_step)


def find_traversals(record: EpisodeRecord) -> tuple[Traversal, ...]:
    """Find every traversal whose stop line is crossed in the record, by actor and then by time.

    The footprint's centre lay on the approach edge before and on the exit edge after. Where several movements join
    the two, the movement counts whose path held the centre longest. A vehicle that keeps no lane (between lanes, on
    the wrong side of the road) is followed by its projection on the approach lane and the exit lane.
    """
    places = places_of(record, record.rows)
    movements = _Movements(record.network)
    drives = [_Drive(record, places, key, movements) for key in record.actors if len(record.rows_of(key))]
    return tuple(traversal for drive in drives for traversal in drive.traversals())


class _Movements:
    """Movements of the network by approach and exit edge."""

    def __init__(self, network: RoadNetwork) -> None:
        self.network = network
        self.edge_of_lane = np.array([lane.edge for lane in network.lanes], dtype=np.int32)
        self.is_road = np.array([lane.kind is not LaneKind.INTERNAL for lane in network.lanes])
        self.length_m = np.array([lane.length_m for lane in network.lanes])

    @cached_property
    def between(self) -> Mapping[tuple[int, int], list[int]]:
        """Connection indices by approach and exit edge."""
        grouped: dict[tuple[int, int], list[int]] = {}
        for index, connection in enumerate(self.network.connections):
            ends = (int(self.edge_of_lane[connection.from_lane]), int(self.edge_of_lane[connection.to_lane]))
            grouped.setdefault(ends, []).append(index)
        return grouped

    def out_of(self, edge: int) -> list[int]:
        """Connection indices of all movements out of an edge."""
        return [index for ends, group in self.between.items() if ends[0] == edge for index in group]

    def likeliest(self, candidates: Iterable[int], last_lane: int, between: Indices) -> tuple[int | None, int]:
        """The movement whose path contains most of the given lanes, and their number.

        Of equal ones that of the nearest lane.
        """
        position = self.network.lanes[last_lane].position

        def rank(index: int) -> tuple[int, int, int]:
            connection = self.network.connections[index]
            held = int(np.isin(between, connection.via).sum())
            return held, -abs(self.network.lanes[connection.from_lane].position - position), -index

        best = max(candidates, key=rank, default=None)
        return best, rank(best)[0] if best is not None else 0


@dataclass(frozen=True)
class _Run:
    """A range of rows (inclusive) in which the centre is on one edge or on no road."""

    edge: int
    first: int
    last: int


class _Drive(Drive):
    """A drive together with the network's movements."""

    def __init__(self, record: EpisodeRecord, places: LanePlaces, actor_id: int, movements: _Movements) -> None:
        super().__init__(record, places, actor_id)
        self.movements = movements
        self.reach_m = self.actor.length_m / 2.0
        self.along = np.stack((np.cos(self.rows.yaw_rad), np.sin(self.rows.yaw_rad)), axis=-1)

    def traversals(self) -> Iterator[Traversal]:
        """Find the actor's traversals in the order of time."""
        runs = [*self._with_short_edges(self._runs())]
        for number, run in enumerate(runs):
            connection, following = self._movement(run, runs[number + 1 : number + 3])
            if connection is not None:
                traversal = self._traversal(connection, run, following)
                if traversal is not None:
                    yield traversal

    def _runs(self) -> list[_Run]:
        on_lane = self.lane != NO_LANE
        road = np.flatnonzero(on_lane)[self.movements.is_road[self.lane[on_lane]]]
        if len(road) == 0:
            return []
        edges = self.movements.edge_of_lane[self.lane[road]]
        starts = np.concatenate(([0], np.flatnonzero(np.diff(edges)) + 1, [len(edges)]))
        return [_Run(int(edges[start]), int(road[start]), int(road[end - 1])) for start, end in pairwise(starts)]

    def _with_short_edges(self, runs: list[_Run]) -> Iterator[_Run]:
        """The runs, and between two of them the edge over which one step went: some are shorter than a step's way."""
        for run, following in pairwise(runs):
            yield run
            yield from self._short_edge_between(run, following)
        yield from runs[-1:]

    def _short_edge_between(self, run: _Run, following: _Run) -> Iterator[_Run]:
        """The run over the edge that joins two others; nothing where they follow each other, or no step is between."""
        between, network = self.movements.between, self.movements.network
        rows = np.arange(run.last + 1, following.first)
        if (run.edge, following.edge) in between or not len(rows):
            return
        after = (edge for start, edge in between if start == run.edge)
        edge = next((edge for edge in after if (edge, following.edge) in between), None)
        if edge is not None:
            lane = network.lanes[network.edges[edge].lanes[0]]
            passed = _first(rows, self._along(lane, rows, 0.0) >= lane.length_m, following.first)
            yield _Run(edge, run.last + 1, max(passed - 1, run.last + 1))

    def _movement(self, run: _Run, later: list[_Run]) -> tuple[int | None, _Run | None]:
        """Find the movement that follows a run, and the run to which it leads.

        At most one stray run between is skipped.
        """
        last_lane = int(self.lane[run.last])
        for following in later:
            candidates = self.movements.between.get((run.edge, following.edge), [])
            best, _ = self.movements.likeliest(candidates, last_lane, self.lane[run.last + 1 : following.first])
            if best is not None:
                return best, following
        if later:
            return None, None
        candidates = self.movements.out_of(run.edge)
        best, held = self.movements.likeliest(candidates, last_lane, self.lane[run.last + 1 :])
        return (best, None) if held > 0 else (None, None)

    def _traversal(self, index: int, run: _Run, following: _Run | None) -> Traversal | None:
        connection = self.network.connections[index]
        approach = self.network.lanes[connection.from_lane]
        rows = np.arange(self._near_line(run), len(self.rows) if following is None else following.last + 1)
        until = len(self.rows) if following is None else following.first
        enter = _first(rows, self._along(approach, rows, self.reach_m) >= approach.length_m, _NEVER)
        if enter <= 0 or enter > until:
            return None
        rows = rows[rows >= enter]
        centre_in = _first(rows, self._along(approach, rows, 0.0) >= approach.length_m, until)
        rows = rows[rows >= centre_in]
        centre_out = min(_first(rows, self._on_exit(connection, rows, 0.0), until), until)
        after = int(rows[-1]) + 1 if len(rows) else until
        leave = _first(rows, self._on_exit(connection, rows, -self.reach_m), after)
        return Traversal(
            actor_id=self.actor.actor_id,
            connection=index,
            enter_step=self._step(enter),
            enter_speed_mps=float(self.rows.speed_mps[enter]),
            leave_step=self._step(leave),
            centre_steps=(self._step(centre_in), self._step(max(centre_out, centre_in))),
            approach_step=self._step(run.first),
            exit_step=self._step(len(self.rows) if following is None else following.last + 1),
        )

    def _near_line(self, run: _Run) -> int:
        """First row of the last part of a run in which the front bumper may be beyond the stop line."""
        lanes = self.lane[run.first : run.last + 1]
        on_edge = (lanes != NO_LANE) & self.movements.is_road[lanes]
        remaining = self.movements.length_m[lanes] - self.arc_m[run.first : run.last + 1]
        far = np.flatnonzero(on_edge & (remaining > 2.0 * self.reach_m + _MARGIN_M))
        return run.first + int(far[-1]) + 1 if len(far) else run.first

    def _point(self, rows: Rows, ahead_m: float) -> Floats:
        return self.rows.xy_m[rows] + ahead_m * self.along[rows]

    def _along(self, lane: Lane, rows: Rows, ahead_m: float) -> Floats:
        """Arc length of a point ahead of the centre, on a lane that is extended straight on."""
        return lane.centre.project(self._point(rows, ahead_m))[0]

    def _on_exit(self, connection: Connection, rows: Rows, ahead_m: float) -> Flags:
        lane = self.network.lanes[connection.to_lane]
        s, left = lane.centre.project(self._point(rows, ahead_m))
        turned = np.abs(wrap_angle(self.rows.yaw_rad[rows] - float(lane.centre.heading_rad(0.0))))
        passed: Flags = (s >= 0.0) & (np.abs(left) < _BESIDE_M) & (turned < np.pi / 2.0)
        return passed

    def _step(self, row: int) -> int:
        """Step of a row; for the index after the last row, the step after the last."""
        return int(self.rows.step[row]) if row < len(self.rows) else int(self.rows.step[-1]) + 1


def _first(rows: Rows, holds: Flags, default: int) -> int:
    matching = rows[holds]
    return int(matching[0]) if len(matching) else default


def signal_letter(record: EpisodeRecord, traversal: Traversal) -> str:
    """SUMO's letter of the movement's signal when the front passed the stop line; empty if unknown."""
    connection = record.network.connections[traversal.connection]
    states = record.signal_states(connection.signal_id) if connection.signal_id is not None else {}
    return connection.letter_in(states.get(traversal.enter_step, ""))
