"""Pedestrians in SUMO (its striping model): how they enter, walk and cross, and how others take their place.

In the state of a step they are rows without lane and route; SUMO owns them.
"""

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from operator import itemgetter
from typing import Any, Final, Self

import libsumo
import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Ids, Rows
from siren_ros.base.numerics.compiled import YAW, compiled
from siren_ros.simulation.conflicts.junction_approach import NOBODY, outlines_of, people_at
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle, PlannedWalker, TrafficPlan
from siren_ros.simulation.traffic.sumo.population import PEOPLE_MARGIN_M, PEOPLE_WITHIN_M, Point, Reserve, nearest_m
from siren_ros.simulation.traffic.sumo.readings import ANGLE, SPEED, Offset, X, Y, map_from_sumo
from siren_ros.simulation.traffic.sumo.sidewalks import Corners, Kerbs
from siren_ros.simulation.world.actors import (
    TRAFFIC_STATE_DTYPES,
    ActorClass,
    ActorDescription,
    ActorStates,
    Owner,
    TrafficState,
    rows_of_ids,
)

_SUBSCRIBED: Final = (libsumo.VAR_POSITION, libsumo.VAR_ANGLE, libsumo.VAR_SPEED, libsumo.VAR_ROAD_ID)
_IN_ORDER: Final = itemgetter(*_SUBSCRIBED)
WALKING_OPTIONS: Final[Mapping[str, str]] = {"--pedestrian.striping.walkingarea-detail": "64"}
"""SUMO's option for corners of sidewalks. On a wide sidewalk a person at its edge jumps at each vertex of a corner's
way. SUMO's 4 vertices are up to 70 degrees each."""
_SPACE_M: Final = 1.0
"""Length of a person in SUMO. A person who waits at a kerb stands with the middle half of it behind the kerb, because
vehicles that turn reach over it."""
_WIDTH_M: Final = 0.5
"""Width of a person in SUMO, without the reach of the arms, so that two pass each other on a sidewalk of 1.5 m."""
_CROSSED: Final = re.compile(r"^:.+_c\d+$")
"""SUMO's ids of the edges of crossings."""
_STEP_M: Final = 0.6
"""Distance beyond their stopping place up to which people look for a vehicle in their way."""
_HALT_MPS2: Final = 2.5
"""Deceleration of people who stop (``dynamics.walkers``)."""
_BESIDE_M: Final = 0.35
"""Lateral distance within which a vehicle counts as in their way."""
_AWAY_M: Final = 2.3
"""Distance that people on crossings keep from the way of a vehicle that cannot stop any more."""
_SETS_OFF_M: Final = 2.0
"""Additional distance for people who stand already, because the driver expects them to go on as they walk."""
_STANDS_MPS: Final = 0.5
"""Speed below which a person stands, for this rule."""
_SEES_S: Final = 1.0
"""Time that people who set off leave the driver to see them."""
_STOPPING_MPS2: Final = 3.0
"""Deceleration with which the driver could still stop, for this rule."""
_PACE_MPS: Final = 1.9
"""Speed above which a vehicle counts, for people who walk."""
_ROLLS_MPS: Final = 0.3
"""Speed above which a vehicle counts for people who stand, so that they let it pass."""
_BEHIND_M: Final = 4.0
"""Distance up to which a vehicle that has passed somebody still counts as on the crossing."""
_INTO_M: Final = 0.5
"""Distance from a vehicle's way within which a person has to leave it."""
_HURRY: Final = 1.5
"""Factor on their pace with which people hurry: brisk walking (Weidmann 1993: up to 2 m/s)."""
_LAG_M: Final = 0.3
"""Distance behind SUMO's person from which the simulated one catches up: on the outer side of a corner SUMO's people go
as fast as in its middle."""
_SLOWER: Final = 0.3
"""Share of their pace with which SUMO's people go on while the simulated ones catch up."""
_HELD_UP_MPS: Final = 5.0
"""Speed below which traffic holds up an EMV."""
_IN_QUEUE_M: Final = 80.0
"""Distance at which people ahead of such an EMV hear it, as drivers in a queue do (``YieldConfig.queue_m``)."""
_STANDING_MPS: Final = 0.01
"""Speed of people who stand, because SUMO's persons need a speed."""
_TURNS_MPS: Final = 0.1
"""Speed below which people keep their yaw: SUMO turns them round for a step or two if they are pushed back by a
millimetre."""
_TURNED: Final = 0.7
"""Cosine of the turn (45 degrees) beyond which they keep it as well: they would swing round their toes into the
road."""
_END_M: Final = 1.0
"""Least distance from the end of a street at which people enter or stop."""


