import libsumo
import numpy as np
import pytest
from traffic_helpers import DIMENSIONS, TOWN10, load_map

from siren_ros.numerics.geometry import footprint_corners, separation_m
from siren_ros.roads.sites.site_finder import require_site
from siren_ros.scenario.levels import EmergencyLevel
from siren_ros.scenario.templates import load_template
from siren_ros.traffic.demand.attention import with_attention
from siren_ros.traffic.demand.demand import plan_traffic
from siren_ros.traffic.demand.driver_models import load_drivers
from siren_ros.traffic.simulation import SumoSimulation
from siren_ros.traffic.sumo.vehicle_types import type_id


@pytest.mark.parametrize("name", ["town", "Town10HD_Opt"])
@pytest.mark.parametrize("seed", [1, 2])
def test_nobody_overlaps_when_the_episode_begins(name: str, seed: int) -> None:
    if name == "Town10HD_Opt" and not TOWN10.is_file():
        pytest.skip("shared/maps is not there")
    compiled, network = load_map(TOWN10 if name == "Town10HD_Opt" else None)
    template = load_template("S6")
    site = require_site(network, template.site_kind)
    plan = plan_traffic(network, site, template, seed, load_drivers(), DIMENSIONS)
    with SumoSimulation(compiled, network, plan, EmergencyLevel.L1, seed=seed) as simulation:
        state = simulation.step(0, None)
    assert len(state.actor_id) == len(plan.emvs) + plan.civilians
    size = np.array([(actor.length_m, actor.width_m) for actor in state.spawned])
    corners = footprint_corners(state.sumo_x_m, state.sumo_y_m, state.sumo_yaw_rad, size[:, 0], size[:, 1])
    first, second = np.triu_indices(len(corners), k=1)
    assert separation_m(corners[first], corners[second]).min() > 0.0


def test_sumo_too_lets_inattentive_drivers_overlook_an_emv_on_the_junction() -> None:
    compiled, network = load_map(None)
    template = load_template("S6")
    site = require_site(network, template.site_kind)
    plan = with_attention(plan_traffic(network, site, template, 1, load_drivers(), DIMENSIONS), 0.5, 3)
    with SumoSimulation(compiled, network, plan, EmergencyLevel.L1, seed=1) as simulation:
        simulation.step(0, None)
        ignored = {
            vehicle.name: libsumo.vehicle.getParameter(vehicle.name, "junctionModel.ignoreTypes")
            for vehicle in (*plan.emvs, *plan.groups)
        }
    attentive = {vehicle.name: vehicle.attentive for vehicle in (*plan.emvs, *plan.groups)}
    assert set(attentive.values()) == {True, False}
    assert {name for name, types in ignored.items() if types} == {name for name, sees in attentive.items() if not sees}
    assert {types for types in ignored.values() if types} == {type_id(plan.emvs[0])}
