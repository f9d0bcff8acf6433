"""SUMO in lockstep with the simulated world: poses in, the traffic's state out.

For comparison SUMO also runs alone, with its own bluelight device on the EMVs: nobody tells SUMO's drivers how to
move.
"""

import re
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import ClassVar, Final, Self

import libsumo
import numpy as np

from siren_ros.base.numerics.arrays import Codes, Floats, Ids
from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import EpisodeError, InputError, MapError
from siren_ros.simulation.roads.maps.map_compiler import CompiledMap, mirrored_map
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork, mirror_image, right_hand_image
from siren_ros.simulation.scenario.episode import MAX_SEED
from siren_ros.simulation.scenario.paper import LEVEL_POLICIES, PAPER_CONSTANTS, EmergencyLevel
from siren_ros.simulation.scenario.sealing import actor_ids, actor_name
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle, TrafficPlan
from siren_ros.simulation.traffic.observation import CrossingWatch, Mover, Reactions, find_teleports
from siren_ros.simulation.traffic.sumo.mirror import Mirror
from siren_ros.simulation.traffic.sumo.orders import time_signal
from siren_ros.simulation.traffic.sumo.population import (
    REPLACEMENT_DISTANCE_M,
    Point,
    SumoPopulation,
    route_id,
    vehicle_types_xml,
)
from siren_ros.simulation.traffic.sumo.readings import (
    Readings,
    SumoColumns,
    emv_advice,
    joined_rows,
    read_vehicles,
    simulated,
)
from siren_ros.simulation.traffic.sumo.rules import RULES, Moment, Road, Rule, Setting, acts_of
from siren_ros.simulation.traffic.sumo.walkers import WALKING_OPTIONS, Walkers, walker_types_xml
from siren_ros.simulation.world.actors import (
    MIRRORS_M,
    ActorDescription,
    ActorStates,
    EmvAdvice,
    Event,
    EventKind,
    Indices,
    Lights,
    Mode,
    Owner,
    SignalState,
    TrafficState,
    rows_of_ids,
)

_LARGEST_SEED: Final = 2**31 - 1
_EXCHANGE_STEPS: Final = round(2.0 / STEP_S)
"""So often people enter and leave."""
_YIELDS: Final = np.array([mode.is_yielding for mode in Mode])
"""By mode."""
_SIREN: Final = int(Lights.BEACON | Lights.SIREN)


@dataclass(frozen=True, eq=False)
class _Table:
    """The vehicles that have ids, sorted by them."""

    names: tuple[str, ...]
    actor_id: Ids
    length_m: Floats
    sirens: Codes
    """Lights that EMVs with a siren show and sound."""

    @classmethod
    def of(cls, reported: Mapping[int, PlannedVehicle]) -> "_Table":
        """The table of vehicles by actor id."""
        ids = sorted(reported)
        vehicles = tuple(reported[actor_id] for actor_id in ids)
        return cls(
            tuple(vehicle.name for vehicle in vehicles),
            np.array(ids, dtype=np.uint32),
            np.array([vehicle.length_m for vehicle in vehicles]),
            np.array([_SIREN if vehicle.is_emv else 0 for vehicle in vehicles], dtype=np.uint8),
        )

    @cached_property
    def row_of(self) -> Mapping[str, int]:
        """Row of each vehicle by its name."""
        return {name: row for row, name in enumerate(self.names)}


_LATERAL_RESOLUTION_M: Final = 0.6
"""Width of SUMO's sublanes; rescue corridors need the sublane model."""
_JUMP_M: Final = 1.0
"""A vehicle that moves further than its speed explains by more than this has been teleported."""
_ROUTE_EDGES_AHEAD: Final = 6


