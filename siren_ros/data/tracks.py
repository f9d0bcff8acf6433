"""Recorded vehicles: their tracks at 10 Hz, the paper's logging rate, and their places on the road.

Tracks are cut into windows of frames. A place is the lane, the position along it, or the position relative to another
vehicle.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Flags, Floats, Ids, Rows
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.errors import BagError
from siren_ros.simulation.roads.road_network import MAPS_KEPT, NO_LANE, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.scenario.scenario import region_members
from siren_ros.simulation.world.actors import ActorDescription, Indices, rows_of_ids

LOG_PERIOD_STEPS: Final = 2
"""Steps between logged frames, which are 10 Hz apart (paper: "actor states are logged at 10 Hz")."""
FRAME_S: Final = LOG_PERIOD_STEPS * STEP_S
"""Duration of a *frame*, one logged step."""
REGION: Final = "region"
"""Population of the vehicles that are in the interaction region around the EMV for the whole window."""
POPULATIONS: Final = (REGION, "all")
"""Populations, as in the evaluation of predictors."""
_MOTION: Final = ("x_m", "y_m", "z_m", "yaw_rad", "vx_mps", "vy_mps", "accel_mps2")


@dataclass(frozen=True)
class Track:
    """Track of one vehicle over the frames at which it is present; arrays of shape ``(K,)`` in the ``map`` frame."""

    actor: ActorDescription
    frame: Rows
    """Numbers of 10 Hz frames, increasing."""
    x_m: Floats
    y_m: Floats
    z_m: Floats
    yaw_rad: Floats
    vx_mps: Floats
    vy_mps: Floats
    accel_mps2: Floats
    in_region: Flags
    """Whether the vehicle is in the interaction region around the EMV."""

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def xy_m(self) -> Floats:
        """Positions, shape ``(K, 2)``."""
        return np.stack((self.x_m, self.y_m), axis=-1)

    @property
    def speed_mps(self) -> Floats:
        """Speed over ground."""
        return np.hypot(self.vx_mps, self.vy_mps)

    def window(self, first: int, count: int) -> "Track":
        """The part of the track in some frames."""
        start, end = np.searchsorted(self.frame, [first, first + count])
        arrays: dict[str, Any] = {
            name: values[start:end] for name, values in vars(self).items() if isinstance(values, np.ndarray)
        }
        return Track(actor=self.actor, **arrays)


def rows_in_region(record: EpisodeRecord, *, walkers: bool = False) -> Flags:
    """Which of ``record.rows`` are in the interaction region at their step, shape ``(M,)``.

    It counts vehicles, and pedestrians too with ``walkers``.

    """
    members, inside = np.empty(0, dtype=np.uint32), [np.empty(0, dtype=np.int64)]
    for state in sorted(record.states, key=lambda state: state.step):
        members = region_members(members, state, record.emv_ids)
        inside.append(_row_keys(members, state.step))
    rows = record.rows
    left_out = np.isin(rows.actor_id, [] if walkers else record.walker_ids)
    return ~left_out & np.isin(_row_keys(rows.actor_id, rows.step), np.concatenate(inside))


def _row_keys(actor_id: Ids, step: Any) -> npt.NDArray[np.int64]:
    return np.asarray(actor_id.astype(np.int64) << 32 | step, dtype=np.int64)


def tracks_of(record: EpisodeRecord) -> tuple[Track, ...]:
    """The tracks of all vehicles, in the order of actor ids.

    Raises BagError: the record holds states of an actor that it does not describe.
    """
    rows, inside = record.rows, rows_in_region(record)
    logged = np.flatnonzero(rows.step % LOG_PERIOD_STEPS == 0)
    tracks = []
    for actor_id in np.unique(rows.actor_id[logged]).tolist():
        actor = record.actors.get(actor_id)
        if actor is None:
            raise BagError(record.description.template, f"an episode that describes its actors; {actor_id} is not")
        of_actor = logged[rows.actor_id[logged] == actor_id]
        frame = rows.step[of_actor] // LOG_PERIOD_STEPS
        motion = {name: getattr(rows, name)[of_actor] for name in _MOTION}
        tracks.append(Track(actor, frame, **motion, in_region=inside[of_actor]))
    return tuple(tracks)


def whole_windows(track: Track, count: int, population: str) -> Rows:
    """First frames of windows of ``count`` frames with the vehicle present and in the population throughout."""
    frames = track.frame[track.in_region] if population == REGION else track.frame
    if len(frames) < count:
        return np.empty(0, dtype=np.intp)
    whole = frames[count - 1 :] - frames[: len(frames) - count + 1] == count - 1
    return frames[: len(frames) - count + 1][whole].astype(np.intp)


DRIVEN_KINDS: Final = frozenset({LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL})
"""Kinds of lanes that vehicles use."""
_END_MARGIN_M: Final = 0.05
"""Tolerance for the gap between lanes of consecutive edges, which comes from SUMO's two decimals."""
_HINT_BONUS_M: Final = 100.0
"""Bonus that makes SUMO's lane win where a pose is in several lanes (paths across a junction overlap)."""
_INTERNAL_PENALTY_M: Final = 10.0
ALIGNED_RAD: Final = np.pi / 3.0
"""Two vehicles drive in the same direction if their headings differ by less than this."""


