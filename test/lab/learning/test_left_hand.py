"""On a map with left-hand traffic the driver sees and does the mirror image."""

import pytest

pytest.importorskip("gymnasium", reason="the extra learn is not installed")

import numpy as np

from siren_ros.lab.learning.environment import EmergencyEnv, YieldEnv
from siren_ros.running.seat.manoeuvres import Manoeuvre
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.maps.mirrored_net import mirrored_net

MANOEUVRES = [Manoeuvre.KEEP, Manoeuvre.LEFT, Manoeuvre.LEFT, Manoeuvre.PULL_OVER, Manoeuvre.PULL_OVER, Manoeuvre.STOP]


@pytest.fixture(scope="module")
def towns(tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    net = compile_map(None).read_bytes()
    for name, content in (("right", net), ("left", mirrored_net(net))):
        (folder / f"{name}.net.xml").write_bytes(content)
    return {name: str(folder / f"{name}.net.xml") for name in ("right", "left")}


@pytest.mark.parametrize("kind", [YieldEnv, EmergencyEnv])
@pytest.mark.parametrize("action", ["manoeuvre", "continuous"])
def test_the_same_actions_give_the_same_observations_and_rewards(towns, kind, action) -> None:
    given = [int(manoeuvre) for manoeuvre in MANOEUVRES]
    if action == "continuous":
        given = list(np.random.default_rng(0).uniform(-1.0, 1.0, (6, 3)).astype(np.float32))
    seen, sides = {}, {}
    for side, town in towns.items():
        env = kind(map=town, template="S2", level=2, action=action, decision_s=0.5)
        first, _ = env.reset(seed=7)
        results = [env.step(one)[:4] for one in given]
        sides[side] = env.rollout.setup.network.left_hand
        env.close()
        seen[side] = [first, *results]
    assert sides == {"right": False, "left": True}
    assert np.array_equal(seen["right"][0], seen["left"][0])
    for right, left in zip(seen["right"][1:], seen["left"][1:], strict=True):
        assert np.array_equal(right[0], left[0])
        assert right[1:] == left[1:]
    assert any((one[0] != other[0]).any() for one, other in zip(seen["right"][1:], seen["right"][2:], strict=False))
