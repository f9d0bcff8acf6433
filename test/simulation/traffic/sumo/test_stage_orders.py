"""Orders to single vehicles: EMVs that SUMO drives, at the end of their route, and the head of a jam."""

from dataclasses import replace

import libsumo
import numpy as np
import pytest
from traffic_helpers import load_map, plan_s2

from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.traffic.demand.jam import JamHead
from siren_ros.simulation.traffic.demand.plan import Spot
from siren_ros.simulation.traffic.simulation import SumoSimulation
from siren_ros.simulation.traffic.sumo.stage_orders import JamOrders


@pytest.mark.parametrize("level", [EmergencyLevel.L0, EmergencyLevel.L1])
def test_an_emv_that_sumo_drives_stays_at_the_end_of_its_route(level: EmergencyLevel) -> None:
    """At L1 it is driven from outside; here nobody does, and SUMO takes it out at the end of the road."""
    compiled, network = load_map(None)
    plan, _ = plan_s2(network)
    emv = plan.emvs[0]
    lane = network.lanes[emv.spot.lane]
    alone = replace(emv, route=emv.route[:1], spot=Spot(lane.index, lane.length_m - 80.0, 10.0))
    plan = replace(plan, emvs=(alone,), groups=(), background=(), reserve=())
    with SumoSimulation(compiled, network, plan, level) as simulation:
        for step in range(500):
            state = simulation.step(step, None)
    there = np.flatnonzero(state.actor_id == 1)
    assert len(there) == (level is EmergencyLevel.L0)
    assert (state.speed_mps[there] == 0.0).all()
    assert np.allclose(state.lane_position_m[there], lane.length_m - 1.0, atol=1.0)


def test_the_head_of_a_jam_is_freed_once_and_only_those_whom_sumo_drives_are_told(monkeypatch) -> None:
    told: list[tuple[str, float]] = []
    monkeypatch.setattr(libsumo.vehicle, "setSpeed", lambda name, mps: told.append((name, mps)))
    orders = JamOrders(JamHead(names=("a", "b"), moves=False, roll_s=0.05, roll_mps=2.0, stand_s=1.0, until_s=0.1))
    for step, present in enumerate([{"a", "b", "c"}, {"b"}, {"a"}, {"a", "b"}]):
        orders.apply(step, present)
    assert told == [("a", 2.0), ("b", 2.0), ("b", 0.0), ("a", -1.0)]
