"""A program that nobody asked for publishes on an episode's topics: it ends the episode, and is named."""

import pytest
from faulty_episodes import Episode, Start
from live_episodes import tell

STRANGER = """
import sys, time
import rclpy
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.conversions import to_actor_states
from siren_ros.data.interfaces.conversions import from_episode_description, to_episode_description, to_step_done
from siren_ros.data.interfaces.conversions import Phase, StepReport
from siren_ros.data.interfaces.messages import make_message, stamp
from siren_ros.data.interfaces import wire
from siren_ros.running.ros.transport.endpoints import create_input, create_output
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.world.actors import ActorStates
def report(name, step):
    return wire.encode(topics.STEP_DONE, to_step_done(StepReport(step, name, Phase.STEP)))
def actors(step):
    return wire.encode(topics.ACTORS, to_actor_states(ActorStates.empty(step)))
def episode(**changed):
    from dataclasses import replace
    heard = []
    create_input(node, topics.EPISODE, heard.append)
    while not heard:
        rclpy.spin_once(node, timeout_sec=0.1)
    return wire.encode(topics.EPISODE, to_episode_description(
        replace(from_episode_description(wire.decode(topics.EPISODE, heard[0])), **changed)))
sys.stdin.readline()
rclpy.init()
node = rclpy.create_node("stranger")
topic, payloads = eval(sys.argv[1])
publisher = create_output(node, topic)
while not publisher.get_subscription_count():
    time.sleep(0.001)
for payload in payloads:
    publisher.publish(payload)
publisher.wait_for_all_acked()
time.sleep(1.0)
"""
"""A program that nobody asked for; what it publishes is the test's own text."""


def attacked(start: Start, attack: str, *parameters: str) -> Episode:
    """An episode to which a stranger has come, at its end."""
    episode = start(*parameters)
    with episode.domain.running("-c", STRANGER, attack, cwd=episode.folder) as stranger:
        episode.wait_until_recorded()
        tell(stranger)
        stranger.wait(60.0)
        episode.fault(lambda: None)
        episode.wait_until_gone()
    assert not episode.bag.exists(), "a bag under its own name is complete"
    assert episode.saved_steps >= 20
    return episode


ATTACKS = {
    "forged": (
        "topics.STEP_DONE, [report(name, step) for step in range(12000) for name in ('sensor_sim', 'recorder')]",
        "step_done",
    ),
    "doubled": ("topics.EPISODE, [episode(level=EmergencyLevel.L0, seed=4242)]", "episode"),
    "stale": ("topics.ACTORS, [actors(0), actors(1)]", "actor_states"),
    "flooded": ("topics.STEP_DONE, [report('nobody', 0)] * 100_000", "step_done"),
}
IN_PROCESSES = ("forged", "doubled")
"""Of a topic that the master reads and of one that the nodes read: who notices is in another process."""


@pytest.mark.parametrize(
    ("name", "processes"), [*((name, "false") for name in ATTACKS), *((name, "true") for name in IN_PROCESSES)]
)
def test_a_stranger_ends_the_episode_and_is_named(name: str, processes: str, start: Start) -> None:
    attack, topic = ATTACKS[name]
    error = attacked(start, attack, f"processes:={processes}").error
    assert f"/siren/{topic}: " in error
    assert "that this episode does not know (node stranger)" in error


@pytest.mark.parametrize(
    ("attack", "named"),
    [
        (
            "topics.GROUND_TRUTH, [b'\\0\\1\\0\\0' + b'\\xff' * 9]",
            "recorder: /emv/ground_truth: the stamp -1 s and 4294967295 ns",
        ),
        ("topics.TF, [wire.encode(topics.TF, make_message(topics.TF.type_name, transforms=[]))]", "/tf"),
    ],
)
def test_a_strangers_measurement_ends_the_episode_and_names_the_topic(attack: str, named: str, start: Start) -> None:
    assert named in attacked(start, attack).error
