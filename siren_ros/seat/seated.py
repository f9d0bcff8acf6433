"""A driver of the library in the seat of an episode's AV under test."""

from typing import Any

import numpy as np

from siren_ros.errors import InputError
from siren_ros.generation.closed_loop import LoopStep
from siren_ros.generation.episode_setup import EpisodeSetup
from siren_ros.generation.recorded_episode import Answer
from siren_ros.numerics.geometry import Polyline
from siren_ros.roads.mirror_image import MIRROR, right_hand_image
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.seat.drivers.driver import Driver
from siren_ros.seat.sight import sight_of
from siren_ros.seat.way import Way
from siren_ros.traffic.demand.demand import av_way
from siren_ros.world.actors import ActorDescription, ActorStates
from siren_ros.world.commands import AvControl, Controls
from siren_ros.world.mirror_image import mirror_image
from siren_ros.world.traffic_state import TrafficState


class SeatedDriver:
    """A driver in the seat for one run of an episode.

    On a map with left-hand traffic the driver sees the mirror image, and its answers are mirrored again.
    """

    def __init__(self, driver: Driver[Any], network: RoadNetwork, way: Polyline, av_id: int) -> None:
        """Takes the seat.

        Args:
            driver: Who drives.
            network: The map.
            way: Of the AV (``/av/route``), in the map's frame.
            av_id: The AV.
        """
        self._driver, self._av_id, self._left_hand = driver, av_id, network.left_hand
        driven = Polyline.through(way.points * MIRROR) if network.left_hand else way
        self._way = Way.of(right_hand_image(network), driven)
        self._actors: dict[int, ActorDescription] = {}
        self._state, self._at_m = driver.start, 0.0

    def answer(self, states: ActorStates, traffic: TrafficState) -> AvControl:
        """The answer to a step; it rolls where the AV is not there."""
        self._actors.update({actor.actor_id: actor for actor in traffic.spawned})
        if not np.isin(self._av_id, states.actor_id):
            return AvControl(states.step)
        seen = mirror_image(states) if self._left_hand else states
        sight = sight_of(seen, traffic.signals, self._actors, self._av_id, self._way, self._at_m)
        self._at_m = sight.s_m
        self._state, control = self._driver.step(self._state, sight)
        return mirror_image(control) if self._left_hand else control


def answers_of(setup: EpisodeSetup, driver: Driver[Any]) -> Answer:
    """The answers of a driver in the seat, for one run of an episode without ROS.

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
