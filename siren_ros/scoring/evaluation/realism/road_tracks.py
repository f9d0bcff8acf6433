"""Tracks of road vehicles without a map: of an episode, or of other people's files; what they show of ordinary traffic.

The same code measures both, so that a difference is one of the traffic and not of the measure. Positions are middles of
footprints in any right-handed frame in metres, yaw counts counter-clockwise from its x axis. Raw accelerations and
jerks of camera tracks are mostly noise of the tracking, so the measures use gaps, passing times, and mean
accelerations over whole starts and stops.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Final, Self

import numpy as np

from siren_ros.base.numerics.arrays import Brief, Flags, Floats, Ids, Rows
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.simulation.world.actors import PEOPLE_CLASSES, Lights, Mode

SIREN_M: Final = 50.0
"""Drivers farther than this from every EMV with its siren on are ordinary traffic: the largest published range at which
a siren is heard in a closed car (De Lorenzo and Eilers, Ann. Emerg. Med. 20 (1991) 1377)."""
EVERY_S: Final = 0.2
"""Time between two frames that are kept, at least."""
_HALF_S: Final = 0.5 + 1e-6


@dataclass(frozen=True)
class RoadTracks(Brief):
    """States of vehicles, sorted by vehicle and then by time; arrays of shape ``(M,)``."""

    track_id: Ids
    time_s: Floats
    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    speed_mps: Floats
    length_m: Floats
    """NaN where a file has no sizes: such vehicles have no gaps."""
    width_m: Floats

    def __len__(self) -> int:
        return len(self.track_id)

    @classmethod
    def of_columns(cls, ids: Floats | Ids, times: Floats, *places: Floats) -> Self:
        """Sort columns by vehicle and time: x, y, yaw, length, width. States with missing poses are left out.

        The speed is that of the way driven within a second around each state: speeds that trackers give are noisy.
        """
        known = np.isfinite(np.stack((times, *places[:3]))).all(axis=0)
        order = np.flatnonzero(known)[np.lexsort((times[known], ids[known]))]
        x_m, y_m, yaw_rad, length_m, width_m = (column[order].astype(np.float64) for column in places)
        track_id, times = ids[order].astype(np.uint32), times[order].astype(np.float64)
        key = times + 1e6 * np.unique(track_id, return_inverse=True)[1]  # sorts by vehicle, then by time
        starts, ends = (np.searchsorted(track_id, track_id, side) for side in ("left", "right"))
        before = np.maximum(np.searchsorted(key, key - _HALF_S), starts)
        after = np.minimum(np.searchsorted(key, key + _HALF_S, "right"), ends) - 1
        way_m = np.hypot(x_m[after] - x_m[before], y_m[after] - y_m[before])
        speed_mps = way_m / np.maximum(times[after] - times[before], STEP_S)
        return cls(track_id, times, x_m, y_m, yaw_rad, speed_mps, length_m, width_m)

    @classmethod
    def of_record(cls, record: EpisodeRecord) -> Self:
        """Ordinary traffic of an episode: vehicles on four wheels or more while no siren is near, without EMVs."""
        rows = record.rows
        rows = rows.select(rows.step % round(EVERY_S / STEP_S) == 0)
        near = np.zeros(len(rows), dtype=np.bool_)
        for emv_id in record.emv_ids:
            emv = record.track(emv_id)
            at = np.searchsorted(emv.step, rows.step).clip(0, max(len(emv) - 1, 0))
            if len(emv):
                here = (emv.step[at] == rows.step) & ((emv.lights[at] & Lights.SIREN) != 0)
                near |= here & (np.hypot(*(emv.xy_m[at] - rows.xy_m).T) < SIREN_M)
        people = PEOPLE_CLASSES
        others = [key for key, actor in record.actors.items() if actor.is_emv or actor.actor_class in people]
        near |= np.isin(rows.actor_id, [*others, record.description.av_id])
        rows = rows.select(~near & (rows.mode != Mode.STOPPED))
        length_m, width_m = (
            np.array([getattr(record.actors[actor], size) for actor in rows.actor_id.tolist()])
            for size in ("length_m", "width_m")
        )
        return cls.of_columns(rows.actor_id, rows.time_s, rows.x_m, rows.y_m, rows.yaw_rad, length_m, width_m)

    def select(self, rows: Flags | Rows) -> Self:
        """Select some of the states."""
        return type(self)(*(getattr(self, field.name)[rows] for field in fields(self)))

    def each(self) -> Iterator[Self]:
        """One vehicle after the other."""
        starts = np.flatnonzero(np.diff(self.track_id, prepend=-1)) if len(self) else np.empty(0, dtype=np.intp)
        for first, end in pairwise((*starts.tolist(), len(self))):
            yield self.select(np.arange(first, end))

    def frames(self) -> Iterator[Self]:
        """One time after the other, at least ``EVERY_S`` apart."""
        order = np.argsort(self.time_s, kind="stable")
        times = self.time_s[order]
        starts = np.flatnonzero(np.diff(times, prepend=-np.inf) > 0.5 * STEP_S)
        last = -np.inf
        for first, end in pairwise((*starts.tolist(), len(self))):
            if times[first] - last >= EVERY_S - 0.5 * STEP_S:
                last = times[first]
                yield self.select(order[first:end])


STANDING_MPS: Final = 0.3
"""A slower vehicle counts as standing; camera tracks of parked cars show up to 0.2 m/s."""
QUEUED_WITHIN_M: Final = 8.0
"""Two standing vehicles with a larger gap between them are not one queue."""
FOLLOWS_WITHIN_M: Final = 40.0
"""A driver with a larger gap counts as driving freely."""
FOLLOWS_AT_MPS: Final = 1.0
"""A driver follows the vehicle ahead if their speeds differ by less than this."""
MOVES_MPS: Final = 3.0
"""Followers that are slower than this start or stop."""
_SAME_WAY_RAD: Final = np.pi / 6.0
_IN_LINE: Final = 0.6
"""Share of the mean width by which two bodies may lie beside one line; lanes are apart by 1.5 to 2 widths."""
_SLOW_MPS, _FAST_MPS = 1.0, 6.0
"""Speeds between which starts and stops are measured."""


def pairs_in(frame: RoadTracks) -> tuple[Rows, Rows, Floats]:
    """Find for each vehicle of a frame the nearest one ahead in its way, within 40 m: rows behind, rows ahead, gaps.

    Both head in the same direction within 30°, and lie along the mean of their headings with most of their widths in
    one line: there is no map, so on a bend only near vehicles are found.
    """
    count = len(frame)
    turn_rad = wrap_angle(frame.yaw_rad[None] - frame.yaw_rad[:, None])
    mean_rad = frame.yaw_rad[:, None] + 0.5 * turn_rad
    right, up = frame.x_m[None] - frame.x_m[:, None], frame.y_m[None] - frame.y_m[:, None]
    ahead_m = right * np.cos(mean_rad) + up * np.sin(mean_rad)
    aside_m = np.abs(up * np.cos(mean_rad) - right * np.sin(mean_rad))
    gap_m = ahead_m - 0.5 * (frame.length_m[:, None] + frame.length_m[None])
    meets = (np.abs(turn_rad) < _SAME_WAY_RAD) & (ahead_m > 0.0)
    meets &= aside_m < _IN_LINE * 0.5 * (frame.width_m[:, None] + frame.width_m[None])
    meets &= (gap_m > -1.0) & (gap_m < FOLLOWS_WITHIN_M)
    gap_m = np.where(meets, gap_m, np.inf)
    nearest = np.argmin(gap_m, axis=1) if count else np.empty(0, dtype=np.intp)
    behind = np.flatnonzero(meets.any(axis=1))
    return behind, nearest[behind], gap_m[behind, nearest[behind]]


def _queued(frame: RoadTracks) -> tuple[Rows, Rows, Floats]:
    """Pairs that stand one behind the other."""
    behind, ahead, gap_m = pairs_in(frame)
    stands = frame.speed_mps < STANDING_MPS
    near = stands[behind] & stands[ahead] & (gap_m < QUEUED_WITHIN_M)
    return behind[near], ahead[near], gap_m[near]


def standing_gaps_m(tracks: RoadTracks) -> Floats:
    """Gap between two vehicles that stand one behind the other: the median of each pair's, one value a pair."""
    gaps: dict[tuple[int, int], list[float]] = {}
    for frame in tracks.frames():
        behind, ahead, gap_m = _queued(frame)
        ids = frame.track_id[behind].tolist(), frame.track_id[ahead].tolist()
        for first, second, gap in zip(*ids, gap_m.tolist(), strict=True):
            gaps.setdefault((first, second), []).append(gap)
    return np.array([float(np.median(values)) for values in gaps.values()])


