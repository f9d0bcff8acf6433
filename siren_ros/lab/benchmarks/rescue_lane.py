"""Compares S8 with SUMO's bluelight device on the same traffic: ``python -m siren_ros.benchmarks.rescue_lane``.

Every seed is driven twice: by this project, and by SUMO alone with its device on the EMV and the template's drivers,
who make way for the siren as the device makes them. The cause of the jam is gone after some time, so that the traffic
flows again. The figures come from the positions of all vehicles, with the functions of the predicate.
"""

import argparse
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Rows
from siren_ros.base.numerics.geometry import overlapping_pairs
from siren_ros.base.numerics.units import STEP_S, steps_from_s
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.lab.benchmarks.templates import seeds_of_option
from siren_ros.lab.reproduction.results import add_json, write_json
from siren_ros.running.generation.closed_loop import LoopStep, closed_loop, record_of
from siren_ros.running.generation.episode_setup import EpisodeSetup, set_up_episode
from siren_ros.scoring.judging.corridor_templates import RoadView, bodies_at, free_width_m, road_of
from siren_ros.scoring.judging.outcome import evaluate_predicate
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.traffic.simulation import BluelightSimulation
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, ActorStates, TrafficState

DURATION_S: Final = 150.0
JAM_ENDS_S: Final = 90.0
"""Time at which the head of the jam drives on: the EMV has passed by then, and half of the jam flows at the end."""
AFTER_S: Final = 30.0
"""Time after the EMV at which the rescue lane is measured again, for a possible second EMV."""
OVERLAP_M: Final = 0.05
"""Overlaps below this are rounding errors."""
FLOWS_MPS: Final = 18.0
"""Vehicles of the jam that are faster than this flow again."""
OFF_MIDDLE_M: Final = 0.3
"""A vehicle in flowing traffic farther than this from the middle of its lane still keeps to the side."""
_EACH_STEPS: Final = 5


@dataclass(frozen=True)
class RescueFigures:
    """Figures of one drive through one jam."""

    open_before: float
    """Share of the jam with a free width for the EMV when it was 90 m away."""
    open_after: float
    """The same share 30 s after the EMV, among places with vehicles on both sides."""
    through_s: float
    """Time from the rear of the jam to its head; NaN where the EMV did not get through."""
    jam_m: float
    """Distance that the EMV drove in the jam."""
    overlaps: int
    """Number of pairs of vehicles that overlap at some time."""
    emv_overlaps: int
    """Number of these pairs that include the EMV."""
    overtaking: int
    """Number of civilians that overtake the EMV."""
    off_middle: float
    """Share of the jam's vehicles flowing at the end that still keep to the side of their lane."""


def sumo_states(traffic: TrafficState) -> ActorStates:
    """SUMO's vehicles as states of actors."""
    arrays: dict[str, Any] = {name: np.zeros(len(traffic), dtype) for name, dtype in ACTOR_STATE_DTYPES.items()}
    speed, yaw = traffic.sumo_speed_mps, traffic.sumo_yaw_rad
    poses = {"x_m": traffic.sumo_x_m, "y_m": traffic.sumo_y_m, "yaw_rad": yaw, "actor_id": traffic.actor_id}
    arrays |= poses | {
        "vx_mps": speed * np.cos(yaw),
        "vy_mps": speed * np.sin(yaw),
        "accel_mps2": traffic.sumo_accel_mps2,
    }
    return ActorStates(step=traffic.step, **arrays)


def bluelight_steps(setup: EpisodeSetup, steps: int) -> Iterator[LoopStep]:
    """Steps of an episode that SUMO alone drives."""
    plan = replace(setup.plan, duty=False)
    arguments = setup.compiled_map, setup.network, plan, setup.level
    with BluelightSimulation(*arguments, seed=setup.description.seed) as simulation:
        for step in range(steps):
            traffic = simulation.step(step, None)
            yield LoopStep(traffic, (), sumo_states(traffic), ())


