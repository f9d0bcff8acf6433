"""What SUMO reports at one step: poses by subscription as arrays, and its advice on lane changes and reactions.

Poses are converted between the ``map`` frame (footprint centre, yaw) and SUMO (front bumper, navigational angle).
"""

from collections.abc import Collection, Mapping, Sequence
from itertools import accumulate, chain
from operator import itemgetter
from typing import Any, Final, NamedTuple, TypeAlias

import libsumo
import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Codes, Flags, Floats, Ids, Rows
from siren_ros.base.numerics.compiled import YAW, compiled, wrapped_rad
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.simulation.world.actors import NO_ACTOR, EmvAdvice, Lights, TrafficFlags

Offset = tuple[float, float]
"""The net's ``netOffset``: ``map = sumo − offset``."""


@compiled
def sumo_from_map(
    x_m: float, y_m: float, yaw_rad: float, length_m: float, offset_m: Offset
) -> tuple[float, float, float]:
    """Front bumper's x and y in SUMO's frame and SUMO's angle in degrees (0–360) of a centre pose."""
    half = length_m / 2.0
    x = x_m + half * np.cos(yaw_rad) + offset_m[0]
    y = y_m + half * np.sin(yaw_rad) + offset_m[1]
    return x, y, (90.0 - np.degrees(yaw_rad)) % 360.0


@compiled
def map_from_sumo(
    x_m: float, y_m: float, angle_deg: float, length_m: float, offset_m: Offset
) -> tuple[float, float, float]:
    """Footprint centre's x and y and the yaw in (−π, π] in the ``map`` frame of one of SUMO's poses."""
    yaw = wrapped_rad(np.radians(90.0 - angle_deg))
    half = length_m / 2.0
    return x_m - half * np.cos(yaw) - offset_m[0], y_m - half * np.sin(yaw) - offset_m[1], yaw


SUBSCRIBED: Final = (
    libsumo.VAR_POSITION,
    libsumo.VAR_ANGLE,
    libsumo.VAR_SPEED,
    libsumo.VAR_ACCELERATION,
    libsumo.VAR_LANEPOSITION,
    libsumo.VAR_LANEPOSITION_LAT,
    libsumo.VAR_SIGNALS,
    libsumo.VAR_ROUTE_INDEX,
    libsumo.VAR_LANE_ID,
)
"""Variables for which every vehicle is subscribed."""
_IN_ORDER: Final = itemgetter(*SUBSCRIBED)
X, Y, ANGLE, SPEED, ACCEL, ALONG, ASIDE, SIGNALS, ROUTE_INDEX = range(9)
"""Rows of ``SumoColumns.numbers``."""
Results: TypeAlias = Mapping[str, Mapping[int, Any]]
"""SUMO's subscription results by vehicle."""


_OFF_ROAD: Final = (float(NO_LANE), 1.0)


class SumoColumns:
    """SUMO's subscription results of one step as columns; the vehicles are in SUMO's order."""

    def __init__(self, network: RoadNetwork, length_scale: Mapping[str, float]) -> None:
        """Takes the ratio of SUMO's length of each lane to that of its centre line (``length_scale``)."""
        self._lanes = {key: (float(lane.index), length_scale.get(key, 1.0)) for key, lane in network.lane_by_id.items()}
        self._results: Results = {}
        self.names: list[str] = []
        """Another list where the vehicles have changed."""
        self.row_of: Mapping[str, int] = {}
        self.lane_ids: tuple[str, ...] = ()
        """Another tuple where a vehicle has come to another lane."""
        self.lane = np.empty(0, np.int32)
        """Index of each lane; −1 off the road."""
        self.scale = np.empty(0)
        """Of each vehicle's lane; 1 off the road."""
        self.route_index: tuple[int, ...] = ()
        """Another tuple where a vehicle has come to another edge of its route."""
        self.numbers = np.empty((9, 0))
        """Front bumper's x and y, angle, speed, acceleration, place along and beside the lane, signals, route index."""
        self._nobody = np.empty(0, np.bool_)

    def take(self, results: Results) -> None:
        """Reads the results of a step."""
        self._results = results
        if list(results) != self.names:
            self.names = list(results)
            self.row_of = {name: row for row, name in enumerate(self.names)}
            self._nobody = np.zeros(len(self.names), np.bool_)
        columns = zip(*map(_IN_ORDER, results.values()), strict=True) if results else ((),) * len(SUBSCRIBED)
        points, *numbers, lane_ids = columns
        if numbers[-1] != self.route_index:
            self.route_index = numbers[-1]
        if lane_ids != self.lane_ids:
            self.lane_ids = lane_ids
            lanes = np.array([self._lanes.get(key, _OFF_ROAD) for key in lane_ids]).reshape(-1, 2)
            self.lane, self.scale = lanes[:, 0].astype(np.int32), lanes[:, 1].copy()
        values = chain(*(zip(*points, strict=True) if points else ((), ())), *numbers)
        self.numbers = np.fromiter(values, np.float64, 9 * len(lane_ids)).reshape(9, -1)

    def leave_out(self, names: Collection[str]) -> None:
        """Removes vehicles that are not in SUMO any more."""
        if not self.row_of.keys().isdisjoint(names):
            self.take({name: result for name, result in self._results.items() if name not in names})

    def which(self, names: Collection[str]) -> Flags:
        """The rows of some vehicles, as flags; vehicles without a row are passed over."""
        if not names:
            return self._nobody
        flags = self._nobody.copy()
        flags[[self.row_of[name] for name in names if name in self.row_of]] = True
        return flags


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
"""For each value of these bits, the project's code of lights; hazard lights are both indicators."""


