"""The line of the EMV (its driven path and what follows), its encounters along it, and the corridor ahead of it.

The corridor is how wide a path through the traffic is, measured every half second. Also the thresholds of the metrics.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Points
from siren_ros.base.numerics.compiled import Array, compiled
from siren_ros.base.numerics.geometry import Polyline, wrap_angle
from siren_ros.base.tables import Measure
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows, Steps
from siren_ros.data.tracks import places_of
from siren_ros.errors import InputError
from siren_ros.simulation.roads.road_network import NO_LANE, LaneKind, RoadNetwork
from siren_ros.simulation.scenario.paper import PAPER_CONSTANTS
from siren_ros.simulation.world.actors import ActorClass, Lights, rows_of_ids

REACH_M: Final = 45.0
"""Length of the continuation: more than a vehicle's length and the corridor's look-ahead together."""
_FIRST_M: Final = 1.0
_STEP_M: Final = 1.0


@dataclass(frozen=True)
class YieldThresholds:
    """Thresholds of the metrics.

    All published numbers use the defaults; other values are for studies of the metrics.
    """

    stop_mps: float = 0.5
    """A slower vehicle counts as standing; walking pace is 1.4 m/s."""
    moving_mps: float = 2.0
    """A stop ends above this speed: slow motion in a queue does not begin a second stop."""
    encounter_m: float = PAPER_CONSTANTS.region_enter_m
    """Gap between the EMV and a driver ahead at which the encounter begins (paper: interaction region, 40 m)."""
    beside_m: float = 7.0
    """Largest distance of a driver from the EMV's line in an encounter: two lanes of 3.5 m."""
    shift_m: float = 0.3
    """Lateral shift that counts as a response. Lane keeping varies by less (standard deviation 0.1 to 0.2 m; J. Verster
    and T. Roth, Int. J. Gen. Med. 4 (2011) 359, on the standard deviation of lateral position)."""
    slowed_mps: float = 1.5
    """Drop of speed that counts as a response: three seconds of coasting at about 0.5 m/s²."""
    clear_before_m: float = 5.0
    """Gap at which the way must be clear: one car's length, so that the EMV need not stop."""
    held_gap_m: float = 10.0
    """The driver delays the EMV if the EMV stands or drives very slowly within this gap behind it."""
    beyond_m: float = 15.0
    """Length of the EMV's strip beyond the end of its record; a driver there is in its way."""
    recovered_share: float = 0.8
    """A driver has recovered at this share of its speed before the encounter."""
    recovered_offset_m: float = 0.5
    """A driver within this distance of the lane's centre line is back in the lane."""
    look_ahead_m: float = 30.0
    """Length of the measured corridor: the distance of 2 s at 50 km/h."""
    corridor_margin_m: float = 0.2
    """Free space that the EMV needs on each side: the smallest margin of its own gap search."""


def way_ahead(record: EpisodeRecord, track: StateRows) -> Points:
    """Continuation of a track along its lane at the same lateral offset, shape ``(K, 2)``, K ≥ 1.

    Where the vehicle is in no lane, or its lane ends, they lead straight on.
    """
    last = track.select(np.arange(len(track)) == len(track) - 1)
    place = places_of(record, last)
    lane, arc = int(place.lane[0]), float(place.arc_m[0]) + _FIRST_M
    points: list[Points] = []
    way, edges = 0.0, _route(record, last)
    while lane != NO_LANE and way < REACH_M:
        centre = record.network.lanes[lane].centre
        along = np.arange(arc, centre.length_m, _STEP_M)
        points.extend(centre.offset_points(along, np.full(len(along), place.offset_m[0])))
        way += max(0.0, centre.length_m - arc)
        lane, arc = _next_lane(record.network, lane, edges), 0.0
    if len(points) < 2:
        heading = float(last.yaw_rad[0])
        straight = np.arange(_FIRST_M, REACH_M, _STEP_M)[:, None] * (np.cos(heading), np.sin(heading))
        return np.asarray(last.xy_m[0] + straight)
    return np.array(points)


def _route(record: EpisodeRecord, last: StateRows) -> frozenset[int]:
    """Edges that remain on the vehicle's route; empty if SUMO gave none."""
    for traffic in reversed(record.traffic):
        if traffic.step == int(last.step[0]):
            row = int(rows_of_ids(traffic.actor_id, last.actor_id)[0])
            return frozenset(traffic.route_of_row(row).tolist()) if row >= 0 else frozenset()
    return frozenset()


