"""Corrections of how SUMO's vehicles move.

* They slow down for bends: SUMO knows a lane's speed limit, not its shape.
* They stay where they are when they change to a lane of another length.
* They move sideways by driving, also where a lane change is urgent.
* Cyclists ride in the middle of a cycle lane, and on the right of wider lanes.
"""

from collections.abc import Collection, Container, Mapping, Sequence
from functools import lru_cache
from itertools import accumulate, pairwise, takewhile
from typing import Final

import libsumo
import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Rows
from siren_ros.base.numerics.braking import (
    SAMPLE_M,
    bend_speeds_mps,
    braking_distance_m,
    speed_before_mps,
    with_braking,
)
from siren_ros.base.numerics.compiled import compiled, within
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.base.numerics.units import STEP_S
from siren_ros.simulation.roads.road_network import MAPS_KEPT, NO_LANE, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle, connections_onward
from siren_ros.simulation.traffic.sumo.readings import ALONG, ASIDE, SPEED, SumoColumns, X, Y
from siren_ros.simulation.world.actors import TWO_WHEELED, ActorClass

# These are no parameters: they make SUMO's motion one that a car can follow, and are calibrated with the vehicle model.
LATERAL_ACCEL_MPS2: Final = 3.0
"""Lateral acceleration of drivers in bends. The 85th percentile of drivers in urban turns is 2.5 to 3 m/s² (AASHTO, A
Policy on Geometric Design, side friction at low speeds); the drivers of the behaviour model have the same limit."""
_RIDERS_SHARE: Final = 0.8
"""Share of these speeds at which riders take bends: a lean of 11 degrees in the lane's middle, of 15 at its outer
edge."""
BRAKING_MPS2: Final = 1.5
"""Deceleration of drivers before a bend (Treiber and Kesting, comfortable deceleration of the IDM in towns)."""
_WISHED, _LENGTH, _SHARE = range(3)
"""Columns of the bodies in ``BendLimits``."""
_FIRST, _SAMPLES = range(2)
"""Columns of its profiles."""
_IN_BEND, _BEFORE_BEND = range(2)
"""Rows of the speeds of profiles."""
_LEAST_REST_M: Final = 1e-3
"""Least distance from a lane's last sample to its end, because the slope of the speed divides by it."""
_PLACE, _BEND_SPEED = range(2)
"""Columns of the table of places that a vehicle has passed."""
_AHEAD_M: Final = 90.0
"""Distance within which a bend ahead counts: 16 m/s come down to walking speed within it."""
_FASTEST: Final = 1.5
"""Greatest wished speed over a lane's limit: a driver's factor of at most 1.25, a template's of at most 1.2."""
_STEP_MPS: Final = 0.05
"""Smallest change of a speed limit that is sent to SUMO."""


class _Rows:
    """The rows in which vehicles stood at the step before."""

    def __init__(self) -> None:
        self._names: list[str] = []
        self._row_of: Mapping[str, int] = {}

    def follow(self, columns: SumoColumns) -> Rows | None:
        """The row that each vehicle had before, −1 for a new one; None where the vehicles are the same."""
        if columns.names is self._names:
            return None
        rows = np.array([self._row_of.get(name, -1) for name in columns.names], dtype=np.intp)
        self._names, self._row_of = columns.names, columns.row_of
        return rows


_NO_PROFILE: Final = range(0)
_MOST_PASSED: Final = 64
"""Most places that are remembered along a vehicle; they are at least a metre apart, or on shorter lanes."""


