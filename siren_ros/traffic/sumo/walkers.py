"""People on foot in SUMO (its striping model): they enter, walk on sidewalks and over crossings, and others follow.

In the state of a step they are rows without lane and route; SUMO owns them.
"""

import re
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import compress, pairwise
from typing import Any, Final

import libsumo
import numpy as np
import shapely

from siren_ros.conflicts.people import NOBODY, outlines_of, people_at
from siren_ros.numerics.arrays import Flags, Floats, Ids, Rows
from siren_ros.numerics.compiled import compiled
from siren_ros.roads.road_network import NO_LANE, LaneKind, RoadNetwork
from siren_ros.traffic.demand.plan import PlannedVehicle, PlannedWalker, TrafficPlan
from siren_ros.traffic.sumo.readings import map_from_sumo
from siren_ros.world.actors import ActorClass, ActorDescription, ActorStates, Owner, rows_of_ids
from siren_ros.world.traffic_state import TRAFFIC_STATE_DTYPES, TrafficState

_SUBSCRIBED: Final = (libsumo.VAR_POSITION, libsumo.VAR_ANGLE, libsumo.VAR_SPEED, libsumo.VAR_ROAD_ID)
_SPACE_M: Final = 1.0
"""Length of a person for SUMO: who waits at a kerb stands with the middle half of it behind the kerb, because vehicles
that turn reach over it."""
_WIDTH_M: Final = 0.5
"""Width for SUMO: without the reach of the arms, so that two pass each other on a sidewalk of 1.5 m."""
_AREA: Final = re.compile(r":.+_w\d+_0")
_CROSSING: Final = re.compile(r":.+_c\d+_0")
_CROSSED: Final = re.compile(r"^:.+_c\d+$")
"""SUMO's ids of the lanes where sidewalks meet and of crossings, and of the edges of crossings."""
_DRIVEN: Final = frozenset({LaneKind.DRIVING, LaneKind.CYCLE, LaneKind.SHOULDER, LaneKind.INTERNAL})
_FROM_KERB_M: Final = 0.45
"""Least distance from the middle of somebody to the road: half a body and the mirrors of vehicles."""
_STEP_M: Final = 0.6
"""How far ahead somebody looks for a vehicle in the way…"""
_BESIDE_M: Final = 0.35
"""…and how near it may be beside that place."""
_AWAY_M: Final = 2.3
"""Distance that people on crossings keep from the way of a vehicle that cannot stop any more…"""
_STOPPING_MPS2: Final = 3.0
"""…with this deceleration…"""
_PACE_MPS: Final = 1.9
"""…and that is faster than this."""
_INTO_M: Final = 0.5
"""Who is nearer to its way has to leave it."""
_HURRY: Final = 1.5
"""Of their pace, with which people hurry: brisk walking (Weidmann 1993: up to 2 m/s)."""
_KERB_AHEAD_M: Final = 1.3
"""How far ahead the road begins for those who wait at the kerb."""
_STANDING_MPS: Final = 0.01
"""SUMO's persons need a speed."""
_END_M: Final = 1.0
"""Nobody enters or stops nearer than this to the end of a street."""


def walker_types_xml(walkers: tuple[PlannedWalker, ...]) -> str:
    """Elements of the types of some people, each with an own pace."""
    return "".join(
        f'<vType id="{_type_id(walker)}" vClass="pedestrian" maxSpeed="{walker.speed_mps:.6g}" speedDev="0" '
        f'length="{_SPACE_M:g}" width="{_WIDTH_M:g}"/>\n'
        for walker in walkers
    )


def _type_id(walker: PlannedWalker) -> str:
    return f"type.{walker.name}"


class Corners:
    """Which sidewalks meet at a corner of a junction, and which corners a crossing joins; SUMO runs.

    SUMO 1.28 moves who has to cross two streets at a signal from the corner where they wait to another crossing that
    has green, 15 m in one step. So nobody here walks such a way.
    """

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        self._at: dict[tuple[str, str], str] = {}
        """Corner of an edge at a junction."""
        beside: dict[str, set[str]] = {}
        for lane in libsumo.lane.getIDList():
            for link in libsumo.lane.getLinks(lane):
                target = link[0]
                for area, other in ((lane, target), (target, lane)):
                    if not _AREA.fullmatch(area):
                        continue
                    if _CROSSING.fullmatch(other):
                        beside.setdefault(other, set()).add(area)
                    elif not other.startswith(":"):
                        self._at[other.rpartition("_")[0], area[1:].rpartition("_w")[0]] = area
        self._joined = frozenset(frozenset(areas) for areas in beside.values())

    def leads_simply(self, edges: Sequence[str]) -> bool:
        """Whether a walk along some edges crosses at most one street at each junction."""
        return all(self._meet(before, after) for before, after in pairwise(edges))

    def _meet(self, before: str, after: str) -> bool:
        one, two = (self._network.edge_by_id[edge] for edge in (before, after))
        shared = {one.from_junction, one.to_junction} & {two.from_junction, two.to_junction}
        return any(
            first == second or frozenset((first, second)) in self._joined
            for junction in shared
            if (first := self._at.get((before, junction))) and (second := self._at.get((after, junction)))
        )


