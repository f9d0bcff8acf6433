"""SUMO's subscription results as arrays: along the lanes' geometric lengths, in our frame, with our light codes."""

from collections.abc import Mapping
from typing import Any

import libsumo
import numpy as np
import pytest
from made_streets import A_LEFT, NEAR, streets

from siren_ros.roads.road_network import NO_LANE
from siren_ros.traffic.sumo.readings import joined_rows, lights_of, read_vehicles
from siren_ros.world.actors import Lights

NETWORK = streets()
LEFT, RIGHT, BRAKE = Lights.INDICATOR_LEFT, Lights.INDICATOR_RIGHT, Lights.BRAKE


@pytest.mark.parametrize(
    ("bits", "lights"),
    [(0, 0), (1, RIGHT), (2, LEFT), (4, LEFT | RIGHT), (8, BRAKE), (9, BRAKE | RIGHT), (10, BRAKE | LEFT), (16, 0)],
)
def test_sumos_signals_are_our_lights(bits: int, lights: int) -> None:
    """Bits of SUMO: 0 right, 1 left, 2 hazard, 3 brake; higher ones have no light of ours."""
    assert lights_of(np.array([bits, 0])).tolist() == [lights, 0]


def result(lane_id: str, angle_deg: float) -> Mapping[int, Any]:
    return {
        libsumo.VAR_POSITION: (100.0, 50.0),
        libsumo.VAR_ANGLE: angle_deg,
        libsumo.VAR_SPEED: 12.0,
        libsumo.VAR_ACCELERATION: -3.0,
        libsumo.VAR_LANE_ID: lane_id,
        libsumo.VAR_LANEPOSITION: 30.0,
        libsumo.VAR_LANEPOSITION_LAT: -0.4,
        libsumo.VAR_SIGNALS: 8,
        libsumo.VAR_ROUTE_INDEX: 2,
    }


def test_motion_is_along_the_geometric_length_of_the_lane() -> None:
    """SUMO's first lane is twice as long as its centre line; the other vehicle is off the road."""
    lane_id = NETWORK.lanes[A_LEFT].lane_id
    results = {"on": result(lane_id, 90.0), "off": result("", 0.0)}
    scale = {lane_id: 2.0, NETWORK.lanes[NEAR].lane_id: 7.0}
    found = read_vehicles(results, ["off", "on"], np.array([4.0, 6.0]), NETWORK, scale)
    assert found.lane.tolist() == [NO_LANE, A_LEFT]
    assert found.speed_mps.tolist() == [12.0, 6.0]
    assert found.accel_mps2.tolist() == [-3.0, -1.5]
    assert found.lane_position_m.tolist() == [0.0, 15.0]
    assert found.lateral_m.tolist() == [0.0, -0.4]
    assert found.lights.tolist() == [BRAKE, BRAKE]
    assert found.route_index.tolist() == [2, 2]
    assert found.x_m == pytest.approx([100.0, 97.0])
    assert found.y_m == pytest.approx([48.0, 50.0])
    assert found.yaw_rad == pytest.approx([np.pi / 2.0, 0.0])


def test_lists_of_different_lengths_become_one() -> None:
    offsets, values = joined_rows([[1, 2], [], [3]])
    assert (offsets.tolist(), values.tolist()) == ([0, 2, 2, 3], [1, 2, 3])
    assert joined_rows([])[0].tolist() == [0]