def figures_of(record: EpisodeRecord, jam: frozenset[str]) -> RescueFigures:
    """Figures of a record of S8; ``jam`` contains the names of the vehicles of its jam.

    Raises:
        ValueError: The record's road has no two lanes.
    """
    road = road_of(record)
    if road is None:
        raise ValueError("a record of S8 is needed")
    emv_id = record.emv_ids[0]
    ids = sorted(actor for actor, known in record.actors.items() if known.name in jam)
    times, places, lefts = _tracks(record, road, [emv_id, *ids])
    half_m = 0.5 * np.array([record.actors[actor].length_m for actor in (emv_id, *ids)])
    emv_m, jam_m, jam_half_m = places[0], places[1:], half_m[1:, None]
    entered = np.flatnonzero(emv_m + half_m[0] > np.nanmin(jam_m - jam_half_m, axis=0))
    left = np.flatnonzero(emv_m - half_m[0] > np.nanmax(jam_m + jam_half_m, axis=0))
    first = int(entered[0]) if len(entered) else len(times) - 1
    last = int(left[0]) if len(left) else len(times) - 1
    overlaps = _overlaps(record)
    return RescueFigures(
        open_before=evaluate_predicate(record).measures()["open_share"],  # type: ignore[arg-type] # a number
        open_after=_open_after(record, road, times, emv_m, first, last),
        through_s=float(times[last] - times[first]) * STEP_S if len(left) else float("nan"),
        jam_m=float(emv_m[last] - emv_m[first]),
        overlaps=len(overlaps),
        emv_overlaps=sum(emv_id in pair for pair in overlaps),
        overtaking=_overtaking(record, road, emv_id),
        off_middle=_off_middle(record, road, ids, lefts[1:, -1]),
    )


def _tracks(record: EpisodeRecord, road: RoadView, ids: Sequence[int]) -> tuple[Rows, Floats, Floats]:
    """Indices of states, and positions of some actors on the road at these; NaN while they are not in traffic."""
    times = np.arange(0, record.steps, _EACH_STEPS)
    along, left = np.full((2, len(ids), len(times)), np.nan)
    for row, actor in enumerate(ids):
        track = record.track(actor)
        here = np.isin(track.step, times)
        s_m, left_m = road.line.project(track.xy_m[here])
        columns = track.step[here] // _EACH_STEPS
        along[row, columns], left[row, columns] = s_m, left_m
    return times, along, left


def _open_after(record: EpisodeRecord, road: RoadView, times: Rows, emv_m: Floats, first: int, last: int) -> float:
    emv, margin_m = record.actors[record.emv_ids[0]], 0.2
    widths = []
    for column in range(first, last):
        index = int(times[column]) + steps_from_s(AFTER_S)
        if index < record.steps:
            bodies = bodies_at(record, road, index)
            widths += free_width_m(bodies, emv_m[column : column + 1], road).tolist()
    between = [width for width in widths if np.isfinite(width)]
    return float(np.mean(np.array(between) >= emv.width_m + 2.0 * margin_m)) if between else float("nan")


def _overlaps(record: EpisodeRecord) -> set[tuple[int, int]]:
    pairs: set[tuple[int, int]] = set()
    for states in record.states[::_EACH_STEPS]:
        known = [record.actors[actor] for actor in states.actor_id.tolist()]
        length_m, width_m = np.array([(actor.length_m, actor.width_m) for actor in known]).T
        first, second, depth_m = overlapping_pairs(states.x_m, states.y_m, states.yaw_rad, length_m, width_m)
        deep = depth_m > OVERLAP_M
        pairs.update(zip(states.actor_id[first[deep]].tolist(), states.actor_id[second[deep]].tolist(), strict=True))
    return pairs


