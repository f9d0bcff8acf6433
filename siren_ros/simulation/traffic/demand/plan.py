"""A traffic plan: every vehicle of an episode and its driver, decided before SUMO starts.

The lanes along a route are addressed by one distance. The head of a jam, the foremost vehicle of each lane, stands, or
stops and goes, although the road ahead is free.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.params.parameters import FILES_ON_DISK, InputFiles, StrictMapping
from siren_ros.simulation.roads.road_network import Connection, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import TOWN_LIMIT_MPS
from siren_ros.simulation.scenario.driver_parameters import SumoEmvDriver, TrafficDrivers
from siren_ros.simulation.scenario.presets import DriverPreset, OncomingResponse, TruncatedNormal, read_distribution
from siren_ros.simulation.traffic.demand.own_demand import OwnDemand
from siren_ros.simulation.world.actors import TWO_WHEELED, VEHICLE_CLASSES, ActorClass, by_class


@dataclass(frozen=True)
class JamHead:
    """How the cause of a jam holds up the foremost vehicles, and how they move."""

    names: tuple[str, ...]
    moves: bool
    """Whether the vehicles go on after their first stop."""
    roll_s: float
    """Time for which the vehicles roll, first from step 0 on."""
    roll_mps: float
    stand_s: float
    """Time for which they then stand; rolling and standing alternate."""
    until_s: float = math.inf
    """Time at which the cause of the jam ends."""

    def speed_mps(self, step: int) -> float:
        """The speed that is ordered at a step. −1 is SUMO's code for no order; it holds after the cause has ended."""
        time_s = step * STEP_S
        if time_s >= self.until_s:
            return -1.0
        into_s = time_s % (self.roll_s + self.stand_s) if self.moves else time_s
        return self.roll_mps if into_s < self.roll_s else 0.0


LEAST_HEADWAY_S: Final = 0.3
"""Least time headway that a driver may have."""
CAR_FOLLOWING_MODELS: Final = ("IDM", "EIDM", "Krauss", "ACC")


PLACEMENT_GAP_M: Final = 9.0
"""Least gap between a vehicle's front and the rear of the next one at its first placement."""
_FAST_GAP_S: Final = 2.0
"""Least time of the same gap at the speed limit out of town, because no vehicle can start right in front of a fast
one."""


ENGINE_SPEED_MPS: Final = 80.0 / 3.6
"""Speed up to which every class has the acceleration of ``params/drivers``: the one of lorries on a motorway."""
_PROFILE_STEP_MPS: Final = 2.5


def least_gap_m(limit_mps: float) -> float:
    """Least gap before and behind a vehicle that is put on a lane with a speed limit."""
    return max(PLACEMENT_GAP_M, _FAST_GAP_S * limit_mps if limit_mps > TOWN_LIMIT_MPS else 0.0)


@dataclass(frozen=True)
class ClassDriving:
    """What a vehicle class is able to do in traffic, and how much of it drivers use."""

    accel_mps2: float
    decel_mps2: float
    min_gap_m: float
    max_speed_mps: float
    engine_mps2: float = math.inf
    """Acceleration that the engine gives at ``ENGINE_SPEED_MPS``: of faster drivers, that of the class."""

    @property
    def acceleration_profile(self) -> tuple[tuple[float, float], ...]:
        """Speeds and the acceleration at each, falling at constant power; empty where the engine limits nothing."""
        if math.isinf(self.engine_mps2):
            return ()
        speeds = np.arange(0.0, self.max_speed_mps + _PROFILE_STEP_MPS, _PROFILE_STEP_MPS)
        power = self.engine_mps2 * ENGINE_SPEED_MPS / np.maximum(speeds, 0.1)
        return tuple(zip(speeds.tolist(), np.minimum(power, self.accel_mps2).tolist(), strict=True))


_SAME: Final = TruncatedNormal(1.0, 0.0, 1.0, 1.0)


