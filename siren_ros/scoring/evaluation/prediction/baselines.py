"""Predictors without learning: constant motion, motion along the lane, the Intelligent Driver Model.

Acceleration and turn rate are slopes over the last second of the history: a tracker measures neither. Along the lane a
vehicle keeps its offset from the centre line and goes straight on at junctions; one in no lane goes straight ahead.
With IDM its leader is the next vehicle along the successors of its lane, or the next one straight ahead where it is in
no lane. Those that stop see what the learned predictor sees of lines: red signals and stop signs on that way.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Flags, Floats, Rows
from siren_ros.base.numerics.geometry import Polyline, wrap_angle
from siren_ros.data.tracks import LanePlaces, locate
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, ObservedActors, SampleBatch, future_times_s
from siren_ros.simulation.roads.road_network import NO_LANE, Connection, Lane, RoadNetwork
from siren_ros.simulation.world.actors import ActorClass, Indices


@dataclass(frozen=True)
class ConstantVelocity:
    """Predicts that every vehicle keeps its present velocity.

    The velocity is the recorded one (columns ``vx, vy`` of ``trajectory.csv``). The difference of the last two points
    of the history would be the velocity half a grid period earlier.
    """

    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """Give one hypothesis per sample."""
        return Hypotheses.certain(batch.xy_m[:, None] + future_times_s()[:, None] * batch.velocity_mps[:, None])


@dataclass(frozen=True)
class Idm:
    """The Intelligent Driver Model with the parameters of its application to roads.

    Source: M. Treiber, A. Hennecke, D. Helbing, Phys. Rev. E 62 (2000) 1805, eqs. 2 to 4.
    """

    time_headway_s: float = 1.5
    standstill_gap_m: float = 2.0
    acceleration_mps2: float = 1.5
    comfortable_braking_mps2: float = 2.0
    exponent: float = 4.0
    """Exponent of the free-road term, as in the original."""
    integration_s: float = 0.1
    range_m: float = 250.0
    """Largest distance to a leader."""
    off_lane_limit_mps: float = 50.0 / 3.6
    """Speed limit for vehicles in no lane: that of an urban road."""
    standing_mps: float = 0.1
    """Least desired speed of pedestrians and cyclists, whose desired speed no speed limit tells."""
    least_gap_m: float = 0.1
    """Smallest gap that the model accepts; the measured gap is negative where vehicles overlap."""

    def acceleration(self, speed_mps: Floats, desired_mps: Floats, gap_m: Floats, closing_mps: Floats) -> Floats:
        """Acceleration of the model; all arrays of shape ``(N,)``; an infinite gap means a free road.

        Args:
            speed_mps: Speed of the follower.
            desired_mps: Its speed on a free road.
            gap_m: Distance from the follower's front bumper to the leader's rear bumper.
            closing_mps: The follower's speed minus the leader's.
        """
        braking_term = 2.0 * np.sqrt(self.acceleration_mps2 * self.comfortable_braking_mps2)
        dynamic = speed_mps * self.time_headway_s + speed_mps * closing_mps / braking_term
        desired_gap = self.standstill_gap_m + np.maximum(dynamic, 0.0)
        free = (speed_mps / desired_mps) ** self.exponent
        return self.acceleration_mps2 * (1.0 - free - (desired_gap / np.maximum(gap_m, self.least_gap_m)) ** 2)

    def travel(
        self, speed_mps: Floats, desired_mps: Floats, gap_m: Floats, leader_mps: Floats, times_s: Floats
    ) -> Floats:
        """Distances travelled behind leaders of constant speed, shape ``(N, T)``.

        Ballistic update: a vehicle whose speed would become negative stops within the step
        (M. Treiber, V. Kanagaraj, Physica A 419 (2015) 183, eqs. 10 and 11).

        Args:
            speed_mps: Present speeds, shape ``(N,)``.
            desired_mps: Speeds on a free road, shape ``(N,)``.
            gap_m: Present bumper gaps, inf without a leader, shape ``(N,)``.
            leader_mps: Leaders' speeds, shape ``(N,)``.
            times_s: Times of the answer, multiples of the integration step, shape ``(T,)``.
        """
        dt = self.integration_s
        steps = np.round(times_s / dt).astype(np.intp)
        speed, travelled = speed_mps, np.zeros(len(speed_mps))
        after = [travelled]
        for step in range(int(steps.max())):
            gap = gap_m + leader_mps * (step * dt) - travelled
            acceleration = self.acceleration(speed, desired_mps, gap, speed - leader_mps)
            stops = speed + acceleration * dt < 0.0
            to_stop = 0.5 * speed**2 / np.where(stops, -acceleration, 1.0)
            travelled = travelled + np.where(stops, to_stop, speed * dt + 0.5 * acceleration * dt**2)
            speed = np.where(stops, 0.0, speed + acceleration * dt)
            after.append(travelled)
        return np.stack(after, axis=-1)[:, steps]


_SAME_TURN_RAD = 0.1
"""Movements whose turns differ by less count as equally straight; then the smaller lateral shift decides."""


def straight_successors(network: RoadNetwork) -> Indices:
    """The lane that follows each lane without a lane change, NO_LANE at an end; shape ``(L,)``.

    Where several movements leave a lane, the straightest is taken, because an observer does not know the driver's
    turn. Lanes of the same kind come first, so that a shoulder leads to a shoulder. A path across a junction is
    followed to its end.
    """
    successor = np.full(len(network.lanes), NO_LANE, dtype=np.int32)
    for lane in network.lanes:
        movements = network.connections_from.get(lane.index, ())
        if movements:
            best = min(movements, key=lambda movement: _bend(network, lane, movement))
            successor[lane.index] = (*best.via, best.to_lane)[0]
    for movement in network.connections:
        chain = (*movement.via, movement.to_lane)
        for inside, following in pairwise(chain):
            successor[inside] = following
    return successor


def _bend(network: RoadNetwork, lane: Lane, movement: Connection) -> tuple[bool, int, float, int]:
    target = network.lanes[movement.to_lane]
    heading = float(lane.centre.heading_rad(lane.length_m))
    turn = abs(float(wrap_angle(target.centre.heading_rad(0.0) - heading)))
    ahead = target.centre.points[0] - lane.centre.points[-1]
    sideways = abs(float(ahead[1] * np.cos(heading) - ahead[0] * np.sin(heading)))
    return target.kind is not lane.kind, round(turn / _SAME_TURN_RAD), sideways, target.index


@dataclass(frozen=True)
class LanePaths:
    """P paths, each straight ahead from one lane."""

    path_of_lane: npt.NDArray[np.intp]
    """Path that starts at each lane of the network, −1 if none does; shape ``(L,)``."""
    curves: tuple[Polyline, ...]
    """Centre line of each path, from its first lane's start."""
    start_m: Floats
    """Distance along path p at which lane l begins, infinite if p does not use it; shape ``(P, L)``."""

    def points(self, path: npt.NDArray[np.intp], arc_m: Floats, offset_m: Floats) -> Floats:
        """Positions along paths.

        Args:
            path: Path of each of N vehicles, shape ``(N,)``.
            arc_m: Distances along it, shape ``(N, T)``; the path continues straight past its end.
            offset_m: Offset to keep from the centre line, left positive, shape ``(N,)``.

        Returns:
            Shape ``(N, T, 2)``.
        """
        points = np.zeros((*arc_m.shape, 2))
        for index in np.unique(path).tolist():
            rows = path == index
            points[rows] = self.curves[index].offset_points(arc_m[rows], offset_m[rows, None])
        return points