def following_headways_s(tracks: RoadTracks) -> Floats:
    """Time headways, front to front, of vehicles that follow another: one value a second of following."""
    speed_mps, gap_m, length_m = _following(tracks)
    return (gap_m + length_m) / speed_mps


def following_gaps_m(tracks: RoadTracks) -> Floats:
    """Gaps of vehicles that follow another: one value a second of following."""
    return _following(tracks)[1]


def _following(tracks: RoadTracks) -> Floats:
    """Speed, gap and length of the vehicle ahead, each second of all vehicles that follow another; ``(3, N)``."""
    found: list[Floats] = [np.empty((3, 0))]
    last = -np.inf
    for frame in tracks.frames():
        if frame.time_s[0] - last < 1.0 - 0.5 * STEP_S:
            continue
        last = float(frame.time_s[0])
        behind, ahead, gap_m = pairs_in(frame)
        speed, lead = frame.speed_mps[behind], frame.speed_mps[ahead]
        follows = (speed > MOVES_MPS) & (np.abs(lead - speed) < FOLLOWS_AT_MPS)
        found.append(np.stack((speed, gap_m, frame.length_m[ahead]))[:, follows])
    return np.concatenate(found, axis=1)


def crossing_lags_s(tracks: RoadTracks) -> Floats:
    """Time from one vehicle's driving over a place to that of the next one that comes across, one value a pair.

    It is the time gap that the first driver took, up to 12 s, to within the time for a square of 2 m.
    """
    over = tracks.select(tracks.speed_mps > STANDING_MPS)
    square = np.round(np.stack((over.x_m, over.y_m)) / _SQUARE_M)
    order = np.lexsort((over.time_s, *square))
    first, second = over.select(order[:-1]), over.select(order[1:])
    here = (np.diff(square[:, order], axis=1) == 0.0).all(axis=0)
    turn_rad, lag_s = np.abs(wrap_angle(second.yaw_rad - first.yaw_rad)), second.time_s - first.time_s
    across = here & (np.abs(turn_rad - 0.5 * np.pi) < 0.25 * np.pi) & (lag_s < _LAG_S)
    across &= first.track_id != second.track_id
    pairs = np.stack((first.track_id, second.track_id))[:, across]
    known, of = np.unique(pairs, axis=1, return_inverse=True)
    least_s = np.full(known.shape[1], np.inf)
    np.minimum.at(least_s, of.ravel(), lag_s[across])
    return least_s


