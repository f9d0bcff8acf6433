"""Prepares an episode: everything that is decided before the first step, and what the controllers need of it."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Final, cast

from siren_ros import __version__
from siren_ros.base.numerics.arrays import random_stream
from siren_ros.base.numerics.units import steps_from_s
from siren_ros.base.params.parameters import FILES_ON_DISK, InputFile, InputFiles, NotedFiles, files_to_json
from siren_ros.data.recording.bag_folder import bag_path
from siren_ros.running.generation.site_choice import plan_at_site, sites_to_try
from siren_ros.running.generation.template_map import map_of_template
from siren_ros.sensing.look import load_look
from siren_ros.sensing.suite import load_suite
from siren_ros.simulation.behaviour.driving.step_view import BehaviourWorld
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.roads.maps.map_compiler import (
    CompiledMap,
    compile_map,
    with_shoulders_in_use,
    with_speed_limit,
)
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import RoadNetwork, right_hand_image
from siren_ros.simulation.roads.sites import Site
from siren_ros.simulation.scenario.driver_parameters import driver_parameters
from siren_ros.simulation.scenario.episode import (
    CROSSING_PARAMETER,
    DEMAND_PARAMETER,
    FILES_PARAMETER,
    MAP_SOURCE_PARAMETER,
    EpisodeDescription,
    EpisodeRequest,
    values_of,
)
from siren_ros.simulation.scenario.paper import LEVEL_POLICIES, EmergencyLevel
from siren_ros.simulation.scenario.presets import DriverPreset, load_preset
from siren_ros.simulation.scenario.scenario import Template
from siren_ros.simulation.scenario.sealing import sealed, seed_of
from siren_ros.simulation.scenario.templates import load_template, realised
from siren_ros.simulation.traffic.demand.av_way import choose_av
from siren_ros.simulation.traffic.demand.own_demand import OwnDemand, read_demand
from siren_ros.simulation.traffic.demand.plan import (
    TrafficPlan,
    load_drivers,
    with_emv_drivers,
    with_responses,
)
from siren_ros.simulation.traffic.demand.road_users import largest, with_sizes


def files_of_request(request: EpisodeRequest, files: InputFiles = FILES_ON_DISK) -> tuple[InputFile, ...]:
    """The files that ``set_up_episode`` reads and puts into the episode's description.

    Raises:
        InputError: One of them cannot be used.
    """
    noted = NotedFiles(files)
    load_template(request.template, noted)
    load_preset(request.preset, noted)
    for suite in (request.sensors, request.av_sensors):
        load_suite(suite, noted)
    load_look(request.look, noted)
    load_vehicle_parameters(noted)
    load_drivers(files=noted)
    return noted.seen


_version = cache(version)
_PACKAGES: Final = ("eclipse-sumo", "numpy", "embreex")


@dataclass(frozen=True)
class EpisodeSetup:
    """A request with all lookups, draws and compilations done."""

    description: EpisodeDescription
    template: Template
    level: EmergencyLevel
    compiled_map: CompiledMap
    network: RoadNetwork
    site: Site
    plan: TrafficPlan
    preset: DriverPreset

    @property
    def steps(self) -> int:
        """Number of steps of the episode."""
        return _steps_of(self.description.duration_s)


def level_of(request: EpisodeRequest, template: Template) -> EmergencyLevel:
    """Level of the request, or the template's own."""
    return EmergencyLevel[request.level] if request.level else template.level


def map_of(request: EpisodeRequest, template: Template) -> Path | None:
    """Map of the request, or the template's own; None means the built-in town."""
    name = request.map or template.map_name
    return Path(name) if name else None


def plan_length(request: EpisodeRequest) -> int:
    """Number of steps of a request's episode, which need not be set up for it.

    Raises:
        InputError: The template cannot be used.
    """
    template = load_template(request.template).with_values(values_of(request.values))
    return _steps_of(request.duration_s or template.lasting_s)


def _steps_of(duration_s: float) -> int:
    return max(1, steps_from_s(duration_s))


def default_bag_path(request: EpisodeRequest) -> Path:
    """Default folder of a bag: ``bags/S2_L2_seed0``, with the map's name if the request gives one."""
    template = load_template(request.template)
    return bag_path(
        template.template_id, level_of(request, template), request.seed, request.map, has_av=bool(request.av)
    )