def paths_from(network: RoadNetwork, lanes: npt.NDArray[np.int32], reach_m: float) -> LanePaths:
    """Paths straight ahead from some lanes, each given once.

    A path reaches ``reach_m`` beyond the end of its first lane, as far as lanes follow.
    """
    successor = straight_successors(network)
    path_of_lane = np.full(len(network.lanes), -1, dtype=np.intp)
    start_m = np.full((len(lanes), len(network.lanes)), np.inf)
    curves = []
    for path, first in enumerate(lanes.tolist()):
        path_of_lane[first] = path
        chain, lane, end = [], first, 0.0
        end_of_reach = network.lanes[first].length_m + reach_m
        while lane != NO_LANE and end < end_of_reach:
            chain.append(network.lanes[lane].centre)
            start_m[path, lane] = min(start_m[path, lane], end)
            end += network.lanes[lane].length_m
            lane = int(successor[lane])
        curves.append(Polyline.joined(chain))
    return LanePaths(path_of_lane, tuple(curves), start_m)


def drive_along(batch: SampleBatch, places: LanePlaces, paths: LanePaths, travelled_m: Floats) -> Floats:
    """Positions of vehicles after distances of shape ``(N, T)``: along the path of their lane, else straight ahead.

    Arguments as of ``leaders_of``; returns shape ``(N, T, 2)``.
    """
    lane = places.lane[batch.target]
    in_lane = lane != NO_LANE
    heading = np.stack((np.cos(batch.yaw_rad), np.sin(batch.yaw_rad)), axis=-1)
    path = batch.xy_m[:, None] + travelled_m[..., None] * heading[:, None]
    rows = batch.target[in_lane]
    arc_m = places.arc_m[rows, None] + travelled_m[in_lane]
    path[in_lane] = paths.points(paths.path_of_lane[lane[in_lane]], arc_m, places.offset_m[rows])
    return path


