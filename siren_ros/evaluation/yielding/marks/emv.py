"""The marks of the EMV's own way: delay, stops, time in gap escape, time until it has passed the site."""

import numpy as np

from siren_ros.evaluation.yielding.emv_line import EmvLine
from siren_ros.evaluation.yielding.measure import Measure
from siren_ros.evaluation.yielding.thresholds import YieldThresholds
from siren_ros.judging.lane_location import places_of
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.units import STEP_S
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.roads.road_network import NO_LANE, LaneKind
from siren_ros.roads.sites.site_middle import middle_of_site
from siren_ros.scenario.paper_constants import PAPER_SPEEDS
from siren_ros.world.actors import Mode

_AT_SITE_M = 30.0
"""An EMV that comes no nearer to the middle of its site does not pass it."""


def free_speed_mps(record: EpisodeRecord) -> Floats:
    """The speed that the EMV would have on an empty road, at each of its steps, shape ``(M,)``.

    It is the template's target speed, on paths across junctions at most the speed at which the turn can be driven. It
    is the same at all levels, so that the delay at L0 includes what obeying the limit and the signals costs.
    """
    target = record.description.template_values.get("emv.speed_mps", PAPER_SPEEDS.emv_route_follow_mps)
    track = record.track(record.emv_ids[0])
    free = np.full(len(track), target)
    for row, lane in enumerate(places_of(record, track).lane.tolist()):
        if lane != NO_LANE and record.network.lanes[lane].kind is LaneKind.INTERNAL:
            free[row] = min(target, record.network.lanes[lane].speed_limit_mps)
    return free


def emv_delay_s(record: EpisodeRecord, line: EmvLine, _limits: YieldThresholds) -> Measure:
    """Time that the EMV lost against free flow over the way that it drove: the integral of 1 − v / v_free.

    As SUMO's time loss. The acceleration from its start counts, at all levels alike.
    """
    speed = line.emv.track.speed_mps
    return Measure(float(np.sum(1.0 - speed / free_speed_mps(record)) * STEP_S))


def emv_stops(_record: EpisodeRecord, line: EmvLine, limits: YieldThresholds) -> Measure:
    """How often the EMV came to a stop: slower than ``stop_mps`` after it was faster than ``moving_mps``."""
    stops, moving = 0, False
    for speed in line.emv.track.speed_mps.tolist():
        if moving and speed < limits.stop_mps:
            stops, moving = stops + 1, False
        elif speed > limits.moving_mps:
            moving = True
    return Measure(float(stops))


def emv_standstill_s(_record: EpisodeRecord, line: EmvLine, limits: YieldThresholds) -> Measure:
    """Time for which the EMV stood."""
    return Measure(float(np.count_nonzero(line.emv.track.speed_mps < limits.stop_mps)) * STEP_S)


def emv_gap_escape_s(_record: EpisodeRecord, line: EmvLine, _limits: YieldThresholds) -> Measure:
    """Time for which the EMV drove in the mode ``gap_escape``."""
    return Measure(float(np.count_nonzero(line.emv.track.mode == Mode.GAP_ESCAPE)) * STEP_S)


def site_time_s(record: EpisodeRecord, line: EmvLine, _limits: YieldThresholds) -> Measure:
    """Time until the EMV is at the middle of its site: of its junction, or half way along its road."""
    middle = middle_of_site(record.network, record.description.site)
    if middle is None:
        return Measure.lacking("the record names no site")
    track = line.emv.track
    distance = np.hypot(*(track.xy_m - middle).T)
    nearest = int(np.argmin(distance))
    if distance[nearest] > _AT_SITE_M or nearest == len(distance) - 1:
        return Measure(len(track) * STEP_S, at_least=True)
    return Measure(float(track.time_s[nearest]))
