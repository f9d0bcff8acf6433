"""Measures traffic flow over templates and seeds: ``python -m siren_ros.benchmarks.traffic_flow --seeds 0:5``.

Prints how queues discharge (L0, where nobody makes way), how drivers follow, and how civilians accelerate and brake at
each template's own level, with what traffic engineers measure on roads.

The measures of a record are those of traffic engineering (HCM 2010, chapter 31): the saturation headway of a queue
counts from its fourth vehicle on, at the stop line.
"""

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Ids
from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.processes.process_pool import ProcessPool, side_by_side
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.lab.benchmarks.templates import seeds_of_option
from siren_ros.lab.reproduction.results import add_json, write_json
from siren_ros.running.generation.closed_loop import closed_loop, record_of
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.scoring.judging.verify import CIVILIAN_PERCENTILES, MOVING_MPS
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import TEMPLATES
from siren_ros.simulation.world.actors import ActorClass, Mode, Owner, TrafficState

START_LOST: Final = 3
"""Number of vehicles of a queue that are left out: their headways include reaction and start-up time."""
QUEUED_MPS: Final = 1.5
"""A vehicle that was slower than this before the line belonged to the queue."""
FOLLOWS_WITHIN_M: Final = 40.0
"""A driver with a larger gap counts as driving freely."""
FOLLOWS_AT_MPS: Final = 1.0
"""A driver follows the vehicle ahead if their speeds differ by less than this."""
MOVES_MPS: Final = 3.0
_HEAVY: Final = frozenset({ActorClass.BUS, ActorClass.TRUCK})
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
            long = [record.actors[actor_id].actor_class.body in _HEAVY for _, _, actor_id in crossings]
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


ALL: Final = "all"
NOMINAL_S: Final = 90.0


def record_at(request: EpisodeRequest, level: str = "") -> EpisodeRecord:
    """Record an episode without ROS and sensors; at L0 it lasts until the signal is green again."""
    asked = replace(request, level=level, duration_s=NOMINAL_S if level else 0.0)
    setup = set_up_episode(asked)
    return record_of(setup, list(closed_loop(setup, setup.steps)))


def measure(request: EpisodeRequest) -> dict[str, Floats]:
    """Measure the samples of an episode by name; those of ``cars_s`` are among those of ``through_s``."""
    own, nominal = record_at(request), record_at(request, "L0")
    queues = discharge_headways(nominal)
    through_s, turning_s = queues.headway_s[~queues.turns], queues.headway_s[queues.turns]
    cars_s = queues.headway_s[~queues.turns & ~queues.heavy]
    return {
        "through_s": through_s,
        "cars_s": cars_s,
        "turning_s": turning_s,
        "following_s": following_headways_s(own),
        "accel_mps2": civilian_accelerations_mps2(own),
    }


def summary(samples: Sequence[Mapping[str, Floats]]) -> dict[str, float]:
    """The figures over episodes; NaN without samples."""
    through, cars, turning, following, accel = (
        np.concatenate([episode[name] for episode in samples])
        for name in ("through_s", "cars_s", "turning_s", "following_s", "accel_mps2")
    )
    low, high = np.percentile(accel, CIVILIAN_PERCENTILES) if len(accel) else (np.nan, np.nan)
    return {
        "through_s": float(np.mean(through)) if len(through) else np.nan,
        "through_median_s": float(np.median(through)) if len(through) else np.nan,
        "through": float(len(through)),
        "cars_median_s": float(np.median(cars)) if len(cars) else np.nan,
        "cars": float(len(cars)),
        "turning_s": float(np.mean(turning)) if len(turning) else np.nan,
        "turning": float(len(turning)),
        "following_s": float(np.median(following)) if len(following) else np.nan,
        "followers": float(len(following)),
        "accel_low_mps2": float(low),
        "accel_high_mps2": float(high),
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Print a row for each template, and one for all."""
    options = _parser().parse_args(argv)
    requests = [
        EpisodeRequest(template, seed=seed, map=options.map, preset=options.preset, sensors="none")
        for template in options.templates
        for seed in options.seeds
    ]
    with ProcessPool(options.workers, preload="siren_ros.lab.benchmarks.traffic_flow") as pool:
        calls = {request: partial(pool.call, measure, request) for request in requests}
        samples = side_by_side(calls, options.workers, pool.stop)
    print(
        "     through s, mean  median  vehicles  cars  vehicles  turning s  vehicles  following s  samples"
        "  acceleration p0.5 and p99.5"
    )
    figures = {}
    for name in (*options.templates, ALL):
        row = figures[name] = summary([samples[asked] for asked in requests if name in (asked.template, ALL)])
        print(
            f"{name:<5}{row['through_s']:15.2f}{row['through_median_s']:8.2f}{row['through']:10.0f}"
            f"{row['cars_median_s']:6.2f}{row['cars']:10.0f}{row['turning_s']:11.2f}{row['turning']:10.0f}{row['following_s']:13.2f}"
            f"{row['followers']:9.0f}{row['accel_low_mps2']:10.2f}{row['accel_high_mps2']:7.2f}"
        )
    write_json(options.json, figures)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--templates", nargs="+", default=list(TEMPLATES), metavar="ID")
    parser.add_argument("--seeds", type=seeds_of_option, default=range(5), help="first:last, the last not included")
    parser.add_argument("--map", default="", help="map file; the built-in town by default")
    parser.add_argument("--preset", default="paper", help="how drivers respond")
    parser.add_argument("--workers", "--jobs", type=int, default=2, help="processes")
    add_json(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