class _Profiles:
    """The speed profiles of a map's lanes, each computed once."""

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        lanes_of = ((*connection.via, connection.to_lane) for connection in network.connections)
        self._after = dict(pair for lanes in lanes_of for pair in pairwise(lanes))
        """The lane that follows each internal lane."""
        self._of_route: dict[tuple[int, tuple[int, ...]], range] = {}
        self._entries_mps: dict[tuple[int, tuple[int, ...]], float] = {}
        """Speed at which one may come to a lane, given the edges of the route."""
        self._used = 0
        self.speeds_mps = np.empty((2, 0))
        """Of all profiles: that of the bend at a place, and that from which one still slows down for what follows."""

    @staticmethod
    @lru_cache(maxsize=MAPS_KEPT)
    def of_map(network: RoadNetwork) -> "_Profiles":
        """The profiles of a map, including those that other episodes on it have computed."""
        return _Profiles(network)

    def of(self, lane: Lane, edges: tuple[int, ...]) -> range:
        """Which of ``speeds_mps`` are those of a lane, metre by metre, with regard to what follows it on the route."""
        lengths_m = (self._network.lanes[self._network.edges[edge].lanes[0]].length_m for edge in edges[1:])
        starts_m = accumulate(lengths_m, initial=0.0)
        near = edges[: 1 + sum(1 for _ in takewhile(look_ahead_m(lane).__gt__, starts_m))]
        key = (lane.index, near)
        if key not in self._of_route:
            speeds = self._speeds_mps(lane, near)
            first, self._used = self._used, self._used + speeds.shape[1]
            if self._used > self.speeds_mps.shape[1]:
                self.speeds_mps = np.concatenate((self.speeds_mps, np.empty((2, self._used))), axis=1)
            self.speeds_mps[:, first : self._used] = speeds
            self._of_route[key] = range(first, self._used)
        return self._of_route[key]

    def _speeds_mps(self, lane: Lane, edges: tuple[int, ...]) -> Floats:
        """The profile of a lane, as in ``speeds_mps``; the lowest where several lanes of the route may follow."""
        samples, ways = int(lane.length_m / SAMPLE_M) + 1, []
        onward: list[tuple[Lane | None, tuple[int, ...]]] = [*self._onward(lane, edges)]
        for following, left in onward or [(None, ())]:
            parts = [lane.centre] if following is None else [lane.centre, following.centre]
            bend = bend_speeds_mps(Polyline.joined(parts), LATERAL_ACCEL_MPS2)[:samples]
            rest_m = max(lane.length_m - (len(bend) - 1) * SAMPLE_M, _LEAST_REST_M)
            entry_mps = np.inf if following is None else self._entry_mps(following, left)
            last_mps = min(bend[-1], speed_before_mps(entry_mps**2, BRAKING_MPS2, rest_m))
            before = with_braking(np.append(bend[:-1], last_mps), BRAKING_MPS2)
            # Between the last sample and one beyond the lane the speed comes down to that at the lane's end.
            beyond_mps = last_mps + min(entry_mps - last_mps, 0.0) / rest_m * SAMPLE_M
            ways.append((np.append(bend, bend[-1]), np.append(before, beyond_mps)))
        return np.min(ways, axis=0)

    def _entry_mps(self, lane: Lane, edges: tuple[int, ...]) -> float:
        key = (lane.index, edges)
        if key not in self._entries_mps:
            self._entries_mps[key] = float(self._speeds_mps(lane, edges)[_BEFORE_BEND, 0])
        return self._entries_mps[key]

    def _onward(self, lane: Lane, edges: tuple[int, ...]) -> list[tuple[Lane, tuple[int, ...]]]:
        """The lanes that may follow a lane on the route, each with the edges from there on."""
        if lane.index in self._after:
            following = self._network.lanes[self._after[lane.index]]
            return [(following, edges if following.kind is LaneKind.INTERNAL else edges[1:])]
        edges = edges[edges.index(lane.edge) :] if lane.edge in edges else ()
        found = connections_onward(self._network, lane, edges[1]) if len(edges) > 1 else ()
        nexts = (self._network.lanes[(*connection.via, connection.to_lane)[0]] for connection in found)
        return [(other, edges if other.kind is LaneKind.INTERNAL else edges[1:]) for other in nexts]


def look_ahead_m(lane: Lane) -> float:
    """How far beyond a lane's end bends count: at least the stopping distance from the greatest speed on the lane."""
    return max(_AHEAD_M, braking_distance_m((_FASTEST * lane.speed_limit_mps) ** 2, BRAKING_MPS2))


