"""What SUMO reports of every vehicle at one step, read by subscription and turned into arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import libsumo
import numpy as np
import numpy.typing as npt

from siren_ros.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.traffic.sumo.sumo_frames import map_from_sumo
from siren_ros.world.actors import Lights

SUBSCRIBED = (
    libsumo.VAR_POSITION,
    libsumo.VAR_ANGLE,
    libsumo.VAR_SPEED,
    libsumo.VAR_ACCELERATION,
    libsumo.VAR_LANE_ID,
    libsumo.VAR_LANEPOSITION,
    libsumo.VAR_LANEPOSITION_LAT,
    libsumo.VAR_SIGNALS,
    libsumo.VAR_ROUTE_INDEX,
)
"""Variables that every vehicle is subscribed for."""

_BLINK_RIGHT, _BLINK_LEFT, _HAZARD, _BRAKE = 1, 2, 4, 8
"""SUMO's vehicle signals, bits 0–3 (https://sumo.dlr.de/docs/TraCI/Vehicle_Signalling.html)."""


@dataclass(frozen=True)
class Readings:
    """Arrays over the vehicles, shape ``(N,)``, in the order asked for; poses are centres in the ``map`` frame."""

    x_m: npt.NDArray[np.float64]
    y_m: npt.NDArray[np.float64]
    yaw_rad: npt.NDArray[np.float64]
    speed_mps: npt.NDArray[np.float64]
    accel_mps2: npt.NDArray[np.float64]
    lane: npt.NDArray[np.int32]
    lane_position_m: npt.NDArray[np.float64]
    lateral_m: npt.NDArray[np.float64]
    lights: npt.NDArray[np.uint8]
    route_index: npt.NDArray[np.int32]


def read_vehicles(
    results: Mapping[str, Mapping[int, Any]],
    names: Sequence[str],
    lengths_m: npt.NDArray[np.float64],
    network: RoadNetwork,
    length_scale: Mapping[str, float],
) -> Readings:
    """The present step's readings.

    SUMO moves along nominal lane lengths; positions, speeds and accelerations are converted to the
    lanes' geometric lengths, so that speed is the derivative of position.

    Args:
        results: SUMO's subscription results by vehicle.
        names: Subscribed vehicles that are in SUMO.
        lengths_m: Their lengths, shape ``(N,)``.
        network: The map.
        length_scale: SUMO's length of each lane over that of its centre line.
    """
    rows = [results[name] for name in names]
    position = np.array([row[libsumo.VAR_POSITION] for row in rows], dtype=np.float64).reshape(len(rows), 2)
    x, y, yaw = map_from_sumo(
        position[:, 0], position[:, 1], _column(rows, libsumo.VAR_ANGLE), lengths_m, network.sumo_offset_m
    )
    lane_ids = [row[libsumo.VAR_LANE_ID] for row in rows]
    lane = [network.lane_by_id[lane_id].index if lane_id in network.lane_by_id else NO_LANE for lane_id in lane_ids]
    scale = np.array([length_scale.get(lane_id, 1.0) for lane_id in lane_ids], dtype=np.float64)
    on_road = np.array(lane, dtype=np.int32) != NO_LANE
    return Readings(
        x_m=x,
        y_m=y,
        yaw_rad=yaw,
        speed_mps=_column(rows, libsumo.VAR_SPEED) / scale,
        accel_mps2=_column(rows, libsumo.VAR_ACCELERATION) / scale,
        lane=np.array(lane, dtype=np.int32),
        lane_position_m=np.where(on_road, _column(rows, libsumo.VAR_LANEPOSITION) / scale, 0.0),
        lateral_m=np.where(on_road, _column(rows, libsumo.VAR_LANEPOSITION_LAT), 0.0),
        lights=lights_of(np.array([row[libsumo.VAR_SIGNALS] for row in rows], dtype=np.int64)),
        route_index=np.array([row[libsumo.VAR_ROUTE_INDEX] for row in rows], dtype=np.int32),
    )


def _column(rows: Sequence[Mapping[int, Any]], variable: int) -> npt.NDArray[np.float64]:
    return np.array([row[variable] for row in rows], dtype=np.float64)


def lights_of(signals: npt.NDArray[np.int64]) -> npt.NDArray[np.uint8]:
    """Our light codes of SUMO's signal bits; hazard lights are both indicators."""
    lights = np.zeros(len(signals), dtype=np.uint8)
    for bits, light in (
        (_BRAKE, Lights.BRAKE),
        (_BLINK_LEFT | _HAZARD, Lights.INDICATOR_LEFT),
        (_BLINK_RIGHT | _HAZARD, Lights.INDICATOR_RIGHT),
    ):
        lights[(signals & bits) != 0] |= np.uint8(light)
    return lights


def joined_rows(routes: Sequence[Sequence[int]]) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Lists of different lengths as one array of offsets ``(N + 1,)`` and one of all values."""
    offsets = np.concatenate(([0], np.cumsum([len(route) for route in routes]))).astype(np.int32)
    values: list[Any] = [edge for route in routes for edge in route]
    return offsets, np.array(values, dtype=np.int32)
