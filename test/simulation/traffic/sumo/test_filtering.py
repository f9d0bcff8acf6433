"""Motorcyclists who follow an EMV through the rescue lane."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import libsumo
import numpy as np
import pytest
from traffic_helpers import columns_of, load_map, plan_of

from siren_ros.base.numerics.geometry import overlapping_pairs
from siren_ros.running.generation.closed_loop import closed_loop
from siren_ros.running.generation.episode_setup import EpisodeSetup, set_up_episode
from siren_ros.simulation.roads.rescue_lane import rescue_sides
from siren_ros.simulation.roads.road_network import Lane, RoadNetwork
from siren_ros.simulation.roads.routing import driving_lanes
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle, load_drivers
from siren_ros.simulation.traffic.sumo.filtering import (
    BEND,
    BESIDE_M,
    FASTEST_MPS,
    KEEPS_M,
    NEXT_M,
    ROAD_M,
    WITHIN_M,
    FilteringRiders,
    filter_speeds_mps,
)
from siren_ros.simulation.traffic.sumo.population import MIRRORS_M
from siren_ros.simulation.world.actors import ActorClass, ActorDescription, rows_of_ids


@pytest.mark.parametrize("angle_deg", [0.0, 75.0, 200.0])
@pytest.mark.parametrize(
    ("ahead_m", "aside_m", "turned_deg", "speed_mps"),
    [
        (KEEPS_M + 6.0, 2.0, 0.0, 4.0),
        (KEEPS_M + 6.5, 2.0, 0.0, 4.0),
        (KEEPS_M + 0.1, 2.0, 0.0, 0.5),
        (60.0, -2.0, 0.0, 0.5 * np.floor(FASTEST_MPS / 0.5)),
        (WITHIN_M + 0.1, 0.0, 0.0, 0.0),
        (KEEPS_M - 0.1, 0.0, 0.0, 0.0),
        (-20.0, 0.0, 0.0, 0.0),
        (60.0, ROAD_M + 60.0 * BEND + 0.1, 0.0, 0.0),
        (60.0, ROAD_M + 60.0 * BEND - 0.1, 0.0, 8.0),
        (60.0, 0.0, 180.0, 0.0),
    ],
)
def test_riders_keep_a_distance_behind_an_emv_that_has_passed(
    angle_deg: float, ahead_m: float, aside_m: float, turned_deg: float, speed_mps: float
) -> None:
    angle = np.radians(angle_deg)
    forward, right = np.array([np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), -np.sin(angle)])
    x, y = np.array([50.0, 20.0]) + ahead_m * forward + aside_m * right
    rider = np.array([[50.0], [20.0], [angle_deg]])
    assert filter_speeds_mps(rider, np.array([[x], [y], [angle_deg + turned_deg]])).tolist() == [speed_mps]


@pytest.mark.parametrize(("behind_m", "follows"), [(NEXT_M + 1.0, True), (NEXT_M - 1.0, False)])
def test_nobody_filters_before_the_next_emv(behind_m: float, follows: bool) -> None:
    rider, emvs = np.array([[0.0], [0.0], [0.0]]), np.array([[0.0, 0.0], [40.0, -behind_m], [0.0, 0.0]])
    assert bool(filter_speeds_mps(rider, emvs)[0] > 0.0) is follows
    assert filter_speeds_mps(rider, emvs[:, :0]).tolist() == [0.0]


@pytest.fixture(scope="module")
def motorway() -> RoadNetwork:
    return load_map(Path("motorway"))[1]


def at(lane: Lane, y_m: float) -> dict[int, Any]:
    return {libsumo.VAR_LANE_ID: lane.lane_id, libsumo.VAR_POSITION: (0.0, y_m)}


def ridden(vehicle: PlannedVehicle, **changes: Any) -> PlannedVehicle:
    driver = replace(vehicle.driver, driving=load_drivers().classes[ActorClass.MOTORCYCLE])
    body = {"actor_class": ActorClass.MOTORCYCLE, "length_m": 2.25, "width_m": 0.85, "height_m": 1.65}
    return replace(vehicle, driver=driver, **body, **changes)


def test_who_filters_is_told_a_width_and_a_speed_until_nobody_waits_beside_them(
    motorway: RoadNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of two riders in each of three lanes one filters; the rescue lane is not beside the rightmost lane."""
    edge = next(edge.index for edge in motorway.edges if len(driving_lanes(motorway, edge.index)) == 3)
    lanes = driving_lanes(motorway, edge)
    assert rescue_sides(motorway)[[lane.index for lane in lanes]].tolist() == [-1, -1, 1]
    told: list[tuple[str, str, float]] = []
    monkeypatch.setattr(libsumo.vehicle, "setWidth", lambda name, width: told.append((name, "width", width)))
    monkeypatch.setattr(libsumo.vehicle, "setSpeedFactor", lambda name, factor: told.append((name, "speed", factor)))
    plan, _, _ = plan_of("S2", load_map(None)[1], 0)
    emv, driver = plan.emvs[0], plan.background[0]
    vehicles = {f"{kind}{lane.position}": ridden(driver, filters=kind == "f") for lane in lanes for kind in "fn"}

    def filtering(ahead_m: float, slow: bool = True, waits_m: float = 30.0) -> list[str]:
        here = {libsumo.VAR_POSITION: (0.0, ahead_m)}
        riders = {  # those who do not filter are behind
            f"{kind}{lane.position}": at(lane, 0.0 if kind == "f" else -50.0) for lane in lanes for kind in "fn"
        }
        waits = {libsumo.VAR_POSITION: (0.0, waits_m)}
        columns = columns_of({"emv0": here, "car": waits, **riders}, motorway, {})
        everybody = {"emv0": emv, "car": driver, **vehicles}
        flags = riding.apply(columns, everybody, np.array([False, *[slow] * 7]), ["emv0"])
        return [columns.names[row] for row in np.flatnonzero(flags).tolist()]

    riding, first = FilteringRiders(motorway), lanes[0].position
    both = [f"f{first + 1}", f"f{first + 2}"]
    assert filtering(60.0, slow=False) == []
    assert told == []
    assert filtering(60.0) == both
    assert filtering(50.0) == both
    factor = 8.0 / lanes[0].speed_limit_mps
    begins = [item for name in both for item in ((name, "width", pytest.approx(1.05)), (name, "speed", factor))]
    assert told == begins
    told.clear()
    assert filtering(50.0, waits_m=BESIDE_M[1] + 1.0) == []
    width, own = driver.width_m, vehicles[both[0]].driver.speed_factor
    assert width != 0.85
    ends = [item for name in both for item in ((name, "width", 0.85 + MIRRORS_M), (name, "speed", own))]
    assert told == ends


