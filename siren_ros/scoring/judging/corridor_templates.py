"""Templates S1 and S8, where the EMV drives through a corridor between two rows of civilians.

S1: civilians in two queues pull over and hold; the EMV passes between them and crosses the stop line. S8: a rescue lane
is open in a jam before the EMV comes, and the EMV drives through it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Ids
from siren_ros.base.numerics.geometry import Polyline, wrap_angle
from siren_ros.base.numerics.units import STEP_S, mps_from_kmh, steps_from_s
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.data.tracks import LanePlaces, ahead_and_left_m, in_same_direction, places_of
from siren_ros.scoring.judging.verdict import (
    Moment,
    Part,
    Verdict,
    at_least,
    at_most,
    first_reaching,
    listed,
    verdict_of,
)
from siren_ros.simulation.roads.road_network import NO_LANE, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import road_lane_of
from siren_ros.simulation.world.actors import Mode

CREEP_MPS: Final = 10.0 / 3.6
"""Largest speed of a vehicle in a queue, 10 km/h, as in slow jam traffic."""
STANDING_MPS: Final = 0.3
HOLD_S: Final = 1.0
"""Smallest time for which a holding vehicle must stand."""
OFF_CENTRE_M: Final = 0.3
"""Smallest offset from the lane's centre line of a vehicle that has pulled over."""
QUEUE_MIN: Final = 2
"""Smallest number of vehicles in a queue."""
LATERAL_REACH_M: Final = 6.0
"""Largest lateral distance between centres of two vehicles side by side on one carriageway: less than two lanes."""


@dataclass(frozen=True)
class Overtaking:
    """Moment at which the EMV's centre passes the centre of a civilian in a queue."""

    actor_id: int
    step: int
    side: int
    """Side of the nearest lane boundary on which the civilian is: +1 left, −1 right."""
    lateral_m: float
    """Distance of the EMV's centre from that boundary."""

    @property
    def moment(self) -> Moment:
        """The overtaken civilian and the step."""
        return Moment(self.step, self.actor_id, f"{self.lateral_m:.2f} m")


@dataclass(frozen=True)
class Holding:
    """A civilian that stands in the hold of its yield manoeuvre."""

    actor_id: int
    step: int
    """First step at which it stands."""
    offset_m: float
    """Offset from its lane's centre line, positive to the left."""

    @property
    def pulled_over(self) -> bool:
        """Whether it stands off the middle of its lane."""
        return abs(self.offset_m) >= OFF_CENTRE_M

    @property
    def moment(self) -> Moment:
        """The civilian and the step at which it begins to stand."""
        return Moment(self.step, self.actor_id, f"{self.offset_m:+.2f} m")


def queues_split(record: EpisodeRecord, thresholds: Mapping[str, float]) -> Verdict:
    """S1: at least ``holding_min`` civilians pull over and hold.

    The EMV overtakes ``overtaken_min`` between two queues.

    As it passes a vehicle, its centre is at most ``lateral_max_m`` from the boundary between the two lanes. It crosses
    the stop line of the site: an EMV that stands trapped in the queues has not got through.
    """
    places = places_of(record, record.rows)
    standing = find_holding(record, places)
    holding = [item.moment for item in standing if item.pulled_over]
    in_lane = [item.moment for item in standing if not item.pulled_over]
    held = _joined(listed(holding), "not pulled over", listed(in_lane))
    holding_part = at_least("holding", len(holding), thresholds["holding_min"], held, *holding)
    if not record.emv_ids:
        overtaken_part = at_least("overtaken", 0, thresholds["overtaken_min"], "there is no EMV")
        return verdict_of((holding_part, overtaken_part), "there is no EMV")
    emv_id = record.emv_ids[0]
    passed = find_overtakings(record, places, emv_id)
    between = [item for item in passed if item.lateral_m <= thresholds["lateral_max_m"]]
    aside = [item.moment for item in passed if item.lateral_m > thresholds["lateral_max_m"]]
    overtaken = [item.moment for item in between]
    parts = (
        holding_part,
        at_least(
            "overtaken",
            len(between),
            thresholds["overtaken_min"],
            _joined(listed(overtaken), "off the line", listed(aside)),
            *overtaken,
        ),
        _shorter_queue(between),
        _crossed(record, emv_id),
    )
    text = (
        f"{len(holding)} civilians pulled over and held, and the EMV passed {len(between)} between two queues "
        f"and {'crossed' if parts[-1].holds else 'did not cross'} the stop line"
    )
    return verdict_of(parts, text)