@dataclass(frozen=True)
class DriverPopulation:
    """Distributions and constants from which drivers are drawn."""

    car_following: str
    speed_factor: TruncatedNormal
    tau_s: TruncatedNormal
    max_lateral_speed_mps: float
    speed_gain_eagerness: float
    cooperation: float
    classes: Mapping[ActorClass, ClassDriving]
    gap_share: TruncatedNormal = _SAME
    """Standing distance of a civilian driver over that of the vehicle's class."""
    traffic: TrafficDrivers = field(default_factory=TrafficDrivers)
    """Parameters that are the same for all."""

    def by(self, traffic: TrafficDrivers) -> "DriverPopulation":
        """The population with the factors of some parameters, which it also keeps."""
        classes = {
            member: driving
            if member.is_emergency
            else replace(
                driving,
                accel_mps2=driving.accel_mps2 * traffic.accel_factor,
                engine_mps2=driving.accel_mps2 if traffic.accel_factor > 1.0 else math.inf,
                decel_mps2=driving.decel_mps2 * traffic.decel_factor,
                min_gap_m=driving.min_gap_m * traffic.gap_factor,
            )
            for member, driving in self.classes.items()
        }
        speed_factor, tau_s, gap_share = (
            replace(drawn, std=drawn.std * traffic.spread_factor)
            for drawn in (self.speed_factor, self.tau_s.scaled(traffic.headway_factor), self.gap_share)
        )
        return replace(
            self, speed_factor=speed_factor, tau_s=tau_s, gap_share=gap_share, classes=classes, traffic=traffic
        )

    def draw(self, actor_class: ActorClass, rng: np.random.Generator, speed_scale: float = 1.0) -> "DriverModel":
        """One driver of a vehicle of the given class; ``speed_scale`` scales the wished speed."""
        speed_factor, tau_s = self.speed_factor.draw(rng) * speed_scale, self.tau_s.draw(rng)
        sideways = self.max_lateral_speed_mps, self.speed_gain_eagerness, self.cooperation
        driving = self.classes[actor_class]
        if not actor_class.is_emergency:
            driving = replace(driving, min_gap_m=driving.min_gap_m * self.gap_share.draw(rng))
        return DriverModel(self.car_following, speed_factor, tau_s, *sideways, driving)


@dataclass(frozen=True)
class DriverModel:
    """SUMO's parameters of one driver."""

    car_following: str
    speed_factor: float
    """Wished speed over the speed limit."""
    tau_s: float
    max_lateral_speed_mps: float
    speed_gain_eagerness: float
    cooperation: float
    driving: ClassDriving


def load_drivers(name_or_path: str = "urban", files: InputFiles = FILES_ON_DISK) -> DriverPopulation:
    """A population of drivers by its name in ``params/drivers`` or from a YAML file.

    Raises:
        InputError: unknown name, or a mistake in the file (names file and line).
    """
    top = files.read("drivers", "drivers", name_or_path).mapping()
    top.text("title")
    classes = top.mapping("classes")
    population = DriverPopulation(
        car_following=top.text("car_following", CAR_FOLLOWING_MODELS),
        speed_factor=read_distribution(top.mapping("speed_factor"), 0.1, 2.0),
        tau_s=read_distribution(top.mapping("tau_s"), LEAST_HEADWAY_S, 5.0),
        max_lateral_speed_mps=top.number("max_lateral_speed_mps", 0.1, 3.0),
        speed_gain_eagerness=top.number("speed_gain_eagerness", 0.0, 10.0),
        cooperation=top.number("cooperation", 0.0, 1.0),
        classes=by_class(
            {
                member: _class_driving(classes.mapping(member.name.lower()))
                for member in VEHICLE_CLASSES
                # A class drives as its body if it has no row. Older records have no riders' classes.
                if (member.body is member and member not in TWO_WHEELED) or classes.has(member.name.lower())
            }
        ),
        # Older records have no spread.
        gap_share=read_distribution(top.mapping("gap_share"), 0.2, 5.0)
        if top.has("gap_share")
        else DriverPopulation.gap_share,
    )
    classes.finish()
    top.finish()
    return population


def _class_driving(section: StrictMapping) -> ClassDriving:
    driving = ClassDriving(
        accel_mps2=section.number("accel_mps2", 0.2, 8.0),
        decel_mps2=section.number("decel_mps2", 0.5, 9.0),
        min_gap_m=section.number("min_gap_m", 0.5, 10.0),
        max_speed_mps=section.number("max_speed_mps", 5.0, 100.0),
    )
    section.finish()
    return driving


@dataclass(frozen=True)
class Spot:
    """A place on a lane for a vehicle's front bumper, with the speed there."""

    lane: int
    """Index into ``RoadNetwork.lanes``."""
    front_m: float
    """Distance of the front bumper along the lane's centre line."""
    speed_mps: float


