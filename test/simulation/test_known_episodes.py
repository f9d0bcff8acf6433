"""Plans of traffic and whole episodes of the templates, without sensors, as stored next to this file.

A change of what drivers do changes these episodes: the reader of the change sees where, when and by how much.
"""

from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from known_outputs import assert_known
from repository import REPOSITORY

from siren_ros.running.generation.closed_loop import LoopStep, closed_loop
from siren_ros.running.generation.episode_setup import EpisodeSetup, plan_length, set_up_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle, PlannedWalker
from siren_ros.simulation.world.actors import ActorClass, Mode

KNOWN = Path(__file__).parent / "known"
PEOPLE = "demand.people.cyclists=4,demand.people.motorcycles=3,demand.people.pedestrians=6"
REQUESTS = {
    "S1": EpisodeRequest("S1", values="emv.count=2"),
    "S2": EpisodeRequest("S2", preset="realistic", values="emv.count=2"),
    "S3": EpisodeRequest("S3", preset="observed", values=PEOPLE),
    "S4": EpisodeRequest("S4", level="L1", values="emv.crossing=1"),
    "S5": EpisodeRequest("S5", preset="inattentive"),
    "S6": EpisodeRequest("S6", preset="reckless", values=PEOPLE),
    "S7": EpisodeRequest("S7"),
    "S8": EpisodeRequest("S8", duration_s=25.0),
    "S2 in bends": EpisodeRequest("S2", "L3", map=str(REPOSITORY / "test" / "maps" / "bends.xodr"), duration_s=25.0),
}  # fmt: skip
EVERY = 50
"""Steps between two stored rows: 2.5 s."""
MOST = 700
"""Steps of an episode."""


def of_vehicle(one: PlannedVehicle) -> list[object]:
    driver = [value for value in vars(one.driver).values() if isinstance(value, float)]
    return [
        one.name, one.actor_class, one.length_m, one.width_m, *one.colour_rgb,
        one.route[0], one.route[-1], len(one.route), one.spot.lane, one.spot.front_m, one.spot.speed_mps,
        one.attentive, one.oncoming_share, one.rescue_m, one.filters, one.lane_change_s, *one.sideways, *driver,
    ]  # fmt: skip


def of_plan(setup: EpisodeSetup) -> dict[str, object]:
    """EMVs and groups, and some of the others, with the timing of signals."""
    plan = setup.plan
    some: list[PlannedVehicle | PlannedWalker] = [
        *plan.background[:: max(9, len(plan.background) // 5)],
        *plan.reserve[:: max(40, len(plan.reserve) // 4)],
        *plan.riders[::8],
    ]
    return {
        "vehicles": [of_vehicle(one) for one in (*plan.emvs, *plan.groups[:: max(2, len(plan.groups) // 8)], *some)],
        "walkers": plan.walkers[::9],
        "counts": [len(part) for part in (plan.groups, plan.background, plan.reserve, plan.riders, plan.walkers)],
        "stage": [[one.lane, one.from_m, one.to_m] for one in plan.stage[::4]],
        "kept": [plan.civilians, plan.riders_kept, plan.walkers_kept, plan.warm_up_steps, plan.response_distance_m],
        "signals": [plan.signal, *plan.signals_behind, plan.crossed, plan.uncrossed, plan.jam, plan.duty],
    }


def row_of(setup: EpisodeSetup, made: list[LoopStep]) -> list[object]:
    """EMVs, modes of the others, mean speed, lights, signals, and what happened, over the steps of a row."""
    last = made[-1]
    states, emvs = last.states, setup.description.emv_ids
    emv = np.isin(states.actor_id, emvs)
    speed = np.hypot(states.vx_mps, states.vy_mps)
    poses = np.stack((states.x_m, states.y_m, np.cos(states.yaw_rad), np.sin(states.yaw_rad), speed), axis=1)
    signals = {signal.signal_id: signal.state for signal in last.traffic.signals}
    commanded = [value for one in last.commands for value in (len(one), one.throttle.sum(), one.brake.sum())]
    modes = Counter(Mode(mode).name for mode in states.mode[~emv])
    events = Counter(event.kind.value for step in made for event in step.events)
    lights = [np.count_nonzero(states.lights & bit) for bit in (1, 2, 4)]
    return [
        *([*poses[k], Mode(states.mode[k]).name] for k in np.flatnonzero(emv)),
        [
            len(states),
            speed[~emv].mean(),
            states.residual_m.max(),
            np.abs(states.yaw_rate_radps).max(),
            *lights,
            *commanded,
        ],
        " ".join([signals.get(setup.site.junction or "", ""), *counted(modes), *counted(events)]).strip(),
    ]


def counted(counts: Counter[str]) -> list[str]:
    return [f"{count} {name}" for name, count in sorted(counts.items())]


@cache
def setup_of(name: str) -> EpisodeSetup:
    return set_up_episode(replace(REQUESTS[name], sensors="none"))


def file_of(name: str, what: str) -> Path:
    return KNOWN / f"{what}_{name.replace(' ', '_')}.json"


@pytest.mark.parametrize("name", REQUESTS)
def test_plans(name: str) -> None:
    assert_known(file_of(name, "plan"), of_plan(setup_of(name)), digits=5, decimals=3)


@pytest.mark.parametrize("name", REQUESTS)
def test_episodes(name: str) -> None:
    setup = setup_of(name)
    steps = list(closed_loop(setup, min(MOST, plan_length(REQUESTS[name]))))
    rows = [row_of(setup, steps[start : start + EVERY]) for start in range(0, len(steps), EVERY)]
    spawned = Counter(ActorClass(one.actor_class).name for step in steps for one in step.traffic.spawned)
    known = {"spawned": counted(spawned), "rows": rows}
    assert_known(file_of(name, "episode"), known, digits=5, decimals=1)