_SQUARE_M: Final = 2.0
_LAG_S: Final = 12.0
"""Drivers take longer gaps without a look: critical gaps of turns are 4 to 7.5 s (HCM 2010, chapter 19)."""


def changes_of_speed(tracks: RoadTracks, order: int) -> Floats:
    """Accelerations (first order) or jerks (second) over whole seconds, of vehicles that move: one value a second.

    Noise of 0.1 m in each position of a tracker still gives them deviations of 0.24 m/s² and 0.45 m/s³.
    """
    found: list[Floats] = [np.empty(0)]
    for track in tracks.each():
        seconds = np.arange(np.ceil(track.time_s[0]), track.time_s[-1] + 1e-6)
        speed_mps = np.interp(seconds, track.time_s, track.speed_mps)
        found.append(np.diff(speed_mps, order)[speed_mps[order:] > STANDING_MPS])
    return np.concatenate(found)


def starts_mps2(tracks: RoadTracks) -> Floats:
    """Mean acceleration of each start from 1 to 6 m/s."""
    return np.array([value for track in tracks.each() for value in _ramps(track.time_s, track.speed_mps)])


def stops_mps2(tracks: RoadTracks) -> Floats:
    """Mean deceleration of each stop from 6 to 1 m/s, positive."""
    return np.array([value for track in tracks.each() for value in _ramps(-track.time_s[::-1], track.speed_mps[::-1])])