@dataclass(frozen=True)
class PlannedVehicle:
    """One vehicle: body, driver, route and place of entry."""

    name: str
    actor_class: ActorClass
    length_m: float
    width_m: float
    height_m: float
    colour_rgb: tuple[int, int, int]
    driver: DriverModel
    route: tuple[str, ...]
    """Edge ids; the first is the spot's edge."""
    spot: Spot
    is_emv: bool = False
    attentive: bool = True
    """Whether the driver sees an EMV that crosses against a signal or sign."""
    oncoming_share: float = 1.0
    """Share of the wished speed to which the driver slows down for an EMV from ahead; 1 for no reaction."""
    rescue_m: float = math.inf
    """Distance to an EMV with a siren within which the driver forms a rescue lane; infinite for who does unasked."""
    filters: bool = False
    """Whether a motorcyclist follows an EMV through the rescue lane."""
    lane_change_s: float | None = None
    """Time of lane changes that no EMV asks for; None for the usual one."""

    @property
    def sideways(self) -> tuple[float, float]:
        """Lateral speed and acceleration of lane changes that no EMV asks for."""
        usual_mps = self.driver.max_lateral_speed_mps
        return (usual_mps, _ACROSS_MPS2) if self.lane_change_s is None else sideways(self.lane_change_s, usual_mps)


_ACROSS_M: Final = 3.25
"""Way across in a lane change: a lane of a town's main road (RASt 06)."""
_ACROSS_MPS2: Final = 1.0
"""Lateral acceleration of lane changes (SUMO's ``lcAccelLat``)."""


def sideways(duration_s: float, usual_mps: float) -> tuple[float, float]:
    """Lateral speed and acceleration of a lane change, from standing still across to standing still again.

    SUMO accelerates up to the speed, and brakes as hard. A driver who takes longer than at the usual speed has a lower
    one; a driver who is faster does the same as usual in a shorter time.
    """
    usual_s = _ACROSS_M / usual_mps + usual_mps / _ACROSS_MPS2
    if duration_s <= usual_s:
        faster = usual_s / duration_s
        return usual_mps * faster, _ACROSS_MPS2 * faster**2
    reached_mps = _ACROSS_MPS2 * duration_s
    return 0.5 * (reached_mps - math.sqrt(reached_mps**2 - 4.0 * _ACROSS_MPS2 * _ACROSS_M)), _ACROSS_MPS2


@dataclass(frozen=True)
class PlannedWalker:
    """A pedestrian: body, place of entry and ways to go."""

    name: str
    length_m: float
    width_m: float
    height_m: float
    colour_rgb: tuple[int, int, int]
    """Colour of the clothes."""
    speed_mps: float
    edge: str
    place_m: float
    """Distance of the place of entry along the edge."""
    goals: tuple[str, ...]
    """Edges with a sidewalk that the pedestrian walks to in turn."""
    notice_m: float = 0.0
    """Distance at which the pedestrian responds to an EMV with a siren."""
    attentive: bool = True
    """Whether the pedestrian looks out for vehicles, as in ``PlannedVehicle``."""


@dataclass(frozen=True)
class LaneInterval:
    """A stretch of a lane, from and to in metres along its centre line."""

    lane: int
    from_m: float
    to_m: float


YELLOW_DRIVEN_S: Final = 1.8
"""Time before the line at which every driver who sees yellow drives on: 1 s to react, and too near to stop from 30 km/h
with 5 m/s². What a programme's yellow is longer stays between the last vehicle and the red."""
RED_BEHIND_S: Final = 1.2
"""Time from the last platoon vehicle's crossing of the stop line to the red. It is no parameter, but a usual time."""

BEFORE_EMV_S: Final = 0.4
"""Least time from the beginning of the red to the EMV's arrival, so that it meets a red however late the platoon is."""


@dataclass(frozen=True)
class SignalTiming:
    """Where in its programme a signal is at the episode's start."""

    signal_id: str
    link: int
    """Index into the signal's state string."""
    red_from_s: float
    """Time from step 0 on at which the link's red begins; negative where it is red already."""
    crossing: tuple[int, ...] = ()
    """Links of the movements that are to cross during this red. If their green begins later, the red is timed by it."""
    platoon: tuple[str, ...] = ()
    """Vehicles for which the green is extended. It ends when a detector has seen the last of them (gap-out control)."""
    emv: str = ""
    """Vehicle before whose arrival the green ends in any case."""
    emv_from_s: float = 0.0
    """Time from step 0 on before which that vehicle cannot arrive."""
    approach: tuple[int, ...] = ()
    """Links of the lanes on which the vehicles come; one signal may have others behind them. Empty for all."""
    beside: tuple[str, ...] = ()
    """Further vehicles that keep their lanes up to the signal, as the platoon does."""