@dataclass(frozen=True)
class LanePlaces:
    """Lane of each of M poses; arrays of shape ``(M,)``."""

    lane: Indices
    """Index into ``RoadNetwork.lanes``; NO_LANE where the pose is in no lane of its direction."""
    arc_m: Floats
    """Arc length of the footprint's centre on the lane's centre line."""
    offset_m: Floats
    """Distance of the centre from the lane's centre line, positive to the left."""


def locate(network: RoadNetwork, xy_m: Floats, yaw_rad: Floats, hint: Indices) -> LanePlaces:
    """Find the lane of each pose: it contains the footprint's centre, and its direction is within 90° of the heading.

    Footprint centres have the shape ``(M, 2)``, headings ``(M,)``. ``hint`` is the preferred lane where a pose lies in
    several ones, NO_LANE for none, shape ``(M,)``.
    """
    count, x_m, y_m = len(xy_m), xy_m[:, 0].copy(), xy_m[:, 1].copy()
    lane = np.full(count, NO_LANE, dtype=np.int32)
    arc, offset, cost = np.zeros(count), np.zeros(count), np.full(count, np.inf)
    for candidate, low, high in _around(network, xy_m) if count else ():
        near = np.flatnonzero((x_m >= low[0]) & (x_m <= high[0]) & (y_m >= low[1]) & (y_m <= high[1]))
        if len(near) == 0:
            continue
        s, left = candidate.centre.project(xy_m[near])
        turned = np.abs(wrap_angle(candidate.centre.heading_rad(s) - yaw_rad[near]))
        inside = np.abs(left) <= candidate.width_m / 2.0
        inside &= (s >= -_END_MARGIN_M) & (s <= candidate.length_m + _END_MARGIN_M) & (turned < np.pi / 2.0)
        penalty = _INTERNAL_PENALTY_M if candidate.kind is LaneKind.INTERNAL else 0.0
        price = np.abs(left) + penalty - _HINT_BONUS_M * (hint[near] == candidate.index)
        better = inside & (price < cost[near])
        rows = near[better]
        lane[rows], arc[rows], offset[rows], cost[rows] = candidate.index, s[better], left[better], price[better]
    return LanePlaces(lane, arc, offset)


def _around(network: RoadNetwork, xy_m: Floats) -> Iterator[tuple[Lane, Floats, Floats]]:
    """Lanes near some of the points, in their order, each with two corners of its bounding box."""
    lanes, low, high = _boxes(network)
    near = (low <= np.fmax.reduce(xy_m)).all(axis=1) & (high >= np.fmin.reduce(xy_m)).all(axis=1)
    for k in np.flatnonzero(near).tolist():
        yield lanes[k], low[k], high[k]


@lru_cache(maxsize=MAPS_KEPT)
def _boxes(network: RoadNetwork) -> tuple[tuple[Lane, ...], Floats, Floats]:
    """Lanes that vehicles use, and two corners of each lane's bounding box, shape ``(L, 2)``."""
    lanes = tuple(lane for lane in network.lanes if lane.kind in DRIVEN_KINDS)
    low = np.array([lane.centre.points.min(axis=0) - lane.width_m for lane in lanes]).reshape(-1, 2)
    high = np.array([lane.centre.points.max(axis=0) + lane.width_m for lane in lanes]).reshape(-1, 2)
    return lanes, low, high


