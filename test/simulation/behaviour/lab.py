"""Small hand-made roads, a stand-in for SUMO, and a closed loop with the vehicle model."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import hand_made_record
import numpy as np

from siren_ros.base.numerics.geometry import Polyline, footprint_corners, separation_m
from siren_ros.simulation.behaviour.civilians.yield_manager import YieldState, step_yield
from siren_ros.simulation.behaviour.driving.step_view import ActorTable, BehaviourWorld, StepView, Surroundings
from siren_ros.simulation.behaviour.emv.controller import EmvState, step_emv
from siren_ros.simulation.dynamics.vehicle_model import (
    BodyState,
    Controls,
    ParameterTable,
    load_vehicle_parameters,
    step_bodies,
)
from siren_ros.simulation.roads.road_network import Connection, Edge, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.scenario.driver_parameters import DriverParameters
from siren_ros.simulation.scenario.paper import LEVEL_POLICIES, EmergencyLevel
from siren_ros.simulation.scenario.presets import load_preset
from siren_ros.simulation.world.actors import ActorClass, ActorDescription, EmvAdvice, Lights, Mode, Owner, TrafficFlags

vehicles = load_vehicle_parameters()
WIDTH = 3.3
RESCUE = int(TrafficFlags.RESCUE_LANE)
L0, L1, L2, L3 = EmergencyLevel


class RoadBuilder:
    def __init__(self):
        self.lanes, self.edges, self.connections = [], [], []

    def edge(self, points, count, ends, internal=False, shoulder=False, width=WIDTH):
        """Lanes from the line of the rightmost one to the left; with a shoulder, lane 0 is one."""
        line = Polyline.through(np.asarray(points, dtype=float))
        edge = len(self.edges)
        first = len(self.lanes)
        for position in range(count):
            centre = Polyline.through(line.offset_points(line.arc_m, np.full(len(line.arc_m), position * width)))
            on_shoulder = shoulder and position == 0
            kind = LaneKind.INTERNAL if internal else LaneKind.SHOULDER if on_shoulder else LaneKind.DRIVING
            self.lanes.append(
                Lane(
                    index=first + position,
                    lane_id=f"e{edge}_{position}",
                    edge=edge,
                    position=position,
                    kind=kind,
                    centre=centre,
                    width_m=width,
                    speed_limit_mps=13.89,
                    emergency_allowed=True,
                    civilian_allowed=not on_shoulder,
                )
            )
        self.edges.append(Edge(edge, f"e{edge}", tuple(range(first, first + count)), *ends, internal=internal))
        return self

    def connect(self, a, b, via=(), direction="s", signal=False):
        self.connections.append(
            Connection(a, b, via, direction, "J" if signal else None, 0 if signal else -1, False, "J")
        )
        return self

    def built(self):
        return RoadNetwork(tuple(self.lanes), tuple(self.edges), tuple(self.connections), {}, (0.0, 0.0), "!")


def straight_road(lanes=2, length=400.0, shoulder=False):
    return RoadBuilder().edge([[0.0, 0.0], [length, 0.0]], lanes, ("A", "B"), shoulder=shoulder).built()


def two_way_road():
    """One lane of 400 m in each direction."""
    road = RoadBuilder().edge([[0.0, 0.0], [400.0, 0.0]], 1, ("A", "B"))
    return road.edge([[400.0, 3.3], [0.0, 3.3]], 1, ("B", "A")).built()


def road_with_shoulder():
    """West (edge 0), a junction path (1), the edge before the turn (2) of 30 m, the road to the south (3)."""
    road = RoadBuilder().edge([[0, 0], [100, 0]], 2, ("W", "I"), shoulder=True)
    road.edge([[100, 0], [120, 0]], 2, ("I", "I"), internal=True)
    road.edge([[120, 0], [150, 0]], 2, ("I", "J"), shoulder=True)
    road.edge([[160, -10], [160, -200]], 1, ("J", "S"))
    for lane in (0, 1):
        road.connect(lane, 4 + lane, via=(2 + lane,)).connect(4 + lane, 6, direction="r")
    return road.built()


def junction_road(lanes=2):
    """West approach (edge 0), straight on (edge 2 by 1), right turn south from lane 0 (edge 4 by 3), crossing (5)."""
    road = RoadBuilder().edge([[0.0, 0.0], [150.0, 0.0]], lanes, ("W", "J"))
    road.edge([[150.0, 0.0], [175.0, 0.0]], lanes, ("J", "J"), internal=True)
    road.edge([[175.0, 0.0], [400.0, 0.0]], lanes, ("J", "E"))
    a = np.linspace(0.0, np.pi / 2.0, 8)
    turn = np.stack((150.0 + 10.0 * np.sin(a), -10.0 * (1.0 - np.cos(a))), axis=-1)
    road.edge(turn, 1, ("J", "J"), internal=True)
    road.edge([[160.0, -10.0], [160.0, -200.0]], 1, ("J", "S"))
    road.edge([[165.0, -100.0], [165.0, 100.0]], 1, ("S", "N"))
    for position in range(lanes):
        road.connect(position, 2 * lanes + position, via=(lanes + position,), signal=True)
    return road.connect(0, 3 * lanes + 1, via=(3 * lanes,), direction="r", signal=True).built()


@dataclass
class Car:
    actor_id: int
    lane: int
    s: float
    speed: float
    route: tuple[int, ...]
    kind: ActorClass = ActorClass.SEDAN
    desired: float = 8.0
    flags: int = 0
    left: float = 0.0


def describe(car):
    p = vehicles[car.kind]
    size = (p.length_m, p.width_m, p.height_m)
    return ActorDescription(car.actor_id, f"v{car.actor_id}", car.kind, *size, (90, 90, 90), car.kind.is_emergency)


def world_of(network, level, **changes):
    config = changes.pop("config", DriverParameters())
    preset = changes.pop("preset", load_preset("paper"))
    return BehaviourWorld(network, LEVEL_POLICIES[level], vehicles, preset, seed=1, config=config, **changes)


def traffic_of(network, cars, step=0, poses=None, advice=None, spawn=True, flags=0, lights=None, owners=None):
    """The state of cars in the order of their ids; poses (N, 4) of x, y, yaw, speed, or on their lanes."""
    cars = sorted(cars, key=lambda car: car.actor_id)
    n = len(cars)
    if poses is None:
        poses = np.empty((n, 4))
        for i, car in enumerate(cars):
            centre = network.lanes[car.lane].centre
            poses[i, :2] = centre.offset_points(car.s, car.left)
            poses[i, 2:] = float(centre.heading_rad(car.s)), car.speed
    lane, position, offset = np.empty(n, np.int32), np.empty(n), np.empty(n)
    for i, car in enumerate(cars):
        half = 0.5 * vehicles[car.kind].length_m
        front = poses[i, :2] + half * np.array([np.cos(poses[i, 2]), np.sin(poses[i, 2])])
        lane[i], position[i], offset[i] = locate(network, front, poses[i, 2], car.route)
    routes = [route_from(network, car.route, lane[i]) for i, car in enumerate(cars)]
    advised = tuple(EmvAdvice(car.actor_id, **{**NO_ADVICE, **(advice or {})}) for car in cars if car.kind.is_emergency)
    ids = [car.actor_id for car in cars]
    return hand_made_record.traffic_of(
        step, poses=poses, spawned=tuple(describe(car) for car in cars) if spawn else (), actor_id=ids, emvs=advised,
        owner=[(owners or {}).get(key, Owner.SUMO) for key in ids], lights=[(lights or {}).get(key, 0) for key in ids],
        lane=lane, lane_position_m=position, lateral_offset_m=offset, flags=[car.flags | flags for car in cars],
        route_offset=np.cumsum([0, *map(len, routes)]), route_edges=[edge for route in routes for edge in route],
    )  # fmt: skip


NO_ADVICE = {
    "lane_change_intent": 0, "leader_id": 0, "leader_gap_m": 0.0, "speed_without_control_mps": 0.0,
    "rescue_count": 0,
}  # fmt: skip


def locate(network, point, yaw, route):
    best = (1e9, -1, 0.0, 0.0)
    for lane in network.lanes:
        edge = network.edges[lane.edge]
        if not edge.internal and lane.edge not in route:
            continue
        s, left = lane.centre.project(point)
        along = np.cos(yaw - lane.centre.heading_rad(s))
        miss = abs(left) + 5.0 * max(-s, s - lane.length_m, 0.0) + (0.0 if along > 0.5 else 50.0)
        if miss < best[0]:
            best = (miss, lane.index, float(np.clip(s, 0.0, lane.length_m)), float(left))
    return best[1:]


def route_from(network, route, lane):
    edge = network.lanes[lane].edge
    if edge in route:
        return route[route.index(edge) :]
    for connection in network.connections:
        if lane in connection.via:
            before = network.lanes[connection.from_lane].edge
            if before in route:
                return route[route.index(before) :]
    return route


def view_of(world, traffic):
    table = ActorTable.empty().updated(traffic)
    return StepView(world, traffic, Surroundings.seen(traffic, table, world.courses), table)


def view_in(world, cars, step=0, **changes):
    """A step of cars on a world's network; ``changes`` as for ``traffic_of``."""
    return view_of(world, traffic_of(world.network, cars, step, **changes))


