"""Episodes on small maps made for the tests: bends that nobody flies out of, signs that somebody stops at."""

import numpy as np
import pytest
from repository import REPOSITORY

from siren_ros.errors import MapError
from siren_ros.running.generation.closed_loop import LoopStep, closed_loop
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.world.actors import Owner
from siren_ros.simulation.world.traffic_state import EventKind

MAPS = REPOSITORY / "test" / "maps"


def drive(template: str, name: str, steps: int) -> list[LoopStep]:
    setup = set_up_episode(EpisodeRequest(template, map=str(MAPS / name), sensors="none"))
    return list(closed_loop(setup, steps))


def test_nobody_flies_out_of_a_bend() -> None:
    steps = drive("S2", "bends.xodr", 500)
    owner = np.concatenate([step.states.owner for step in steps])
    lateral = np.abs(np.concatenate([step.states.lateral_accel_mps2 for step in steps]))[owner == Owner.SUMO]
    assert len(lateral) > 5000
    assert np.percentile(lateral, 99.9) < 4.0
    residual = np.concatenate([step.states.residual_m for step in steps])
    assert residual.max() < 1.5
    assert not [event for step in steps for event in step.events if event.kind is EventKind.REALIGNED]
    in_bend = np.concatenate([np.abs(step.states.yaw_rate_radps) for step in steps])[owner == Owner.SUMO] > 0.2
    assert in_bend.sum() > 50, "somebody drives through the bend"


@pytest.mark.parametrize("template", ["S5", "S6"])
def test_the_templates_at_stop_signs_run_on_openstreetmap(template: str) -> None:
    steps = drive(template, "signs.osm", 320)
    crossed = [event for step in steps for event in step.events if event.kind is EventKind.STOP_LINE_CROSSED]
    assert any(event.detail["must_stop"] for event in crossed), "somebody passes a stop sign"
    assert all(step.states.residual_m.max() < 1.5 for step in steps)


def test_a_map_without_a_site_is_named_with_what_it_lacks() -> None:
    with pytest.raises(MapError, match=r"bends\.xodr.*stop sign"):
        drive("S5", "bends.xodr", 1)