STOP_AND_GO = "jam.moves=1,jam.roll_s=12,jam.roll_mps=3,jam.stand_s=8"


def jam_with_riders(filters: bool) -> tuple[EpisodeSetup, frozenset[str]]:
    """S8 with a motorcycle in the place of each sixth of the vehicles that stand beside the rescue lane."""
    setup = set_up_episode(EpisodeRequest("S8", values=STOP_AND_GO, sensors="none"))
    beside = {vehicle.spot.lane for vehicle in setup.plan.groups}
    beside -= {lane for lane in beside if setup.network.lanes[lane].position < max_position(setup, lane) - 1}
    groups = list(setup.plan.groups)
    chosen = [row for row, vehicle in enumerate(groups) if vehicle.spot.lane in beside][3::12]
    for row in chosen:
        groups[row] = ridden(groups[row], filters=filters)
    names = frozenset(groups[row].name for row in chosen)
    return replace(setup, plan=replace(setup.plan, groups=tuple(groups))), names


def max_position(setup: EpisodeSetup, lane: int) -> int:
    return driving_lanes(setup.network, setup.network.lanes[lane].edge)[-1].position


@pytest.mark.parametrize("filters", [False, True])
def test_riders_leave_the_jam_behind_the_emv(filters: bool) -> None:
    setup, names = jam_with_riders(filters)
    actors: dict[int, ActorDescription] = {}
    for step in closed_loop(setup, 900):
        traffic = step.traffic
        actors |= {actor.actor_id: actor for actor in traffic.spawned}
        if traffic.step % 10 == 0:
            size = np.array([(actors[i].length_m, actors[i].width_m) for i in traffic.actor_id.tolist()])
            poses = traffic.x_m, traffic.y_m, traffic.yaw_rad
            first, second, *_ = overlapping_pairs(*poses, size[:, 0], size[:, 1])
            touching = {actors[int(traffic.actor_id[row])].name for row in (*first.tolist(), *second.tolist())}
            assert not touching & names
    riders = [actor_id for actor_id, actor in actors.items() if actor.name in names]
    assert len(riders) == len(names) > 4
    emv, *rows = rows_of_ids(traffic.actor_id, np.array([1, *sorted(riders)], np.uint32)).tolist()
    cos, sin = np.cos(traffic.yaw_rad[emv]), np.sin(traffic.yaw_rad[emv])
    dx, dy = traffic.x_m[rows] - traffic.x_m[emv], traffic.y_m[rows] - traffic.y_m[emv]
    behind_m, aside_m = -(cos * dx + sin * dy), np.abs(cos * dy - sin * dx)
    follows = (behind_m > KEEPS_M) & (behind_m < 60.0) & (aside_m < 1.0) & (traffic.speed_mps[rows] > 7.0)
    assert bool(follows.any()) is filters
