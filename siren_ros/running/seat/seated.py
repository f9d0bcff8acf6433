"""Lets a driver control an episode's AV under test, without ROS or in a ROS program."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.conversions import (
    from_actor_states,
    from_episode_description,
    from_path,
    from_traffic_state,
    to_av_control,
)
from siren_ros.data.interfaces.topics import Topic
from siren_ros.errors import InputError
from siren_ros.running.generation.closed_loop import Answer, LoopStep
from siren_ros.running.generation.episode_setup import EpisodeSetup
from siren_ros.running.seat.drivers.drivers import Driver, driver_of
from siren_ros.running.seat.sight import Way, sight_of
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import MIRROR, RoadNetwork, mirror_image, right_hand_image
from siren_ros.simulation.traffic.demand.av_way import av_way
from siren_ros.simulation.world.actors import ActorDescription, ActorStates, TrafficState
from siren_ros.simulation.world.commands import AvControl, Controls

_INPUTS: Final[Mapping[str, Topic]] = {
    topic.name: topic
    for topic in (
        *(topics.EPISODE, topics.MAP, topics.AV_ROUTE, topics.EPISODE_END),
        *(topics.TRAFFIC, topics.ACTORS),
    )
}


class SeatedDriver:
    """A driver of the AV for one run of an episode.

    On a map with left-hand traffic the driver sees the mirror image, and its answers are mirrored again.
    """

    def __init__(self, driver: Driver[Any], network: RoadNetwork, way: Polyline, av_id: int) -> None:
        """Prepare the driver.

        Args:
            driver: The driver of the AV.
            network: The map.
            way: Way of the AV (``/av/route``), in the map's frame.
            av_id: The AV.
        """
        self._driver, self._av_id, self._left_hand = driver, av_id, network.left_hand
        driven = Polyline.through(way.points * MIRROR) if network.left_hand else way
        self._way = Way.of(right_hand_image(network), driven)
        self._actors: dict[int, ActorDescription] = {}
        self._state, self._at_m = driver.start, 0.0

    def answer(self, states: ActorStates, traffic: TrafficState) -> AvControl:
        """Control for a step; without the AV the control lets it roll."""
        self._actors.update({actor.actor_id: actor for actor in traffic.spawned})
        if not np.isin(self._av_id, states.actor_id):
            return AvControl(states.step)
        seen = mirror_image(states) if self._left_hand else states
        sight = sight_of(seen, traffic.signals, self._actors, self._av_id, self._way, self._at_m)
        self._at_m = sight.s_m
        self._state, control = self._driver.step(self._state, sight)
        return mirror_image(control) if self._left_hand else control


def answers_of(setup: EpisodeSetup, driver: Driver[Any]) -> Answer:
    """Answers of a driver of the AV, for one run of an episode without ROS.

    Raises:
        InputError: The request names no AV.
    """
    if not setup.plan.av:
        raise InputError("av", "", "civilian, so that somebody can drive it")
    av_id = setup.description.av_id
    seated = SeatedDriver(driver, setup.network, av_way(setup.network, setup.plan), av_id)

    def answer(step: LoopStep) -> Controls:
        return {av_id: seated.answer(step.states, step.traffic)}

    return answer


class AvController:
    """Drives the AV under test in a ROS program: it takes encoded messages and returns encoded answers.

    The program subscribes to the topics of ``INPUTS`` with ``raw=True`` and hands each message to ``take``. When the
    controller is ``ready``, the program creates the publisher of ``OUTPUT``, with which the episode begins, and then
    publishes the answers. The topics of ``LATCHED`` are said once, with the durability ``TRANSIENT_LOCAL``.

    A driver is a pure function with a first state: the property ``start`` and the method
    ``step(state, sight) -> (state, control)``, with ``siren_ros.Sight`` and ``siren_ros.AvControl``. On maps with
    left-hand traffic it sees the mirror image, and its answers are mirrored again.
    """

    INPUTS: Final[Mapping[str, str]] = {topic.name: topic.type_name for topic in _INPUTS.values()}
    """Topics to subscribe to, with their types."""
    LATCHED: Final = frozenset(topic.name for topic in _INPUTS.values() if topic.latched)
    OUTPUT: Final = (topics.AV_CONTROL.name, topics.AV_CONTROL.type_name)
    """Name and type of the topic for answers."""

    def __init__(self, driver: str | Driver[Any]) -> None:
        """Take a driver.

        Args:
            driver: One of the library by its name, such as ``lawful-california``, a file of ``siren train driver``, or
                a driver of one's own.

        Raises:
            InputError: There is no such driver, or its file cannot be used.
        """
        self._driver = driver_of(driver) if isinstance(driver, str) else driver
        self._last: dict[str, Any] = {}
        self._seated: SeatedDriver | None = None

    @property
    def ready(self) -> bool:
        """Whether episode, map and route have arrived."""
        return self._seated is not None

    @property
    def ended(self) -> bool:
        """Whether the episode is over."""
        return topics.EPISODE_END.name in self._last

    def take(self, topic: str, cdr: bytes) -> bytes | None:
        """Process a message.

        Args:
            topic: Name of its topic, one of ``INPUTS``.
            cdr: The encoded message.

        Returns:
            The encoded answer where the step's traffic and actor states are both there; None otherwise.

        Raises:
            InputError: The topic is none of ``INPUTS``.
            EpisodeError: The bytes are no message of the topic's type.
        """
        if topic not in _INPUTS:
            raise InputError("topic", topic, f"one of {', '.join(_INPUTS)}")
        self._last[topic] = wire.decode(_INPUTS[topic], cdr)
        if self._seated is None:
            self._seated = self._sit_down()
        states, traffic = (self._last.get(one.name) for one in (topics.ACTORS, topics.TRAFFIC))
        of_step = topic in {topics.ACTORS.name, topics.TRAFFIC.name}
        if self._seated is None or not of_step or states is None or traffic is None or states.step != traffic.step:
            return None
        answer = self._seated.answer(wire.content(from_actor_states, states), wire.content(from_traffic_state, traffic))
        return wire.encode(topics.AV_CONTROL, to_av_control(answer))

    def _sit_down(self) -> SeatedDriver | None:
        described, city, route = (self._last.get(topic.name) for topic in (topics.EPISODE, topics.MAP, topics.AV_ROUTE))
        if described is None or city is None or route is None:
            return None
        network = parse_road_network(city.data.encode())
        return SeatedDriver(self._driver, network, from_path(route), from_episode_description(described).av_id)
