"""An EMV that another program than SUMO drives tells where it turns, as everybody else does."""

import numpy as np
import pytest

from siren_ros.running.generation.closed_loop import closed_loop
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.world.actors import Lights, Mode


@pytest.mark.parametrize(("template", "steps", "shown"), [("S7", 460, {Lights.INDICATOR_RIGHT}), ("S3", 200, set())])
def test_the_emv_indicates_where_it_turns_and_nowhere_else(template: str, steps: int, shown: set[Lights]) -> None:
    setup = set_up_episode(EpisodeRequest(template, sensors="none"))
    states = [step.states for step in closed_loop(setup, steps)]
    row = [int(np.flatnonzero(state.actor_id == setup.description.emv_ids[0])[0]) for state in states]
    yaw = np.unwrap([state.yaw_rad[k] for state, k in zip(states, row, strict=True)])
    lights = np.array([state.lights[k] & Lights.INDICATORS for state, k in zip(states, row, strict=True)])
    follows = np.array([state.mode[k] == Mode.ROUTE_FOLLOW for state, k in zip(states, row, strict=True)])
    assert set(lights[follows].tolist()) - {Lights.NONE} == shown
    turns = np.flatnonzero(np.abs(yaw[60:] - yaw[:-60]) > 0.8) + 60
    assert bool(len(turns)) is bool(shown)
    if shown:
        before = lights[turns[0] - 80 : turns[0]]
        assert set(before.tolist()) == shown, "from 4 s before the road has turned"