class BendLimits:
    """Sets the greatest speed of SUMO's vehicles, step by step, from the shapes of the lanes ahead."""

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        self._profiles = _Profiles.of_map(network)
        self._routes: dict[str, tuple[int, ...]] = {}
        self._rows = _Rows()
        self._present: list[tuple[str, int]] = []
        """Lane and place on the route of each vehicle, for which its profile holds."""
        self._seen: tuple[tuple[str, ...], tuple[int, ...]] = (), ()
        """The same as it was looked at last..."""
        self._unseen = False
        """...when vehicles that were moved from outside were passed over."""
        self._profile = np.empty((0, 2), np.intp)
        """First place of each vehicle's profile, and number of places."""
        self._passed = np.empty((0, _MOST_PASSED, 2))
        """Places where each front bumper was: distance driven until there, and the speed of the bend."""
        self._passed_count = np.empty(0, np.intp)
        self._bodies = np.empty((0, 3))
        """Wished speed and length of each vehicle, and its share of a bend's speed."""
        self._limits_mps = np.empty(0)

    def apply(self, columns: SumoColumns, vehicles: Mapping[str, PlannedVehicle], outside: Flags) -> None:
        """Sets the limits for SUMO's next step. Vehicles that are moved from outside get none."""
        before = self._rows.follow(columns)
        if before is not None:
            self._follow(before, columns.names, vehicles)
        seen = columns.lane_ids, columns.route_index
        if before is not None or self._unseen or seen[0] is not self._seen[0] or seen[1] is not self._seen[1]:
            self._seen = seen
            self._look_ahead(columns, vehicles, outside)
        now, profiles = (columns.numbers, columns.scale, outside), (self._profile, self._profiles.speeds_mps)
        passed = self._passed, self._passed_count
        for row in _bend_limits(*now, self._bodies, *profiles, *passed, self._limits_mps).tolist():
            libsumo.vehicle.setMaxSpeed(columns.names[row], float(self._limits_mps[row]))

    def _look_ahead(self, columns: SumoColumns, vehicles: Mapping[str, PlannedVehicle], outside: Flags) -> None:
        """Finds the profiles of vehicles that have come to another lane or edge."""
        self._unseen = False
        for row, present in enumerate(zip(columns.lane_ids, columns.route_index, strict=True)):
            if present == self._present[row]:
                continue
            if outside[row]:
                self._unseen = True
                continue
            self._present[row] = present
            name = columns.names[row]
            lane = self._network.lane_by_id.get(present[0])
            edges = self._route_ahead(name, vehicles[name], present[1])
            profile = _NO_PROFILE if lane is None else self._profiles.of(lane, edges)
            self._profile[row, _FIRST], self._profile[row, _SAMPLES] = profile.start, len(profile)

    def _follow(self, before: Rows, names: Sequence[str], vehicles: Mapping[str, PlannedVehicle]) -> None:
        """Brings what is remembered of vehicles into the order of the rows, given the rows that they had before."""
        new = before < 0
        self._present = [self._present[row] if row >= 0 else ("", -2) for row in before.tolist()]
        known = [vehicles[name] for name in names]
        shares = [_RIDERS_SHARE if vehicle.actor_class in TWO_WHEELED else 1.0 for vehicle in known]
        bodies = [(vehicle.driver.driving.max_speed_mps, vehicle.length_m) for vehicle in known]
        self._bodies = np.column_stack((np.array(bodies).reshape(-1, 2), shares))
        if not len(self._limits_mps):
            self._profile, self._passed = np.zeros((1, 2), np.intp), np.zeros((1, _MOST_PASSED, 2))
            self._passed_count, self._limits_mps = np.zeros(1, np.intp), np.zeros(1)
        self._profile, self._passed = self._profile[before], self._passed[before]
        self._passed_count, self._limits_mps = self._passed_count[before], self._limits_mps[before]
        self._profile[new], self._passed_count[new] = 0, 0
        self._limits_mps[new] = self._bodies[new, _WISHED]

    def _route_ahead(self, name: str, vehicle: PlannedVehicle, index: int) -> tuple[int, ...]:
        """The edge that a vehicle is on, or comes from inside a junction, and all that follow on its route."""
        if name not in self._routes:
            self._routes[name] = tuple(self._network.edge_by_id[edge].index for edge in vehicle.route)
        return self._routes[name][max(index, 0) :]