def walker_types_xml(walkers: tuple[PlannedWalker, ...]) -> str:
    """Elements of the types of some people, each with an own pace."""
    return "".join(
        f'<vType id="{_type_id(walker)}" vClass="pedestrian" maxSpeed="{walker.speed_mps:.6g}" speedDev="0" '
        f'length="{_SPACE_M:g}" width="{_WIDTH_M:g}"/>\n'
        for walker in walkers
    )


def _type_id(walker: PlannedWalker) -> str:
    return f"type.{walker.name}"


@dataclass(frozen=True, eq=False)
class PeopleTable:
    """The people of a state as arrays, in order of their ids, and what SUMO was told of them."""

    names: tuple[str, ...]
    actor_id: Ids
    notice_m: Floats
    speed_mps: Floats
    told_mps: Floats
    """Speeds that SUMO was told last; otherwise the people's own."""
    stands: Flags
    """Whether each person was told to stand."""
    held_m: Floats
    """Places at which people began to stand, x and y, shape ``(2, N)``; NaN for the others."""
    facing: Floats
    """SUMO's yaw at the last step; NaN at first."""

    @classmethod
    def of(cls, ids: Mapping[str, int], walkers: Mapping[str, PlannedWalker], last: "PeopleTable | None") -> Self:
        """The table of those with ids; speeds as they were told last."""
        names = tuple(name for name in walkers if name in ids)
        before = {name: row for row, name in enumerate(last.names)} if last else {}
        columns = np.array(
            [(ids[name], walkers[name].notice_m, walkers[name].speed_mps) for name in names], np.float64
        ).reshape(-1, 3)
        ids_of, notice_m, speed_mps = columns[:, 0].astype(np.uint32), columns[:, 1], columns[:, 2]
        nobody, nowhere = np.zeros(len(names), np.bool_), np.full((3, len(names)), np.nan)
        table = cls(names, ids_of, notice_m, speed_mps, speed_mps.copy(), nobody, nowhere[:2], nowhere[2])
        if last is not None:
            kept = [(row, before[name]) for row, name in enumerate(names) if name in before]
            now, then = np.array(kept, np.intp).reshape(-1, 2).T
            table.told_mps[now], table.stands[now] = last.told_mps[then], last.stands[then]
            table.held_m[:, now], table.facing[now] = last.held_m[:, then], last.facing[then]
        return table

    def hold(self, poses: Floats) -> None:
        """Keeps people who stand where they began to stand, because SUMO's people go on changing stripes."""
        held, first = self.held_m, np.isnan(self.held_m[0])
        held[:, self.stands & first] = poses[:2, self.stands & first]
        poses[:2, self.stands] = held[:, self.stands]


@lru_cache
def _is_crossing(road: str) -> bool:
    """Whether a road of SUMO is a crossing."""
    return bool(_CROSSED.match(road))