def _next_lane(network: RoadNetwork, lane: int, edges: frozenset[int]) -> int:
    """The next lane, on the route if possible, otherwise straight on; NO_LANE at the end of the road."""
    over = network.connections_over.get(lane, ())
    if over:
        return (*over[0].via, over[0].to_lane)[over[0].via.index(lane) + 1]
    ways = network.connections_from.get(lane, ())
    if not ways:
        return NO_LANE
    way = min(ways, key=lambda way: (network.lanes[way.to_lane].edge not in edges, way.direction != "s"))
    return (*way.via, way.to_lane)[0]


SPACING_M = 1.0
LEAST_WAY_M = 5.0
"""An EMV that drives a shorter distance has no line."""
_SAME_WAY_RAD = np.pi / 3.0


@dataclass(frozen=True)
class OnLine:
    """Position of an actor relative to the line; arrays of shape ``(M,)``, one row per step of ``track``."""

    track: StateRows
    arc_m: Floats
    """Arc length of its centre along the line."""
    left_m: Floats
    """Lateral distance of its centre from the line, positive to the left."""
    turn_rad: Floats
    """Its heading relative to the line's."""
    half_along_m: Floats
    """Half the extent of its footprint along the line, at its heading."""
    half_across_m: Floats
    """Half the extent of its footprint across the line, at its heading."""

    def select(self, rows: Flags) -> "OnLine":
        """Select some of the rows."""
        arrays = (self.arc_m, self.left_m, self.turn_rad, self.half_along_m, self.half_across_m)
        return OnLine(self.track.select(rows), *(values[rows] for values in arrays))

    @property
    def same_way(self) -> Flags:
        """Whether it drives in the line's direction, within 60°."""
        return np.asarray(np.abs(self.turn_rad) < _SAME_WAY_RAD)


@dataclass(frozen=True)
class EmvLine:
    """Line of the first EMV: its driven path, continued along its lane."""

    line: Polyline
    emv: OnLine
    driven_m: float
    """Arc length at which the EMV's record ends."""
    length_m: float
    """Length of the EMV's body."""
    width_m: float

    @classmethod
    def of(cls, record: EpisodeRecord) -> Self | None:
        """Line of an episode; None if the EMV does not move.

        Raises:
            InputError: The episode has no EMV.
        """
        if not record.emv_ids or record.emv_ids[0] not in record.actors:
            raise InputError("episode", record.description.template, "one with an EMV")
        track = record.track(record.emv_ids[0])
        way = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(track.x_m), np.diff(track.y_m)))))
        if not len(track) or way[-1] < LEAST_WAY_M:
            return None
        # One point per metre, because small motions of the pose at standstill are not part of a line.
        marks = np.searchsorted(way, np.arange(0.0, way[-1], SPACING_M))
        driven = Polyline.through(track.xy_m[np.unique(np.append(marks, len(way) - 1))])
        line = Polyline.through(np.concatenate((driven.points, way_ahead(record, track))))
        body = record.actors[record.emv_ids[0]]
        placed = on_line(line, track, body.length_m, body.width_m)
        return cls(line, placed, driven.length_m, body.length_m, body.width_m)

    def place(self, record: EpisodeRecord, actor_id: int) -> OnLine:
        """Position of another actor relative to the line, at the steps with both."""
        body = record.actors[actor_id]
        track = record.track(actor_id)
        track = track.select(np.isin(track.step, self.emv.track.step))
        return on_line(self.line, track, body.length_m, body.width_m)

    def emv_at(self, other: OnLine) -> OnLine:
        """Position of the EMV at the steps of another actor's rows."""
        return self.emv.select(np.isin(self.emv.track.step, other.track.step))


def on_line(line: Polyline, track: StateRows, length_m: float, width_m: float) -> OnLine:
    """Position of a track relative to a line."""
    arc, left = line.project(track.xy_m) if len(track) else (np.empty(0), np.empty(0))
    turn = np.asarray(wrap_angle(track.yaw_rad - line.heading_rad(arc)))
    cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    along, across = 0.5 * (length_m * cos + width_m * sin), 0.5 * (length_m * sin + width_m * cos)
    return OnLine(track, arc, left, turn, along, across)