class Kerbs:
    """Keeps people who are on no crossing a step away from where vehicles drive: SUMO's stand and walk on its edge."""

    def __init__(self, network: RoadNetwork) -> None:
        driven = [
            shapely.LineString(lane.centre.points).buffer(lane.width_m / 2.0, cap_style="flat")
            for lane in network.lanes
            if lane.kind in _DRIVEN
        ]
        self._road = shapely.union_all(driven).buffer(_FROM_KERB_M)
        shapely.prepare(self._road)
        ends, ring = shapely.get_coordinates(self._road.boundary), shapely.get_parts(self._road.boundary)
        of_ring = np.repeat(np.arange(len(ring)), shapely.get_num_coordinates(ring))
        pairs = np.stack((ends[:-1], ends[1:]), axis=1)[of_ring[:-1] == of_ring[1:]]
        self._edges = shapely.linestrings(pairs)
        self._tree = shapely.STRtree(self._edges)

    def kept_off(self, x_m: Floats, y_m: Floats, crossing: Flags) -> tuple[Floats, Floats]:
        """The places, those on the road and on no crossing moved to its edge."""
        rows = np.flatnonzero(shapely.contains_xy(self._road, x_m, y_m) & ~crossing)
        if not len(rows):
            return x_m, y_m
        points = shapely.points(x_m[rows], y_m[rows])
        nearest = self._edges[self._tree.nearest(points)]
        places = shapely.line_interpolate_point(nearest, shapely.line_locate_point(nearest, points))
        x_m, y_m = x_m.copy(), y_m.copy()
        x_m[rows], y_m[rows] = shapely.get_coordinates(places).T
        return x_m, y_m

    def ahead(self, x_m: Floats, y_m: Floats, yaw_rad: Floats) -> Flags:
        """Whether the road begins right before people at some places, in the direction in which they look."""
        x_m, y_m = x_m + _KERB_AHEAD_M * np.cos(yaw_rad), y_m + _KERB_AHEAD_M * np.sin(yaw_rad)
        return np.asarray(shapely.contains_xy(self._road, x_m, y_m), np.bool_)


