"""A driver of the library in the seat of an episode's AV under test."""

from typing import Any

from siren_ros.errors import InputError
from siren_ros.generation.closed_loop import LoopStep
from siren_ros.generation.episode_setup import EpisodeSetup
from siren_ros.generation.recorded_episode import Answer
from siren_ros.roads.mirror_image import right_hand_image
from siren_ros.seat.drivers.driver import Driver
from siren_ros.seat.sight import sight_of
from siren_ros.seat.way import Way
from siren_ros.traffic.demand.demand import av_way
from siren_ros.world.actors import ActorDescription
from siren_ros.world.commands import Controls
from siren_ros.world.mirror_image import mirror_image


def answers_of(setup: EpisodeSetup, driver: Driver[Any]) -> Answer:
    """The answers of a driver in the seat, for one run of an episode.

    On a map with left-hand traffic the driver sees the mirror image, and its answers are mirrored again.

    Raises:
        InputError: The request names no AV.
    """
    if not setup.plan.av:
        raise InputError("av", "", "civilian, so that somebody can drive it")
    network, left_hand, av_id = right_hand_image(setup.network), setup.network.left_hand, setup.description.av_id
    way = Way.of(network, av_way(network, setup.plan))
    actors: dict[int, ActorDescription] = {}
    state = driver.start

    def answer(step: LoopStep) -> Controls:
        nonlocal state
        actors.update({actor.actor_id: actor for actor in step.traffic.spawned})
        if av_id not in step.states.actor_id:
            return {}
        states = mirror_image(step.states) if left_hand else step.states
        state, control = driver.step(state, sight_of(states, step.traffic.signals, actors, av_id, way))
        return {av_id: mirror_image(control) if left_hand else control}

    return answer