def _ramps(time_s: Floats, speed_mps: Floats) -> Iterator[float]:
    """Mean acceleration of each rise from the last time at 1 m/s to the first one at 6 m/s."""
    slow_s = None
    for (before_s, before), (now_s, now) in pairwise(zip(time_s.tolist(), speed_mps.tolist(), strict=True)):
        if before <= _SLOW_MPS < now:
            slow_s = before_s + (now_s - before_s) * (_SLOW_MPS - before) / (now - before)
        if slow_s is not None and before < _FAST_MPS <= now:
            fast_s = before_s + (now_s - before_s) * (_FAST_MPS - before) / (now - before)
            yield (_FAST_MPS - _SLOW_MPS) / (fast_s - slow_s)
            slow_s = None


QUEUE: Final = 3
"""Vehicles of a queue whose headways are left out: they include reaction and start-up (HCM 2010, chapter 31)."""


def discharge_headways_s(tracks: RoadTracks) -> Floats:
    """Times between the fronts of a queue's vehicles at the place where its first one stood, from the fourth one on.

    A queue is a chain of standing vehicles, each the next one ahead of the other; it needs no stop line. Only vehicles
    count that pass the place without another stop, as at green: at a stop sign each one waits there.
    """
    chains: dict[int, list[int]] = {}
    for frame in tracks.frames():
        for chain in _queues(frame):
            if len(chain) > len(chains.get(chain[0], ())):
                chains[chain[0]] = chain
    of = {int(track.track_id[0]): track for track in tracks.each()}
    headways: list[float] = []
    later = {other for chain in chains.values() for other in chain[1:]}
    for chain in (chain for first, chain in chains.items() if first not in later):
        first = of[chain[0]]
        stood = int(np.flatnonzero(first.speed_mps < STANDING_MPS)[-1])
        heading = np.array([np.cos(first.yaw_rad[stood]), np.sin(first.yaw_rad[stood])])
        place = np.array([first.x_m[stood], first.y_m[stood]]) + 0.5 * first.length_m[stood] * heading
        passings = [_passing(of[other], place, heading, float(first.time_s[stood])) for other in chain]
        passed = [passing for passing in passings if passing is not None]
        if len(passed) == len(passings):
            times, speeds = np.array(passed).T
            headways += np.diff(times)[QUEUE - 1 :][speeds[QUEUE:] >= MOVES_MPS].tolist()
    return np.array([value for value in headways if value > 0.0])


def _queues(frame: RoadTracks) -> Iterator[list[int]]:
    """Ids of each queue of a frame, its first vehicle first."""
    behind, ahead, _ = _queued(frame)
    follower = dict(zip(ahead.tolist(), behind.tolist(), strict=True))
    for row in set(follower) - set(follower.values()):
        chain = [row]
        while chain[-1] in follower and len(chain) < len(frame):
            chain.append(follower[chain[-1]])
        yield frame.track_id[chain].tolist()


def _passing(track: RoadTracks, place: Floats, heading: Floats, after_s: float) -> tuple[float, float] | None:
    """Time and speed at which a vehicle's front passes a line across a heading; None if its track does not show it."""
    fronts = np.stack((track.x_m, track.y_m), axis=-1) - place
    front_m = fronts @ heading + 0.5 * track.length_m
    over = np.flatnonzero((front_m[1:] > 0.0) & (front_m[:-1] <= 0.0) & (track.time_s[1:] >= after_s))
    if not len(over):
        return None
    row = int(over[0])
    since = min(max(int(np.searchsorted(track.time_s, after_s, "right")) - 1, 0), row)
    if np.diff(track.time_s[since : row + 2]).max() > _UNSEEN_S:
        return None
    share = -front_m[row] / (front_m[row + 1] - front_m[row])
    time_s = float(track.time_s[row] + share * (track.time_s[row + 1] - track.time_s[row]))
    return time_s, float(track.speed_mps[row])


_UNSEEN_S: Final = 1.0
"""A track with a longer hole, as it has while a siren is near, is of no ordinary discharge."""


def moving_speeds_mps(tracks: RoadTracks) -> Floats:
    """Speeds of vehicles that move: one value a second."""
    moving = tracks.speed_mps > STANDING_MPS
    second = np.floor(tracks.time_s).astype(np.int64)
    fresh = (np.diff(second, prepend=-1) != 0) | (np.diff(tracks.track_id, prepend=-1) != 0)
    return tracks.speed_mps[moving & fresh]
