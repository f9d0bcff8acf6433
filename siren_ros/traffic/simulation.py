"""SUMO in lockstep with the simulated world: poses in, the traffic's state out."""

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, Final, Self

import libsumo
import numpy as np

from siren_ros.errors import EpisodeError, MapError
from siren_ros.numerics.arrays import Codes, Floats, Ids
from siren_ros.numerics.units import STEP_S
from siren_ros.roads.maps.map_compiler import CompiledMap
from siren_ros.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.scenario.paper import LEVEL_POLICIES, EmergencyLevel
from siren_ros.traffic.config import TrafficConfig
from siren_ros.traffic.demand.plan import PlannedVehicle, TrafficPlan
from siren_ros.traffic.observation import CrossingWatch, Mover, Reactions, find_teleports
from siren_ros.traffic.sumo.caution import CautiousDrivers
from siren_ros.traffic.sumo.driving_corrections import BendLimits, LaneContinuity, SidewaysLimits
from siren_ros.traffic.sumo.mirror import Mirror
from siren_ros.traffic.sumo.population import SumoPopulation, route_id, vehicle_types_xml
from siren_ros.traffic.sumo.readings import Readings, emv_advice, joined_rows, read_vehicles
from siren_ros.traffic.sumo.signal_timing import GapOut, time_signal
from siren_ros.world.actors import ActorDescription, ActorStates, Lights, Owner, rows_of_ids
from siren_ros.world.traffic_state import EmvAdvice, Event, EventKind, SignalState, TrafficState

_LARGEST_SEED: Final = 2**31 - 1


