"""Template S1: civilians in two queues pull over and hold; the EMV passes between them and crosses the stop line."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.units import steps_from_s
from siren_ros.data.record.vehicle_location import LanePlaces, ahead_and_left_m, in_same_direction, places_of
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.scoring.judging.verdict import Moment, Part, Verdict, at_least, listed, verdict_of
from siren_ros.simulation.roads.movements import road_lane_of
from siren_ros.simulation.roads.road_network import NO_LANE, LaneKind, RoadNetwork
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