class Walkers:
    """The pedestrians in SUMO, by name in order of entry."""

    def __init__(self, network: RoadNetwork, plan: TrafficPlan) -> None:
        self._network = network
        self._corners: Corners | None = None
        self._kerbs = Kerbs(network)
        self._offset_m = network.sumo_offset_m
        self._kept, self._uncrossed = plan.walkers_kept, plan.uncrossed
        sidewalks = (network.lane_by_id[f"{walker.edge}_0"].centre for walker in plan.walkers)
        places = [line.at(walker.place_m) for line, walker in zip(sidewalks, plan.walkers, strict=True)]
        self._reserve = Reserve(plan.walkers, [(float(x), float(y)) for x, y in places])
        self._present: dict[str, PlannedWalker] = {}
        self._ids: dict[str, int] = {}
        """Actor ids of those who are in the state, in order of these."""
        self._arrived: list[str] = []
        self._outlines = outlines_of(network)
        self.people = NOBODY
        """Those of the last state, as ``people_at`` gives them: SUMO's drivers wait for them."""
        self._table = PeopleTable.of({}, {}, None)
        self._crossing = np.empty(0, np.bool_)
        """Who of the table is on a crossing."""
        self.waiting: tuple[str, ...] = ()
        """Those who wait at the kerb for an EMV, by SUMO's names: its drivers would wait too, and the EMV behind them.
        """
        self._sized, self._sizes = np.empty(0, np.uint32), (np.empty(0), np.empty(0))
        """Actors of the last step, and lengths and widths of their bodies: 0 for those that are no vehicles."""

    def exchange(self, points: Collection[Point], least_m: float) -> None:
        """Removes people who are far from all points, and lets others enter at a distance from each point."""
        offset_x, offset_y = self._offset_m
        for name in self._ids:
            x, y = libsumo.person.getPosition(name)
            if nearest_m((x - offset_x, y - offset_y), points) > PEOPLE_WITHIN_M:
                libsumo.person.removeStages(name)
        if len(self._present) < self._kept:
            most_m = PEOPLE_WITHIN_M - PEOPLE_MARGIN_M
            self._reserve.let_in(points, least_m, most_m, self._enter)

    def _enter(self, walker: PlannedWalker) -> bool:
        if len(self._present) >= self._kept:
            return False
        length_m = float(libsumo.lane.getLength(f"{walker.edge}_0"))
        start_m = min(max(walker.place_m, _END_M), max(length_m - _END_M, 0.0))
        libsumo.person.add(walker.name, walker.edge, start_m, typeID=_type_id(walker))
        if self._corners is None:
            self._corners = Corners(self._network, self._uncrossed)
        stages = self._corners.walks(walker.edge, walker.goals)
        for edges in stages:
            libsumo.person.appendWalkingStage(walker.name, edges, 0.5 * float(libsumo.lane.getLength(f"{edges[-1]}_0")))
        if not stages:  # the person is on a street from which no sidewalk leads on
            libsumo.person.appendWalkingStage(walker.name, [walker.edge], max(length_m - start_m, _END_M))
        libsumo.person.subscribe(walker.name, _SUBSCRIBED)
        self._present[walker.name] = walker
        return True

    def heed(self, states: ActorStates, vehicles: Mapping[int, PlannedVehicle], sirens: Ids) -> None:
        """Lets people stop for vehicles, and before a road on which an EMV or a vehicle that cannot stop comes.

        On crossings they hurry before an EMV, and stand for a vehicle that cannot stop.
        ``states`` is the simulated world at the step before, ``sirens`` are EMVs.
        """
        table = self._table
        rows = rows_of_ids(states.actor_id, table.actor_id)
        if not np.array_equal(self._sized, states.actor_id):
            bodies = [vehicles.get(key) for key in states.actor_id.tolist()]
            sizes = [(body.length_m, body.width_m) if body else (0.0, 0.0) for body in bodies]
            self._sized, self._sizes = states.actor_id, (*np.array(sizes).reshape(-1, 2).T.copy(),)
        poses, speed_mps = (states.x_m, states.y_m, states.yaw_rad), np.hypot(states.vx_mps, states.vy_mps)
        stand, comes = steps_into(rows, (poses, self._sizes), speed_mps)
        warned = _warned(rows, table.notice_m, rows_of_ids(states.actor_id, sirens), poses, speed_mps)
        wait = np.flatnonzero((warned | comes) & ~self._crossing)
        if len(wait):
            stand[wait] |= self._kerbs.ahead(*(values[rows[wait]] for values in poses))
        held = np.flatnonzero(stand & warned & ~self._crossing)
        self.waiting = tuple(table.names[row] for row in held.tolist())
        stand |= comes & self._crossing
        table.held_m[:, ~stand] = np.nan
        table.stands[:] = stand
        behind = (rows >= 0) & (states.residual_m[rows] > _LAG_M) if len(states) else stand
        paces_mps = np.where(warned & self._crossing, _HURRY, np.where(behind, _SLOWER, 1.0)) * table.speed_mps
        paces_mps[stand] = _STANDING_MPS
        for row in np.flatnonzero(paces_mps != table.told_mps).tolist():
            libsumo.person.setSpeed(table.names[row], paces_mps[row])
        table.told_mps[:] = paces_mps

    def drop_arrived(self) -> None:
        """Removes people who arrived in the last step."""
        for name in libsumo.simulation.getArrivedPersonIDList():
            if self._present.pop(name, None) is not None:
                self._arrived.append(name)

    def joined(self, state: TrafficState, mirrored: ActorStates, new_ids: Iterator[int]) -> TrafficState:
        """The state of the vehicles with the people; ``mirrored`` is the simulated world at the step before."""
        results: Mapping[str, Mapping[int, Any]] = libsumo.person.getAllSubscriptionResults()
        removed = [self._ids.pop(name) for name in self._arrived if name in self._ids]
        self._arrived.clear()
        entered = [name for name in self._present if name not in self._ids and name in results]
        self._ids.update((name, next(new_ids)) for name in entered)
        if entered or removed:
            self._table = PeopleTable.of(self._ids, self._present, self._table)
        found = [_IN_ORDER(results[name]) for name in self._table.names]
        values = np.array([(*place, angle, speed) for place, angle, speed, _ in found]).reshape(-1, 4)
        poses = mirrored.x_m, mirrored.y_m, mirrored.yaw_rad, mirrored.speed_mps
        ids = self._table.actor_id
        sumo, simulated = poses_of(
            values, self._offset_m, rows_of_ids(mirrored.actor_id, ids), poses, self._table.facing
        )
        self._crossing = np.array([_is_crossing(road) for *_, road in found], np.bool_)
        self._kerbs.keep_off(sumo, self._crossing)
        self._table.hold(sumo)
        self.people = people_at(ids, simulated, self._outlines)
        spawned = *state.spawned, *(self._described(name) for name in entered)
        removed_ids = np.sort(np.append(state.removed, np.array(removed, np.uint32)))
        state = replace(state, spawned=spawned, removed=removed_ids) if entered or removed else state
        return with_people(state, ids, sumo, simulated)

    def _described(self, name: str) -> ActorDescription:
        walker = self._present[name]
        size = walker.length_m, walker.width_m, walker.height_m
        return ActorDescription(self._ids[name], name, ActorClass.PEDESTRIAN, *size, walker.colour_rgb)


