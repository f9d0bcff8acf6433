"""Measures how civilians drive in a record: queue discharge at green, following headway, acceleration.

The measures are those of traffic engineering (HCM 2010, chapter 31): the saturation headway of a queue counts from
its fourth vehicle on, at the stop line.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Ids
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.scoring.judging.physics import MOVING_MPS
from siren_ros.simulation.world.actors import ActorClass, Mode, Owner
from siren_ros.simulation.world.traffic_state import TrafficState

START_LOST: Final = 3
"""Number of vehicles of a queue that are left out: their headways include reaction and start-up time."""
QUEUED_MPS: Final = 1.5
"""A vehicle that was slower than this before the line belonged to the queue."""
FOLLOWS_WITHIN_M: Final = 40.0
"""A driver with a larger gap counts as driving freely."""
FOLLOWS_AT_MPS: Final = 1.0
"""A driver follows the vehicle ahead if their speeds differ by less than this."""
MOVES_MPS: Final = 3.0
_HEAVY: Final = frozenset({ActorClass.BUS, ActorClass.TRUCK, ActorClass.FIRE_TRUCK})
_GREEN: Final = frozenset("gG")
_EVERY_STEPS: Final = 10


@dataclass(frozen=True)
class DischargeHeadways:
    """Times between fronts of queued vehicles at the stop line after green begins, from the fourth vehicle on."""

    headway_s: Floats
    turns: Flags
    """Whether the vehicle or the one before it turns: vehicles that turn are slower, by the bend (HCM 2010, 31-2)."""
    heavy: Flags
    """Whether one of both has more than four tyres: HCM's saturation headway is for passenger cars and vans."""


def discharge_headways(record: EpisodeRecord) -> DischargeHeadways:
    """Measure headways of queues on lanes that lead straight on, including vehicles that turn off from them."""
    headways: list[float] = []
    turns: list[bool] = []
    heavy: list[bool] = []
    for lane, movements in record.network.connections_from.items():
        straight = [movement for movement in movements if movement.direction == "s" and movement.signal_id is not None]
        if not straight:
            continue
        movement = straight[0]
        states = record.signal_states(str(movement.signal_id))
        green = [states[step][movement.signal_link] in _GREEN for step in sorted(states)]
        begins = [step for step, (before, now) in enumerate(pairwise(green), start=1) if now and not before]
        for begin in begins:
            rest = green[begin:]
            end = begin + (rest.index(False) if False in rest else len(rest))
            crossings = list(_queue_crossings(record, lane, begin, end))[START_LOST - 1 :]
            long = [record.actors[actor_id].actor_class in _HEAVY for _, _, actor_id in crossings]
            headways += [STEP_S * (after - before) for (before, *_), (after, *_) in pairwise(crossings)]
            turns += [before or after for (_, before, _), (_, after, _) in pairwise(crossings)]
            heavy += [before or after for before, after in pairwise(long)]
    return DischargeHeadways(np.array(headways), np.array(turns, dtype=np.bool_), np.array(heavy, dtype=np.bool_))


def _queue_crossings(record: EpisodeRecord, lane: int, begin: int, end: int) -> Iterator[tuple[int, bool, int]]:
    """For each vehicle of a lane's queue: the step at which it passes the lane's end, whether it turns, and its id."""
    waiting: dict[int, bool] = {}
    paths = {
        path: movement.direction != "s"
        for movement in record.network.connections_from[lane]
        for path in (*movement.via, movement.to_lane)
    }
    edge = record.network.lanes[lane].edge
    for traffic in record.traffic[begin:end]:
        on_lane = dict(zip(traffic.actor_id[traffic.lane == lane].tolist(), _speeds(traffic, lane), strict=True))
        for actor_id in [known for known in waiting if known not in on_lane]:
            (row,) = np.flatnonzero(traffic.actor_id == actor_id).tolist() or (-1,)
            here = int(traffic.lane[row]) if row >= 0 else -1
            if here < 0 or (here not in paths and record.network.lanes[here].edge == edge):
                del waiting[actor_id]  # this vehicle left the lane sideways
                continue
            if not waiting.pop(actor_id):
                return
            yield traffic.step, paths.get(here, False), actor_id
        for actor_id, speed_mps in on_lane.items():
            waiting[actor_id] = waiting.get(actor_id, False) or speed_mps < QUEUED_MPS


def _speeds(traffic: TrafficState, lane: int) -> list[float]:
    return [float(speed) for speed in traffic.speed_mps[traffic.lane == lane]]


def following_headways_s(record: EpisodeRecord) -> Floats:
    """Time headways, front to front, of civilians that SUMO drives behind a vehicle in the same lane."""
    headways: list[Floats] = []
    emvs = np.array(record.emv_ids, dtype=np.uint32)
    for traffic in record.traffic[::_EVERY_STEPS]:
        order = np.lexsort((traffic.lane_position_m, traffic.lane))
        behind, ahead = order[:-1], order[1:]
        length_m = _lengths_m(record, traffic.actor_id)[ahead]
        apart_m = traffic.lane_position_m[ahead] - traffic.lane_position_m[behind]
        speed, lead = traffic.speed_mps[behind], traffic.speed_mps[ahead]
        follows = (traffic.lane[behind] == traffic.lane[ahead]) & (traffic.lane[behind] >= 0)
        follows &= (traffic.owner[behind] == Owner.SUMO) & ~np.isin(traffic.actor_id[behind], emvs)
        follows &= (apart_m > length_m) & (apart_m - length_m < FOLLOWS_WITHIN_M)
        follows &= (np.abs(lead - speed) < FOLLOWS_AT_MPS) & (speed > MOVES_MPS)
        headways.append(apart_m[follows] / speed[follows])
    return np.concatenate(headways) if headways else np.zeros(0)


def _lengths_m(record: EpisodeRecord, actor_id: Ids) -> Floats:
    return np.array([record.actors[actor].length_m for actor in actor_id.tolist()])


def civilian_accelerations_mps2(record: EpisodeRecord) -> Floats:
    """Longitudinal accelerations of moving civilians at all steps, as `siren verify` counts them."""
    rows = record.rows
    moves = (rows.speed_mps > MOVING_MPS) & (rows.mode != Mode.STOPPED)
    moves &= ~np.isin(rows.actor_id, np.array(record.emv_ids, dtype=np.uint32))
    return rows.accel_mps2[moves]