class SumoSimulation:
    """One running SUMO simulation; a process holds one at a time (libsumo is global).

    Construction runs the warm-up. Then ``step(0)``, ``step(1)``, … advance by 0.05 s each. Use it as a
    context manager, or call ``close``.
    """

    _running: ClassVar[bool] = False
    _rules: ClassVar[Sequence[Rule]] = RULES
    """The rules that correct SUMO's drivers; a comparison without SIREN's behaviour has fewer."""

    def __init__(
        self,
        compiled_map: CompiledMap,
        network: RoadNetwork,
        plan: TrafficPlan,
        level: EmergencyLevel,
        seed: int = 0,
    ) -> None:
        """Start SUMO, run the warm-up and place the EMVs and their groups.

        The level sets the EMVs' privileges; ``seed`` is SUMO's own.

        Raises:
            EpisodeError: a simulation is already running in this process, or SUMO refuses a vehicle.
            MapError: SUMO refuses the net.
        """
        if SumoSimulation._running:
            raise EpisodeError("a SUMO simulation is already running in this process; close it first")
        self._left_hand = network.left_hand
        if self._left_hand:
            compiled_map, network = mirrored_map(compiled_map), right_hand_image(network)
        self._network, self._plan, self._level = network, plan, level
        self._siren = LEVEL_POLICIES[level].siren
        self._population = SumoPopulation(network, plan)
        self._mirror = Mirror(network, self._population, plan.traffic)
        self._crossings = CrossingWatch(network)
        self._walkers = Walkers(network, plan) if plan.walkers else None
        self._reactions = Reactions(network, plan, level)
        first = (*(vehicle.name for vehicle in plan.emvs), *((plan.av,) if plan.av else ()))
        self._keeping = frozenset(first)
        """Vehicles that yield to nobody."""
        self._ids: dict[str, int] = {name: number for number, name in enumerate(first, start=1)}
        self._seed, self._new_ids = seed, actor_ids(seed, len(first) + 1)
        self._reported: dict[int, PlannedVehicle] = {}
        self._routes: dict[str, tuple[int, ...]] = {}
        self._reached: dict[str, int] = {}
        """Place on its route that each vehicle has reached."""
        self._ahead: dict[str, tuple[int, ...]] = {}
        """Edges ahead of each vehicle from there on."""
        self._table = _Table.of({})
        self._route_rows: tuple[list[tuple[int, ...]], tuple[Indices, Indices]] = [], joined_rows([])
        self._signals: tuple[SignalState, ...] = ()
        self._acts = acts_of(Setting(network, plan, level), self._rules)
        try:
            self._start(compiled_map, seed)
            self._columns = SumoColumns(network, self._population.length_scale)
            self._road = Road(self._columns, self._population, self._mirror, self._walkers, self._reported)
            self._signal_ids = tuple(sorted(libsumo.trafficlight.getIDList()))
            self._warm_up()
        except BaseException as error:
            self.close()  # otherwise no further simulation could start in this process
            if isinstance(error, libsumo.TraCIException):
                raise EpisodeError(f"SUMO failed before the first step: {error}") from error
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @staticmethod
    def close() -> None:
        """End this process's SUMO; may be called twice."""
        if SumoSimulation._running:
            SumoSimulation._running = False
            libsumo.close()

    def step(self, step: int, simulated: ActorStates | None) -> TrafficState:
        """Advance SUMO to a step, one more than at the call before, starting at 0.

        ``simulated`` is the simulated world at ``step − 1``; None at step 0.

        Raises:
            EpisodeError: steps out of order, or SUMO moved a mirrored vehicle elsewhere.
        """
        expected = 0 if self._road.last is None else self._road.last.step + 1
        if step != expected:
            raise EpisodeError(f"SUMO is asked for step {step}, but the next one is {expected}")
        states = ActorStates.empty(step - 1) if simulated is None else simulated
        states = mirror_image(states) if self._left_hand else states
        try:
            last = self._road.last = self._advance(step, states)
        except libsumo.TraCIException as error:
            raise EpisodeError(f"SUMO failed at step {step}: {error}") from error
        joined = last if self._walkers is None else self._walkers.joined(last, states, self._new_ids)
        if joined.spawned and self._seed > MAX_SEED:
            told = (replace(actor, name=actor_name(self._seed, actor.name)) for actor in joined.spawned)
            joined = replace(joined, spawned=tuple(told))
        return mirror_image(joined) if self._left_hand else joined

    def _advance(self, step: int, states: ActorStates) -> TrafficState:
        road = self._road
        road.step = step
        yielding = states.actor_id[_YIELDS[states.mode]].tolist()
        road.asked.update(self._reported[actor_id].name for actor_id in yielding if actor_id in self._reported)
        self._apply(Moment.CAUTION)
        self._mirror.apply(states, self._reported, self._ids, self._ahead)
        if road.last is not None and self._population.civilians < self._plan.civilians:
            emvs = [emv.name for emv in self._plan.emvs]
            self._population.refill(self._points(states, emvs), self._plan.civilians)
        left = self._exchange_people(states) if step % _EXCHANGE_STEPS == 0 else []
        if self._walkers is not None:
            sirens = [self._ids[emv.name] for emv in self._plan.emvs] if self._siren else []
            self._walkers.heed(states, self._reported, np.array(sirens, np.uint32))
        self._apply(Moment.ORDERS)
        removed = self._removed((*left, *self._step_sumo()))
        self._mirror.check_placed(self._columns)
        return self._state(step, states, removed)

    def _apply(self, moment: Moment) -> None:
        """Lets the rules of a moment act."""
        for act in self._acts[moment]:
            act(self._road)

    def _exchange_people(self, states: ActorStates) -> list[str]:
        """Let people enter near the EMVs and the AV under test, and leave far from them; the riders who left."""
        first = self._road.last is None
        points = self._population.emv_starts if first else self._points(states, sorted(self._keeping))
        if not points:
            return []
        if self._walkers is not None:
            self._walkers.exchange(points, 0.0 if first else REPLACEMENT_DISTANCE_M)
        left = self._population.exchange_riders(points) if self._plan.riders and not first else []
        self._columns.leave_out(left)
        return left

    def _types(self, vehicles: Sequence[PlannedVehicle]) -> bytes:
        """The vehicle types that SUMO loads."""
        own = self._plan.own.xml if self._plan.own else ""
        return vehicle_types_xml(vehicles, self._level, walker_types_xml(self._plan.walkers) + own)

    def _more_options(self) -> Mapping[str, str]:
        """Further options of SUMO."""
        return self._plan.own.options if self._plan.own else {}

    def _start(self, compiled_map: CompiledMap, seed: int) -> None:
        plan = self._plan
        types = self._types((*plan.emvs, *plan.groups, *plan.background, *plan.reserve, *plan.riders))
        with tempfile.TemporaryDirectory(prefix="siren-") as folder:
            types_file = Path(folder) / "types.add.xml"
            types_file.write_bytes(types)
            options = {
                "--net-file": str(compiled_map.net_path),
                "--additional-files": str(types_file),
                "--step-length": f"{STEP_S:g}",
                "--lateral-resolution": f"{_LATERAL_RESOLUTION_M:g}",
                "--seed": str(seed % _LARGEST_SEED),
                "--collision.action": "none",
                "--time-to-teleport": "-1",
                "--insertion-checks": "none",
                "--no-step-log": "true",
                "--no-warnings": "true",
                **(WALKING_OPTIONS if self._walkers is not None else {}),
                **self._more_options(),
            }
            try:
                libsumo.start(["sumo", *(part for pair in options.items() for part in pair)])
            except (libsumo.TraCIException, RuntimeError) as error:
                if plan.own:
                    raise InputError("demand", plan.own.source, f"traffic that SUMO can load ({error})") from error
                raise MapError(str(compiled_map.net_path), f"a net that SUMO can load ({error})") from error
        SumoSimulation._running = True

    def _warm_up(self) -> None:
        for timing in (self._plan.signal, *self._plan.signals_behind):
            if timing is not None:
                time_signal(timing, self._plan.warm_up_steps * STEP_S)
        self._population.enter_background()
        for _ in range(self._plan.warm_up_steps):
            self._step_sumo()
            self._population.refill({}, len(self._plan.background))
        self._population.enter_stage()
        self._columns.leave_out(self._columns.row_of.keys() - self._population.vehicles.keys())

    def _step_sumo(self) -> Sequence[str]:
        """One step of SUMO; the vehicles that have left in it."""
        columns = self._columns
        self._road.outside = columns.which(self._mirror.places)
        self._apply(Moment.MOTION)
        self._road.asked.clear()
        libsumo.simulationStep()
        departed = self._population.drop_departed()
        self._population.take_in_own()
        if self._walkers is not None:
            self._walkers.drop_arrived()
        columns.take(libsumo.vehicle.getAllSubscriptionResults())
        if departed:
            columns.leave_out(departed)
        return departed

    def _removed(self, departed: Sequence[str]) -> list[int]:
        """Forgets vehicles; the ids of those that had one."""
        removed = []
        for name in departed:
            self._mirror.forget(name)
            self._reached.pop(name, None)
            self._ahead.pop(name, None)
            actor_id = self._ids.get(name)
            if actor_id in self._reported:
                del self._reported[actor_id]
                self._crossings.forget(actor_id)
                removed.append(actor_id)
        return sorted(removed)

    def _points(self, states: ActorStates, names: Sequence[str]) -> list[Point]:
        """Centres of those of some vehicles that are simulated."""
        there = [name for name in names if self._ids[name] in self._reported]
        rows = rows_of_ids(states.actor_id, np.array([self._ids[name] for name in there], np.uint32)).tolist()
        return [(float(states.x_m[row]), float(states.y_m[row])) for row in rows if row >= 0]

    def _spawn(self) -> tuple[ActorDescription, ...]:
        """Describe the vehicles that are new in SUMO; ids in order of entry, the EMVs' first."""
        if len(self._reported) == len(self._population.vehicles):
            return ()
        spawned = []
        in_sumo = frozenset(libsumo.vehicle.getIDList())
        for name, vehicle in self._population.vehicles.items():
            if name not in in_sumo or self._ids.get(name) in self._reported:
                continue
            if name not in self._ids:
                self._ids[name] = next(self._new_ids)
            actor_id = self._ids[name]
            self._reported[actor_id] = vehicle
            self._routes[name] = tuple(self._network.edge_by_id[edge].index for edge in vehicle.route)
            size = vehicle.length_m, vehicle.width_m, vehicle.height_m
            looks = vehicle.colour_rgb, vehicle.is_emv
            spawned.append(ActorDescription(actor_id, name, vehicle.actor_class, *size, *looks))
        return tuple(sorted(spawned, key=lambda description: description.actor_id))

    def _state(self, step: int, mirrored: ActorStates, removed: list[int]) -> TrafficState:
        spawned = self._spawn()
        if spawned or removed:
            self._table = _Table.of(self._reported)
        names, ids, lengths = self._table.names, self._table.actor_id, self._table.length_m
        self._apply(Moment.CORRECTION)
        rows = np.array([self._columns.row_of[name] for name in names], np.intp)
        readings = read_vehicles(self._columns, rows, lengths, self._network.sumo_offset_m)
        self._place_mirrored(readings)
        poses = readings.x_m, readings.y_m, readings.yaw_rad, readings.speed_mps
        motion = mirrored.x_m, mirrored.y_m, mirrored.yaw_rad, mirrored.vx_mps, mirrored.vy_mps
        (x, y, yaw, speed), owner = simulated(ids, poses, mirrored.actor_id, mirrored.owner, motion)
        offsets, edges = self._routes_of(names, readings.route_index.tolist())
        rescued = self._reactions.rescued(names, readings, offsets, edges)
        signals = self._signal_states()
        if self._siren:
            readings.lights[:] |= self._table.sirens
        return TrafficState(
            step=step,
            spawned=spawned,
            removed=np.array(removed, dtype=np.uint32),
            actor_id=ids,
            owner=owner,
            sumo_x_m=readings.x_m,
            sumo_y_m=readings.y_m,
            sumo_yaw_rad=readings.yaw_rad,
            sumo_speed_mps=readings.speed_mps,
            sumo_accel_mps2=readings.accel_mps2,
            x_m=x,
            y_m=y,
            yaw_rad=yaw,
            speed_mps=speed,
            lane=readings.lane,
            lane_position_m=readings.lane_position_m,
            lateral_offset_m=readings.lateral_m,
            lights=readings.lights,
            flags=self._reactions.flags(names, readings, rescued),
            route_offset=offsets,
            route_edges=edges,
            emvs=self._advice(rescued),
            signals=signals,
            events=self._events(step, readings, owner, speed),
        )

    def _signal_states(self) -> tuple[SignalState, ...]:
        """The states of all signals; the same object where none has changed."""
        states = [libsumo.trafficlight.getRedYellowGreenState(signal) for signal in self._signal_ids]
        if states != [signal.state for signal in self._signals]:
            self._signals = tuple(map(SignalState, self._signal_ids, states))
        return self._signals

    def _advice(self, rescued: Mapping[str, Sequence[str]]) -> tuple[EmvAdvice, ...]:
        """SUMO's advice for every EMV on the map; the civilians that ROS drives yield, and those who wait for a gap."""
        yielding = (self._mirror.places.keys() | self._mirror.deferred()) - self._keeping
        reach_m = PAPER_CONSTANTS.leader_query_m
        return tuple(
            emv_advice(emv.name, self._ids, yielding, reach_m, emv.driver.driving.min_gap_m, len(rescued[emv.name]))
            for emv in self._plan.emvs
            if self._ids[emv.name] in self._reported
        )

    def _place_mirrored(self, readings: Readings) -> None:
        """Replace SUMO's lane of vehicles that were put somewhere by the lane that they were put on."""
        for name, place in self._mirror.places.items():
            row = self._table.row_of.get(name)
            if row is not None:
                readings.lane[row] = place.match.lane
                readings.lane_position_m[row] = place.match.position_m
                readings.lateral_m[row] = place.match.lateral_m

    def _routes_of(self, names: Sequence[str], route_index: list[int]) -> tuple[Indices, Indices]:
        """Edges ahead of each vehicle, as one array with offsets (``joined_rows``)."""
        places, reached = self._mirror.places, self._reached
        routes = [
            self._ahead[name] if name not in places and reached.get(name) == index else self._route_of(name, index)
            for name, index in zip(names, route_index, strict=True)
        ]
        if routes != self._route_rows[0]:
            self._route_rows = routes, joined_rows(routes)
        return self._route_rows[1]

    def _route_of(self, name: str, index: int) -> tuple[int, ...]:
        """Edges ahead: from SUMO's place on the route, or for a mirrored vehicle from the lane that it was matched to.

        SUMO gives a mirrored vehicle another route where it finds it on another lane, and may find it at a later part
        of the route.
        """
        before, ahead = self._reached.get(name), self._ahead.get(name, ())
        place = self._mirror.places.get(name)
        reached = index
        if before is not None and place is not None:
            edge = NO_LANE if place.match.lane == NO_LANE else self._network.lanes[place.match.lane].edge
            reached = before + (ahead.index(edge) if edge in ahead else 0)
        elif before is not None and before != index and libsumo.vehicle.getRouteID(name) != route_id(name):
            reached = before
        if before != reached:
            self._reached[name] = reached
            self._ahead[name] = self._routes[name][max(reached, 0) :][:_ROUTE_EDGES_AHEAD]
        return self._ahead[name]

    def _events(self, step: int, readings: Readings, owner: Codes, speed_mps: Floats) -> tuple[Event, ...]:
        """Events of the step, given the simulated speeds."""
        ids, lengths_m = self._table.actor_id, self._table.length_m
        started = [self._ids[name] for name in libsumo.simulation.getStartingTeleportIDList() if name in self._ids]
        back = self._mirror.realigned
        events: list[Event] = find_teleports(
            step, ids, readings, lengths_m, owner, started, back, self._road.last, _JUMP_M
        )
        looked_at = self._crossings.elsewhere(ids, readings.lane)
        if back:
            looked_at = sorted({*looked_at, *np.flatnonzero(np.isin(ids, list(back))).tolist()})
        signals = {signal.signal_id: signal.state for signal in self._signals} if looked_at else {}
        for row in looked_at:
            actor_id, lane = int(ids[row]), int(readings.lane[row])
            x_m, y_m = float(readings.x_m[row]), float(readings.y_m[row])
            if actor_id in back:
                detail: dict[str, float | int | str] = {"residual_m": back[actor_id]}
                events.append(Event(step, EventKind.REALIGNED, actor_id, x_m=x_m, y_m=y_m, detail=detail))
            if lane != NO_LANE:
                passing_mps = speed_mps if owner[row] == Owner.ROS else readings.speed_mps
                mover = Mover(actor_id, lane, x_m, y_m, float(passing_mps[row]))
                events += self._crossings.watch(step, mover, signals)
        return tuple(events)


_OURS: Final = re.compile(rb' lcMaxSpeedLat(Standing|Factor)="[^"]*"')
"""Finds the parameters of lateral motion, because SUMO's own values let vehicles move sideways while they stand."""
_EMV_TYPE: Final = re.compile(rb'(vClass="emergency"[^>]*latAlignment=)"center"')
"""Finds the alignment in an EMV's type, because an EMV with the device needs the whole width of its lane."""


class BluelightSimulation(SumoSimulation):
    """Runs an episode's plan in SUMO alone, which also drives the EMVs and forms their corridor."""

    _rules = tuple(rule for rule in RULES if rule.moment in {Moment.ORDERS, Moment.CORRECTION})

    def _types(self, vehicles: Sequence[PlannedVehicle]) -> bytes:
        bare = [v if v.is_emv else replace(v, width_m=v.width_m - MIRRORS_M) for v in vehicles]
        return _EMV_TYPE.sub(rb'\1"arbitrary"', _OURS.sub(b"", super()._types(bare)))

    def _more_options(self) -> Mapping[str, str]:
        return {
            **super()._more_options(),
            "--device.bluelight.explicit": ",".join(vehicle.name for vehicle in self._plan.emvs),
        }