class Readings(NamedTuple):
    """Arrays over the vehicles, shape ``(N,)``, in the order asked for; poses are centres in the ``map`` frame."""

    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    speed_mps: Floats
    accel_mps2: Floats
    lane_position_m: Floats
    lateral_m: Floats
    lane: npt.NDArray[np.int32]
    lights: npt.NDArray[np.uint8]
    route_index: npt.NDArray[np.int32]


def read_vehicles(columns: SumoColumns, rows: Rows, lengths_m: Floats, offset_m: Offset) -> Readings:
    """The present step's readings of the vehicles in some rows.

    SUMO moves along nominal lane lengths; positions, speeds and accelerations are converted to the
    lanes' geometric lengths, so that speed is the derivative of position.
    """
    lanes = columns.lane, columns.scale
    values, lane, lights, index = _readings(columns.numbers, *lanes, rows, lengths_m, offset_m, _LIGHTS)
    return Readings._make((*values, lane, lights, index))


_SPEED, _ACCEL, _ALONG, _ASIDE = range(3, 7)
"""Rows of what ``_readings`` gives, after ``X``, ``Y`` and ``YAW``."""


@compiled
def _readings(
    numbers: Floats,
    lane: npt.NDArray[np.int32],
    scale: Floats,
    rows: Rows,
    lengths_m: Floats,
    offset_m: Offset,
    codes: Codes,
) -> tuple[Floats, npt.NDArray[np.int32], Codes, npt.NDArray[np.int32]]:
    """Values of ``Readings``, shape ``(7, N)``, lanes, lights (``codes`` by SUMO's bits), and places on the route."""
    n = len(rows)
    out, lanes = np.empty((7, n)), np.empty(n, np.int32)
    lights, indices = np.empty(n, np.uint8), np.empty(n, np.int32)
    for k in range(n):
        row = rows[k]
        front = numbers[X, row], numbers[Y, row], numbers[ANGLE, row]
        out[X, k], out[Y, k], out[YAW, k] = map_from_sumo(*front, lengths_m[k], offset_m)
        out[_SPEED, k], out[_ACCEL, k] = numbers[SPEED, row] / scale[row], numbers[ACCEL, row] / scale[row]
        lanes[k], out[_ALONG, k], out[_ASIDE, k] = lane[row], 0.0, 0.0
        if lane[row] != NO_LANE:
            out[_ALONG, k], out[_ASIDE, k] = numbers[ALONG, row] / scale[row], numbers[ASIDE, row]
        lights[k] = codes[int(numbers[SIGNALS, row]) & (_SIGNALS - 1)]
        indices[k] = int(numbers[ROUTE_INDEX, row])
    return out, lanes, lights, indices