def leaders_of(batch: SampleBatch, places: LanePlaces, paths: LanePaths, range_m: float) -> tuple[Floats, Floats]:
    """Find the leader of each sample: the nearest vehicle whose centre is ahead within the range.

    The leader of a sample in a lane is in this lane or in those that follow straight on. The leader of a sample in
    no lane overlaps the strip that the sample sweeps straight ahead; its heading does not matter. ``places`` are those
    of all rows of ``batch.actors``, ``paths`` those from every sample's lane.

    Returns:
        Gaps in metres from the sample's front bumper to the leader's rear bumper, inf without a leader, and the
        leaders' speeds in m/s in the sample's direction, not negative, 0 without a leader; shapes ``(N,)``. A gap is
        negative where the two overlap lengthwise: the leader's centre is ahead, its rear behind the sample's front.
    """
    actors = batch.actors
    sample, other = batch.neighbours()
    follower = batch.target[sample]
    distance, speed = _straight_ahead(actors, follower, other)
    in_lane = np.flatnonzero(places.lane[follower] != NO_LANE)
    behind, leading = follower[in_lane], other[in_lane]
    start_m = paths.start_m[paths.path_of_lane[places.lane[behind]], places.lane[leading]]
    start_m = np.where(places.lane[leading] == NO_LANE, np.inf, start_m)
    distance[in_lane] = start_m + places.arc_m[leading] - places.arc_m[behind]
    speed[in_lane] = np.hypot(*actors.velocity_mps[leading, -1].T)
    ahead = np.flatnonzero((distance > 0.0) & (distance <= range_m))
    gap = (distance - 0.5 * (actors.length_m[follower] + actors.length_m[other]))[ahead]
    order = np.lexsort((gap, sample[ahead]))
    led, first = np.unique(sample[ahead][order], return_index=True)
    nearest = order[first]
    gap_m, speed_mps = np.full(len(batch), np.inf), np.zeros(len(batch))
    gap_m[led], speed_mps[led] = gap[nearest], speed[ahead][nearest]
    return gap_m, speed_mps


def _straight_ahead(actors: ObservedActors, follower: Rows, other: Rows) -> tuple[Floats, Floats]:
    """Distances to the others' centres along the headings, infinite outside the strip, and their speeds along them."""
    cos, sin = np.cos(actors.yaw_rad[follower, -1]), np.sin(actors.yaw_rad[follower, -1])
    x, y = (actors.xy_m[other, -1] - actors.xy_m[follower, -1]).T
    vx, vy = actors.velocity_mps[other, -1].T
    in_strip = np.abs(cos * y - sin * x) < 0.5 * (actors.width_m[follower] + actors.width_m[other])
    return np.where(in_strip, cos * x + sin * y, np.inf), np.maximum(cos * vx + sin * vy, 0.0)


RED_LETTERS: Final = "ru"
"""SUMO's letters for a red signal."""
_LINE_BEHIND_M: Final = 1.0
"""A stop line counts as ahead until the front bumper is this far beyond it."""
_AT_REST_MPS: Final = 0.1
"""Below this speed a vehicle has stopped at a stop sign, and may go on."""


def lines_of(batch: SampleBatch, places: LanePlaces, paths: LanePaths) -> Floats:
    """Distances from the front bumpers to the next line at which each sample has to stop, inf without one; ``(N,)``.

    It is a line with a red signal, or a stop sign for those that have not stopped yet, on the way straight ahead.
    EMVs stop at none: at three of four levels they may pass. Arguments as of ``leaders_of``.
    """
    network, actors, target = batch.network, batch.actors, batch.target
    successor, lane = straight_successors(network), places.lane[target]
    bound = (lane != NO_LANE) & (~actors.is_emv[target])
    front_m = places.arc_m[target] + 0.5 * actors.length_m[target]
    line_m = np.full(len(batch), np.inf)
    for path in np.unique(paths.path_of_lane[lane[bound]]).tolist():
        rows = np.flatnonzero(bound & (paths.path_of_lane[lane] == path))
        for used in np.flatnonzero(np.isfinite(paths.start_m[path])).tolist():
            for movement in network.connections_from.get(used, ()):
                if (*movement.via, movement.to_lane)[0] != successor[used]:
                    continue
                away_m = paths.start_m[path, used] + network.lanes[used].length_m - front_m[rows]
                stops = (away_m > -_LINE_BEHIND_M) & _must_stop(batch, movement, rows)
                line_m[rows] = np.minimum(line_m[rows], np.where(stops, away_m, np.inf))
    return line_m


