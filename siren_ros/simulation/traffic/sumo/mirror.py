"""Moves SUMO's vehicles to their poses in the simulated world, and hands them back without a jump.

The lane of a vehicle on its route is found from its pose alone.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import libsumo
import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Codes, Flags, Floats, Ids, Rows
from siren_ros.base.numerics.compiled import compiled, within, wrapped_rad
from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import EpisodeError
from siren_ros.simulation.roads.road_network import NO_LANE, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.scenario.driver_parameters import TrafficDrivers
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle
from siren_ros.simulation.traffic.sumo.population import SumoPopulation, route_id
from siren_ros.simulation.traffic.sumo.readings import SumoColumns, sumo_from_map
from siren_ros.simulation.world.actors import ActorClass, ActorStates, Mode, Owner

_DRIVABLE = frozenset({LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL})


@dataclass(frozen=True)
class LaneMatch:
    """The lane on which a point lies, and where on it."""

    lane: int
    """Index into ``RoadNetwork.lanes``; −1 off the route's lanes."""
    position_m: float
    lateral_m: float
    """Distance from the centre line, left positive."""


OFF_ROUTE = LaneMatch(NO_LANE, 0.0, 0.0)
_SIDEWAYS_M: Final = 1.2
"""A point at most this far outside a lane's edge still belongs to it."""
_JUNCTION_SIDEWAYS_M: Final = 5.0
"""The same distance on junctions, where the space between the paths is road, too;"""
_SEAM_M: Final = 1.0
"""Paths on junctions shorter than this only join two pieces of one road. libsumo 1.28 takes a slow vehicle off the road
whose front is on one, and crashes when it looks for the vehicle beside its rear."""
_CLEAR_M: Final = 0.1
"""Distance from such a path at which a front is put instead."""
_BACK_M: Final = 0.5
"""Distance by which a vehicle is put back if SUMO found it on another road at the end of its lane."""
_HEADING_LIMIT_RAD: Final = 1.2
"""Largest angle between a lane and the vehicle's heading at which the lane counts."""
_STAY_M: Final = 0.1
"""Least distance by which a neighbour of the present lane has to be nearer to replace it."""


class _Corridor(NamedTuple):
    """All centre-line segments of some lanes, among which the nearest is searched."""

    segments: npt.NDArray[np.float64]
    """Start's x and y, length, direction's x and y, heading, arc length at the start, and the distance from the centre
    line up to which a point belongs to the lane; shape ``(8, K)``."""
    lanes: npt.NDArray[np.int32]
    """Lane and edge of each segment, shape ``(2, K)``."""


_X, _Y, _LENGTH, _UNIT_X, _UNIT_Y, _HEADING, _ARC, _REACH = range(8)
"""Rows of ``_Corridor.segments``."""
_LANE, _EDGE = range(2)
"""Rows of ``_Corridor.lanes``."""


class LaneMatcher:
    """Matches poses to the lanes of the next edges of a route."""

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        self._corridors: dict[tuple[int, ...], _Corridor] = {}

    def match(self, edges: Sequence[int], front_m: tuple[float, float], yaw_rad: float, present_lane: int) -> LaneMatch:
        """The lane under the middle of a front bumper in the ``map`` frame.

        ``edges`` are the route's next ones, the present one (or the one before the junction) first; ``present_lane`` is
        the lane at the step before, −1 where unknown.
        """
        key = tuple(edges)
        if key not in self._corridors:
            self._corridors[key] = self._corridor(key)
        corridor = self._corridors[key]
        edge = NO_LANE if present_lane == NO_LANE else self._network.lanes[present_lane].edge
        best, along_m, lateral_m = _nearest(corridor, front_m, yaw_rad, edge, present_lane)
        if best < 0:
            return OFF_ROUTE
        return LaneMatch(int(corridor.lanes[_LANE, best]), float(corridor.segments[_ARC, best] + along_m), lateral_m)

    def _corridor(self, edges: tuple[int, ...]) -> _Corridor:
        indices: list[int] = []
        for number, edge in enumerate(edges):
            indices += self._network.edges[edge].lanes
            following = edges[number + 1] if number + 1 < len(edges) else None
            for lane in self._network.edges[edge].lanes:
                for connection in self._network.connections_from.get(lane, ()):
                    if self._network.lanes[connection.to_lane].edge == following:
                        indices += connection.via
        lanes = [self._network.lanes[index] for index in dict.fromkeys(indices)]
        lanes = [lane for lane in lanes if lane.kind in _DRIVABLE]
        counts = [len(lane.centre.points) - 1 for lane in lanes]
        delta = np.concatenate([np.diff(lane.centre.points, axis=0) for lane in lanes])
        length = np.hypot(delta[:, 0], delta[:, 1])
        beside_m = _SIDEWAYS_M, _JUNCTION_SIDEWAYS_M
        reach_m = [lane.width_m / 2.0 + beside_m[lane.kind is LaneKind.INTERNAL] for lane in lanes]
        start = np.concatenate([lane.centre.points[:-1] for lane in lanes])
        unit, heading = delta / length[:, None], np.arctan2(delta[:, 1], delta[:, 0])
        arc = np.concatenate([lane.centre.arc_m[:-1] for lane in lanes])
        segments = np.stack((*start.T, length, *unit.T, heading, arc, np.repeat(reach_m, counts)))
        return _Corridor(segments, np.repeat([[lane.index, lane.edge] for lane in lanes], counts, axis=0).T.copy())