def _shorter_queue(between: list[Overtaking]) -> Part:
    """Number of overtaken vehicles on the side with fewer of them."""
    left, right = ([item.moment for item in between if item.side == side] for side in (1, -1))
    both = [max(pair, key=lambda moment: moment.step) for pair in zip(left, right, strict=False)]
    detail = f"{len(left)} on the left, {len(right)} on the right"
    return at_least("shorter_queue", len(both), QUEUE_MIN, detail, *both)


def _crossed(record: EpisodeRecord, emv_id: int) -> Part:
    """Whether an EMV's centre crosses the stop line of the site.

    Between the lanes it may be on none of them: its way is measured along the lane that is nearest to it.
    """
    stretch = record.description.site.get("stretch")
    edge = record.network.edge_by_id.get(str(stretch[-1])) if isinstance(stretch, list | tuple) and stretch else None
    emv = record.track(emv_id)
    steps = np.zeros(0, dtype=np.intp)
    for lane in (record.network.lanes[index] for index in (edge.lanes if edge else ())):
        along_m, left_m = lane.centre.project(emv.xy_m)
        near = np.abs(left_m) <= LATERAL_REACH_M
        beyond = near & (along_m >= lane.length_m)
        came = np.flatnonzero(beyond[1:] & near[:-1] & (along_m[:-1] < lane.length_m))
        steps = np.union1d(steps, emv.step[came + 1])
    first = [Moment(int(step), emv_id) for step in steps[:1]]
    return at_least("crossed", len(first), 1, listed(first), *first)


def _joined(counted: str, name: str, others: str) -> str:
    """Text of a count: what counts, then after a name what does not count."""
    return "; ".join(text for text in (counted, f"{name}: {others}" if others else "") if text)


def find_holding(record: EpisodeRecord, places: LanePlaces) -> tuple[Holding, ...]:
    """Find civilians that stand for ``HOLD_S`` in the hold of their yield, each once, by time.

    ``places`` of ``record.rows``.

    A civilian that stands away from its lane's centre line has pulled over. Where a civilian holds several times,
    its first time pulled over counts, or else its first time.
    """
    rows = record.rows
    still = (rows.mode == Mode.YIELD_HOLD) & (rows.speed_mps <= STANDING_MPS) & (places.lane != NO_LANE)
    aside = np.abs(places.offset_m) >= OFF_CENTRE_M
    state = still.astype(np.int8) + (still & aside)
    connected = (rows.actor_id[1:] == rows.actor_id[:-1]) & (rows.step[1:] == rows.step[:-1] + 1)
    starts = np.flatnonzero(np.concatenate(([True], ~connected | (state[1:] != state[:-1]), [True])))
    by_actor: dict[int, Holding] = {}
    for first, end in pairwise(starts):
        if not still[first] or end - first < steps_from_s(HOLD_S):
            continue
        holding = Holding(int(rows.actor_id[first]), int(rows.step[first]), float(places.offset_m[first]))
        before = by_actor.get(holding.actor_id)
        if before is None or (holding.pulled_over and not before.pulled_over):
            by_actor[holding.actor_id] = holding
    return tuple(sorted(by_actor.values(), key=lambda item: (item.step, item.actor_id)))


def find_overtakings(record: EpisodeRecord, places: LanePlaces, emv_id: int) -> tuple[Overtaking, ...]:
    """Find the EMV's passes of civilians in queues, each civilian once, by time; ``places`` of ``record.rows``.

    A civilian in a queue stands or creeps in a driving lane next to another driving lane.
    """
    rows = record.rows
    emv = record.track(emv_id)
    overtakings = []
    for actor_id, actor in record.actors.items():
        span = record.rows_of(actor_id)
        if actor.is_emv or not len(span):
            continue
        civilian = rows.select(span)
        for emv_row, row in _abreast(emv, civilian):
            lane = int(places.lane[span[row]])
            line = _boundary(record.network, lane, emv.xy_m[emv_row])
            if line is not None and civilian.speed_mps[row] <= CREEP_MPS:
                side, lateral_m = line
                overtakings.append(Overtaking(actor_id, int(civilian.step[row]), side, lateral_m))
                break
    return tuple(sorted(overtakings, key=lambda item: (item.step, item.actor_id)))