@dataclass(frozen=True)
class TrafficPlan:
    """All vehicles of an episode, in the order in which they enter."""

    emvs: tuple[PlannedVehicle, ...]
    groups: tuple[PlannedVehicle, ...]
    """Civilians placed around the EMV's start; with the EMVs they enter at step 0."""
    background: tuple[PlannedVehicle, ...]
    """Civilians that enter before the warm-up, around the groups."""
    reserve: tuple[PlannedVehicle, ...]
    """Vehicles that replace those that leave, in this order, if their places are free."""
    stage: tuple[LaneInterval, ...]
    """Stretches on which EMVs and groups start. Background vehicles are removed from them at step 0."""
    civilians: int
    """Number of civilians to keep in the network."""
    warm_up_steps: int
    response_distance_m: float
    """Distance at which drivers hear the siren."""
    signal: SignalTiming | None = None
    """Timing of the signal on the EMV's way; None where all signals run as the map says."""
    signals_behind: tuple[SignalTiming, ...] = ()
    """Timings of the signals behind the end of a road, which are coordinated with it."""
    crossed: str = ""
    """Junction at which further EMVs cross the way of the first; empty where none does."""
    jam: JamHead | None = None
    """What holds up the foremost vehicles; None where only traffic holds vehicles up."""
    duty: bool = False
    """Whether drivers open a rescue lane in slow traffic out of town."""
    riders: tuple[PlannedVehicle, ...] = ()
    """Cyclists and motorcyclists. Those with free places enter at step 0, the others when one has left."""
    riders_kept: Mapping[ActorClass, int] = field(default_factory=dict)
    """Number of each class to keep in the network."""
    walkers: tuple[PlannedWalker, ...] = ()
    """Pedestrians. The first ``walkers_kept`` enter at step 0, the others when one has arrived."""
    walkers_kept: int = 0
    uncrossed: str = ""
    """Junction at which no pedestrian crosses a street; empty for none."""
    traffic: TrafficDrivers = field(default_factory=TrafficDrivers)
    """Parameters of all drivers."""
    own: OwnDemand | None = None
    """The user's traffic, which is then the only background."""
    attention: tuple[int, float, OncomingResponse] = (0, 1.0, OncomingResponse())
    """Seed and shares by which its drivers respond, as ``with_responses`` draws them for all others."""
    av: str = ""
    """Name of the civilian that an external controller drives; empty for none. It has the first id after the EMVs'."""


def with_responses(plan: TrafficPlan, preset: DriverPreset, seed: int) -> TrafficPlan:
    """The plan with the preset's shares of attentive drivers and of those who react to an EMV that comes towards them.

    And with the distances at which pedestrians heed one, the share of motorcyclists who filter behind one, and the time
    that each driver takes for a lane change.

    Each driver has draws of its own, whatever else is drawn, but for the rescue lane: a jam's drivers do as those ahead
    of them, so that one draw says what they all do.
    """
    attentive, oncoming, filtering = preset.attention.civilians, preset.oncoming, preset.filtering

    def among(share: float, stream: str, index: int) -> bool:
        return share >= 1.0 or (share > 0.0 and bool(random_stream(seed, stream, index).random() < share))

    unasked = 0.0 if preset.rescue_at_once >= 1.0 else random_stream(seed, "rescue_lane").random()
    late = unasked - preset.rescue_at_once < preset.rescue_late

    def rescue_m(purpose: str, index: int) -> float:
        if unasked < preset.rescue_at_once:
            return math.inf
        return preset.rescue_near_m.draw(random_stream(seed, f"rescue_lane/{purpose}", index)) if late else 0.0

    def drawn(purpose: str) -> tuple[PlannedVehicle, ...]:
        return tuple(
            replace(
                vehicle,
                attentive=among(attentive, f"attention/{purpose}", index),
                oncoming_share=oncoming.speed_share if among(oncoming.share, f"oncoming/{purpose}", index) else 1.0,
                rescue_m=rescue_m(purpose, index) if plan.duty else vehicle.rescue_m,
                lane_change_s=_lane_change_s(preset, seed, purpose, index),
            )
            for index, vehicle in enumerate(getattr(plan, purpose))
        )

    riders = tuple(
        replace(rider, filters=rider.actor_class is ActorClass.MOTORCYCLE and among(filtering, "filtering", index))
        for index, rider in enumerate(plan.riders)
    )
    distance = preset.pedestrian_distance_m
    walkers = tuple(
        replace(walker, notice_m=distance.draw(random_stream(seed, "siren/pedestrians", index)))
        for index, walker in enumerate(plan.walkers)
    )
    background, reserve = drawn("background"), drawn("reserve")
    plan = replace(plan, walkers=walkers, riders=riders, attention=(seed, attentive, oncoming))
    return replace(plan, groups=drawn("groups"), background=background, reserve=reserve)