@compiled
def _nearest(
    corridor: _Corridor, front_m: tuple[float, float], yaw_rad: float, edge: int, lane: int
) -> tuple[int, float, float]:
    """The segment under a front bumper, −1 where there is none; the place along it and beside it, left positive.

    ``edge`` and ``lane`` are the vehicle's present ones.
    """
    segments, lanes = corridor
    best, best_m, best_along, best_left = -1, np.inf, 0.0, 0.0
    for k in range(segments.shape[1]):
        x, y = front_m[0] - segments[_X, k], front_m[1] - segments[_Y, k]
        unit_x, unit_y = segments[_UNIT_X, k], segments[_UNIT_Y, k]
        along = within(x * unit_x + y * unit_y, 0.0, segments[_LENGTH, k])
        distance = np.hypot(x - along * unit_x, y - along * unit_y)
        if distance > segments[_REACH, k] or abs(wrapped_rad(segments[_HEADING, k] - yaw_rad)) > _HEADING_LIMIT_RAD:
            continue
        if lanes[_EDGE, k] == edge and lanes[_LANE, k] != lane:
            distance += _STAY_M
        if distance < best_m:
            best, best_m, best_along, best_left = k, distance, along, unit_x * y - unit_y * x
    return best, best_along, best_left


# These are no parameters, but codes of SUMO and tolerances of the mirror on which no behaviour depends.
DEFAULT_LANE_CHANGE_MODE: Final = 1621
"""SUMO's default code of lane changes."""
KEEP_LANE_CHANGE_MODE: Final = 1536
"""All reasons for a lane change off; respecting others and alignment within the lane stay on."""
DEFAULT_SPEED_MODE: Final = 31
_MATCH_ON_ROAD: Final = 0
"""``keepRoute`` of moveToXY: exact pose, on a lane that is open to the vehicle; with the lane named the route stays.
With 2 or 3, SUMO takes a vehicle off the road that does not overlap the lane that it finds, as between the paths of a
joint; libsumo 1.28 then crashes where others look for that vehicle beside its rear."""
_MATCH_ON_SHOULDER: Final = 4
"""The same on a lane that is closed to the vehicle. libsumo 1.28 was seen to crash without the 4 when a civilian was
mirrored onto a shoulder, and with the 4 when SUMO matched a vehicle to a pedestrian crossing. EMVs, to which shoulders
are open, are mirrored without it."""
_MATCH_ON_ROUTE: Final = 1
"""The same beside all lanes of the route: SUMO has the vehicle on the nearest of them."""
_LEAST_REALIGNED_M: Final = 1.0
"""Least correction when a vehicle is brought back; less would only correct its angle or its lateral place."""
_STANDING_MPS: Final = 0.05
_EDGES_TO_MATCH: Final = 3
_EDGES_TO_FIND: Final = 10
"""Number of edges that are searched where a vehicle was off its route: SUMO's place on the route has stayed behind."""
_BY_ROS: Final = int(Owner.ROS)
_BINDING_MODES: Final = frozenset({Mode.YIELD_DEFERRED, Mode.YIELD_KEEP_LANE})
"""Phases of a yield in which SUMO drives, but with orders that a normal driver does not have."""
_BINDS: Final = np.array([code in _BINDING_MODES for code in range(256)])
"""Whether each mode code is among them."""

