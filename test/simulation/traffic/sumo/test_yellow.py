"""Which drivers drive on at yellow, and until when."""

from dataclasses import replace
from types import SimpleNamespace

import libsumo
import numpy as np
import pytest
from hand_made_record import STRAIGHT, crossing, traffic_of

from siren_ros.simulation.traffic.sumo.yellow import HEEDS_LIGHTS, DriversAtYellow, goes_at_yellow
from siren_ros.simulation.world.actors import Owner


@pytest.mark.parametrize(
    ("ahead_m", "mps", "goes"),
    [
        (22.0, 9.0, True),  # 9 m to react, 13.3 m to brake from 9 m/s with 3.05 m/s², and 2 m before the line
        (24.5, 9.0, False),
        (41.5, 13.9, True),  # stopping takes 47.6 m, but yellow ends after 41.7 m
        (42.0, 13.9, False),
    ],
)
def test_who_stops_at_yellow_can_do_so_gently(ahead_m: float, mps: float, goes: bool) -> None:
    assert goes_at_yellow(ahead_m, mps, 3.0) is goes


@pytest.mark.parametrize(("ahead_m", "owner", "turns"), [(20.0, 0, 0), (40.0, 0, 0), (20.0, 1, 0), (20.0, 0, 1)])
def test_who_goes_at_yellow_heeds_lights_again_once_it_is_red(
    monkeypatch: pytest.MonkeyPatch, ahead_m: float, owner: int, turns: int
) -> None:
    network = crossing()
    network = replace(network, connections=tuple(replace(way, yellow_s=3.0) for way in network.connections))
    way, modes, seen = network.connections[STRAIGHT], {"car": 27}, []
    monkeypatch.setattr(libsumo.vehicle, "getSpeedMode", modes.__getitem__)
    monkeypatch.setattr(libsumo.vehicle, "setSpeedMode", modes.__setitem__)
    drivers = DriversAtYellow(network)
    edges = [
        network.lanes[lane].edge for lane in (way.from_lane, network.connections[-1].to_lane if turns else way.to_lane)
    ]
    columns = {
        "actor_id": np.array([7], np.uint32),
        "owner": np.array([[Owner.SUMO, Owner.ROS][owner]], np.uint8),
        "lane": np.array([way.from_lane], np.int32),
        "lane_position_m": np.array([network.lanes[way.from_lane].length_m - ahead_m]),
        "sumo_speed_mps": np.array([9.0]),
        "route_offset": np.array([0, 2], np.int32),
        "route_edges": np.array(edges, np.int32),
    }
    vehicles = {7: SimpleNamespace(name="car")}
    for letter in "Ggyyrr":
        last = replace(traffic_of(0, letter * len(network.connections)), **columns)
        drivers.apply(last, vehicles)
        seen.append(modes["car"] & HEEDS_LIGHTS)
    goes = (ahead_m, owner, turns) == (20.0, 0, 0)
    assert seen == [16, 16, *([0, 0] if goes else [16, 16]), 16, 16]
    assert modes == {"car": 27}