def _abreast(emv: StateRows, civilian: StateRows) -> list[tuple[int, int]]:
    """Rows of the EMV and of a civilian at each pass: the first step with the EMV's centre ahead."""
    _, emv_rows, rows = np.intersect1d(emv.step, civilian.step, assume_unique=True, return_indices=True)
    emv_then, civilian_then = emv.select(emv_rows), civilian.select(rows)
    ahead_m, left_m = ahead_and_left_m(emv_then, civilian_then)
    near = in_same_direction(emv_then, civilian_then) & (np.abs(left_m) < LATERAL_REACH_M)
    passes = np.flatnonzero((ahead_m[:-1] > 0.0) & (ahead_m[1:] <= 0.0) & near[1:]) + 1
    return [(int(emv_rows[index]), int(rows[index])) for index in passes]


def _boundary(network: RoadNetwork, lane: int, xy_m: Floats) -> tuple[int, float] | None:
    """Nearest boundary to a point between a driving lane and its neighbour; None if there is none.

    The lane lies on its side +1 (left) or −1; the second number is the point's distance from it.
    """
    if not _is_driving(network, lane):
        return None
    lane_of_road = network.lanes[lane]
    offset = float(lane_of_road.centre.project(xy_m)[1])
    lines = []
    for side in (1, -1):
        neighbour = network.neighbour(lane_of_road, side)
        if neighbour is not None and _is_driving(network, neighbour.index):
            lines.append((abs(offset - side * lane_of_road.width_m / 2.0), -side))
    if not lines:
        return None
    lateral_m, lies = min(lines)
    return lies, lateral_m


def _is_driving(network: RoadNetwork, lane: int) -> bool:
    """Whether a lane is a driving lane of a road, or a plain connection between two of them."""
    road = road_lane_of(network, lane)
    return road != NO_LANE and network.lanes[road].kind is LaneKind.DRIVING


JAM_MPS: Final = mps_from_kmh(20.0)
"""Largest speed of vehicles in a jam with stop-and-go traffic."""
BESIDE_M: Final = 15.0
"""The EMV is in the jam if slow vehicles are within this distance ahead or behind it on both sides: two cars and a
gap."""
STATION_M: Final = 2.0
"""Distance between the places at which the rescue lane is measured."""
BODY_M: Final = 5.0
"""Vehicles within this distance before and behind a place narrow it, too: an EMV is longer than the gaps between
them."""
ON_SHOULDER_M: Final = 0.3
"""A vehicle is on the hard shoulder if it reaches this far over the edge: more than a mirror or a long vehicle's
tail."""
_EACH_STEPS: Final = 10
"""The states are measured every half second."""


@dataclass(frozen=True, eq=False)
class RoadView:
    """The road of a jam: centre line of its leftmost lane, and lateral offsets from it, positive to the left."""

    line: Polyline
    boundary_m: float
    """Offset of the line between the leftmost lane and its right neighbour."""
    outer_m: float
    """Offset of the right edge of the rightmost driving lane; beyond it is the hard shoulder."""
    shoulders_m: tuple[tuple[float, float], ...]
    """Ranges along the road that have a hard shoulder: begin and end of each."""