@compiled
def _bend_limits(
    numbers: Floats,
    scales: Floats,
    outside: Flags,
    bodies: Floats,
    profiles: Rows,
    speeds_mps: Floats,
    passed: Floats,
    passed_count: Rows,
    limits_mps: Floats,
) -> Rows:
    """Sets the limit of every vehicle; rows of those that SUMO has to be told, which are all that change.

    ``numbers`` and ``scales`` are of ``SumoColumns``, ``speeds_mps`` of ``_Profiles``, the others of ``BendLimits``.
    What was passed is kept up as far as the vehicle is long.
    """
    changed, count = np.empty(len(outside), np.intp), 0
    for row in range(len(outside)):
        wished, length_m = bodies[row, _WISHED], bodies[row, _LENGTH]
        scale, first, samples = scales[row], profiles[row, _FIRST], profiles[row, _SAMPLES]
        limit = wished
        if samples > 0 and not outside[row]:
            place = within(numbers[ALONG, row] / scale / SAMPLE_M, 0.0, samples - 1.0)
            at = first + min(int(place), samples - 2)
            ahead_mps, next_mps = speeds_mps[_BEFORE_BEND, at], speeds_mps[_BEFORE_BEND, at + 1]
            ahead_mps += (place - (at - first)) * min(next_mps - ahead_mps, 0.0)
            moved_m, bend_mps = numbers[SPEED, row] / scale * STEP_S, speeds_mps[_IN_BEND, at]
            held = _slowest_held(passed[row], passed_count, row, moved_m, bend_mps, length_m)
            limit = min(wished, bodies[row, _SHARE] * scale * min(held, ahead_mps))
        before = limits_mps[row]
        if abs(limit - before) >= _STEP_MPS or (limit != before and wished in (limit, before)):
            limits_mps[row] = limit
            changed[count] = row
            count += 1
    return changed[:count]


@compiled
def _slowest_held(places: Floats, counts: Rows, row: int, moved_m: float, bend_mps: float, length_m: float) -> float:
    """The slowest bend that some part of a vehicle is in, when its front bumper has come to another place.

    Earlier places that are no slower leave the outline first and never count again: speeds ascend.
    """
    count = counts[row]
    at_m = (places[count - 1, _PLACE] if count else 0.0) + moved_m
    while count and places[count - 1, _BEND_SPEED] >= bend_mps:
        count -= 1
    gone = 0
    while gone < count and places[gone, _PLACE] < at_m - length_m:
        gone += 1
    if gone == 0 and count == len(places):
        gone = 1
    for k in range(gone, count):
        places[k - gone, _PLACE], places[k - gone, _BEND_SPEED] = places[k, _PLACE], places[k, _BEND_SPEED]
    count += 1 - gone
    places[count - 1, _PLACE], places[count - 1, _BEND_SPEED] = at_m, bend_mps
    counts[row] = count
    return places[0, _BEND_SPEED]


# This is no parameter: smaller jumps are rounding.
_TOLERANCE_M: Final = 0.05


class LaneContinuity:
    """Corrects the place of vehicles that jumped along the road when they changed lanes, by their last places."""

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        self._rows = _Rows()
        self._lane_ids: tuple[str, ...] = ()
        self._fronts_m = np.empty((2, 0))
        """Place of each front bumper, in SUMO's frame."""

    def correct(self, columns: SumoColumns, skip: Container[str]) -> None:
        """Put vehicles that changed lanes in the last step where their motion leads, in SUMO and in the columns.

        Their position and lane position are replaced in place. Vehicles that are moved from outside (``skip``) stand
        right already.
        """
        before = self._rows.follow(columns)
        if before is not None or columns.lane_ids is not self._lane_ids:
            rows = range(len(columns.names)) if before is None else before.tolist()
            for row, (name, earlier) in enumerate(zip(columns.names, rows, strict=True)):
                if earlier < 0 or columns.lane_ids[row] == self._lane_ids[earlier] or name in skip:
                    continue
                if self._beside(self._lane_ids[earlier], columns.lane_ids[row]):
                    self._correct_vehicle(columns, row, self._fronts_m[:, earlier])
        self._lane_ids, self._fronts_m = columns.lane_ids, columns.numbers[:2]

    def _beside(self, before: str, now: str) -> bool:
        """Whether two lanes, by their ids, belong to one edge."""
        first, second = self._network.lane_by_id.get(before), self._network.lane_by_id.get(now)
        return first is not None and second is not None and first.edge == second.edge

    def _correct_vehicle(self, columns: SumoColumns, row: int, before_m: Floats) -> None:
        lane = self._network.lane_by_id[columns.lane_ids[row]]
        scale, numbers, offset_m = columns.scale[row], columns.numbers[:, row], self._network.sumo_offset_m
        along, _ = lane.centre.project(before_m - offset_m)
        at_m = float(along + numbers[SPEED] / scale * STEP_S)
        jump = numbers[ALONG] / scale - at_m
        if abs(jump) < _TOLERANCE_M or not 0.0 < at_m < lane.length_m:
            return
        libsumo.vehicle.moveTo(columns.names[row], lane.lane_id, float(at_m * scale))
        numbers[X], numbers[Y] = lane.centre.offset_points(at_m, numbers[ASIDE]) + np.array(offset_m)
        numbers[ALONG] = at_m * scale