def _must_stop(batch: SampleBatch, movement: Connection, samples: Rows) -> Flags:
    """Whether a movement's line binds some samples at their present frame."""
    states = batch.signals.get(movement.signal_id or "")
    if states is None or not 0 <= movement.signal_link < states.shape[1]:
        return movement.must_stop & (batch.speed_mps[samples] > _AT_REST_MPS)
    shown = states[batch.actors.frame[batch.target[samples]], movement.signal_link]
    return np.isin(shown, [ord(letter) for letter in RED_LETTERS])


def halting(speed_mps: Floats, line_m: Floats, braking_mps2: float, times_s: Floats) -> Floats:
    """Distances of who drives on at its speed and stops at a line, ``(N, T)``; inf without a line.

    It brakes as late as it can with ``braking_mps2``, or at once and harder where that is too late already.
    """
    away_m = np.maximum(line_m, 0.01)[:, None]
    speed = speed_mps[:, None]
    harder = np.maximum(braking_mps2, speed**2 / (2.0 * away_m))
    begin_s = (away_m - speed**2 / (2.0 * harder)) / np.maximum(speed, _AT_REST_MPS)
    braked_s = np.clip(times_s - begin_s, 0.0, speed / harder)
    driven = speed * (np.minimum(times_s, begin_s) + braked_s) - 0.5 * harder * braked_s**2
    return np.where(np.isfinite(away_m), driven, np.inf)


@dataclass(frozen=True)
class IdmPredictor:
    """Car following along the lane's path: the leader keeps its velocity, the desired speed is max(v, speed limit).

    People on foot and on bicycles desire their present speed.

    A vehicle keeps its present offset from the lane's centre line, so that the prediction starts at its position.
    A vehicle in no lane goes straight ahead. The predictor knows no routes, and signals and stop signs only if it
    ``stops``: then the line is a standing leader.
    """

    idm: Idm = field(default_factory=Idm)
    stops: bool = False
    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """Give one hypothesis per sample."""
        actors, idm = batch.actors, self.idm
        places = locate(batch.network, actors.xy_m[:, -1], actors.yaw_rad[:, -1], actors.sumo_lane)
        lane = places.lane[batch.target]
        in_lane = lane != NO_LANE
        paths = paths_from(batch.network, np.unique(lane[in_lane]), idm.range_m)
        gap_m, leader_mps = leaders_of(batch, places, paths, idm.range_m)
        limits = [road_lane.speed_limit_mps for road_lane in batch.network.lanes]
        speed = batch.speed_mps
        # NO_LANE is −1 and selects the last limit, which is for vehicles in no lane.
        desired = np.maximum(speed, np.array([*limits, idm.off_lane_limit_mps])[lane])
        unmotorised = np.isin(actors.actor_class[batch.target], (ActorClass.PEDESTRIAN, ActorClass.BICYCLE))
        desired[unmotorised] = np.maximum(speed[unmotorised], idm.standing_mps)
        travelled = idm.travel(speed, desired, gap_m, leader_mps, future_times_s())
        if self.stops:
            line_m = lines_of(batch, places, paths)
            to_line = idm.travel(speed, desired, line_m, np.zeros(len(batch)), future_times_s())
            travelled = np.minimum(travelled, to_line)
        return Hypotheses.certain(drive_along(batch, places, paths, travelled))


_SLOPE_POINTS: Final = 6
"""Number of history points (1 s) for a slope."""
_SUBSTEPS: Final = 20
"""Integration steps per 0.2 s of the prediction."""


def slope(values: Floats, times_s: Floats) -> Floats:
    """Slope per second over the last second of a history, by least squares; values ``(N, H)``, result ``(N,)``."""
    times = times_s[-_SLOPE_POINTS:] - times_s[-_SLOPE_POINTS:].mean()
    return np.asarray(values[:, -_SLOPE_POINTS:] @ times / (times @ times))


def acceleration_of(batch: SampleBatch) -> Floats:
    """Acceleration of the samples over the last second, in m/s², shape ``(N,)``."""
    speed = np.hypot(*np.moveaxis(batch.actors.velocity_mps[batch.target], -1, 0))
    return slope(speed, batch.window.times_s)


def turn_rate_of(batch: SampleBatch) -> Floats:
    """Turn rate of the samples over the last second, in rad/s, shape ``(N,)``."""
    return slope(np.unwrap(batch.actors.yaw_rad[batch.target], axis=1), batch.window.times_s)