def _overtaking(record: EpisodeRecord, road: RoadView, emv_id: int) -> int:
    ids = [actor for actor, known in record.actors.items() if not known.is_emv]
    _, along, left = _tracks(record, road, [emv_id, *ids])
    on_road = (left > road.outer_m + 2.0 * road.boundary_m) & (left < -road.boundary_m)
    ahead = along[1:] - along[0]
    passes = (ahead[:, :-1] < 0.0) & (ahead[:, 1:] >= 0.0) & on_road[1:, 1:] & on_road[1:, :-1]
    near = np.abs(ahead[:, 1:]) < 30.0
    return int(np.any(passes & near, axis=1).sum())


def _off_middle(record: EpisodeRecord, road: RoadView, ids: Sequence[int], left_m: Floats) -> float:
    """Share of flowing vehicles that keep to the side; ``left_m`` are their lateral positions at the end."""
    final = record.states[-1]
    speed = dict(zip(final.actor_id.tolist(), final.speed_mps.tolist(), strict=True))
    lane_m = -2.0 * road.boundary_m
    flowing = [left for actor, left in zip(ids, left_m.tolist(), strict=True) if speed.get(actor, 0.0) > FLOWS_MPS]
    off = np.array([left - lane_m * round(left / lane_m) for left in flowing if np.isfinite(left)])
    return float(np.mean(np.abs(off) > OFF_MIDDLE_M)) if len(off) else float("nan")


def compare(request: EpisodeRequest) -> Mapping[str, RescueFigures]:
    """Figures of one seed, by the program that drives."""
    setup = set_up_episode(request)
    if setup.plan.jam is not None:
        setup = replace(setup, plan=replace(setup.plan, jam=replace(setup.plan.jam, until_s=JAM_ENDS_S)))
    steps = steps_from_s(setup.description.duration_s)
    jam = frozenset(vehicle.name for vehicle in setup.plan.groups)
    driven = {"SIREN": closed_loop(setup, steps), "bluelight": bluelight_steps(setup, steps)}
    return {name: figures_of(record_of(setup, list(loop)), jam) for name, loop in driven.items()}


_HEAD: Final = (
    f"{'':<16}{'open before':>12}{'open after':>11}{'through s':>10}{'in jam m':>9}{'overlaps':>9}{'of EMV':>7}"
    f"{'overtake':>9}{'off middle':>11}"
)


def means_of(found: Sequence[RescueFigures]) -> dict[str, float]:
    """Mean of each figure over the drives that have it; NaN if none has."""
    columns = {part.name: [float(getattr(figures, part.name)) for figures in found] for part in fields(RescueFigures)}
    known = {name: [value for value in values if not math.isnan(value)] for name, values in columns.items()}
    return {name: sum(values) / len(values) if values else math.nan for name, values in known.items()}


def row_of(name: str, figures: Mapping[str, float]) -> str:
    """A row of the printed table."""
    return (
        f"{name:<16}{figures['open_before']:>12.2f}{figures['open_after']:>11.2f}{figures['through_s']:>10.1f}"
        f"{figures['jam_m']:>9.0f}{figures['overlaps']:>9.3g}{figures['emv_overlaps']:>7.3g}"
        f"{figures['overtaking']:>9.3g}{figures['off_middle']:>11.2f}"
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Print a row for each seed and driver, and the means."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seeds_of_option, default=range(5), help="first:last, the last not included")
    parser.add_argument("--map", default="", help="map file; the built-in motorway by default")
    add_json(parser)
    options = parser.parse_args(argv)
    print(_HEAD)
    rows: dict[str, list[RescueFigures]] = {}
    for seed in options.seeds:
        request = EpisodeRequest("S8", seed=seed, map=options.map, sensors="none", duration_s=DURATION_S)
        for name, figures in compare(request).items():
            rows.setdefault(name, []).append(figures)
            print(row_of(f"{seed} {name}", asdict(figures)), flush=True)
    means = {name: means_of(found) for name, found in rows.items()}
    for name, mean in means.items():
        print(row_of(f"mean {name}", mean))
    write_json(options.json, {name: {"drives": len(rows[name]), **mean} for name, mean in means.items()})
    return 0


if __name__ == "__main__":
    sys.exit(main())
