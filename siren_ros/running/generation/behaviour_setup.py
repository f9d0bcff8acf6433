"""Prepares what the controllers need from an episode's description."""

from collections.abc import Mapping
from typing import cast

from siren_ros.simulation.behaviour.driving.step_view import BehaviourWorld
from siren_ros.simulation.dynamics.parameters import load_vehicle_parameters
from siren_ros.simulation.roads.mirror_image import right_hand_image
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.scenario.driver_parameters import driver_parameters
from siren_ros.simulation.scenario.episode import EpisodeDescription
from siren_ros.simulation.scenario.paper import LEVEL_POLICIES
from siren_ros.simulation.scenario.presets import load_preset


def behaviour_world(episode: EpisodeDescription, map_xml: bytes) -> BehaviourWorld:
    """Constant inputs of the controllers in an episode.

    Args:
        episode: The description, with the template's values under ``parameters["template"]``.
        map_xml: The compiled SUMO net.

    Raises:
        InputError: The preset, the vehicles or the map cannot be used.
    """
    files = episode.files
    values = cast("Mapping[str, float]", episode.parameters["template"])
    preset = load_preset(episode.preset, files).for_scenario(
        values["response.response_distance_m"], values["response.extra_delay_s"], values["response.compliance"]
    )
    config = driver_parameters(preset.drivers, values)
    network = parse_road_network(map_xml)
    return BehaviourWorld(
        network=right_hand_image(network),
        policy=LEVEL_POLICIES[episode.level],
        vehicles=load_vehicle_parameters(files),
        preset=preset,
        seed=episode.seed,
        av_id=episode.av_id,
        speeds=config.speeds(values["emv.speed_mps"]),
        config=config,
        left_hand=network.left_hand,
        duty=bool(values.get("response.duty", 0)),
    )