@compiled
def simulated(
    ids: Ids, poses: tuple[Floats, Floats, Floats, Floats], known: Ids, known_owner: Codes, motion: tuple[Floats, ...]
) -> tuple[Floats, Codes]:
    """x, y, yaw and speed of the simulated vehicles, SUMO's ``poses`` of others, shape ``(4, N)``; and owners.

    ``known`` are the ids of simulated vehicles; both kinds of ids are sorted.
    """
    x_m, y_m, yaw_rad, vx_mps, vy_mps = motion
    values, owner, k = np.empty((4, len(ids))), np.zeros(len(ids), np.uint8), 0
    for row in range(len(ids)):
        while k < len(known) and known[k] < ids[row]:
            k += 1
        if k < len(known) and known[k] == ids[row]:
            values[X, row], values[Y, row], values[YAW, row] = x_m[k], y_m[k], yaw_rad[k]
            values[_SPEED, row], owner[row] = np.hypot(vx_mps[k], vy_mps[k]), known_owner[k]
        else:
            for column in range(4):
                values[column, row] = poses[column][row]
    return values, owner


def joined_rows(routes: Sequence[Sequence[int]]) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Lists of different lengths as one array of offsets ``(N + 1,)`` and one of all values."""
    offsets = np.array([0, *accumulate(map(len, routes))], dtype=np.int32)
    return offsets, np.array([edge for route in routes for edge in route], dtype=np.int32)


_LEFT, _RIGHT = 1 << 1, 1 << 2
_REASONS = (1 << 3) | (1 << 4) | (1 << 5) | (1 << 6)
"""SUMO's LCA_STRATEGIC, LCA_COOPERATIVE, LCA_SPEEDGAIN, LCA_KEEPRIGHT (https://sumo.dlr.de/docs/TraCI: lane change
state); a wish without one of these is alignment within the lane."""
_HELD_UP = (1 << 5) | (1 << 6)
"""The wishes among these that a vehicle ahead causes: to gain speed, and to keep right where there is none."""
HELD_UP_M: Final = 40.0
"""Distance beyond which a vehicle ahead holds nobody up: 3 s at the paper's 50 km/h."""
_UNKNOWN = 1 << 30
_SIDES: Final = ((1, _LEFT), (-1, _RIGHT))
_INTENTS: Final = {0: TrafficFlags.NONE, 1: TrafficFlags.WANTS_LEFT, -1: TrafficFlags.WANTS_RIGHT}


def lane_change_intent(name: str, reasons: int = _REASONS) -> int:
    """+1 where SUMO's lane-change model wants the vehicle one lane to the left, −1 right, 0 neither."""
    for side, bit in _SIDES:
        wish, _ = libsumo.vehicle.getLaneChangeState(name, side)
        if wish & bit and wish & reasons and not wish & _UNKNOWN:
            return side
    return 0


def intent_flags(name: str) -> TrafficFlags:
    """The intent as flags."""
    return _INTENTS[lane_change_intent(name)]


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


@compiled
def ahead_on_route(
    emv: int,
    poses: tuple[Floats, Floats, Floats],
    route_offset: npt.NDArray[np.int32],
    route_edges: npt.NDArray[np.int32],
    reach_m: float,
) -> Rows:
    """Rows of vehicles that hear the EMV in a row come from behind: on its route's edges, ahead of it, within reach.

    The same criterion as that of SUMO's bluelight device: vehicles on the EMV's upcoming edges within
    ``reactiondist``. ``poses`` are the centres' x and y and the
    yaws of all vehicles; routes are as in ``joined_rows``. Inside a junction the edge before it counts, also as the
    first one of a route.
    """
    x_m, y_m, yaw_rad = poses
    cos, sin = np.cos(yaw_rad[emv]), np.sin(yaw_rad[emv])
    rows, count = np.empty(len(x_m), np.intp), 0
    begin, end = route_offset[emv], route_offset[emv + 1]
    for row in range(len(x_m)):
        dx, dy = x_m[row] - x_m[emv], y_m[row] - y_m[emv]
        if route_offset[row] == route_offset[row + 1] or np.hypot(dx, dy) > reach_m:
            continue
        edge = route_edges[route_offset[row]]
        for k in range(begin, end):
            if edge == route_edges[k] and (edge != route_edges[begin] or dx * cos + dy * sin > 0.0):
                rows[count] = row
                count += 1
                break
    return rows[:count]
