"""What single nodes tell, without an episode: given what one that was made before would give them."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from dds_domains import shared_domain
from rclpy.parameter import Parameter
from recorded_episode import quick_template

from siren_nodes.recorder import Recorder
from siren_nodes.sensor_sim import SensorSim
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.recording.bag_reader import open_bag
from siren_ros.running.generation.closed_loop import record_episode
from siren_ros.running.generation.episode_setup import EpisodeSetup, set_up_episode
from siren_ros.sensing import rig
from siren_ros.sensing.camera.renderer import RendererUnavailableError
from siren_ros.simulation.scenario.episode import EpisodeRequest


@pytest.fixture
def options() -> Iterator[dict[str, Any]]:
    """Options of a node in a domain that only tests use."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=shared_domain())
    yield {"context": context}
    rclpy.shutdown(context=context)


def setup_with(sensors: str) -> EpisodeSetup:
    return set_up_episode(EpisodeRequest(quick_template("S2"), sensors=sensors, duration_s=1.0))


def test_the_recorders_time_is_that_of_each_step_alone(options: dict[str, Any], tmp_path: Path) -> None:
    callbacks: dict[str, Callable[[bytes], None]] = {}
    told: list[tuple[int, float]] = []

    class Heard(Recorder):
        def add_raw_input(self, topic: Topic, callback: Callable[[bytes], None]) -> None:
            callbacks[topic.name] = callback

        def step_finished(self, step: int, busy_s: float) -> None:
            told.append((step, busy_s))

    setup = setup_with("none")
    record_episode(setup, tmp_path / "made")
    node = Heard("recorder", **options, parameter_overrides=[Parameter("bag", value=str(tmp_path / "bag"))])
    node.prepare(setup.description, setup.compiled_map.read_bytes())
    with open_bag(tmp_path / "made") as bag:
        messages = [(message.topic, bytes(message.cdr)) for message in bag.messages() if message.topic in callbacks]
    began_s = time.perf_counter()
    for topic, cdr in messages:
        callbacks[topic](cdr)
    whole_s = time.perf_counter() - began_s
    node.discard()
    node.destroy_node()
    assert [step for step, _ in told] == list(range(20))
    assert 0.0 < sum(busy_s for _, busy_s in told) <= whole_s


def test_a_user_is_told_where_cameras_cast_rays(options: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """There are pictures without shadows in the bag."""

    def unavailable(*_: object) -> None:
        raise RendererUnavailableError("no EGL here")

    monkeypatch.setattr(rig, "Renderer", unavailable)
    setup, warnings = setup_with("front"), list[str]()
    node = SensorSim("sensor_sim", **options)
    monkeypatch.setattr(node.get_logger(), "warning", warnings.append)
    node.prepare(setup.description, setup.compiled_map.read_bytes())
    node.destroy_node()
    assert ["no EGL here" in text for text in warnings] == [True]