def road_of(record: EpisodeRecord) -> RoadView | None:
    """The road of a record's site and the route before it, as long as the number of lanes stays the same.

    None where there are no two driving lanes.
    """
    site, network = record.description.site, record.network
    stretch, route = (site.get(key) for key in ("stretch", "route"))
    if not isinstance(stretch, list | tuple) or not isinstance(route, list | tuple) or not stretch:
        return None
    names = route[route.index(stretch[0]) :] if stretch[0] in route else stretch
    driven: list[list[Lane]] = []
    shoulders: list[Lane] = []
    for name in names:
        edge = network.edge_by_id.get(str(name))
        lanes = [network.lanes[lane] for lane in edge.lanes] if edge is not None else []
        driving = [lane for lane in lanes if lane.kind is LaneKind.DRIVING]
        if len(driving) < 2 or (driven and len(driving) != len(driven[0])):
            break
        driven.append(driving)
        shoulders += [lane for lane in lanes if lane.kind is LaneKind.SHOULDER]
    if not driven:
        return None
    line = Polyline.joined([driving[-1].centre for driving in driven])
    half_m = 0.5 * driven[0][-1].width_m
    outer_m = half_m - sum(lane.width_m for lane in driven[0])
    ends = (line.project(lane.centre.points[[0, -1]])[0].tolist() for lane in shoulders)
    return RoadView(line, -half_m, outer_m, tuple((first, last) for first, last in ends))


@dataclass(frozen=True, eq=False)
class Bodies:
    """Civilians on a road at one step: their extents along and across it, and their speeds."""

    actor_id: Ids
    from_m: Floats
    to_m: Floats
    right_m: Floats
    left_m: Floats
    speed_mps: Floats


def bodies_at(record: EpisodeRecord, road: RoadView, index: int) -> Bodies:
    """The civilians on driving lanes or hard shoulder at one of the record's states."""
    states = record.states[index]
    known = [record.actors[actor] for actor in states.actor_id.tolist()]
    half_length, half_width = 0.5 * np.array([(actor.length_m, actor.width_m) for actor in known]).reshape(-1, 2).T
    along, left = road.line.project(np.stack((states.x_m, states.y_m), axis=-1))
    turned = wrap_angle(states.yaw_rad - road.line.heading_rad(along))
    cos, sin = np.abs(np.cos(turned)), np.abs(np.sin(turned))
    length_m, width_m = cos * half_length + sin * half_width, sin * half_length + cos * half_width
    is_civilian = np.array([not actor.is_emv for actor in known], np.bool_)
    beside_m = 2.0 * road.boundary_m  # width of a lane, negative
    on_road = is_civilian & (left > road.outer_m + beside_m) & (left < -road.boundary_m) & (np.cos(turned) > 0.5)
    on_road &= (along > 0.0) & (along < road.line.length_m)
    extents = along - length_m, along + length_m, left - width_m, left + width_m, states.speed_mps
    return Bodies(states.actor_id[on_road], *(extent[on_road] for extent in extents))


def free_width_m(bodies: Bodies, places_m: Floats, road: RoadView) -> Floats:
    """Free width between the vehicles left and right of the boundary, at places; infinite if one side is empty."""
    on_left = bodies.left_m + bodies.right_m > 2.0 * road.boundary_m
    near = (places_m[:, None] > bodies.from_m - BODY_M) & (places_m[:, None] < bodies.to_m + BODY_M)
    left = np.min(np.where(near & on_left, bodies.right_m, np.inf), axis=1, initial=np.inf)
    right = np.max(np.where(near & ~on_left, bodies.left_m, -np.inf), axis=1, initial=-np.inf)
    return left - right


def _in_jam(bodies: Bodies, at_m: float, road: RoadView) -> bool:
    near = (bodies.from_m < at_m + BESIDE_M) & (bodies.to_m > at_m - BESIDE_M) & (bodies.speed_mps <= JAM_MPS)
    on_left = bodies.left_m + bodies.right_m > 2.0 * road.boundary_m
    return bool(np.any(near & on_left) and np.any(near & ~on_left))


def _on_shoulder(seen: Mapping[int, Bodies], road: RoadView, first_step: int) -> list[Moment]:
    """Civilians that stand on the hard shoulder, by id, with the step at which each is first seen there."""
    found: dict[int, Moment] = {}
    for index, bodies in seen.items():
        beyond = (bodies.right_m < road.outer_m - ON_SHOULDER_M) & (bodies.speed_mps <= STANDING_MPS)
        beside = [(bodies.to_m > first) & (bodies.from_m < last) for first, last in road.shoulders_m]
        for actor_id in bodies.actor_id[beyond & np.any(beside, axis=0)].tolist():
            found.setdefault(actor_id, Moment(first_step + index, actor_id))
    return [found[actor_id] for actor_id in sorted(found)]