@compiled
def _warned(
    walkers: Rows, notice_m: Floats, emvs: Rows, poses: tuple[Floats, Floats, Floats], speed_mps: Floats
) -> Flags:
    """Whether an EMV with a siren comes towards each of some people, within the distance at which they heed it.

    People ahead of an EMV that traffic holds up hear it as far as the drivers of a queue do: those at the queue's head
    may wait for them.
    """
    x_m, y_m, yaw_rad = poses
    warned = np.zeros(len(walkers), np.bool_)
    for number in range(len(walkers)):
        row = walkers[number]
        for emv in emvs:
            if row >= 0 and emv >= 0:
                dx, dy = x_m[row] - x_m[emv], y_m[row] - y_m[emv]
                ahead = np.cos(yaw_rad[emv]) * dx + np.sin(yaw_rad[emv]) * dy
                reach = max(notice_m[number], _IN_QUEUE_M) if speed_mps[emv] < _HELD_UP_MPS else notice_m[number]
                warned[number] |= ahead > 0.0 and notice_m[number] > 0.0 and np.hypot(dx, dy) < reach
    return warned


@compiled
def steps_into(
    walkers: Rows, bodies: tuple[tuple[Floats, Floats, Floats], tuple[Floats, ...]], speed_mps: Floats
) -> tuple[Flags, Flags]:
    """Whether a vehicle's body is right before each of some people, with room on both sides of the shoulders.

    And whether the next metre brings them nearer to the way of a vehicle that cannot stop. ``walkers`` are their rows
    among the actors, −1 for somebody who is not there; those who are no vehicles have no size.
    """
    (x_m, y_m, yaw_rad), (length_m, width_m) = bodies
    found, comes = np.zeros(len(walkers), np.bool_), np.zeros(len(walkers), np.bool_)
    for number in range(len(walkers)):
        row = walkers[number]
        if row < 0:
            continue
        x, y = x_m[row] + _STEP_M * np.cos(yaw_rad[row]), y_m[row] + _STEP_M * np.sin(yaw_rad[row])
        halt_m = speed_mps[row] * speed_mps[row] / (2.0 * _HALT_MPS2)
        away_m, sees_s, slow_mps = _AWAY_M, 0.0, _PACE_MPS
        if speed_mps[row] < _STANDS_MPS:
            away_m, sees_s, slow_mps = _AWAY_M + _SETS_OFF_M, _SEES_S, _ROLLS_MPS
        for k in range(len(x_m)):
            dx, dy = x - x_m[k], y - y_m[k]
            stopping = 0.0
            if speed_mps[k] > slow_mps:
                stopping = speed_mps[k] * (sees_s + speed_mps[k] / (2.0 * _STOPPING_MPS2))
            if length_m[k] == 0.0 or abs(dx) + abs(dy) > length_m[k] + width_m[k] + 2.0 * (stopping + away_m):
                continue
            cos, sin = np.cos(yaw_rad[k]), np.sin(yaw_rad[k])
            ahead, left = dx * cos + dy * sin, abs(dy * cos - dx * sin)
            now = abs((y_m[row] - y_m[k]) * cos - (x_m[row] - x_m[k]) * sin) - 0.5 * width_m[k]
            reached = -0.5 * length_m[k] - _BEHIND_M < ahead < 0.5 * length_m[k] + stopping + _STEP_M
            nearer = now > _INTO_M and left - 0.5 * width_m[k] < min(away_m, now)
            if stopping > 0.0 and reached and nearer:
                comes[number] = True
            turned = yaw_rad[row] - yaw_rad[k]
            for way_m in (0.0, halt_m):
                along, across = ahead + way_m * np.cos(turned), dy * cos - dx * sin + way_m * np.sin(turned)
                if abs(along) < 0.5 * length_m[k] + _BESIDE_M and abs(across) < 0.5 * width_m[k] + _BESIDE_M:
                    found[number] = True
    return found, comes