# These are no parameters, for the reason above.
SIDEWAYS_SHARE: Final = 0.3
"""Largest lateral speed as a share of the speed: a course 17° off the lane's direction."""
_LEAST_MPS: Final = 1e-3
"""Least lateral speed, because SUMO divides by it."""
_SIDEWAYS_STEP_MPS: Final = 0.1
"""Limits are multiples of this, so that they are seldom set."""


class SidewaysLimits:
    """Limits the lateral speed of SUMO's vehicles, so that they move sideways only as they drive."""

    def __init__(self) -> None:
        self._rows = _Rows()
        self._asked_mps = self._own_mps = self._limits_mps = np.empty(0)

    def apply(
        self, columns: SumoColumns, vehicles: Mapping[str, PlannedVehicle], outside: Flags, asked: Collection[str] = ()
    ) -> None:
        """Set the limits for SUMO's next step; some vehicles are moved from outside.

        Drivers whom an EMV has ``asked`` to make way move sideways as fast as all do then, the others as each one is
        used to.
        """
        before = self._rows.follow(columns)
        if before is not None:
            known = [vehicles[name] for name in columns.names]
            self._asked_mps = np.array([vehicle.driver.max_lateral_speed_mps for vehicle in known])
            self._own_mps = np.array([vehicle.sideways[0] for vehicle in known])
            last = np.append(self._limits_mps, 0.0)
            self._limits_mps = np.where(before >= 0, last[before], self._asked_mps)
        wished_mps = np.where(columns.which(asked), self._asked_mps, self._own_mps)
        for row in _sideways_limits(columns.numbers, outside, wished_mps, self._limits_mps).tolist():
            libsumo.vehicle.setMaxSpeedLat(columns.names[row], float(self._limits_mps[row]))


@compiled
def _sideways_limits(numbers: Floats, outside: Flags, wished_mps: Floats, limits_mps: Floats) -> Rows:
    """Sets the limit of every vehicle; rows of those that change. ``outside`` are moved from outside."""
    changed, count = np.empty(len(outside), np.intp), 0
    for row in range(len(outside)):
        speed = 0.0 if outside[row] else numbers[SPEED, row]
        limit = _SIDEWAYS_STEP_MPS * np.trunc(SIDEWAYS_SHARE * speed / _SIDEWAYS_STEP_MPS)
        limit = min(max(limit, _LEAST_MPS), wished_mps[row])
        if limit != limits_mps[row]:
            limits_mps[row] = limit
            changed[count] = row
            count += 1
    return changed[:count]


_CYCLE_LANE_M: Final = 2.5
"""Greatest width of lanes in whose middle cyclists ride (RASt 06: cycle lanes have 1.5 to 2.25 m)."""
_RIGHT: Final = "right"
_FROM_EDGE_M: Final = 0.3
"""Distance of cyclists from the right edge of wider lanes, because people who wait stand at the kerb."""


class CyclistsSide:
    """Tells SUMO on which side of their lanes cyclists ride."""

    def __init__(self, network: RoadNetwork) -> None:
        self._widths_m = [lane.width_m for lane in network.lanes]
        self._lane_ids: tuple[str, ...] = ()
        self._sides: dict[str, str] = {}

    def apply(self, columns: SumoColumns, vehicles: Mapping[str, PlannedVehicle]) -> None:
        """Tell SUMO about cyclists who have come to a lane of another kind."""
        if columns.lane_ids is self._lane_ids:
            return
        self._lane_ids = columns.lane_ids
        for name, lane in zip(columns.names, columns.lane.tolist(), strict=True):
            if vehicles[name].actor_class is not ActorClass.BICYCLE or lane == NO_LANE:
                continue
            edge_m = 0.5 * (self._widths_m[lane] - vehicles[name].width_m) - _FROM_EDGE_M
            side = "center" if self._widths_m[lane] < _CYCLE_LANE_M else f"{-edge_m:.2f}"
            if self._sides.get(name, _RIGHT) != side:
                libsumo.vehicle.setLateralAlignment(name, side)
                self._sides[name] = side
