"""A program that nobody asked for publishes on an episode's topics: it ends the episode, and is named."""

import pytest
from faulty_episodes import Start
from live_episodes import tell

STRANGER = """
import sys, time
import rclpy
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.conversions import to_actor_states
from siren_ros.data.interfaces.conversions import from_episode_description, to_episode_description, to_step_done
from siren_ros.data.interfaces.conversions import Phase, StepReport
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


STRANGER_SAID = "that this episode does not know (node stranger)"
ATTACKS = {
    "forged": (
        "true",
        "topics.STEP_DONE, [report(name, step) for step in range(12000) for name in ('sensor_sim', 'recorder')]",
        ("/siren/step_done: ", STRANGER_SAID),
    ),
    "doubled": (
        "true",
        "topics.EPISODE, [episode(level=EmergencyLevel.L0, seed=4242)]",
        ("/siren/episode: ", STRANGER_SAID),
    ),
    "stale": ("false", "topics.ACTORS, [actors(0), actors(1)]", ("/siren/actor_states: ", STRANGER_SAID)),
    "a measurement": (
        "false",
        "topics.GROUND_TRUTH, [b'\\0\\1\\0\\0' + b'\\xff' * 9]",
        ("recorder: /emv/ground_truth: the stamp -1 s and 4294967295 ns",),
    ),
}
"""Whether nodes have processes of their own, where another one notices than the one that is attacked; the attack; and
what is said."""


@pytest.mark.parametrize(("processes", "attack", "said"), ATTACKS.values(), ids=ATTACKS)
def test_a_stranger_ends_the_episode_and_is_named(
    processes: str, attack: str, said: tuple[str, ...], start: Start
) -> None:
    episode = start(f"processes:={processes}")
    with episode.domain.running("-c", STRANGER, attack, cwd=episode.folder) as stranger:
        episode.wait_until_recorded()
        tell(stranger)
        stranger.wait(60.0)
        episode.wait_until_gone()
    assert not episode.bag.exists(), "a bag under its own name is complete"
    assert episode.saved_steps >= 20
    assert all(part in episode.error for part in said)