class Walkers:
    """The people on foot, by name in order of entry."""

    def __init__(self, network: RoadNetwork, plan: TrafficPlan) -> None:
        self._network = network
        self._corners: Corners | None = None
        self._kerbs = Kerbs(network)
        self._offset_m = network.sumo_offset_m
        self._kept = plan.walkers_kept
        self._reserve = deque(plan.walkers)
        self._present: dict[str, PlannedWalker] = {}
        self._ids: dict[str, int] = {}
        self._arrived: list[str] = []
        self._outlines = outlines_of(network)
        self.people = NOBODY
        """Those of the last state, as ``people_at`` gives them: SUMO's drivers wait for them."""
        self._crossing: frozenset[str] = frozenset()
        """Those on crossings."""
        self._held: dict[str, tuple[float, float] | None] = {}
        """Places of those who stand, None before their first step of it: SUMO's go on changing stripes."""
        self._paces: dict[str, float] = {}
        """Speeds that SUMO was told last."""

    def refill(self) -> None:
        """Let people enter until there are as many as there should be."""
        while self._reserve and len(self._present) < self._kept:
            self._enter(self._reserve.popleft())

    def _enter(self, walker: PlannedWalker) -> None:
        length_m = float(libsumo.lane.getLength(f"{walker.edge}_0"))
        start_m = min(max(walker.place_m, _END_M), max(length_m - _END_M, 0.0))
        libsumo.person.add(walker.name, walker.edge, start_m, typeID=_type_id(walker))
        if self._corners is None:
            self._corners = Corners(self._network)
        present, stages = walker.edge, 0
        for goal in walker.goals:
            for stage in libsumo.simulation.findIntermodalRoute(present, goal) if goal != present else ():
                if not self._corners.leads_simply(stage.edges):
                    continue
                middle_m = 0.5 * float(libsumo.lane.getLength(f"{goal}_0"))
                libsumo.person.appendWalkingStage(walker.name, stage.edges, middle_m)
                present, stages = goal, stages + 1
        if not stages:  # on a street from which no sidewalk leads on
            libsumo.person.appendWalkingStage(walker.name, [walker.edge], max(length_m - start_m, _END_M))
        libsumo.person.subscribe(walker.name, _SUBSCRIBED)
        self._present[walker.name] = walker

    def heed(self, states: ActorStates, vehicles: Mapping[int, PlannedVehicle], sirens: Ids) -> None:
        """Who would step into a vehicle stands still, or near one that cannot stop, or on a road on which an EMV comes.

        Who is on a crossing then hurries. ``states`` is the simulated world at the step before, ``sirens`` are EMVs.
        """
        names = [name for name in self._present if name in self._ids]
        mine = rows_of_ids(states.actor_id, np.array([self._ids[name] for name in names], np.uint32))
        driven = np.array([vehicles[key].length_m if key in vehicles else 0.0 for key in states.actor_id.tolist()])
        wide = np.array([vehicles[key].width_m if key in vehicles else 0.0 for key in states.actor_id.tolist()])
        bodies = (states.x_m, states.y_m, states.yaw_rad), (driven, wide)
        stand, comes = _step_into(mine, bodies, np.hypot(states.vx_mps, states.vy_mps))
        warned = self._warned(states, names, mine, sirens)
        crossing = np.array([name in self._crossing for name in names], np.bool_)
        rows = np.flatnonzero((warned | comes) & ~crossing)
        place = states.x_m[mine[rows]], states.y_m[mine[rows]], states.yaw_rad[mine[rows]]
        stand[rows] |= self._kerbs.ahead(*place)
        stand |= comes & crossing
        hurry = warned & crossing
        self._held = {name: self._held.get(name) for name in compress(names, stand)}
        for name, stands, hurries in zip(names, stand.tolist(), hurry.tolist(), strict=True):
            pace = _STANDING_MPS if stands else self._present[name].speed_mps * (_HURRY if hurries else 1.0)
            if self._paces.get(name, self._present[name].speed_mps) != pace:
                libsumo.person.setSpeed(name, pace)
                self._paces[name] = pace

    def _warned(self, states: ActorStates, names: Sequence[str], rows: Rows, sirens: Ids) -> Flags:
        """Whether an EMV with a siren comes towards each of some people, within the distance at which they heed it."""
        warned = np.zeros(len(names), np.bool_)
        notice_m = np.array([self._present[name].notice_m for name in names])
        for emv in rows_of_ids(states.actor_id, sirens).tolist():
            if emv >= 0:
                dx, dy = states.x_m[rows] - states.x_m[emv], states.y_m[rows] - states.y_m[emv]
                ahead = np.cos(states.yaw_rad[emv]) * dx + np.sin(states.yaw_rad[emv]) * dy
                warned |= (rows >= 0) & (ahead > 0.0) & (np.hypot(dx, dy) < notice_m)
        return warned

    def drop_arrived(self) -> None:
        """Forget those who arrived in the last step."""
        for name in libsumo.simulation.getArrivedPersonIDList():
            if self._present.pop(name, None) is not None:
                self._arrived.append(name)

    def joined(self, state: TrafficState, mirrored: ActorStates, next_id: Callable[[], int]) -> TrafficState:
        """The state of the vehicles with the people; ``mirrored`` is the simulated world at the step before."""
        results: Mapping[str, Mapping[int, Any]] = libsumo.person.getAllSubscriptionResults()
        removed = [self._ids.pop(name) for name in self._arrived if name in self._ids]
        self._arrived.clear()
        spawned = []
        for name, walker in self._present.items():
            if name in results and name not in self._ids:
                self._ids[name] = next_id()
                size = walker.length_m, walker.width_m, walker.height_m
                colour = walker.colour_rgb
                spawned.append(ActorDescription(self._ids[name], name, ActorClass.PEDESTRIAN, *size, colour))
        names = sorted((name for name in self._present if name in self._ids), key=self._ids.__getitem__)
        ids = np.array([self._ids[name] for name in names], np.uint32)
        values = np.array([_values(results[name]) for name in names]).reshape(-1, 4)
        x_m, y_m, yaw_rad = map_from_sumo(values[:, 0], values[:, 1], values[:, 2], _SPACE_M, self._offset_m)
        crossing = np.array([bool(_CROSSED.match(results[name][libsumo.VAR_ROAD_ID])) for name in names], np.bool_)
        x_m, y_m = self._kerbs.kept_off(x_m, y_m, crossing)
        self._hold(names, x_m, y_m)
        sumo = x_m, y_m, yaw_rad, values[:, 3]
        self._crossing = frozenset(compress(names, crossing))
        simulated = _simulated(ids, sumo, mirrored)
        self.people = people_at(ids, simulated, self._outlines)
        return _merged(
            replace(
                state,
                spawned=tuple(sorted((*state.spawned, *spawned), key=lambda actor: actor.actor_id)),
                removed=np.sort(np.append(state.removed, np.array(removed, np.uint32))),
            ),
            ids,
            sumo,
            simulated,
        )

    def _hold(self, names: Sequence[str], x_m: Floats, y_m: Floats) -> None:
        """Leave those who stand where they stood first, in place."""
        for row in np.flatnonzero([name in self._held for name in names]).tolist():
            place = self._held[names[row]]
            if place is None:
                self._held[names[row]] = float(x_m[row]), float(y_m[row])
            else:
                x_m[row], y_m[row] = place