def fine_times_s() -> Floats:
    """Midpoints of the integration steps, shape ``(T · substeps,)``."""
    step = future_times_s()[0] / _SUBSTEPS
    return (np.arange(len(future_times_s()) * _SUBSTEPS) + 0.5) * step


def integrated(rates: Floats) -> Floats:
    """Integrate rates at ``fine_times_s`` up to each predicted time; ``(N, T · substeps, …)`` gives ``(N, T, …)``."""
    step = future_times_s()[0] / _SUBSTEPS
    return np.asarray(np.cumsum(rates, axis=1)[:, _SUBSTEPS - 1 :: _SUBSTEPS] * step)


def speeds_of(speed_mps: Floats, gained_mps: Floats) -> Floats:
    """Speeds at ``fine_times_s``, at least 0: present speed plus its gain, which must be monotonic.

    Shapes ``(N,)`` and ``(N, T · substeps)``.
    """
    return np.asarray(np.maximum(speed_mps[:, None] + gained_mps, 0.0))


@dataclass(frozen=True)
class TurnRate:
    """Constant acceleration along the heading, and constant turn rate (CTRA) or none (CA).

    Source: R. Schubert, E. Richter, G. Wanielik, Int. Conf. Information Fusion 2008. A vehicle that brakes stops.
    """

    turns: bool
    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """Give one hypothesis per sample."""
        times = fine_times_s()
        speed = speeds_of(batch.speed_mps, acceleration_of(batch)[:, None] * times)
        course = np.where(batch.speed_mps > 0.0, np.arctan2(*batch.velocity_mps.T[::-1]), batch.yaw_rad)
        rate = turn_rate_of(batch) if self.turns else np.zeros(len(batch))
        heading = course[:, None] + rate[:, None] * times
        velocity = speed[..., None] * np.stack((np.cos(heading), np.sin(heading)), axis=-1)
        return Hypotheses.certain(batch.xy_m[:, None] + integrated(velocity))


def make_ca() -> TurnRate:
    """Constant acceleration along the present course."""
    return TurnRate(turns=False)


def make_ctra() -> TurnRate:
    """Constant turn rate and acceleration."""
    return TurnRate(turns=True)


DECAY_S: Final = 1.0
"""Time constant: an acceleration falls to 1/e in this time."""
_REACH_M: Final = 250.0


@dataclass(frozen=True)
class LaneFollowing:
    """Follows the lane with the acceleration a₀ of the last second, a(t) = a₀ exp(−t / decay), until a stop."""

    decay_s: float
    """Time constant of the decay; 0 gives constant speed, infinity constant acceleration."""
    stops: bool = False
    """Whether it stops at red signals and stop signs, with the comfortable braking of IDM."""
    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """Give one hypothesis per sample."""
        times = fine_times_s()
        gain_s = times if np.isinf(self.decay_s) else 0.0 * times
        if 0.0 < self.decay_s < np.inf:
            gain_s = self.decay_s * (1.0 - np.exp(-times / self.decay_s))
        travelled = integrated(speeds_of(batch.speed_mps, acceleration_of(batch)[:, None] * gain_s))
        actors = batch.actors
        places = locate(batch.network, actors.xy_m[:, -1], actors.yaw_rad[:, -1], actors.sumo_lane)
        lane = places.lane[batch.target]
        paths = paths_from(batch.network, np.unique(lane[lane != NO_LANE]), _REACH_M)
        if self.stops:
            lines_m, braking_mps2 = lines_of(batch, places, paths), Idm.comfortable_braking_mps2
            travelled = np.minimum(travelled, halting(batch.speed_mps, lines_m, braking_mps2, future_times_s()))
        return Hypotheses.certain(drive_along(batch, places, paths, travelled))


def make_cv_lane() -> LaneFollowing:
    """Constant speed along the lane."""
    return LaneFollowing(0.0)


def make_ca_lane() -> LaneFollowing:
    """Constant acceleration along the lane."""
    return LaneFollowing(np.inf)


def make_decay_lane() -> LaneFollowing:
    """Decaying acceleration along the lane, with a time constant of one second."""
    return LaneFollowing(DECAY_S)


def make_idm_stop() -> IdmPredictor:
    """Intelligent Driver Model that stops at red signals and stop signs."""
    return IdmPredictor(stops=True)


def make_decay_stop() -> LaneFollowing:
    """Decaying acceleration along the lane, up to a red signal or a stop sign."""
    return LaneFollowing(DECAY_S, stops=True)
