"""A small network, plans on it and states of mirrored vehicles, for the traffic tests."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import libsumo
from hand_made_record import actor_states
from made_district import write_district

from siren_ros.simulation.roads.maps.map_compiler import CompiledMap, compile_map
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.roads.site_finder import require_site
from siren_ros.simulation.roads.sites import Site
from siren_ros.simulation.scenario.presets import DriverPreset, OncomingResponse, load_preset
from siren_ros.simulation.scenario.scenario import Template
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.traffic.demand.demand import plan_traffic
from siren_ros.simulation.traffic.demand.plan import TrafficPlan, load_drivers
from siren_ros.simulation.traffic.sumo.readings import SUBSCRIBED, SumoColumns
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, ActorClass, ActorStates

DIMENSIONS: Mapping[ActorClass, tuple[float, float, float]] = dict.fromkeys(ActorClass, (4.6, 1.8, 1.5)) | {
    ActorClass.BUS: (12.0, 2.55, 3.1),
    ActorClass.TRUCK: (8.5, 2.5, 3.4),
    ActorClass.AMBULANCE: (6.2, 2.1, 2.7),
}


def load_map(source: Path | None) -> tuple[CompiledMap, RoadNetwork]:
    compiled = compile_map(source)
    return compiled, parse_road_network(compiled.read_bytes())


MAPS = ("town", "district")


def named_map(name: str) -> tuple[CompiledMap, RoadNetwork]:
    """The built-in town, or the made district."""
    if name == "town":
        return load_map(None)
    with TemporaryDirectory() as folder:
        return load_map(write_district(Path(folder)))


def plan_of(name: str, network: RoadNetwork, seed: int = 0) -> tuple[TrafficPlan, Template, Site]:
    """A template's plan on a map, the template and its site."""
    template = load_template(name)
    site = require_site(network, template.site_kind)
    return plan_traffic(network, site, template, seed, load_drivers(), DIMENSIONS), template, site


def plan_s2(network: RoadNetwork, seed: int = 0, warm_up_s: float = 5.0) -> tuple[TrafficPlan, Template]:
    template = replace(load_template("S2"), warm_up_s=warm_up_s)
    site = require_site(network, template.site_kind)
    return plan_traffic(network, site, template, seed, load_drivers(), DIMENSIONS), template


def columns_of(
    results: Mapping[str, Mapping[int, Any]], network: RoadNetwork, scale: Mapping[str, float]
) -> SumoColumns:
    """SUMO's results as columns; what a test leaves out is 0, and nowhere."""
    columns = SumoColumns(network, scale)
    columns.take({name: WITHOUT | result for name, result in results.items()})
    return columns


WITHOUT: Mapping[int, Any] = dict.fromkeys(SUBSCRIBED, 0) | {
    libsumo.VAR_POSITION: (0.0, 0.0),
    libsumo.VAR_LANE_ID: "",
}


def states_of(step: int, rows: list[dict[str, float]]) -> ActorStates:
    """ActorStates with the given fields, all others 0."""
    ordered = sorted(rows, key=lambda row: row["actor_id"])
    return actor_states(step, **{name: [row.get(name, 0) for row in ordered] for name in ACTOR_STATE_DTYPES})


def responding(attentive: float = 1.0, oncoming: float = 0.0) -> DriverPreset:
    """The paper's preset with other shares of drivers who look out and who react to an EMV that comes towards them."""
    preset = load_preset("paper")
    attention = replace(preset.attention, civilians=attentive)
    return replace(preset, attention=attention, oncoming=OncomingResponse(oncoming, 0.6))