def set_up_episode(
    request: EpisodeRequest,
    files: InputFiles = FILES_ON_DISK,
    compiled_map: CompiledMap | None = None,
    own: OwnDemand | None = None,
) -> EpisodeSetup:
    """Look up, draw and compile what an episode needs. Equal requests and files give equal setups.

    Args:
        request: What the user asks for.
        files: Source of the parameter files; every file that is read becomes part of the description.
        compiled_map: The map, compiled before; None to compile the request's map.
        own: The own traffic of the request, read before; None to read its file.

    Raises:
        InputError: Any part of the request cannot be used; the error names it.
    """
    noted = NotedFiles(files)
    written, seed = load_template(request.template, noted), seed_of(request)
    template = realised(written, random_stream(seed, "scenario/values"))
    template = template.with_values(values_of(request.values))
    preset = load_preset(request.preset, noted, seed)
    for suite in (request.sensors, request.av_sensors):
        load_suite(suite, noted)
    load_look(request.look, noted)
    compiled = _map_for(template, written, map_of(request, written), compiled_map)
    network = parse_road_network(compiled.read_bytes())
    driven = right_hand_image(network)
    dimensions = {
        actor_class: (vehicle.length_m, vehicle.width_m, vehicle.height_m)
        for actor_class, vehicle in load_vehicle_parameters(noted).items()
    }
    drivers = driver_parameters(preset.drivers, template.drivers)
    population = load_drivers(files=noted).by(drivers.traffic)
    sites = sites_to_try(driven, written, seed, request.site, request.map or compiled.name)
    lasting = replace(template, duration_s=max(template.lasting_s, request.duration_s))
    if request.demand:
        until_s = template.warm_up_s + (request.duration_s or template.lasting_s)
        own = own or read_demand(Path(request.demand), driven, until_s, request.demand_begin_s)
        people = replace(template.demand.people, cyclists=0, motorcycles=0)
        alone = replace(template.demand, background_vehicles=0, district_per_lane_km=0.0, people=people)
        lasting = replace(lasting, demand=alone)
        for line in own.left_out:
            logging.getLogger("siren_ros").warning("%s does not drive as it is: %s", own.source, line)
    spread = template.demand.variety.size_spread
    planned_for = largest(dimensions, spread) if spread else dimensions
    site, plan = plan_at_site(driven, sites, lasting, seed, population, planned_for)
    if spread:
        plan = with_sizes(plan, dimensions, spread, seed)
    if own:
        plan = replace(plan, own=own, reserve=(), civilians=0, riders_kept={})
    plan = with_emv_drivers(with_responses(plan, preset, seed), drivers.sumo)
    if request.av:
        plan = replace(plan, av=choose_av(driven, plan))
    description = sealed(_description(request, template, compiled, network, site, plan, noted), request)
    return EpisodeSetup(description, template, description.level, compiled, network, site, plan, preset)


def _map_for(template: Template, written: Template, path: Path | None, compiled_map: CompiledMap | None) -> CompiledMap:
    """The map with the template's speed limit and shoulders, compiled unless it is given."""
    people = template.demand.people
    for_people = bool(people.pedestrians or people.cyclists)
    compiled = map_of_template(
        written, compiled_map or compile_map(path, for_people=for_people), path, cyclists=bool(people.cyclists)
    )
    compiled = with_speed_limit(compiled, template.demand.speed_limit_mps)
    return with_shoulders_in_use(compiled) if template.shoulders_in_use else compiled


def _description(
    request: EpisodeRequest,
    template: Template,
    compiled: CompiledMap,
    network: RoadNetwork,
    site: Site,
    plan: TrafficPlan,
    noted: NotedFiles,
) -> EpisodeDescription:
    """What an episode's bag says of it: the request, what was drawn and compiled, and the files that were read."""
    av = {"actor_id": len(plan.emvs) + 1, "name": plan.av, "sensors": request.av_sensors}
    emv_ids = tuple(range(1, 1 + len(plan.emvs)))
    roads = (network.edges[edge] for edge in site.route)
    prolonged_m = {road.edge_id: road.prolonged_m for road in roads if road.prolonged_m}
    crossing = {"junction": plan.crossed, "emv_ids": list(emv_ids[template.emv.count :])}
    return EpisodeDescription(
        template=template.template_id,
        level=level_of(request, template),
        seed=seed_of(request),
        map_name=compiled.name,
        map_sha256=compiled.sha256,
        duration_s=request.duration_s or template.lasting_s,
        sensor_suite=request.sensors,
        preset=request.preset,
        emv_ids=emv_ids,
        parameters={
            "request": request.to_json(),
            "template": template.recorded_values(),
            "predicate": {"name": template.predicate.name, "thresholds": dict(template.predicate.thresholds)},
            **({"av": av} if plan.av else {}),
            **({CROSSING_PARAMETER: crossing} if plan.crossed else {}),
            **({DEMAND_PARAMETER: vars(plan.own)} if plan.own else {}),
            FILES_PARAMETER: files_to_json(noted.seen),
            MAP_SOURCE_PARAMETER: compiled.source_sha256,
        },
        versions=present_versions(),
        site={
            "kind": site.kind.value,
            "name": site.name,
            "junction": site.junction or "",
            **({"control": site.control.value} if site.control else {}),
            "route": [network.edges[edge].edge_id for edge in site.route],
            "stretch": [network.edges[edge].edge_id for edge in site.stretch],
            **({"prolonged_m": prolonged_m} if prolonged_m else {}),
            **({"map_variant": compiled.variant} if compiled.variant else {}),
        },
    )


def present_versions() -> Mapping[str, str]:
    """Versions of this program and of the packages that an episode depends on."""
    return {"siren_ros": __version__, **{package: _version(package) for package in _PACKAGES}}


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
    preset = load_preset(episode.preset, files, episode.seed).for_scenario(
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