@dataclass(frozen=True)
class LaneOffsets:
    """Lateral position of a driver; arrays of shape ``(M,)``, one value for each state of a track."""

    offset_m: Floats
    """Distance from the centre line of the present lane, or of the last one if the driver is in no lane."""
    lateral_m: Floats
    """Lateral distance driven to the left since the first state, relative to the road."""

    def select(self, rows: Flags) -> "LaneOffsets":
        """Select some of the states."""
        return LaneOffsets(self.offset_m[rows], self.lateral_m[rows])


def lane_offsets(record: EpisodeRecord, track: StateRows) -> LaneOffsets:
    """Lateral positions of one actor. A lane change on the same edge continues the lateral distance."""
    places = places_of(record, track)
    known = np.where(places.lane != NO_LANE, np.arange(len(places.lane)), 0)
    lane = places.lane[np.maximum.accumulate(known)]
    offset = places.offset_m.copy()
    for off_lane in np.flatnonzero((places.lane == NO_LANE) & (lane != NO_LANE)).tolist():
        centre = record.network.lanes[int(lane[off_lane])].centre
        offset[off_lane] = float(centre.project(track.xy_m[off_lane])[1])
    jump = np.zeros(len(offset))
    changes = np.flatnonzero(lane[1:] != lane[:-1]) + 1
    lanes = record.network.lanes
    for row, before, after in zip(changes.tolist(), lane[changes - 1].tolist(), lane[changes].tolist(), strict=True):
        if NO_LANE not in (before, after) and lanes[before].edge == lanes[after].edge:
            jump[row] = float(lanes[before].centre.project(track.xy_m[row])[1]) - offset[row]
    lateral = offset + np.cumsum(jump)
    return LaneOffsets(offset, lateral - lateral[:1])


@dataclass(frozen=True)
class Encounter:
    """One driver and the EMV behind it. Rows are the steps from the encounter's beginning to the episode's end."""

    actor_id: int
    driver: OnLine
    emv: OnLine
    gap_m: Floats
    """Gap from the EMV's front to the driver's rear along the line; negative while they are side by side."""
    passed_row: int
    """First row at which the EMV's rear is ahead of the driver's front; −1 if the EMV does not pass."""
    with_siren: bool
    """Whether the siren sounds when the encounter begins."""
    offsets: LaneOffsets
    """Lateral position of the driver on its road."""
    in_the_way: Flags
    """Whether the driver's body is in the strip that the EMV drives through, at each row."""

    def nearer(self, limits: YieldThresholds) -> "Encounter | None":
        """The encounter from the first row on that begins one by other thresholds; None if there is none."""
        near = _near_ahead(self.driver, self.gap_m, limits)
        if not near.any():
            return None
        first = int(np.argmax(near))
        rows = np.arange(len(near)) >= first
        return Encounter(
            actor_id=self.actor_id,
            driver=self.driver.select(rows),
            emv=self.emv.select(rows),
            gap_m=self.gap_m[rows],
            passed_row=self.passed_row - first if self.passed_row >= first else -1,
            with_siren=bool(self.emv.track.lights[first] & Lights.SIREN),
            offsets=self.offsets.select(rows),
            in_the_way=self.in_the_way[rows],
        )

    @property
    def until_passed(self) -> slice:
        """Rows before the EMV has passed, or all."""
        return slice(0, self.passed_row if self.passed_row >= 0 else None)

    @property
    def was_in_the_way(self) -> bool:
        """Whether the driver had to make way: it was in the EMV's strip when the encounter began."""
        return bool(self.in_the_way[0])


def _near_ahead(driver: OnLine, gap_m: Floats, limits: YieldThresholds) -> Flags:
    """Rows at which a driver is so near ahead of the EMV, in its direction, that an encounter begins."""
    near = (gap_m > 0.0) & (gap_m <= limits.encounter_m) & (np.abs(driver.left_m) <= limits.beside_m)
    return np.asarray(near & driver.same_way)


def encounters_of(record: EpisodeRecord, line: EmvLine, limits: YieldThresholds) -> Iterator[Encounter]:
    """Find all encounters of an episode, by actor id; at most one per driver.

    An encounter begins when the driver is ahead of the EMV within ``encounter_m``, drives in its direction, and is at
    most ``beside_m`` from its line.
    """
    for actor_id, actor in record.actors.items():
        drives = not actor.is_emv and actor.actor_class not in {ActorClass.PEDESTRIAN, ActorClass.BICYCLE}
        if drives and (encounter := _encounter(record, line, actor_id, limits)) is not None:
            yield encounter


