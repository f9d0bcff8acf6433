import numpy as np
import pytest

from siren_ros.generation.closed_loop import closed_loop
from siren_ros.generation.episode_setup import set_up_episode
from siren_ros.scenario.request import EpisodeRequest

PRIVILEGED_MPS = 10.0
"""Well above the limit of 30 km/h, well below the EMV's 45 km/h and more."""


@pytest.mark.parametrize(("level", "above_the_limit"), [("L0", False), ("L1", True)])
def test_an_emv_keeps_to_the_limit_unless_it_is_privileged(level: str, above_the_limit: bool) -> None:
    setup = set_up_episode(EpisodeRequest("S6", level=level, seed=2, sensors="none"))
    assert setup.plan.emvs[0].spot.speed_mps > setup.network.lanes[setup.plan.emvs[0].spot.lane].speed_limit_mps
    speeds = [float(step.states.speed_mps[0]) for step in closed_loop(setup, 120)]
    assert (np.max(speeds) > PRIVILEGED_MPS) == above_the_limit
