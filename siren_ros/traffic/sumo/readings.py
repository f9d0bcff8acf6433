"""What SUMO reports at one step: poses by subscription as arrays, and its advice on lane changes and reactions.

Poses are converted between the ``map`` frame (footprint centre, yaw) and SUMO (front bumper, navigational angle).
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from operator import itemgetter
from typing import Any, Final

import libsumo
import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.geometry import wrap_angle
from siren_ros.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.world.actors import NO_ACTOR, Lights
from siren_ros.world.traffic_state import EmvAdvice, TrafficFlags

Offset = tuple[float, float]
"""The net's ``netOffset``: ``map = sumo − offset``."""


def sumo_from_map(
    x_m: npt.ArrayLike, y_m: npt.ArrayLike, yaw_rad: npt.ArrayLike, length_m: npt.ArrayLike, offset_m: Offset
) -> tuple[Floats, Floats, Floats]:
    """Front bumper's x and y in SUMO's frame and SUMO's angle in degrees (0–360) of centre poses."""
    yaw = np.asarray(yaw_rad, dtype=np.float64)
    half = np.asarray(length_m, dtype=np.float64) / 2.0
    x = np.asarray(x_m, dtype=np.float64) + half * np.cos(yaw) + offset_m[0]
    y = np.asarray(y_m, dtype=np.float64) + half * np.sin(yaw) + offset_m[1]
    return x, y, np.mod(90.0 - np.degrees(yaw), 360.0)


def map_from_sumo(
    x_m: npt.ArrayLike, y_m: npt.ArrayLike, angle_deg: npt.ArrayLike, length_m: npt.ArrayLike, offset_m: Offset
) -> tuple[Floats, Floats, Floats]:
    """Footprint centre's x and y and the yaw in (−π, π] in the ``map`` frame of SUMO's poses."""
    yaw = wrap_angle(np.radians(90.0 - np.asarray(angle_deg, dtype=np.float64)))
    half = np.asarray(length_m, dtype=np.float64) / 2.0
    x = np.asarray(x_m, dtype=np.float64) - half * np.cos(yaw) - offset_m[0]
    y = np.asarray(y_m, dtype=np.float64) - half * np.sin(yaw) - offset_m[1]
    return x, y, yaw


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
_IN_ORDER: Final = itemgetter(*SUBSCRIBED)
_NONE: Final = ((),) * len(SUBSCRIBED)

_BLINK_RIGHT, _BLINK_LEFT, _HAZARD, _BRAKE = 1, 2, 4, 8
"""SUMO's vehicle signals, bits 0–3 (https://sumo.dlr.de/docs/TraCI/Vehicle_Signalling.html)."""
_SIGNALS: Final = 16
_LIGHTS: Final = np.array(
    [
        (Lights.BRAKE if bits & _BRAKE else 0)
        | (Lights.INDICATOR_LEFT if bits & (_BLINK_LEFT | _HAZARD) else 0)
        | (Lights.INDICATOR_RIGHT if bits & (_BLINK_RIGHT | _HAZARD) else 0)
        for bits in range(_SIGNALS)
    ],
    dtype=np.uint8,
)
"""Our light codes of these bits."""


@dataclass(frozen=True)
class Readings:
    """Arrays over the vehicles, shape ``(N,)``, in the order asked for; poses are centres in the ``map`` frame."""

    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    speed_mps: Floats
    accel_mps2: Floats
    lane: npt.NDArray[np.int32]
    lane_position_m: Floats
    lateral_m: Floats
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

    ``results`` are SUMO's subscription results by vehicle, ``names`` the subscribed vehicles that are in SUMO, and
    ``length_scale`` is SUMO's length of each lane over that of its centre line.
    """
    columns = zip(*(_IN_ORDER(results[name]) for name in names), strict=True) if names else _NONE
    position, angle, speed, accel, lane_ids, along, left, signals, route_index = columns
    points = np.array(position, dtype=np.float64).reshape(len(names), 2)
    x, y, yaw = map_from_sumo(points[:, 0], points[:, 1], np.array(angle), lengths_m, network.sumo_offset_m)
    indices = [network.lane_by_id[lane_id].index if lane_id in network.lane_by_id else NO_LANE for lane_id in lane_ids]
    lane = np.array(indices, dtype=np.int32)
    scale = np.array([length_scale.get(lane_id, 1.0) for lane_id in lane_ids], dtype=np.float64)
    on_road = lane != NO_LANE
    return Readings(
        x_m=x,
        y_m=y,
        yaw_rad=yaw,
        speed_mps=np.array(speed, dtype=np.float64) / scale,
        accel_mps2=np.array(accel, dtype=np.float64) / scale,
        lane=lane,
        lane_position_m=np.where(on_road, np.array(along, dtype=np.float64) / scale, 0.0),
        lateral_m=np.where(on_road, np.array(left, dtype=np.float64), 0.0),
        lights=lights_of(np.array(signals, dtype=np.int64)),
        route_index=np.array(route_index, dtype=np.int32),
    )


def lights_of(signals: npt.NDArray[np.int64]) -> npt.NDArray[np.uint8]:
    """Our light codes of SUMO's signal bits; hazard lights are both indicators."""
    return _LIGHTS[signals & (_SIGNALS - 1)]