class SumoSimulation:
    """One running SUMO simulation; a process holds one at a time (libsumo is global).

    Construction runs the warm-up. Then ``step(0)``, ``step(1)``, … advance by 0.05 s each. Use it as a
    context manager, or call ``close``.
    """

    _running: ClassVar[bool] = False

    def __init__(
        self,
        compiled: CompiledMap,
        network: RoadNetwork,
        plan: TrafficPlan,
        level: EmergencyLevel,
        config: TrafficConfig | None = None,
        seed: int = 0,
    ) -> None:
        """Start SUMO, run the warm-up and place the EMVs and their groups.

        The level sets the EMVs' privileges and SUMO's bluelight device; ``seed`` is SUMO's own.

        Raises:
            EpisodeError: a simulation is already running in this process, or SUMO refuses a vehicle.
            MapError: SUMO refuses the net.
        """
        if SumoSimulation._running:
            raise EpisodeError("a SUMO simulation is already running in this process; close it first")
        self._network = network
        self._plan = plan
        self._level = level
        self._config = config or TrafficConfig()
        self._population = SumoPopulation(network, plan, self._config)
        self._mirror = Mirror(network, self._config, self._population)
        self._sideways = SidewaysLimits()
        self._cautious = CautiousDrivers(network, self._config.caution)
        self._crossings = CrossingWatch(network)
        self._reactions = Reactions(network, plan, level, self._config)
        first = (*(vehicle.name for vehicle in plan.emvs), *((plan.av,) if plan.av else ()))
        self._ids: dict[str, int] = {name: number for number, name in enumerate(first, start=1)}
        self._next_id = len(first) + 1
        self._reported: dict[int, PlannedVehicle] = {}
        self._routes: dict[str, tuple[int, ...]] = {}
        self._route_ahead: dict[str, tuple[int, tuple[int, ...]]] = {}
        self._gap_out = GapOut(plan.signal) if plan.signal is not None else None
        self._last: TrafficState | None = None
        self._results: Mapping[str, dict[int, Any]] = {}
        """SUMO's answers of the last step, by vehicle."""
        try:
            self._start(compiled, seed)
            self._continuity = LaneContinuity(network, self._population.length_scale)
            self._bends = BendLimits(network, self._population.length_scale)
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

    def close(self) -> None:
        """End SUMO; may be called twice."""
        if SumoSimulation._running:
            SumoSimulation._running = False
            libsumo.close()

    def step(self, step: int, mirrored: ActorStates | None) -> TrafficState:
        """Advance SUMO to a step, one more than at the call before, starting at 0.

        ``mirrored`` is the simulated world at ``step − 1``; None at step 0.

        Raises:
            EpisodeError: steps out of order, or SUMO moved a mirrored vehicle elsewhere.
        """
        expected = 0 if self._last is None else self._last.step + 1
        if step != expected:
            raise EpisodeError(f"SUMO is asked for step {step}, but the next one is {expected}")
        states = ActorStates.empty(step - 1) if mirrored is None else mirrored
        try:
            self._last = self._advance(step, states)
        except libsumo.TraCIException as error:
            raise EpisodeError(f"SUMO failed at step {step}: {error}") from error
        return self._last

    def _advance(self, step: int, states: ActorStates) -> TrafficState:
        ahead = {name: edges for name, (_, edges) in self._route_ahead.items()}
        self._cautious.apply(self._last, self._reported)
        self._mirror.apply(states, self._reported, ahead)
        if self._last is not None:
            self._population.refill(self._emv_points(states), self._plan.civilians)
        if self._gap_out is not None:
            self._gap_out.apply(self._population.vehicles.keys())
        self._step_sumo()
        removed = self._drop_departed()
        self._mirror.check_placed()
        return self._state(step, states, removed)

    def _start(self, compiled: CompiledMap, seed: int) -> None:
        vehicles = (*self._plan.emvs, *self._plan.groups, *self._plan.background, *self._plan.reserve)
        types = vehicle_types_xml(vehicles, self._level, self._plan.response_distance_m, self._config)
        with tempfile.TemporaryDirectory(prefix="siren-") as folder:
            types_file = Path(folder) / "types.add.xml"
            types_file.write_bytes(types)
            options = {
                "--net-file": str(compiled.net_path),
                "--additional-files": str(types_file),
                "--step-length": f"{STEP_S:g}",
                "--lateral-resolution": f"{self._config.lateral_resolution_m:g}",
                "--seed": str(seed % _LARGEST_SEED),
                "--collision.action": "none",
                "--time-to-teleport": "-1",
                "--insertion-checks": "none",
                "--no-step-log": "true",
                "--no-warnings": "true",
            }
            try:
                libsumo.start(["sumo", *(part for pair in options.items() for part in pair)])
            except (libsumo.TraCIException, RuntimeError) as error:
                raise MapError(str(compiled.net_path), f"a net that SUMO can load ({error})") from error
        SumoSimulation._running = True

    def _warm_up(self) -> None:
        if self._plan.signal is not None:
            time_signal(self._plan.signal, self._plan.warm_up_steps * STEP_S)
        self._population.enter_background()
        for _ in range(self._plan.warm_up_steps):
            self._step_sumo()
            self._population.drop_departed()
            self._population.refill({}, len(self._plan.background))
        self._population.enter_stage()

    def _step_sumo(self) -> None:
        vehicles = self._population.vehicles
        known = {name: result for name, result in self._results.items() if name in vehicles}
        self._sideways.apply(known, vehicles, self._mirror.places)
        self._bends.apply(known, vehicles, self._mirror.places)
        libsumo.simulationStep()
        self._results = libsumo.vehicle.getAllSubscriptionResults()

    def _drop_departed(self) -> list[int]:
        removed = []
        for name in self._population.drop_departed():
            self._mirror.forget(name)
            self._cautious.forget(name)
            self._route_ahead.pop(name, None)
            actor_id = self._ids.get(name)
            if actor_id in self._reported:
                del self._reported[actor_id]
                self._crossings.forget(actor_id)
                removed.append(actor_id)
        return sorted(removed)

    def _emv_points(self, states: ActorStates) -> Mapping[str, tuple[float, float]]:
        points = {}
        for row in range(len(states)):
            vehicle = self._reported.get(int(states.actor_id[row]))
            if vehicle is not None and vehicle.is_emv:
                points[vehicle.name] = (float(states.x_m[row]), float(states.y_m[row]))
        return points

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
                self._ids[name] = self._next_id
                self._next_id += 1
            actor_id = self._ids[name]
            self._reported[actor_id] = vehicle
            self._routes[name] = tuple(self._network.edge_by_id[edge].index for edge in vehicle.route)
            size = vehicle.length_m, vehicle.width_m, vehicle.height_m
            looks = vehicle.colour_rgb, vehicle.is_emv
            spawned.append(ActorDescription(actor_id, name, vehicle.actor_class, *size, *looks))
        return tuple(sorted(spawned, key=lambda description: description.actor_id))

    def _state(self, step: int, mirrored: ActorStates, removed: list[int]) -> TrafficState:
        spawned = self._spawn()
        actor_ids = sorted(self._reported)
        names = [self._reported[actor_id].name for actor_id in actor_ids]
        lengths = np.array([self._reported[actor_id].length_m for actor_id in actor_ids])
        moved = {self._reported[actor_id].name for actor_id in self._mirror.realigned if actor_id in self._reported}
        self._continuity.correct(self._results, {*self._mirror.places, *moved})
        readings = read_vehicles(self._results, names, lengths, self._network, self._population.length_scale)
        self._place_mirrored(names, readings)
        ids = np.array(actor_ids, dtype=np.uint32)
        source = rows_of_ids(mirrored.actor_id, ids)
        known = source >= 0
        routes = [self._route_of(name, int(index)) for name, index in zip(names, readings.route_index, strict=True)]
        offsets, edges = joined_rows(routes)

        def simulated(field: Floats, fallback: Floats) -> Floats:
            return np.where(known, field[source], fallback) if len(field) else fallback.copy()

        owner = np.where(known, mirrored.owner[source], Owner.SUMO) if len(mirrored) else np.zeros(len(ids))
        x, y = simulated(mirrored.x_m, readings.x_m), simulated(mirrored.y_m, readings.y_m)
        rescued = self._reactions.rescued(names, readings, routes)
        signals = {signal: libsumo.trafficlight.getRedYellowGreenState(signal) for signal in self._signal_ids}
        if LEVEL_POLICIES[self._level].siren:
            emvs = [self._reported[actor_id].is_emv for actor_id in actor_ids]
            readings.lights[emvs] |= np.uint8(Lights.BEACON | Lights.SIREN)
        speed = simulated(mirrored.speed_mps, readings.speed_mps)
        passing_mps = np.where(owner == Owner.ROS, speed, readings.speed_mps)
        events = self._events(step, ids, readings, lengths, passing_mps, owner.astype(np.uint8), signals)
        return TrafficState(
            step=step,
            spawned=spawned,
            removed=np.array(removed, dtype=np.uint32),
            actor_id=ids,
            owner=owner.astype(np.uint8),
            sumo_x_m=readings.x_m,
            sumo_y_m=readings.y_m,
            sumo_yaw_rad=readings.yaw_rad,
            sumo_speed_mps=readings.speed_mps,
            sumo_accel_mps2=readings.accel_mps2,
            x_m=x,
            y_m=y,
            yaw_rad=simulated(mirrored.yaw_rad, readings.yaw_rad),
            speed_mps=speed,
            lane=readings.lane,
            lane_position_m=readings.lane_position_m,
            lateral_offset_m=readings.lateral_m,
            lights=readings.lights,
            flags=self._reactions.flags(names, readings, rescued),
            route_offset=offsets,
            route_edges=edges,
            emvs=self._advice(rescued),
            signals=tuple(SignalState(signal, state) for signal, state in signals.items()),
            events=events,
        )

    def _advice(self, rescued: Mapping[str, Sequence[str]]) -> tuple[EmvAdvice, ...]:
        """SUMO's advice for every EMV on the map; the civilians that ROS drives yield."""
        keeping = {self._plan.av, *(vehicle.name for vehicle in self._plan.emvs)}
        yielding = self._mirror.places.keys() - keeping
        reach_m = self._config.leader_range_m
        return tuple(
            emv_advice(emv.name, self._ids, yielding, reach_m, emv.driver.driving.min_gap_m, len(rescued[emv.name]))
            for emv in self._plan.emvs
            if self._ids[emv.name] in self._reported
        )

    def _place_mirrored(self, names: list[str], readings: Readings) -> None:
        """Replace SUMO's lane of vehicles that were put somewhere by the lane that they were put on."""
        for row, name in enumerate(names):
            place = self._mirror.places.get(name)
            if place is not None:
                readings.lane[row] = place.match.lane
                readings.lane_position_m[row] = place.match.position_m
                readings.lateral_m[row] = place.match.lateral_m

    def _route_of(self, name: str, index: int) -> tuple[int, ...]:
        """Edges ahead: from SUMO's place on the route, or for a mirrored vehicle from the lane that it was matched to.

        SUMO gives a mirrored vehicle another route where it finds it on another lane, and may find it at a later part
        of the route.
        """
        cached = self._route_ahead.get(name)
        place = self._mirror.places.get(name)
        reached = index
        if cached is not None and place is not None:
            edge = NO_LANE if place.match.lane == NO_LANE else self._network.lanes[place.match.lane].edge
            reached = cached[0] + (cached[1].index(edge) if edge in cached[1] else 0)
        elif cached is not None and cached[0] != index and libsumo.vehicle.getRouteID(name) != route_id(name):
            reached = cached[0]
        if cached is None or cached[0] != reached:
            cached = (reached, self._routes[name][max(reached, 0) :][: self._config.route_edges_ahead])
            self._route_ahead[name] = cached
        return cached[1]

    def _events(
        self,
        step: int,
        ids: Ids,
        readings: Readings,
        lengths_m: Floats,
        speed_mps: Floats,
        owner: Codes,
        signals: Mapping[str, str],
    ) -> tuple[Event, ...]:
        """Events of the step; ``speed_mps`` is SUMO's, and for vehicles that ROS drives the simulated one."""
        started = [self._ids[name] for name in libsumo.simulation.getStartingTeleportIDList() if name in self._ids]
        jump_m, back = self._config.jump_m, self._mirror.realigned
        events: list[Event] = find_teleports(step, ids, readings, lengths_m, owner, started, back, self._last, jump_m)
        for row, (actor_id, lane) in enumerate(zip(ids.tolist(), readings.lane.tolist(), strict=True)):
            if actor_id not in back and (lane == NO_LANE or self._crossings.is_on(actor_id, lane)):
                continue
            x_m, y_m = float(readings.x_m[row]), float(readings.y_m[row])
            if actor_id in back:
                detail: dict[str, float | int | str] = {"residual_m": back[actor_id]}
                events.append(Event(step, EventKind.REALIGNED, actor_id, x_m=x_m, y_m=y_m, detail=detail))
            if lane != NO_LANE:
                mover = Mover(actor_id, lane, x_m, y_m, float(speed_mps[row]))
                events += self._crossings.watch(step, mover, signals)
        return tuple(events)
