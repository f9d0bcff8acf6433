"""The leader of each sample: along its lane's successors, or straight ahead where it is in no lane."""

from dataclasses import dataclass

import numpy as np

from siren_ros.evaluation.prediction.baselines.lane_following import LanePaths
from siren_ros.evaluation.prediction.protocol.samples import SampleBatch
from siren_ros.judging.lane_location import LanePlaces
from siren_ros.numerics.arrays import Floats, Rows
from siren_ros.roads.road_network import NO_LANE


@dataclass(frozen=True)
class Leaders:
    """The leader of each of N samples at the present; arrays of shape ``(N,)``."""

    gap_m: Floats
    """From the own front bumper to the leader's rear bumper, inf without a leader.

    It is negative where the two overlap lengthwise: the leader's centre is ahead, its rear behind the own front.
    """
    speed_mps: Floats
    """The leader's, in the own direction and not negative; 0 without a leader."""


def leaders_of(batch: SampleBatch, places: LanePlaces, paths: LanePaths, range_m: float) -> Leaders:
    """The nearest vehicle whose centre is ahead within the range.

    The leader of a sample in a lane is in this lane or in those that follow straight on. The leader of a sample in
    no lane overlaps the strip that the sample sweeps straight ahead; its heading does not matter.

    Args:
        batch: The samples.
        places: Lanes of the rows of ``batch.actors``.
        paths: Paths from every sample's lane.
        range_m: Greatest distance between the centres.
    """
    sample, other = batch.neighbours()
    own = batch.target[sample]
    in_lane = places.lane[own] != NO_LANE
    distance, speed = np.full(len(sample), np.inf), np.zeros(len(sample))
    for pairs, (ahead_m, speed_mps) in (
        (in_lane, _along_lanes(batch, places, paths, own[in_lane], other[in_lane])),
        (~in_lane, _straight_ahead(batch, own[~in_lane], other[~in_lane])),
    ):
        distance[pairs], speed[pairs] = ahead_m, speed_mps
    half_lengths = 0.5 * (batch.actors.length_m[own] + batch.actors.length_m[other])
    ahead = np.flatnonzero((distance > 0.0) & (distance <= range_m))
    gap = distance[ahead] - half_lengths[ahead]
    order = np.lexsort((gap, sample[ahead]))
    led, first = np.unique(sample[ahead][order], return_index=True)
    nearest = order[first]
    gap_m, speed_mps = np.full(len(batch), np.inf), np.zeros(len(batch))
    gap_m[led], speed_mps[led] = gap[nearest], speed[ahead][nearest]
    return Leaders(gap_m, speed_mps)


def _along_lanes(
    batch: SampleBatch, places: LanePlaces, paths: LanePaths, own: Rows, other: Rows
) -> tuple[Floats, Floats]:
    """Distances along the lanes to the others' centres, inf in other lanes, and the others' speeds."""
    path, lane = paths.path_of_lane[places.lane[own]], places.lane[other]
    start_m = np.where(lane == NO_LANE, np.inf, paths.start_m[path, lane])
    velocity = batch.actors.velocity_mps[other, -1]
    return start_m + places.arc_m[other] - places.arc_m[own], np.hypot(velocity[:, 0], velocity[:, 1])


def _straight_ahead(batch: SampleBatch, own: Rows, other: Rows) -> tuple[Floats, Floats]:
    """Distances along the headings to the others' centres, inf outside the strip, and their speeds along them."""
    actors = batch.actors
    cos, sin = np.cos(actors.yaw_rad[own, -1]), np.sin(actors.yaw_rad[own, -1])
    x, y = (actors.xy_m[other, -1] - actors.xy_m[own, -1]).T
    vx, vy = actors.velocity_mps[other, -1].T
    in_strip = np.abs(cos * y - sin * x) < 0.5 * (actors.width_m[own] + actors.width_m[other])
    return np.where(in_strip, cos * x + sin * y, np.inf), np.maximum(cos * vx + sin * vy, 0.0)
