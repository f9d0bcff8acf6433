"""Template S8: a rescue lane is open in a jam before the EMV comes, and the EMV drives through it."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Ids
from siren_ros.base.numerics.geometry import Polyline, wrap_angle
from siren_ros.base.numerics.units import STEP_S, mps_from_kmh
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.scoring.judging.queue_splitting import STANDING_MPS
from siren_ros.scoring.judging.verdict import Moment, Verdict, at_least, at_most, first_reaching, verdict_of
from siren_ros.simulation.roads.road_network import Lane, LaneKind

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