def _encounter(record: EpisodeRecord, line: EmvLine, actor_id: int, limits: YieldThresholds) -> Encounter | None:
    driver = line.place(record, actor_id)
    if not len(driver.track):
        return None
    emv = line.emv_at(driver)
    apart = driver.arc_m - emv.arc_m
    reach = driver.half_along_m + emv.half_along_m
    gap = apart - reach
    near = _near_ahead(driver, gap, limits)
    if not near.any():
        return None
    rows = np.arange(len(near)) >= int(np.argmax(near))
    driver, emv, gap, apart, reach = driver.select(rows), emv.select(rows), gap[rows], apart[rows], reach[rows]
    behind = apart < -reach
    strip = np.abs(driver.left_m) < driver.half_across_m + 0.5 * line.width_m
    on_the_line = (driver.arc_m + driver.half_along_m > 0.0) & (
        driver.arc_m - driver.half_along_m < line.driven_m + 0.5 * line.length_m + limits.beyond_m
    )
    return Encounter(
        actor_id=actor_id,
        driver=driver,
        emv=emv,
        gap_m=gap,
        passed_row=int(np.argmax(behind)) if behind.any() else -1,
        with_siren=bool(emv.track.lights[0] & Lights.SIREN),
        offsets=lane_offsets(record, driver.track),
        in_the_way=np.asarray(strip & on_the_line),
    )


EVERY_STEPS: Final = 10
_CELL_M: Final = 0.1
_REACH_M: Final = 10.0
"""Lateral range of the search on each side of the line."""
_SLOPE: Final = 0.3
"""Largest lateral shift per metre, which a vehicle can follow at low speed."""
_START_M: Final = 0.3
"""The path begins within this distance of the EMV."""
_USED: Final = (LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL)
_SEAM_M: Final = 0.1
"""Tolerance for rounding gaps between neighbouring lanes."""
_ALIGNED_RAD: Final = np.pi / 4.0
_ACROSS_M: Final = np.arange(-_REACH_M, _REACH_M + 0.5 * _CELL_M, _CELL_M)


@dataclass(frozen=True)
class CorridorSeries:
    """The corridor over time; arrays of shape ``(K,)``."""

    step: Steps
    width_m: Floats
    """Width of the widest path through the traffic over the look-ahead, at its narrowest place."""
    contested: Flags
    """Whether other vehicles are on that part of the road; an empty road has no corridor."""
    needed_m: float
    """Width that the EMV needs: its own and the margins."""

    @property
    def passable(self) -> Flags:
        """Whether the EMV fits through."""
        return np.asarray(self.width_m >= self.needed_m)


def corridor_series(record: EpisodeRecord, line: EmvLine, limits: YieldThresholds) -> CorridorSeries:
    """Compute the corridor at every half second for which the line covers the whole look-ahead."""
    others = [line.place(record, actor) for actor in record.actors if actor not in record.emv_ids]
    sizes = {actor_id: (actor.length_m, actor.width_m) for actor_id, actor in record.actors.items()}
    stations = np.arange(0.0, limits.look_ahead_m + 0.5, 1.0)
    road = road_cells(record.network, line, np.arange(0.0, line.line.length_m + 1.0, 1.0))
    steps, widths, contested = [], [], []
    for row in range(0, len(line.emv.track), EVERY_STEPS):
        arc = float(line.emv.arc_m[row]) + 0.5 * line.length_m + stations
        if arc[-1] > line.line.length_m:
            continue
        step = int(line.emv.track.step[row])
        free = road[np.minimum(np.round(arc).astype(np.intp), len(road) - 1)]
        occupied = np.zeros_like(free)
        for other in others:
            at = int(np.searchsorted(other.track.step, step))
            if at == len(other.track) or other.track.step[at] != step:
                continue
            size_m = sizes[int(other.track.actor_id[at])]
            reach_m = sum(size_m) + 0.5
            if arc[0] - reach_m < other.arc_m[at] < arc[-1] + reach_m:
                occupied |= covered_cells(other, at, size_m, arc)
        steps.append(step)
        contested.append(bool((occupied & free).any()))
        widths.append(widest_way_m(free & ~occupied, float(line.emv.left_m[row])))
    columns = np.array(steps, dtype=np.int64), np.array(widths), np.array(contested, dtype=np.bool_)
    return CorridorSeries(*columns, needed_m=line.width_m + 2.0 * limits.corridor_margin_m)