_DRIVEN, _ASTRAY, _BOUND = range(3)
"""Kinds of vehicles that have to be treated."""


@compiled
def _to_treat(
    owners: tuple[Ids, Codes, Codes],
    columns: tuple[Floats, Floats, Floats],
    limits_m: tuple[float, float],
    binds: Flags,
    known: Ids,
) -> tuple[Floats, Rows, Rows, Rows]:
    """Speeds of all vehicles, and the rows of those that have to be treated, of three kinds.

    These are vehicles that ROS drives; those of SUMO that are farther from it than one of ``limits_m``, of standing and
    of other vehicles, allows; and those of SUMO whose mode ``binds`` them or whose ids are ``known``.
    """
    actor_id, owner, mode = owners
    vx_mps, vy_mps, residual_m = columns
    n = len(actor_id)
    speeds_mps, rows, counts = np.empty(n), np.empty((3, n), np.intp), np.zeros(3, np.intp)
    for row in range(n):
        speeds_mps[row] = np.hypot(vx_mps[row], vy_mps[row])
        if owner[row] == _BY_ROS:
            rows[_DRIVEN, counts[_DRIVEN]] = row
            counts[_DRIVEN] += 1
            continue
        if residual_m[row] > (limits_m[0] if speeds_mps[row] < _STANDING_MPS else limits_m[1]):
            rows[_ASTRAY, counts[_ASTRAY]] = row
            counts[_ASTRAY] += 1
        treated = binds[mode[row]]
        for k in range(len(known)):
            treated = treated or known[k] == actor_id[row]
        if treated:
            rows[_BOUND, counts[_BOUND]] = row
            counts[_BOUND] += 1
    return (
        speeds_mps,
        rows[_DRIVEN, : counts[_DRIVEN]],
        rows[_ASTRAY, : counts[_ASTRAY]],
        rows[_BOUND, : counts[_BOUND]],
    )


@dataclass(frozen=True)
class Place:
    """Where a mirrored vehicle was put in SUMO at this step, in SUMO's frame."""

    x_m: float
    y_m: float
    """y of the front bumper in SUMO's frame."""
    angle_deg: float
    match: LaneMatch


def _comes_up(front: tuple[float, float], place: Place) -> bool:
    """Whether a front is behind that at a place, in the direction of the latter."""
    sin, cos = math.sin(math.radians(place.angle_deg)), math.cos(math.radians(place.angle_deg))
    return sin * (front[0] - place.x_m) + cos * (front[1] - place.y_m) < 0.0


_STILL_M: Final = 0.01
"""A mirrored pose that moved less than this is held, because SUMO may snap to another lane on creeping back."""
_PLACED_M: Final = 0.05
"""A mirrored actor has to stand within this of where it was put."""
_REALIGN_M: Final = 1.5
"""A simulated vehicle farther than this from its pose in SUMO cannot follow: SUMO's is brought back to it."""
_REALIGN_STANDING_M: Final = 0.4
"""The same where both stand: the simulated vehicle came to a stop later and will not make up for it."""