def view(network, level, cars, step=0, **changes):
    """A step of cars on a network at a level."""
    return view_in(world_of(network, level), cars, step, **changes)


@dataclass
class Loop:
    """EMV controller, yield manager, vehicle model and a stand-in for SUMO, step by step."""

    world: BehaviourWorld
    cars: list[Car]
    advise: Callable[["Loop"], dict[str, Any]] = lambda _: {}
    emv: EmvState = field(default_factory=EmvState)
    yields: YieldState = field(default_factory=YieldState)
    step: int = 0
    events: list[Any] = field(default_factory=list)
    log: list[dict[int, tuple[float, float, float, float, int, int]]] = field(default_factory=list)

    def __post_init__(self):
        self.cars = sorted(self.cars, key=lambda car: car.actor_id)
        first = traffic_of(self.world.network, self.cars)
        self.table = ParameterTable.of([car.kind for car in self.cars], vehicles)
        self.body = BodyState.moving(first.x_m.copy(), first.y_m.copy(), first.yaw_rad.copy(), first.speed_mps.copy())
        self.lights, self.owners, self.modes = {}, {}, {}

    def run(self, steps):
        for _ in range(steps):
            self.once()
        return self

    def once(self):
        body, network = self.body, self.world.network
        poses = np.stack((body.x_m, body.y_m, body.yaw_rad, np.hypot(body.forward_mps, body.lateral_mps)), axis=-1)
        given = {"spawn": self.step == 0, "lights": self.lights, "owners": self.owners}
        self.traffic = traffic = traffic_of(network, self.cars, self.step, poses, self.advise(self), **given)
        self.emv, first = step_emv(self.emv, traffic, self.world)
        self.yields, second = step_yield(self.yields, traffic, self.world)
        self.events.extend((*first.events, *second.events))
        self.apply(first, second)
        self.log.append(
            {
                car.actor_id: (*poses[i], self.owners.get(car.actor_id, 0), self.modes.get(car.actor_id, 0))
                for i, car in enumerate(self.cars)
            }
        )
        self.step += 1

    def apply(self, *commands):
        rows = {car.actor_id: i for i, car in enumerate(self.cars)}
        n = len(self.cars)
        throttle, brake, steer, hand = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n, bool)
        driven = np.zeros(n, bool)
        self.lights, self.owners, self.modes = {}, {}, {}
        for group in commands:
            for k, actor_id in enumerate(group.actor_id.tolist()):
                i = rows[actor_id]
                self.lights[actor_id] = int(group.lights[k]) | (int(Lights.BRAKE) if group.brake[k] > 0 else 0)
                self.modes[actor_id] = int(group.mode[k])
                self.owners[actor_id] = int(group.owner[k])
                if group.owner[k] == Owner.ROS:
                    driven[i] = True
                    throttle[i], brake[i], steer[i] = group.throttle[k], group.brake[k], group.steer_rad[k]
                    hand[i] = bool(group.hand_brake[k])
        moved = step_bodies(self.body, Controls(throttle, brake, steer, hand, np.ones(n), np.ones(n)), self.table, 0.05)
        x, y, yaw, v = (a.copy() for a in (self.body.x_m, self.body.y_m, self.body.yaw_rad, self.body.forward_mps))
        for i in np.flatnonzero(~driven):
            x[i], y[i], yaw[i], v[i] = self.sumo(i)
        followed = {"x_m": x, "y_m": y, "yaw_rad": yaw, "forward_mps": v, "lateral_mps": 0.0, "yaw_rate_radps": 0.0}
        columns = {name: np.where(driven, getattr(moved, name), value) for name, value in followed.items()}
        self.body = replace(moved, **columns)

    def sumo(self, i):
        """A lane follower that keeps its distance and drifts back to its lane's centre."""
        car, t = self.cars[i], self.traffic
        lane = self.world.network.lanes[int(t.lane[i])]
        s, left = (float(value) for value in lane.centre.project((t.x_m[i], t.y_m[i])))
        wish = car.desired
        if self.modes.get(car.actor_id) == Mode.YIELD_KEEP_LANE:
            wish *= 0.5
        for j in range(len(t)):
            if j != i and t.lane[j] == t.lane[i] and t.lane_position_m[j] > t.lane_position_m[i]:
                gap = t.lane_position_m[j] - t.lane_position_m[i] - self.table.length_m[j] - 2.0
                wish = min(wish, float(t.speed_mps[j]) + 0.5 * gap)
        v = max(0.0, float(t.speed_mps[i]) + float(np.clip(wish - t.speed_mps[i], -0.2, 0.1)))
        s += v * 0.05
        left *= 0.98 if v > 0.1 else 1.0
        point = lane.centre.offset_points(s, left)
        return float(point[0]), float(point[1]), float(lane.centre.heading_rad(s)), v

    def touching(self):
        """Steps and pairs of actors whose footprints overlap."""
        ids = [car.actor_id for car in self.cars]
        first, second = np.triu_indices(len(ids), 1)
        hits = []
        for step, row in enumerate(self.log):
            pose = np.array([row[actor][:3] for actor in ids])
            corners = footprint_corners(*pose.T, self.table.length_m, self.table.width_m)
            overlap = np.flatnonzero(separation_m(corners[first], corners[second]) <= 0.0)
            hits.extend((step, ids[first[pair]], ids[second[pair]]) for pair in overlap)
        return hits

    def told(self, every=60):
        """Poses, owners and modes of all actors now and then, and all events."""
        rows = [
            [[actor, *pose[:4], Owner(pose[4]).name, Mode(pose[5]).name] for actor, pose in row.items()]
            for row in self.log[::every]
        ]
        return {"rows": rows, "events": [[event.actor_id, event.kind.value, event.detail] for event in self.events]}

    def of(self, kind):
        return [event for event in self.events if event.kind.value == kind]


def kinds(events):
    return [event.kind.value for event in events]


def stepper(control, initial):
    """Steps of the EMVs or of the civilians alone: the state, the last commands and all events."""

    def steps(world, cars, count=1, state=None, start=0, **traffic):
        """Nobody moves; ``traffic`` as for ``traffic_of``."""
        events, commands = [], None
        for k in range(start, start + count):
            state, commands = control(
                state or initial, traffic_of(world.network, cars, step=k, spawn=k == 0, **traffic), world
            )
            events += commands.events
        return state or initial, commands, events

    return steps


def turned_road(turn, lanes=2, length=400.0):
    """A straight road that points anywhere, and the directions along and across it."""
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    return RoadBuilder().edge([[0.0, 0.0], length * along], lanes, ("A", "B")).built(), along, across
