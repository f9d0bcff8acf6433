from collections.abc import Iterator

import libsumo
import numpy as np
import pytest
from traffic_helpers import load_map, plan_s2

from siren_ros.scenario.levels import EmergencyLevel
from siren_ros.traffic.simulation import SumoSimulation
from siren_ros.traffic.sumo.sideways import SIDEWAYS_SHARE, SidewaysLimits
from siren_ros.world.actors import Owner

COMPILED, NETWORK = load_map(None)
PLAN = plan_s2(NETWORK, warm_up_s=20.0)[0]


@pytest.fixture
def sumo() -> Iterator[SumoSimulation]:
    with SumoSimulation(COMPILED, NETWORK, PLAN, EmergencyLevel.L0) as simulation:
        yield simulation


def test_the_limit_follows_the_speed_and_mirrored_vehicles_are_held(sumo: SumoSimulation) -> None:
    sumo.step(0, None)
    vehicles = {vehicle.name: vehicle for vehicle in PLAN.groups[:3]}
    slow, fast, mirrored = vehicles
    own = vehicles[fast].driver.max_lateral_speed_mps
    speeds = {slow: 1.0, fast: 10.0, mirrored: 10.0}
    limits = SidewaysLimits()
    limits.apply({name: {libsumo.VAR_SPEED: speed} for name, speed in speeds.items()}, vehicles, {mirrored})
    assert 0.1 < libsumo.vehicle.getMaxSpeedLat(slow) <= SIDEWAYS_SHARE * 1.0
    assert libsumo.vehicle.getMaxSpeedLat(fast) == own
    assert libsumo.vehicle.getMaxSpeedLat(mirrored) < 0.01
    limits.apply({name: {libsumo.VAR_SPEED: 10.0} for name in vehicles}, vehicles, set())
    assert [libsumo.vehicle.getMaxSpeedLat(name) for name in vehicles] == [own] * 3


def test_nobody_slides_sideways_while_standing(sumo: SumoSimulation) -> None:
    before = sumo.step(0, None)
    stood = 0
    for step in range(1, 500):
        state = sumo.step(step, None)
        common = np.intersect1d(state.actor_id, before.actor_id)
        now, then = np.searchsorted(state.actor_id, common), np.searchsorted(before.actor_id, common)
        standing = (state.sumo_speed_mps[now] < 0.01) & (before.sumo_speed_mps[then] < 0.01)
        standing &= state.owner[now] == Owner.SUMO
        moved = np.hypot(state.sumo_x_m[now] - before.sumo_x_m[then], state.sumo_y_m[now] - before.sumo_y_m[then])
        assert np.all(moved[standing] < 0.002)
        stood += int(standing.sum())
        before = state
    assert stood > 100