class Mirror:
    """Moves vehicles in SUMO to their simulated poses, and restores what SUMO needs when they are handed back."""

    def __init__(self, network: RoadNetwork, population: SumoPopulation, drivers: TrafficDrivers) -> None:
        self._network = network
        self._population, self._drivers = population, drivers
        self._matcher = LaneMatcher(network)
        self.places: dict[str, Place] = {}
        """Vehicles that were put somewhere at this step."""
        self.realigned: dict[int, float] = {}
        """Actors whose vehicle in SUMO was brought back to the simulated one at this step, and how far, in metres."""
        self._bound: dict[str, tuple[int, float]] = {}
        """Mode, and speed factor otherwise, of vehicles that drive differently for a yield."""

    def apply(
        self,
        states: ActorStates,
        vehicles: Mapping[int, PlannedVehicle],
        ids: Mapping[str, int],
        routes: Mapping[str, Sequence[int]],
    ) -> None:
        """Give SUMO the simulated states of the step before, extrapolated by one step.

        ``vehicles`` holds SUMO's vehicles by actor id; states of others (left meanwhile) are passed over. ``ids`` has
        the actor id of each vehicle, ``routes`` the edges ahead of it, the present one first.
        """
        before, self.places = self.places, {}
        known = np.array([ids[name] for name in {*before, *self._bound}], np.uint32)
        owners = states.actor_id, states.owner, states.mode
        limits_m = _REALIGN_STANDING_M, _REALIGN_M
        columns = states.vx_mps, states.vy_mps, states.residual_m
        speeds_mps, moved, lagging, changed = _to_treat(owners, columns, limits_m, _BINDS, known)
        for row in moved.tolist():
            vehicle = vehicles.get(int(states.actor_id[row]))
            if vehicle is not None:
                place = self._place(states, row, vehicle, routes[vehicle.name], before)
                self._put(vehicle, place, float(speeds_mps[row]))
        self.realigned = {}
        for row in lagging.tolist():
            vehicle = vehicles.get(int(states.actor_id[row]))
            if vehicle is not None:
                self._realign(states, row, float(speeds_mps[row]), vehicle, routes[vehicle.name])
        for row in changed.tolist():
            actor_id = int(states.actor_id[row])
            if actor_id in vehicles:
                name, speed_mps = vehicles[actor_id].name, float(speeds_mps[row])
                if name in before and name not in self.places:
                    if self._astray(name, before[name].match):
                        self._put(vehicles[actor_id], self._back(before[name]), speed_mps)
                    else:
                        self._restore_route(vehicles[actor_id], leaves=True)
                        self._hand_back(name, before[name].match.lane, speed_mps)
                self._bind(name, int(states.mode[row]))

    def deferred(self) -> set[str]:
        """Names of vehicles of SUMO that will leave the EMV's lane as soon as they can."""
        return {name for name, (mode, _) in self._bound.items() if mode == Mode.YIELD_DEFERRED}

    def forget(self, name: str) -> None:
        """Removes a vehicle that has left SUMO."""
        self.places.pop(name, None)
        self._bound.pop(name, None)

    def check_placed(self, columns: SumoColumns) -> None:
        """Verify, after SUMO's step, that every mirrored vehicle stands where it was put.

        Raises:
            EpisodeError: SUMO moved one elsewhere; names it and the distance.
        """
        for name, place in self.places.items():
            x, y = columns.numbers[:2, columns.row_of[name]].tolist()
            miss = math.hypot(x - place.x_m, y - place.y_m)
            if miss > _PLACED_M:
                lane = libsumo.vehicle.getLaneID(name)
                raise EpisodeError(f"SUMO put {name} {miss:.2f} m off the pose that it was given (lane {lane!r})")

    def _realign(
        self, states: ActorStates, row: int, speed_mps: float, vehicle: PlannedVehicle, route: Sequence[int]
    ) -> None:
        """Bring a vehicle of SUMO back to the simulated one that cannot follow it, where this is on its route.

        SUMO's vehicle gets the place along its lane, not the pose: SUMO might find an exact pose off the lane's course
        on the lane of the other direction. One that drives up from behind is left alone: at a kink of the lane it would
        be brought to the same place again and again.
        """
        far = states.residual_m[row] > _REALIGN_M
        drives = libsumo.vehicle.getSpeed(vehicle.name) > _STANDING_MPS
        if drives and not far:
            return
        place = self._place(states, row, vehicle, route, {})
        if drives and _comes_up(libsumo.vehicle.getPosition(vehicle.name), place):
            return
        match = place.match
        # SUMO places vehicles on lanes of cars, which lie next to the cycle lane.
        if vehicle.actor_class is ActorClass.BICYCLE:
            match = self._match_in(libsumo.vehicle.getLaneID(vehicle.name), place)
        if match.lane == NO_LANE:
            return
        lane = self._network.lanes[match.lane]
        least_m = _LEAST_REALIGNED_M if far else _REALIGN_STANDING_M
        is_open = lane.civilian_allowed or lane.kind is LaneKind.CYCLE
        if is_open and self._ahead_by_m(vehicle.name, lane, match.position_m) > least_m:
            at_m = min(match.position_m, lane.length_m) * self._population.length_scale[lane.lane_id]
            libsumo.vehicle.moveTo(vehicle.name, lane.lane_id, at_m)
            self._set_speed(vehicle.name, match.lane, speed_mps)
            self.realigned[int(states.actor_id[row])] = float(states.residual_m[row])

    def _match_in(self, lane_id: str, place: Place) -> LaneMatch:
        """A place on a lane, by SUMO's id, even where the vehicle stands beside it."""
        lane, (offset_x, offset_y) = self._network.lane_by_id.get(lane_id), self._network.sumo_offset_m
        if lane is None:
            return place.match
        along_m, left_m = lane.centre.project((place.x_m - offset_x, place.y_m - offset_y))
        return LaneMatch(lane.index, float(np.clip(along_m, 0.0, lane.length_m)), float(left_m))

    def _ahead_by_m(self, name: str, lane: Lane, position_m: float) -> float:
        """Distance of a vehicle's front in SUMO from a place on a lane: what bringing it back there would change."""
        x, y = libsumo.vehicle.getPosition(name)
        place = lane.centre.at(min(position_m, lane.length_m))
        offset_x, offset_y = self._network.sumo_offset_m
        return float(np.hypot(x - offset_x - place[0], y - offset_y - place[1]))

    def _place(
        self,
        states: ActorStates,
        row: int,
        vehicle: PlannedVehicle,
        route: Sequence[int],
        places: Mapping[str, Place],
    ) -> Place:
        """Where a vehicle is one step after its state; ``places`` holds those of the step before."""
        before = places.get(vehicle.name)
        offset = self._network.sumo_offset_m
        yaw = float(states.yaw_rad[row])
        x, y, angle = sumo_from_map(
            float(states.x_m[row]) + float(states.vx_mps[row]) * STEP_S,
            float(states.y_m[row]) + float(states.vy_mps[row]) * STEP_S,
            yaw + float(states.yaw_rate_radps[row]) * STEP_S,
            vehicle.length_m,
            offset,
        )
        if before is not None and math.hypot(x - before.x_m, y - before.y_m) < _STILL_M:
            return before
        lane = before.match.lane if before is not None else NO_LANE
        edges = route[:_EDGES_TO_MATCH]
        match = self._matcher.match(edges, (x - offset[0], y - offset[1]), yaw, lane)
        if match.lane == NO_LANE:
            edges = route[:_EDGES_TO_FIND]
            match = self._matcher.match(edges, (x - offset[0], y - offset[1]), yaw, lane)
        if (aside_m := self._off_seam_m(match)) != 0.0:
            x, y = x + aside_m * math.cos(yaw), y + aside_m * math.sin(yaw)
            match = self._matcher.match(edges, (x - offset[0], y - offset[1]), yaw, lane)
        return Place(x, y, angle, match)

    def _off_seam_m(self, match: LaneMatch) -> float:
        """The shorter way, forwards or backwards, off a path that only joins two pieces of a road; 0 off such paths."""
        if match.lane == NO_LANE:
            return 0.0
        lane = self._network.lanes[match.lane]
        if lane.kind is LaneKind.INTERNAL:
            seam_m, into_m = lane.length_m, match.position_m
        else:
            ways = self._network.connections_from.get(match.lane, ())
            seams = [self._network.lanes[index].length_m for way in ways for index in way.via[:1]]
            seam_m, into_m = min(seams, default=math.inf), match.position_m - lane.length_m
        if seam_m >= _SEAM_M or into_m <= -_CLEAR_M:
            return 0.0
        return seam_m + _CLEAR_M - into_m if into_m > 0.5 * seam_m else -_CLEAR_M - into_m

    def _restore_route(self, vehicle: PlannedVehicle, *, leaves: bool = False) -> None:
        """Gives a vehicle its planned route again, where SUMO changed it to match the vehicle's lane.

        Of a vehicle that ``leaves`` the mirror also where SUMO may find a later visit of its edge: the other route may
        end where it is, or lead back.
        """
        planned = route_id(vehicle.name)
        if libsumo.vehicle.getRouteID(vehicle.name) == planned:
            return
        # A vehicle that visits an edge twice may be found by SUMO at its later visit.
        once = len(frozenset(vehicle.route)) == len(vehicle.route)
        if (once or leaves) and libsumo.vehicle.getRoadID(vehicle.name) in vehicle.route:
            with suppress(libsumo.TraCIException):  # SUMO has assigned the vehicle to an edge outside the planned route
                libsumo.vehicle.setRouteID(vehicle.name, planned)

    def _move(self, vehicle: PlannedVehicle, place: Place) -> None:
        name = vehicle.name
        if place.match.lane == NO_LANE:
            libsumo.vehicle.moveToXY(name, "", -1, place.x_m, place.y_m, place.angle_deg, _MATCH_ON_ROUTE)
            return
        lane = self._network.lanes[place.match.lane]
        edge_id = self._network.edges[lane.edge].edge_id
        is_open = lane.civilian_allowed or (vehicle.is_emv and lane.emergency_allowed)
        keep = _MATCH_ON_ROAD if is_open else _MATCH_ON_SHOULDER
        libsumo.vehicle.moveToXY(name, edge_id, lane.position, place.x_m, place.y_m, place.angle_deg, keep)

    def _put(self, vehicle: PlannedVehicle, place: Place, speed_mps: float) -> None:
        """Put a vehicle at a place, on its planned route; remembered for ``check_placed`` and the hand-back."""
        # SUMO derives a moved vehicle's speed from its positions on lanes, which differ from lane to lane.
        self._set_speed(vehicle.name, place.match.lane, speed_mps)
        self._restore_route(vehicle)
        self._move(vehicle, place)
        self.places[vehicle.name] = place

    def _set_speed(self, name: str, lane: int, speed_mps: float) -> None:
        """Tell SUMO the vehicle's speed, along the nominal length of its lane."""
        libsumo.vehicle.setPreviousSpeed(name, speed_mps * self._population.scale_of(lane))

    def _astray(self, name: str, match: LaneMatch) -> bool:
        """Whether SUMO found a vehicle on another road than that of its lane, and would drive it on from there.

        At the very end of a lane SUMO may find the end of a way across the junction that leads to the opposite lane.
        Off the lanes, and at their very beginning, nothing can be told.
        """
        if match.position_m <= 0.0 or self._network.lanes[match.lane].kind is LaneKind.INTERNAL:
            return False
        edge_id = self._network.edges[self._network.lanes[match.lane].edge].edge_id
        return bool(libsumo.vehicle.getRoute(name)[libsumo.vehicle.getRouteIndex(name)] != edge_id)

    @staticmethod
    def _back(place: Place) -> Place:
        """A place slightly farther back along its heading, where its lane is certain."""
        angle_rad, match = math.radians(place.angle_deg), place.match
        x, y = place.x_m - _BACK_M * math.sin(angle_rad), place.y_m - _BACK_M * math.cos(angle_rad)
        return Place(x, y, place.angle_deg, replace(match, position_m=max(match.position_m - _BACK_M, 0.0)))

    def _hand_back(self, name: str, lane: int, speed_mps: float) -> None:
        self._set_speed(name, lane, speed_mps)
        libsumo.vehicle.setSpeed(name, -1.0)
        libsumo.vehicle.setSpeedMode(name, DEFAULT_SPEED_MODE)
        libsumo.vehicle.setLateralAlignment(name, "center")
        libsumo.vehicle.setLaneChangeMode(name, DEFAULT_LANE_CHANGE_MODE)

    def _bind(self, name: str, mode: int) -> None:
        """Gives a vehicle that SUMO drives the orders of its phase of a yield, and removes them afterwards."""
        bound_mode, factor = self._bound.get(name, (None, None))
        if mode in _BINDING_MODES:
            if bound_mode == mode:
                return
            factor = float(libsumo.vehicle.getSpeedFactor(name)) if factor is None else factor
            keeps = mode == Mode.YIELD_KEEP_LANE
            cleared, waiting = self._drivers.cleared_pace * factor, self._drivers.waiting_pace
            self._bound[name] = (mode, factor)
            libsumo.vehicle.setSpeedFactor(name, cleared if keeps else max(factor, waiting))
            libsumo.vehicle.setLaneChangeMode(name, KEEP_LANE_CHANGE_MODE if keeps else DEFAULT_LANE_CHANGE_MODE)
        elif factor is not None:
            del self._bound[name]
            libsumo.vehicle.setSpeedFactor(name, factor)
            libsumo.vehicle.setLaneChangeMode(name, DEFAULT_LANE_CHANGE_MODE)