def _lane_change_s(preset: DriverPreset, seed: int, purpose: str, index: int) -> float | None:
    drawn = preset.lane_change_log_s
    return None if drawn is None else math.exp(drawn.draw(random_stream(seed, f"lane_change/{purpose}", index)))


def with_emv_drivers(plan: TrafficPlan, sumo: SumoEmvDriver) -> TrafficPlan:
    """The plan with the given values for the drivers of EMVs; values that are None change nothing."""
    given = {name: value for name, value in vars(sumo).items() if value is not None}
    driving = {name: given.pop(name) for name in ("accel_mps2", "decel_mps2", "min_gap_m") if name in given}
    emvs = tuple(
        replace(emv, driver=replace(emv.driver, **given, driving=replace(emv.driver.driving, **driving)))
        for emv in plan.emvs
    )
    return replace(plan, emvs=emvs)


@dataclass(frozen=True)
class LaneChain:
    """Lanes that follow each other, junction paths included; distances count from the first lane's start."""

    lanes: tuple[int, ...]
    start_m: tuple[float, ...]
    """Distance at which each lane starts."""
    end_m: float

    def place(self, network: RoadNetwork, distance_m: float) -> tuple[int, float] | None:
        """Lane and position at a distance; None beyond the ends and inside junctions."""
        if not 0.0 <= distance_m < self.end_m:
            return None
        last = max(i for i, start in enumerate(self.start_m) if start <= distance_m)
        lane = network.lanes[self.lanes[last]]
        return None if lane.kind is LaneKind.INTERNAL else (lane.index, distance_m - self.start_m[last])

    def intervals(self, network: RoadNetwork, from_m: float, to_m: float) -> tuple[LaneInterval, ...]:
        """The stretches of lanes between two distances."""
        intervals = []
        for lane, start in zip(self.lanes, self.start_m, strict=True):
            low, high = max(from_m - start, 0.0), min(to_m - start, network.lanes[lane].length_m)
            if low < high:
                intervals.append(LaneInterval(lane, low, high))
        return tuple(intervals)


def chain_along(network: RoadNetwork, lane: Lane, edges: Sequence[int]) -> LaneChain:
    """The chain from a lane along a route's edges; ``edges[0]`` is the lane's own edge.

    Where a lane does not lead to the next edge, the chain goes on from the nearest lane of the edge that does.
    """
    lanes = [lane.index]
    for following in edges[1:]:
        step = connection_onward(network, network.lanes[lanes[-1]], following)
        if step is None:
            break
        lanes += [*step.via, step.to_lane]
    return chain_of(network, lanes)


def chain_of(network: RoadNetwork, lanes: Sequence[int]) -> LaneChain:
    """The chain of lanes that follow each other."""
    ends = tuple(accumulate((network.lanes[lane].length_m for lane in lanes), initial=0.0))
    return LaneChain(tuple(lanes), ends[:-1], ends[-1])


def connection_onward(network: RoadNetwork, lane: Lane, following: int) -> Connection | None:
    """The movement from a lane to an edge, the first of ``connections_onward``; None where there is none."""
    return next(iter(connections_onward(network, lane, following)), None)


def connections_onward(network: RoadNetwork, lane: Lane, following: int) -> tuple[Connection, ...]:
    """The movements from a lane to an edge; where there are none, from the nearest driving lane of the same edge."""
    siblings = [network.lanes[index] for index in network.edges[lane.edge].lanes]
    for source in sorted(siblings, key=lambda other: (abs(other.position - lane.position), other.position)):
        movements = network.connections_from.get(source.index, ()) if source.kind is LaneKind.DRIVING else ()
        targets = ((network.lanes[movement.to_lane], movement) for movement in movements)
        found = tuple(movement for to, movement in targets if to.edge == following and to.kind is LaneKind.DRIVING)
        if found:
            return found
    return ()
