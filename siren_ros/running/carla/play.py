"""Plays a recorded episode in a CARLA server and writes a bag with the server's measurements in place of ours.

All other messages stay as they are. States, labels and outcome are those of the episode.
"""

from collections.abc import Callable, Generator, Iterator
from itertools import starmap
from pathlib import Path
from typing import Any

from siren_ros.base.numerics.units import step_of_time_ns
from siren_ros.data.datasets.simulator_scenarios import opendrive_of
from siren_ros.data.episode_source import EpisodeSource
from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.conversions import from_actor_states, from_traffic_state
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.recording.bag_folder import check_new_bag
from siren_ros.data.recording.bag_reader import open_bag
from siren_ros.data.sensor_messages.mounted_suite import Published, TrailingSensing, setup_messages
from siren_ros.data.sensor_messages.sensor_topics import topics_of
from siren_ros.errors import BagError
from siren_ros.running.carla.session import CALL_S, CarlaSession
from siren_ros.running.generation.closed_loop import RecordedEpisode, record_messages
from siren_ros.simulation.world.actors import ActorDescription, TrafficState

Sent = Generator[tuple[Topic, bytes], None, None]


def play(
    bag: Path,
    out: Path,
    address: str,
    *,
    load: bool = False,
    overwrite: bool = False,
    timeout_s: float = CALL_S,
    on_step: Callable[[int], None] = lambda _: None,
) -> RecordedEpisode:
    """Play a bag in the server at ``HOST:PORT`` and record what it senses.

    Args:
        bag: Folder of the recorded episode.
        out: Folder of the bag to write.
        address: The server.
        load: Whether the server builds the episode's map first, from its OpenDRIVE.
        overwrite: Whether the new bag replaces an earlier one there.
        timeout_s: Deadline of each call of the server and of each frame.
        on_step: Called with each step that is recorded.

    Raises:
        InputError: The bag cannot be read or written, there is no such server, or it shows another map.
        EpisodeError: The disk is full. What goes wrong in the server once the episode plays leaves a partial bag.
    """
    check_new_bag(out, overwrite=overwrite)
    with open_bag(bag) as opened, CarlaSession(address, timeout_s) as session:
        source = EpisodeSource(opened)
        if load:
            session.load(opendrive_of(source).decode())
        mounted = session.suites(source.description, source.network, lambda _: False)
        sensing = TrailingSensing(mounted, trails=False)
        messages = _messages(source, session, sensing, setup_messages(mounted))
        return record_messages(source.description, out, messages, overwrite=overwrite, on_step=on_step)


def _messages(
    source: EpisodeSource, session: CarlaSession, sensing: TrailingSensing, setup: Iterator[Published]
) -> Sent:
    """The messages of the bag without those of its sensors; at each step those of the server's sensors follow."""
    kept = {each.name: each for each in topics_of(source.description) if each.publisher != "sensor_sim"}
    kept.pop(topics.OUTCOME.name)
    actors: dict[int, ActorDescription] = {}
    traffic: TrafficState | None = None
    yield from starmap(_sent, setup)
    for message in source.bag.messages(kept):
        topic = kept[message.topic]
        yield topic, bytes(message.cdr)
        if topic == topics.TRAFFIC:
            traffic = from_traffic_state(message.read())
            actors.update({actor.actor_id: actor for actor in traffic.spawned})
        elif topic == topics.ACTORS:
            if traffic is None or traffic.step != step_of_time_ns(message.time_ns):
                raise BagError(str(source.path), f"an episode with {topics.TRAFFIC.name} at every step")
            states = from_actor_states(message.read())
            yield from starmap(_sent, session.messages(sensing, states, actors, traffic.signals))


def _sent(topic: Topic, message: Any) -> tuple[Topic, bytes]:
    return topic, wire.encode(topic, message)