def joined_rows(routes: Sequence[Sequence[int]]) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Lists of different lengths as one array of offsets ``(N + 1,)`` and one of all values."""
    offsets = np.array([0, *accumulate(map(len, routes))], dtype=np.int32)
    return offsets, np.array([edge for route in routes for edge in route], dtype=np.int32)


_LEFT, _RIGHT = 1 << 1, 1 << 2
_REASONS = (1 << 3) | (1 << 4) | (1 << 5) | (1 << 6)
"""SUMO's LCA_STRATEGIC, LCA_COOPERATIVE, LCA_SPEEDGAIN, LCA_KEEPRIGHT (https://sumo.dlr.de/docs/TraCI: lane change
state); a wish without one of these is alignment within the lane."""
_HELD_UP = (1 << 5) | (1 << 6)
"""Of these the wishes that come from the vehicle ahead: to gain speed, and to keep right where there is none."""
HELD_UP_M: Final = 40.0
"""A vehicle further ahead holds nobody up: 3 s at the paper's 50 km/h."""
_UNKNOWN = 1 << 30


def lane_change_intent(name: str, reasons: int = _REASONS) -> int:
    """+1 where SUMO's lane-change model wants the vehicle one lane to the left, −1 right, 0 neither."""
    for side, bit in ((1, _LEFT), (-1, _RIGHT)):
        wish, _ = libsumo.vehicle.getLaneChangeState(name, side)
        if not wish & _UNKNOWN and wish & bit and wish & reasons:
            return side
    return 0


def intent_flags(name: str) -> TrafficFlags:
    """The intent as flags."""
    return (TrafficFlags.WANTS_RIGHT, TrafficFlags.NONE, TrafficFlags.WANTS_LEFT)[lane_change_intent(name) + 1]


def emv_advice(
    name: str,
    ids: Mapping[str, int],
    yielding: Collection[str],
    leader_range_m: float,
    min_gap_m: float,
    rescue_count: int,
) -> EmvAdvice:
    """What SUMO advises one EMV. The leader's gap is from bumper to bumper; SUMO leaves out the minimum gap.

    A wish to gain speed counts while a vehicle ahead holds up the EMV that does not make way. It outlasts its cause in
    SUMO, and SUMO knows nothing of yielding: behind a vehicle that leaves the lane it wants the lane next to it, which
    is the one that the vehicle goes to.

    ``yielding`` holds the names of the vehicles that leave their lanes for an EMV or wait for a gap to do so, ``ids``
    those of all vehicles; ``rescue_count`` vehicles react to the EMV.
    """
    leader = libsumo.vehicle.getLeader(name, leader_range_m)
    follows = leader is not None and leader[0] in ids
    held_up = follows and leader[0] not in yielding and float(leader[1]) < HELD_UP_M
    return EmvAdvice(
        actor_id=ids[name],
        lane_change_intent=lane_change_intent(name, _REASONS if held_up else _REASONS & ~_HELD_UP),
        leader_id=ids[leader[0]] if follows else NO_ACTOR,
        leader_gap_m=float(leader[1]) + min_gap_m if follows else leader_range_m,
        speed_without_control_mps=float(libsumo.vehicle.getSpeedWithoutTraCI(name)),
        rescue_count=rescue_count,
    )


def rescued_names(names: Iterable[str], emv_names: Iterable[str]) -> dict[str, list[str]]:
    """Of SUMO's bluelight device: the vehicles that react to each EMV."""
    reacting: dict[str, list[str]] = {emv: [] for emv in emv_names}
    for name in names:
        for emv in libsumo.vehicle.getParameter(name, "rescueLane").split():
            if emv in reacting:
                reacting[emv].append(name)
    return reacting


def ahead_on_route(
    emv: npt.NDArray[np.float64],
    emv_yaw_rad: float,
    route: Sequence[int],
    points: npt.NDArray[np.float64],
    edges: npt.NDArray[np.int32],
    reach_m: float,
) -> npt.NDArray[np.bool_]:
    """Vehicles that hear an EMV come from behind: on its route's edges, ahead of it and within reach.

    The same criterion as that of SUMO's bluelight device (vehicles on the EMV's upcoming edges within
    ``reactiondist``), for levels at which the device itself must not run. ``emv`` is its centre, ``points`` are the
    centres of all vehicles, shape ``(N, 2)``, and ``edges`` their present edges. Inside a junction the edge before it
    counts, also as the first one of ``route``.
    """
    relative = points - emv
    near = np.hypot(relative[:, 0], relative[:, 1]) <= reach_m
    on_route = (edges[:, np.newaxis] == np.array(route, dtype=np.int32)).any(axis=1)
    same = edges == (route[0] if len(route) else -1)
    forward = relative @ np.array([np.cos(emv_yaw_rad), np.sin(emv_yaw_rad)]) > 0.0
    return near & on_route & (forward | ~same)