def sumo_lanes(record: EpisodeRecord, rows: StateRows) -> Indices:
    """SUMO's lane of each row's actor at the row's step, shape ``(M,)``; NO_LANE where it is unknown."""
    hint = np.full(len(rows), NO_LANE, dtype=np.int32)
    order = np.argsort(rows.step, kind="stable")
    edges = np.searchsorted(rows.step[order], [traffic.step for traffic in record.traffic])
    ends = np.searchsorted(rows.step[order], [traffic.step for traffic in record.traffic], side="right")
    for traffic, first, last in zip(record.traffic, edges, ends, strict=True):
        at_step = order[first:last]
        row_of_traffic = rows_of_ids(traffic.actor_id, rows.actor_id[at_step])
        known = row_of_traffic >= 0
        hint[at_step[known]] = traffic.lane[row_of_traffic[known]]
    return hint


def places_of(record: EpisodeRecord, rows: StateRows) -> LanePlaces:
    """Lanes of some rows of a record."""
    return locate(record.network, rows.xy_m, rows.yaw_rad, sumo_lanes(record, rows))


class Drive:
    """One actor's rows of a record in the order of time, with its lanes."""

    def __init__(self, record: EpisodeRecord, places: LanePlaces, actor_id: int) -> None:
        """Select the actor's rows; ``places`` are the lanes of ``record.rows``."""
        span = record.rows_of(actor_id)
        self.actor = record.actors[actor_id]
        self.network = record.network
        self.rows = record.rows.select(span)
        self.lane = places.lane[span]
        self.arc_m = places.arc_m[span]
        self.offset_m = places.offset_m[span]


def lanes_ahead(network: RoadNetwork, lane: int, reach_m: float) -> frozenset[int]:
    """The lane and all lanes that follow it without a lane change, including paths across junctions.

    The lane may be a path across a junction; the reach begins at its end.
    """
    nearest = {lane: 0.0}
    queue = [lane]
    while queue:
        current = queue.pop()
        if nearest[current] > reach_m:
            continue
        for following in _followings(network, current):
            along = nearest[current]
            for step in following:
                along += network.lanes[step].length_m
                if along < nearest.get(step, np.inf):
                    nearest[step] = along
                    if step == following[-1]:
                        queue.append(step)
    return frozenset(nearest)


def _followings(network: RoadNetwork, lane: int) -> list[tuple[int, ...]]:
    """The lanes that follow a lane, or the rest of a path across a junction, for each movement."""
    if network.lanes[lane].kind is LaneKind.INTERNAL:
        on_path = [connection for connection in network.connections if lane in connection.via]
        return [(*item.via[item.via.index(lane) + 1 :], item.to_lane) for item in on_path]
    return [(*connection.via, connection.to_lane) for connection in network.connections_from.get(lane, ())]


def common_rows(first: StateRows, second: StateRows) -> tuple[StateRows, StateRows]:
    """The rows of two tracks at their common steps, in the order of time."""
    _, in_first, in_second = np.intersect1d(first.step, second.step, assume_unique=True, return_indices=True)
    return first.select(in_first), second.select(in_second)


def ahead_and_left_m(observer: StateRows, other: StateRows) -> tuple[Floats, Floats]:
    """Position of the other's centre in the observer's axes; rows of the same steps, arrays of shape ``(M,)``."""
    delta = other.xy_m - observer.xy_m
    cos, sin = np.cos(observer.yaw_rad), np.sin(observer.yaw_rad)
    ahead_m: Floats = delta[:, 0] * cos + delta[:, 1] * sin
    left_m: Floats = delta[:, 1] * cos - delta[:, 0] * sin
    return ahead_m, left_m


def in_same_direction(observer: StateRows, other: StateRows) -> npt.NDArray[np.bool_]:
    """Whether the headings differ by less than ``ALIGNED_RAD``; rows of the same steps."""
    aligned: npt.NDArray[np.bool_] = np.abs(wrap_angle(other.yaw_rad - observer.yaw_rad)) < ALIGNED_RAD
    return aligned
