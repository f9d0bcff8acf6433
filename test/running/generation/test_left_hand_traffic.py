"""On the mirrored town, episodes are mirrored to the last bit; sites, verdicts and records are those of the town."""

import numpy as np
import pytest

from siren_ros.running.generation.closed_loop import closed_loop, record_of
from siren_ros.running.generation.episode_setup import plan_length, set_up_episode
from siren_ros.scoring.judging.predicates import evaluate_predicate
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.maps.mirrored_net import mirrored_net
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES
from siren_ros.simulation.world.mirror_image import mirror_image


@pytest.fixture(scope="module")
def towns(tmp_path_factory):
    """The town and its mirror image as files, so that both are compiled in the same way."""
    folder = tmp_path_factory.mktemp("maps")
    net = compile_map(None).read_bytes()
    for name, content in (("right", net), ("left", mirrored_net(net))):
        (folder / f"{name}.net.xml").write_bytes(content)
    return {name: str(folder / f"{name}.net.xml") for name in ("right", "left")}


def run(towns, side, template, steps=None):
    request = EpisodeRequest(template, map=towns[side])
    setup = set_up_episode(request)
    return setup, list(closed_loop(setup, steps or plan_length(request)))


@pytest.mark.parametrize(("template", "steps"), [("S1", 240), ("S2", 200)])
def test_states_commands_and_events_are_mirrored(towns, template, steps):
    (right_setup, right), (left_setup, left) = (run(towns, side, template, steps) for side in ("right", "left"))
    assert left_setup.site == right_setup.site
    assert left_setup.plan == right_setup.plan
    assert left_setup.network.left_hand
    for own, other in zip(right, left, strict=True):
        image = mirror_image(other.states)
        for name in ACTOR_STATE_DTYPES:
            assert np.array_equal(getattr(own.states, name), getattr(image, name)), (own.states.step, name)
        assert tuple(map(mirror_image, other.events)) == own.events
    assert any(len(step.commands[0]) for step in right)


def test_a_turn_on_the_shoulder_is_to_the_left(towns):
    """S7 turns right where traffic keeps right."""
    verdicts = {}
    for side in ("right", "left"):
        setup, steps = run(towns, side, "S7")
        verdicts[side] = evaluate_predicate(record_of(setup, steps))
        yaw_rad = np.unwrap([step.states.yaw_rad[0] for step in steps])
        turned_rad = float(yaw_rad[-1] - yaw_rad[0])
        assert turned_rad > 1.0 if side == "left" else turned_rad < -1.0
    assert verdicts["left"].holds
    assert verdicts["left"].measures() == verdicts["right"].measures()
    assert "to the left" in verdicts["left"].text
    assert "to the right" in verdicts["right"].text
