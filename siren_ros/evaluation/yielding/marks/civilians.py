"""What the episode cost the civilians: the time that all of them lost."""

import numpy as np

from siren_ros.evaluation.yielding.measure import Measure
from siren_ros.judging.lane_location import sumo_lanes
from siren_ros.numerics.units import STEP_S
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.roads.road_network import NO_LANE


def civilian_delay_s(record: EpisodeRecord) -> Measure:
    """Vehicle-seconds that the civilians lost against the speed limit: the sum of ∫ (1 − v / v_limit) dt.

    Of those who are there at the first step: they are the same at all levels of a seed. As SUMO's time loss, with the
    limit of the lane and not the driver's own wish, which the record does not hold. Most of it is queues and signals;
    what counts is the difference between levels.
    """
    if not record.states:
        return Measure.lacking("the record has no step")
    first = record.states[0].actor_id
    rows = record.rows
    civilian = np.isin(rows.actor_id, first) & ~np.isin(rows.actor_id, record.emv_ids)
    rows = rows.select(civilian)
    lane = sumo_lanes(record, rows)
    known = lane != NO_LANE
    if not known.any():
        return Measure.lacking("nobody was on a lane")
    limits = np.array([one.speed_limit_mps for one in record.network.lanes])
    lost = 1.0 - rows.speed_mps[known] / limits[lane[known]]
    return Measure(float(lost.sum() * STEP_S))