def rescue_lane(record: EpisodeRecord, thresholds: Mapping[str, float]) -> Verdict:
    """S8: a rescue lane was open along the jam before each EMV came, and each drove through it.

    At each place of the jam the free width is looked at when the EMV's front is ``ahead_m`` before it, where no driver
    reacts to the siren yet. It has to be the EMV's width and ``side_m`` on both sides, on a share ``open_share_min`` of
    the places. The EMV drives ``through_min_m`` in the jam, with ``speed_min_mps`` on average. Nobody stands on the
    hard shoulder.
    """
    road = road_of(record)
    indices = range(0, record.steps, _EACH_STEPS)
    seen = {} if road is None else {index: bodies_at(record, road, index) for index in indices}
    verdicts = [_verdict(record, thresholds, road, seen, emv) for emv in record.emv_ids] if road else []
    failing = (verdict for verdict in verdicts if not verdict.holds)
    nothing = verdict_of((at_least("through_m", 0.0, thresholds["through_min_m"]),), "there is no EMV on a motorway")
    return next(failing, verdicts[0] if verdicts else nothing)


def _verdict(
    record: EpisodeRecord, thresholds: Mapping[str, float], road: RoadView, seen: Mapping[int, Bodies], emv_id: int
) -> Verdict:
    track, emv = record.track(emv_id), record.actors.get(emv_id)
    first = record.states[0].step if record.states else 0
    along_m, _ = road.line.project(track.xy_m)
    rows = [row for row, step in enumerate((track.step - first).tolist()) if step in seen]
    jammed = [row for row in rows if _in_jam(seen[int(track.step[row]) - first], float(along_m[row]), road)]
    ends = [min(row + _EACH_STEPS, len(along_m) - 1) for row in jammed]
    ways_m = [0.0, *accumulate(along_m[end] - along_m[row] for row, end in zip(jammed, ends, strict=True))]
    way_m = float(ways_m[-1])
    time_s = STEP_S * sum(end - row for row, end in zip(jammed, ends, strict=True))
    places = [np.arange(along_m[row], along_m[end], STATION_M) for row, end in zip(jammed, ends, strict=True)]
    front_m = along_m + (0.5 * emv.length_m if emv else 0.0) + thresholds["ahead_m"]
    needed_m = (emv.width_m if emv else 0.0) + 2.0 * thresholds["side_m"]
    widths = []
    for place_m in np.concatenate(places).tolist() if places else ():
        row = max(int(np.argmax(front_m >= place_m)) - 1, 0)
        bodies = seen.get((int(track.step[row]) - first) // _EACH_STEPS * _EACH_STEPS)
        if front_m[0] < place_m and bodies is not None:
            widths.append((float(free_width_m(bodies, np.array([place_m]), road)[0]), int(track.step[row])))
    share = float(np.mean([width_m >= needed_m for width_m, _ in widths])) if widths else 0.0
    on_shoulder = _on_shoulder(seen, road, first)
    narrowest = f"narrowest {min(widths)[0]:.2f} m, {needed_m:.2f} m are needed" if widths else ""
    worst = (Moment(min(widths)[1], emv_id),) if widths else ()
    driven = first_reaching(track.step[ends], emv_id, ways_m[1:], thresholds["through_min_m"])
    out = tuple(Moment(int(track.step[end]), emv_id) for end in ends[-1:])
    ids = ", ".join(str(moment.actor_id) for moment in on_shoulder)
    parts = (
        at_least("open_share", share, thresholds["open_share_min"], narrowest, *worst),
        at_least("through_m", way_m, thresholds["through_min_m"], "", *driven),
        at_least("speed_mps", way_m / time_s if time_s > 0.0 else 0.0, thresholds["speed_min_mps"], "", *out),
        at_most("on_shoulder", len(on_shoulder), 0, ids, *on_shoulder),
    )
    text = f"the rescue lane was open on {share:.0%} of the jam, and EMV {emv_id} drove {way_m:.0f} m through it"
    return verdict_of(parts, text)