@compiled
def poses_of(
    values: Floats, offset_m: Offset, rows: Rows, simulated: tuple[Floats, Floats, Floats, Floats], facing: Floats
) -> tuple[Floats, Floats]:
    """Poses in the ``map`` frame of some people: SUMO's, and the simulated ones; shape ``(4, N)`` each.

    ``values`` are SUMO's x, y, angle and speed, ``rows`` the people's among the simulated actors: those who are new
    have none, and SUMO's poses. ``facing`` is the yaw at the step before, NaN at first; it is set. Those
    who stand keep it.
    """
    sumo = np.empty((4, len(rows)))
    before = np.empty((4, len(rows)))
    for k in range(len(rows)):
        x, y, yaw = map_from_sumo(values[k, X], values[k, Y], values[k, ANGLE], _SPACE_M, offset_m)
        if values[k, SPEED] < _TURNS_MPS and np.cos(yaw - facing[k]) < _TURNED:
            angle_deg = 90.0 - np.degrees(facing[k])
            x, y, yaw = map_from_sumo(values[k, X], values[k, Y], angle_deg, _SPACE_M, offset_m)
        facing[k] = yaw
        sumo[X, k], sumo[Y, k], sumo[YAW, k], sumo[SPEED, k] = x, y, yaw, values[k, SPEED]
        before[X, k], before[Y, k], before[YAW, k], before[SPEED, k] = x, y, yaw, values[k, SPEED]
        if rows[k] >= 0:
            x_m, y_m, yaw_rad, speed_mps = simulated
            before[X, k], before[Y, k] = x_m[rows[k]], y_m[rows[k]]
            before[YAW, k], before[SPEED, k] = yaw_rad[rows[k]], speed_mps[rows[k]]
    return sumo, before


_OF_POSES: Final = ("sumo_x_m", "sumo_y_m", "sumo_yaw_rad", "sumo_speed_mps", "x_m", "y_m", "yaw_rad", "speed_mps")
_NOT_BY_ROW: Final = frozenset({"removed", "route_offset", "route_edges"})


def with_people(state: TrafficState, ids: Ids, sumo: Floats, simulated: Floats) -> TrafficState:
    """The state with further rows for some actors, sorted by id; x, y, yaw and speed in SUMO and simulated."""
    rows = np.empty(len(state) + len(ids), np.intp)
    rows[np.argsort(np.concatenate((state.actor_id, ids)), kind="stable")] = np.arange(len(rows))
    theirs: dict[str, Any] = {**dict(zip(_OF_POSES, (*sumo, *simulated), strict=True)), "actor_id": ids}
    theirs |= {"lane": NO_LANE, "owner": Owner.SUMO}
    of_state, of_theirs = rows[: len(state)], rows[len(state) :]
    merged: dict[str, Any] = {}
    for name, kind in TRAFFIC_STATE_DTYPES.items():
        if name not in _NOT_BY_ROW:
            merged[name] = column = np.empty(len(rows), kind)
            column[of_state], column[of_theirs] = getattr(state, name), theirs.get(name, 0)
    offset = np.zeros(len(rows) + 1, np.int32)
    offset[1 + of_state] = np.diff(state.route_offset)
    return replace(state, **merged, route_offset=np.cumsum(offset, dtype=np.int32))
