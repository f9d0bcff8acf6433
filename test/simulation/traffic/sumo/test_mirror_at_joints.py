"""SUMO keeps mirrored vehicles on the road where the number of lanes changes, beside the paths of the joint, too."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import libsumo
import numpy as np
import pytest
from map_networks import plain_net
from traffic_helpers import load_map, states_of

from siren_ros.base.numerics.units import STEP_S
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.scenario.driver_parameters import TrafficDrivers
from siren_ros.simulation.traffic.sumo.mirror import Mirror
from siren_ros.simulation.traffic.sumo.population import route_id
from siren_ros.simulation.world.actors import ActorClass, Owner

ROS = int(Owner.ROS)
SPEED_MPS = 4.0
NODES = '<node id="a" x="0" y="0"/><node id="j" x="100" y="0"/><node id="b" x="200" y="0"/>'
EDGES = '<edge id="{0}" from="{1}" to="{2}" numLanes="{3}"/>'
ROUTE = ("e0", "e1")
SIDES_M = np.arange(-11.2, 1.7, 0.8)
"""Where vehicles drive along the road: beside its lanes, in them, and between them."""
QUIET = {"--no-warnings": "true", "--no-step-log": "true", "--time-to-teleport": "-1", "--collision.action": "none"}


@pytest.fixture(params=[(3, 1), (1, 3)], ids=str)
def network(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[RoadNetwork]:
    """A running simulation on a road that has another number of lanes from the middle on."""
    before, behind = request.param
    edges = EDGES.format("e0", "a", "j", before) + EDGES.format("e1", "j", "b", behind)
    compiled, network = load_map(plain_net(tmp_path, NODES, edges))
    files = {"--net-file": str(compiled.net_path), "--step-length": f"{STEP_S}", "--lateral-resolution": "0.6"}
    libsumo.start(["sumo", *(part for pair in (files | QUIET).items() for part in pair)])
    yield network
    libsumo.close()


def test_a_mirrored_vehicle_stays_on_the_road_at_its_pose_through_a_joint(network: RoadNetwork) -> None:
    population: Any = SimpleNamespace(length_scale={}, scale_of=lambda _: 1.0)
    mirror, offset_m = Mirror(network, population, TrafficDrivers()), network.sumo_offset_m
    names = {f"v{number}": number for number in range(len(SIDES_M))}
    body = {"length_m": 5.0, "route": ROUTE, "is_emv": False, "actor_class": ActorClass.SEDAN}
    vehicles: Any = {number: SimpleNamespace(name=name, **body) for name, number in names.items()}
    edges = tuple(network.edge_by_id[edge].index for edge in ROUTE)
    for name in names:
        libsumo.route.add(route_id(name), ROUTE)
        libsumo.vehicle.add(name, route_id(name), departPos=str(10.0 + len(name)))
    libsumo.simulationStep()
    for step in range(200):
        x_m = 85.0 + SPEED_MPS * STEP_S * step
        rows = [
            {"actor_id": number, "x_m": x_m - offset_m[0], "y_m": y_m - offset_m[1], "vx_mps": SPEED_MPS, "owner": ROS}
            for number, y_m in enumerate(SIDES_M)
        ]
        mirror.apply(states_of(step, rows), vehicles, names, dict.fromkeys(names, edges))
        libsumo.simulationStep()
        for name, place in mirror.places.items():
            assert libsumo.vehicle.getLaneID(name), f"{name} is off the road for SUMO at x = {place.x_m} m"
            assert libsumo.vehicle.getPosition(name) == pytest.approx((place.x_m, place.y_m), abs=0.05)