def widest_way_m(free: Flags, start_m: float) -> float:
    """Width of the widest path through all stations, at its narrowest place.

    Args:
        free: Whether a place is free, shape ``(S, C)``: stations of 1 m ahead, cells of 0.1 m across.
        start_m: Where the way begins across the line.
    """
    # For each cell: twice the lateral distance to the nearest cell that is not free.
    cells = np.arange(free.shape[1])
    left = cells - np.maximum.accumulate(np.where(free, -1, cells), axis=1)
    right = np.minimum.accumulate(np.where(free, free.shape[1], cells)[:, ::-1], axis=1)[:, ::-1] - cells
    width = (2 * np.minimum(left, right) - 1).clip(0) * _CELL_M
    best = np.where(np.abs(_ACROSS_M - start_m) <= _START_M, width[0], 0.0)
    return float(_follow(best, width, round(_SLOPE / _CELL_M)).max())


@compiled
def _follow(best: Array, width: Array, reach: int) -> Array:
    """Widest path to each cell of the last station; between stations it shifts by at most ``reach`` cells."""
    for station in range(1, len(width)):
        before = best.copy()
        for cell in range(len(best)):
            best[cell] = min(before[max(cell - reach, 0) : cell + reach + 1].max(), width[station, cell])
    return best


def covered_cells(other: OnLine, row: int, size_m: tuple[float, float], arc_m: Floats) -> Flags:
    """Cells beside the line that a vehicle's body covers at one state of its track, shape ``(S, C)``.

    The body is half a metre longer at each end, because stations are 1 m apart.

    Args:
        other: The vehicle's places on the line.
        row: The state.
        size_m: Length and width.
        arc_m: Stations on the line, shape ``(S,)``.
    """
    along = arc_m[:, None] - other.arc_m[row]
    across = _ACROSS_M - other.left_m[row]
    cos, sin = np.cos(other.turn_rad[row]), np.sin(other.turn_rad[row])
    inside = np.abs(along * cos + across * sin) <= 0.5 * size_m[0] + 0.5
    return np.asarray(inside & (np.abs(across * cos - along * sin) <= 0.5 * size_m[1]))


def road_cells(network: RoadNetwork, line: EmvLine, arc_m: Floats) -> Flags:
    """Road surface in the line's direction, including shoulders, at places on the line, shape ``(S, C)``.

    Lanes belong to it as far as one borders on the next, from the line outwards; a road of its own next to it does not.
    """
    points, heading = line.line.at(arc_m), line.line.heading_rad(arc_m)
    cells = np.zeros((len(arc_m), len(_ACROSS_M)), dtype=np.bool_)
    for lane in network.lanes:
        if lane.kind not in _USED:
            continue
        low, high = lane.centre.points.min(axis=0) - _REACH_M, lane.centre.points.max(axis=0) + _REACH_M
        near = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
        if not len(near):
            continue
        s, left = lane.centre.project(points[near])
        along = (s >= -0.5) & (s <= lane.length_m + 0.5) & (np.abs(left) <= _REACH_M)
        along &= np.abs(wrap_angle(lane.centre.heading_rad(s) - heading[near])) < _ALIGNED_RAD
        cells[near[along]] |= np.abs(_ACROSS_M + left[along, None]) <= 0.5 * lane.width_m + _SEAM_M
    middle = np.argmin(np.where(cells, np.abs(_ACROSS_M), np.inf), axis=1)
    for row, start in enumerate(middle.tolist()):
        gaps = np.flatnonzero(~cells[row])
        place = int(np.searchsorted(gaps, start))
        cells[row, : gaps[place - 1] if place else 0] = False
        cells[row, gaps[place] if place < len(gaps) else len(_ACROSS_M) :] = False
    return cells


def corridor_width_m(series: CorridorSeries) -> Measure:
    """Median width of the corridor while other vehicles are ahead."""
    if not series.contested.any():
        return Measure.lacking("nobody was ahead of the EMV")
    return Measure(float(np.median(series.width_m[series.contested])))


def corridor_continuity(series: CorridorSeries) -> Measure:
    """Share of the time with vehicles ahead in which the EMV fits through the whole look-ahead."""
    if not series.contested.any():
        return Measure.lacking("nobody was ahead of the EMV")
    return Measure(float(series.passable[series.contested].mean()))