@compiled
def _step_into(walkers: Any, bodies: Any, speed_mps: Any) -> tuple[Any, Any]:
    """Whether a vehicle's body is right before each of some people, with room on both sides of the shoulders.

    And whether the next metre brings them nearer to the way of a vehicle that cannot stop.

    ``walkers`` are their rows among the actors, −1 for who is not there; the size of who is no vehicle is 0.
    """
    (x_m, y_m, yaw_rad), (length_m, width_m) = bodies
    found, comes = np.zeros(len(walkers), np.bool_), np.zeros(len(walkers), np.bool_)
    for number in range(len(walkers)):
        row = walkers[number]
        if row < 0:
            continue
        x, y = x_m[row] + _STEP_M * np.cos(yaw_rad[row]), y_m[row] + _STEP_M * np.sin(yaw_rad[row])
        for k in range(len(x_m)):
            dx, dy = x - x_m[k], y - y_m[k]
            stopping = speed_mps[k] * speed_mps[k] / (2.0 * _STOPPING_MPS2) if speed_mps[k] > _PACE_MPS else 0.0
            if length_m[k] == 0.0 or abs(dx) + abs(dy) > length_m[k] + width_m[k] + 2.0 * (stopping + _AWAY_M):
                continue
            cos, sin = np.cos(yaw_rad[k]), np.sin(yaw_rad[k])
            ahead, left = dx * cos + dy * sin, abs(dy * cos - dx * sin)
            now = abs((y_m[row] - y_m[k]) * cos - (x_m[row] - x_m[k]) * sin) - 0.5 * width_m[k]
            reached = -0.5 * length_m[k] < ahead < 0.5 * length_m[k] + stopping + _STEP_M
            nearer = now > _INTO_M and left - 0.5 * width_m[k] < min(_AWAY_M, now)
            if stopping > 0.0 and reached and nearer:
                comes[number] = True
            ahead = abs(ahead)
            if ahead < 0.5 * length_m[k] + _BESIDE_M and left < 0.5 * width_m[k] + _BESIDE_M:
                found[number] = True
    return found, comes


def _values(result: Mapping[int, Any]) -> tuple[float, float, float, float]:
    (x, y), angle, speed, _ = (result[key] for key in _SUBSCRIBED)
    return x, y, angle, speed


Poses = tuple[Floats, Floats, Floats, Floats]
"""x, y, yaw and speed."""


def _simulated(ids: Ids, sumo: Poses, mirrored: ActorStates) -> Poses:
    """The simulated poses at the step before; SUMO's of those who are new."""
    rows = rows_of_ids(mirrored.actor_id, ids)
    known = rows >= 0
    columns = mirrored.x_m, mirrored.y_m, mirrored.yaw_rad, mirrored.speed_mps
    x, y, yaw, speed = (
        np.where(known, column[rows] if len(column) else theirs, theirs)
        for column, theirs in zip(columns, sumo, strict=True)
    )
    return x, y, yaw, speed


def _merged(state: TrafficState, ids: Ids, sumo: Poses, simulated: Poses) -> TrafficState:
    """The state with further rows for some actors, sorted by id; x, y, yaw and speed in SUMO and simulated."""
    order = np.argsort(np.append(state.actor_id, ids), kind="stable")
    names = ("sumo_x_m", "sumo_y_m", "sumo_yaw_rad", "sumo_speed_mps", "x_m", "y_m", "yaw_rad", "speed_mps")
    theirs: dict[str, Any] = {**dict(zip(names, (*sumo, *simulated), strict=True)), "actor_id": ids}
    theirs["lane"], theirs["owner"] = np.full(len(ids), NO_LANE, np.int32), np.full(len(ids), Owner.SUMO, np.uint8)
    merged: dict[str, Any] = {}
    for name, kind in TRAFFIC_STATE_DTYPES.items():
        if name not in {"removed", "route_offset", "route_edges"}:
            more = theirs.get(name, np.zeros(len(ids), kind))
            merged[name] = np.append(getattr(state, name), more)[order].astype(kind, copy=False)
    edges = np.append(np.diff(state.route_offset), np.zeros(len(ids), np.int32))[order]
    offset = np.append(np.zeros(1, np.int32), np.cumsum(edges)).astype(np.int32)
    return replace(state, **merged, route_offset=offset)
