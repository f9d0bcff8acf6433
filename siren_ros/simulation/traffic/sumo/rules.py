"""Every rule that tells SUMO's drivers what SUMO's own models do not know, in the order in which they act.

A new rule is a class in a file of its own and a row of ``RULES``. ``SumoSimulation`` makes the rules of an episode and
calls them at their moments. The rules about making way are here:

* Drivers open a rescue lane in slow traffic, before any siren, and keep it open: they keep to the side of their lane,
  and do not change lanes across the corridor.
* Motorcyclists who filter ride through the rescue lane behind an EMV, past vehicles that stand next to it: they keep to
  that edge of their lane at which the rescue lane is, so that others who keep to the other edge are beside them. Where
  somebody is too wide for that, they stay behind.
* Oncoming drivers slow down and keep right for an EMV with a siren on undivided roads, until it has passed. The EMV may
  need the middle of such a road, and a driver who sees it come cannot know that it will not.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Final

import libsumo
import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Codes, Flags, Floats, Rows
from siren_ros.base.numerics.compiled import compiled
from siren_ros.simulation.conflicts.junction_approach import NOBODY
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.simulation.roads.routing import opposite_edges, rescue_sides
from siren_ros.simulation.scenario.paper import LEVEL_POLICIES, EmergencyLevel, LevelPolicy
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle, TrafficPlan
from siren_ros.simulation.traffic.sumo.caution import CautiousDrivers
from siren_ros.simulation.traffic.sumo.driving_corrections import (
    BendLimits,
    CyclistsSide,
    LaneContinuity,
    SidewaysLimits,
)
from siren_ros.simulation.traffic.sumo.mirror import DEFAULT_LANE_CHANGE_MODE, KEEP_LANE_CHANGE_MODE, Mirror
from siren_ros.simulation.traffic.sumo.orders import GapOut, JamOrders, RouteEnds, StandOffs
from siren_ros.simulation.traffic.sumo.population import SumoPopulation
from siren_ros.simulation.traffic.sumo.readings import ANGLE, SPEED, SumoColumns, X, Y
from siren_ros.simulation.traffic.sumo.walkers import Walkers
from siren_ros.simulation.traffic.sumo.yellow import DriversAtYellow
from siren_ros.simulation.world.actors import MIRRORS_M, Indices, Owner, TrafficState, rows_of_ids

# These are no parameters: studies vary the share of those who filter.
FASTEST_MPS: Final = 30.0 / 3.6
"""Largest speed of motorcyclists who filter: 30 km/h, where the law permits it (New South Wales, Road Rules 2014,
151A)."""
KEEPS_M: Final = 12.0
"""Distance between the front bumpers that a rider keeps behind an EMV: an ambulance of 6 m and a gap."""
_HEADWAY_S: Final = 1.5
WITHIN_M: Final = 250.0
"""Largest distance behind an EMV at which a rider filters; farther behind, the rescue lane is for the next EMV. A
vehicle moves sideways only while it drives: in stop-and-go traffic half a minute passes until one who stands has the
space to leave the row."""
BESIDE_M: Final = (-10.0, 40.0)
"""Least and greatest distance ahead at which waiting vehicles count. Riders who have come past them drive as usual."""
NEXT_M: Final = 150.0
"""Distance behind a rider within which another EMV forbids filtering."""
ROAD_M: Final = 15.0
"""Lateral distance beyond which a vehicle is on another road, on a straight road."""
BEND: Final = 0.3
"""Share of the distance ahead that is added to it in bends: enough 200 m ahead in a bend of 360 m radius."""
_MARGIN_M: Final = 0.2
"""Margin that is added to a rider's width, which is measured over the mirrors."""
_STEP_MPS: Final = 0.5
"""Speeds are multiples of this, so that they are seldom set."""


def _on_road(riders: Floats, others: Floats) -> tuple[Floats, Flags]:
    """How far ahead of each rider each of the others is, and whether they are on the same road."""
    dx, dy = others[0] - riders[0, :, None], others[1] - riders[1, :, None]
    sin, cos = np.sin(np.radians(riders[2, :, None])), np.cos(np.radians(riders[2, :, None]))
    ahead_m, aside_m = sin * dx + cos * dy, cos * dx - sin * dy
    near = np.abs(aside_m) < ROAD_M + BEND * np.abs(ahead_m)
    return ahead_m, near & (np.cos(np.radians(others[2] - riders[2, :, None])) > 0.5)


def passing(riders: Floats, others: Floats) -> Flags:
    """Which riders have somebody beside them or close ahead, of others who wait; arguments as for the speeds."""
    ahead_m, same = _on_road(riders, others)
    return np.any(same & (ahead_m > BESIDE_M[0]) & (ahead_m < BESIDE_M[1]), axis=1)


def filter_speeds_mps(riders: Floats, emvs: Floats) -> Floats:
    """How fast each rider follows the nearest EMV that has passed, shape ``(N,)``; 0 for those who do not follow one.

    Both are x, y and angle of the front bumper, shape ``(3, N)``; angles are SUMO's: clockwise from north.
    """
    ahead_m, same = _on_road(riders, emvs)
    passed, comes = same & (ahead_m > KEEPS_M), same & (ahead_m <= KEEPS_M) & (ahead_m > -NEXT_M)
    gap_m = np.where(passed, ahead_m, np.inf).min(axis=1, initial=np.inf)
    follows = (gap_m < WITHIN_M) & ~comes.any(axis=1)
    wished = np.clip((np.minimum(gap_m, WITHIN_M) - KEEPS_M) / _HEADWAY_S, 0.0, FASTEST_MPS)
    return np.where(follows, np.maximum(_STEP_MPS * np.floor(wished / _STEP_MPS), _STEP_MPS), 0.0)


class FilteringRiders:
    """Tells SUMO the width and the speed of riders who filter."""

    def __init__(self, network: RoadNetwork) -> None:
        self._limit_mps = np.array([lane.speed_limit_mps for lane in network.lanes])
        self._beside = np.zeros(len(network.lanes) + 1, np.bool_)
        """Whether a lane is beside the rescue lane; the last one is that off the road."""
        leftmost = np.flatnonzero(rescue_sides(network) > 0).tolist()
        for lane in (network.lanes[index] for index in leftmost):
            edge = network.edges[lane.edge].lanes
            self._beside[[index for index in edge if network.lanes[index].position >= lane.position - 1]] = True
        self._told: dict[str, float] = {}
        """Speed factors of those who filter."""

    def apply(
        self, columns: SumoColumns, vehicles: Mapping[str, PlannedVehicle], slow: Flags, emvs: Sequence[str]
    ) -> Flags:
        """Decides who filters in SUMO's next step, among riders who keep to a side in slow traffic (``slow``)."""
        rides = columns.which([name for name, vehicle in vehicles.items() if vehicle.filters])
        rows = np.flatnonzero(rides & slow & self._beside[np.where(columns.lane == NO_LANE, -1, columns.lane)])
        poses = columns.numbers[[X, Y, ANGLE]]
        rows = rows[passing(poses[:, rows], poses[:, slow & ~rides])]
        speeds_mps = filter_speeds_mps(poses[:, rows], poses[:, columns.which(emvs)])
        rows, speeds_mps = rows[speeds_mps > 0.0], speeds_mps[speeds_mps > 0.0]
        factors = (speeds_mps / self._limit_mps[columns.lane[rows]]).tolist()
        now = {columns.names[row]: factor for row, factor in zip(rows.tolist(), factors, strict=True)}
        for name in sorted((now.keys() | self._told.keys()) & columns.row_of.keys()):
            vehicle, factor = vehicles[name], now.get(name)
            if (factor is None) != (name not in self._told):
                libsumo.vehicle.setWidth(name, vehicle.width_m + (MIRRORS_M if factor is None else _MARGIN_M))
            if factor != self._told.get(name):
                libsumo.vehicle.setSpeedFactor(name, vehicle.driver.speed_factor if factor is None else factor)
        self._told = now
        return columns.which(now)


Sides = npt.NDArray[np.int8]

# These are no parameters: the law says at which pace the corridor has to be open.
FORMS_BELOW_MPS: Final = 11.1
"""Speed below which drivers open the rescue lane. Drivers who slow down to 40 km/h out of town come to a jam, in which
the corridor has to be open at walking pace; a vehicle moves sideways only while it drives."""
ENDS_ABOVE_MPS: Final = 16.7
"""Speed above which traffic flows again, so that vehicles go back to the middle of their lanes: 60 km/h."""
COMES_WITHIN_M: Final = 150.0
"""Distance to slow vehicles ahead within which faster drivers open the rescue lane and stay in their lane: nobody
drives past the end of a jam into the corridor. From 130 km/h one comes to a stand within it at 4.3 m/s²."""
_ROAD_M: Final = 15.0
"""Lateral distance beyond which vehicles are on another carriageway, or far behind a bend."""
_ALIGNMENTS: Final = {1: "left", -1: "right", 0: "center"}


def kept_sides(side: Sides, before: Sides, speed_mps: Floats, comes: Flags) -> Sides:
    """The side to which each driver keeps: that of its lane in slow traffic, and as before between the two speeds.

    ``side`` is that of each driver's lane, ``before`` the one kept at the step before; 0 is the middle. ``comes`` says
    who has a jam close ahead.
    """
    slow = speed_mps < np.where(before != 0, ENDS_ABOVE_MPS, FORMS_BELOW_MPS)
    return np.where(slow | comes, side, np.int8(0))


def coming_to_jam(x_m: Floats, y_m: Floats, angle_deg: Floats, speed_mps: Floats, on_road: Flags) -> Flags:
    """Which vehicles have a slow one close ahead on their road; ``on_road`` is who is on a road with the duty.

    Angles are SUMO's: clockwise from north.
    """
    slow = np.flatnonzero(on_road & (speed_mps < FORMS_BELOW_MPS))
    fast = np.flatnonzero(on_road & (speed_mps >= FORMS_BELOW_MPS))
    dx, dy = x_m[slow] - x_m[fast, None], y_m[slow] - y_m[fast, None]
    sin, cos = np.sin(np.radians(angle_deg[fast, None])), np.cos(np.radians(angle_deg[fast, None]))
    ahead_m, aside_m = sin * dx + cos * dy, cos * dx - sin * dy
    same = np.cos(np.radians(angle_deg[slow] - angle_deg[fast, None])) > 0.5
    near = same & (ahead_m > 0.0) & (ahead_m < COMES_WITHIN_M) & (np.abs(aside_m) < _ROAD_M)
    comes = np.zeros(len(x_m), np.bool_)
    comes[fast] = np.any(near, axis=1)
    return comes


def forming(x_m: Floats, y_m: Floats, within_m: Floats, sirens: Flags) -> Flags:
    """Which drivers form the lane: unasked, with an infinite distance ``within_m``, or with a siren within it."""
    forms = np.isinf(within_m)
    for row in np.flatnonzero(sirens).tolist():
        forms |= np.hypot(x_m - x_m[row], y_m - y_m[row]) < within_m
    return forms


class RescueLane:
    """Tells SUMO which drivers keep to the side."""

    def __init__(self, network: RoadNetwork, *, filtering: bool, siren: bool) -> None:
        """Takes the road network, whether a motorcyclist may filter, and whether EMVs sound a siren."""
        self._siren = siren
        self._side_of_lane = np.append(rescue_sides(network), np.int8(0))
        """By lane; the last one is that off the road."""
        self._kept: dict[str, int] = {}
        """The side of the drivers who keep to one."""
        self._riders = FilteringRiders(network) if filtering else None

    def apply(
        self, columns: SumoColumns, vehicles: Mapping[str, PlannedVehicle], outside: Flags, emvs: Sequence[str]
    ) -> None:
        """Moves drivers to the side when they slow down, and back to the middle when they drive on.

        Vehicles that are moved from outside, and EMVs, are left alone; whoever comes back from there is told again.
        """
        names, kept = columns.names, self._kept
        before = np.array([kept.get(name, 0) for name in names], np.int8)
        side = self._side_of_lane[np.where(columns.lane == NO_LANE, -1, columns.lane)]
        numbers = columns.numbers
        comes = coming_to_jam(numbers[X], numbers[Y], numbers[ANGLE], numbers[SPEED], side != 0)
        sides = kept_sides(side, before, numbers[SPEED], comes)
        within_m = np.array([vehicles[name].rescue_m if name in vehicles else np.inf for name in names])
        sirens = columns.which(emvs if self._siren else ())
        sides[(before == 0) & ~forming(numbers[X], numbers[Y], within_m, sirens)] = 0
        sides[outside | columns.which(emvs)] = 0
        if self._riders is not None:
            sides = np.where(self._riders.apply(columns, vehicles, sides != 0, emvs), -sides, sides)
        for row in np.flatnonzero(sides != before).tolist():
            name, now = names[row], int(sides[row])
            if not outside[row]:
                libsumo.vehicle.setLateralAlignment(name, _ALIGNMENTS[now])
                libsumo.vehicle.setLaneChangeMode(name, KEEP_LANE_CHANGE_MODE if now else DEFAULT_LANE_CHANGE_MODE)
        self._kept = {names[row]: int(sides[row]) for row in np.flatnonzero(sides).tolist()}

    @property
    def keeping(self) -> Collection[str]:
        """Names of the drivers who keep to a side."""
        return self._kept.keys()


_ROUTE_EDGES: Final = 3
"""Number of edges of the EMV's route, from its own on, whose opposite side is searched for drivers."""
_NO_EDGE: Final = -1
_BY_SUMO: Final = int(Owner.SUMO)


class OncomingDrivers:
    """Tells SUMO which drivers keep right and slow down."""

    def __init__(self, network: RoadNetwork, reach_m: float) -> None:
        """Takes the distance ahead of the EMV at which drivers notice the siren (``reach_m``)."""
        self._edge_of_lane = np.array([lane.edge for lane in network.lanes], np.int32)
        self._opposite = np.full(len(network.edges), _NO_EDGE, np.int32)
        for edge, other in opposite_edges(network).items():
            self._opposite[edge] = other
        self._reach_m = reach_m
        self._slowed: frozenset[int] = frozenset()

    def apply(self, traffic: TrafficState | None, vehicles: Mapping[int, PlannedVehicle]) -> None:
        """Slows down drivers who meet an EMV, and frees those who do not meet it any more.

        ``traffic`` is the state before SUMO's next step, None before the first one; ``vehicles`` are those in it.
        """
        emvs = [actor_id for actor_id, vehicle in vehicles.items() if vehicle.is_emv]
        meeting = frozenset() if traffic is None else self.meeting(traffic, emvs)
        for actor_id in sorted(self._slowed ^ meeting):
            vehicle = vehicles.get(actor_id)
            if vehicle is None or vehicle.oncoming_share >= 1.0:
                continue
            slows = actor_id in meeting
            share = vehicle.oncoming_share if slows else 1.0
            libsumo.vehicle.setSpeedFactor(vehicle.name, share * vehicle.driver.speed_factor)
            libsumo.vehicle.setLateralAlignment(vehicle.name, "right" if slows else "center")
        self._slowed = meeting

    def slowed(self, vehicles: Mapping[int, PlannedVehicle]) -> set[str]:
        """Names of those who keep right."""
        met = (vehicles[actor_id] for actor_id in self._slowed if actor_id in vehicles)
        return {vehicle.name for vehicle in met if vehicle.oncoming_share < 1.0}

    def meeting(self, traffic: TrafficState, emvs: Collection[int]) -> frozenset[int]:
        """Ids of the actors that SUMO drives and that come towards an EMV on the other side of its road."""
        rows = rows_of_ids(traffic.actor_id, np.array(sorted(emvs), np.uint32))
        met = (self._rows(traffic, row) for row in rows[rows >= 0].tolist())
        return frozenset(actor for others in met for actor in traffic.actor_id[others].tolist())

    def _rows(self, traffic: TrafficState, emv: int) -> Rows:
        edges = self._opposite[traffic.route_of_row(emv)[:_ROUTE_EDGES]]
        drivers = traffic.owner, traffic.lane, self._edge_of_lane
        poses = traffic.x_m, traffic.y_m, traffic.yaw_rad
        return _ahead_on(edges, drivers, poses, emv, self._reach_m)


@compiled
def _ahead_on(
    edges: Indices,
    drivers: tuple[Codes, Indices, Indices],
    poses: tuple[Floats, Floats, Floats],
    emv: int,
    reach_m: float,
) -> Rows:
    """Rows of SUMO's vehicles that are on some edges, within reach ahead of the EMV in a row."""
    (owner, lane, edge_of_lane), (x_m, y_m, yaw_rad) = drivers, poses
    cos, sin = np.cos(yaw_rad[emv]), np.sin(yaw_rad[emv])
    rows, count = np.empty(len(lane), np.intp), 0
    for row in range(len(lane)):
        dx, dy = x_m[row] - x_m[emv], y_m[row] - y_m[emv]
        if owner[row] != _BY_SUMO or lane[row] == NO_LANE or not cos * dx + sin * dy > 0.0:
            continue
        edge = edge_of_lane[lane[row]]
        if np.hypot(dx, dy) < reach_m and np.any(edges == edge):
            rows[count] = row
            count += 1
    return rows[:count]


class Moment(Enum):
    """When in a step a rule acts."""

    CAUTION = auto()
    """The rule acts first, before SUMO's vehicles are moved to where they are in the simulated world."""
    ORDERS = auto()
    """The rule acts after vehicles and people have entered and left."""
    MOTION = auto()
    """The rule acts right before SUMO's step, also in the warm-up."""
    CORRECTION = auto()
    """The rule acts after SUMO's step and corrects what SUMO has done."""


@dataclass(frozen=True, eq=False)
class Setting:
    """What an episode's rules are made for."""

    network: RoadNetwork
    plan: TrafficPlan
    level: EmergencyLevel

    @property
    def policy(self) -> LevelPolicy:
        """What the level allows EMVs."""
        return LEVEL_POLICIES[self.level]

    @property
    def emvs(self) -> tuple[str, ...]:
        """Names of the EMVs."""
        return tuple(emv.name for emv in self.plan.emvs)


@dataclass(eq=False)
class Road:
    """What rules see: SUMO's vehicles, people and the state before."""

    columns: SumoColumns
    population: SumoPopulation
    mirror: Mirror
    walkers: Walkers | None
    reported: Mapping[int, PlannedVehicle]
    """The vehicles of the last state, by actor id."""
    step: int = 0
    """The step that SUMO comes to next."""
    last: TrafficState | None = None
    """The state of the step before, without the people on foot; None before the first."""
    outside: Flags = field(default_factory=lambda: np.empty(0, np.bool_))
    """Which of the columns' vehicles are moved from outside; known in ``Moment.MOTION``."""
    asked: set[str] = field(default_factory=set)
    """Names of the drivers who make way in this step; complete from ``Moment.MOTION`` on."""

    @property
    def vehicles(self) -> Mapping[str, PlannedVehicle]:
        """The vehicles in SUMO, by name."""
        return self.population.vehicles


Act = Callable[[Road], None]
"""What a rule does in each step."""


@dataclass(frozen=True)
class Rule:
    """One rule for SUMO's drivers."""

    name: str
    moment: Moment
    make: Callable[[Setting], Act | None]
    """Makes it for an episode; None where the episode has nobody whom it concerns."""
    about: str


def _caution(setting: Setting) -> Act:
    drivers = CautiousDrivers(setting.network)

    def act(road: Road) -> None:
        people = NOBODY if road.walkers is None else road.walkers.people
        drivers.apply(road.last, road.reported, people, road.population.scale_of)

    return act


def _oncoming(setting: Setting) -> Act | None:
    if not setting.policy.siren:
        return None
    drivers = OncomingDrivers(setting.network, setting.plan.response_distance_m)

    def act(road: Road) -> None:
        drivers.apply(road.last, road.reported)
        road.asked.update(drivers.slowed(road.reported))

    return act


def _stand_offs(setting: Setting) -> Act:
    rule = StandOffs(frozenset(setting.emvs) if setting.policy.privileged else None)

    def act(road: Road) -> None:
        rule.apply(road.last, road.reported, road.columns.names, road.walkers.waiting if road.walkers else ())

    return act


def _route_ends(setting: Setting) -> Act | None:
    if setting.policy.privileged:
        return None
    ends = RouteEnds(setting.plan.emvs)
    return lambda road: ends.apply(road.columns.row_of)


def _gap_out(setting: Setting) -> Act | None:
    if setting.plan.signal is None:
        return None
    gap_out = GapOut(setting.plan.signal)
    return lambda road: gap_out.apply(road.vehicles.keys())


def _jam(setting: Setting) -> Act | None:
    if setting.plan.jam is None:
        return None
    orders = JamOrders(setting.plan.jam)
    return lambda road: orders.apply(road.step, road.vehicles.keys() - road.mirror.places.keys())


def _sideways(_: Setting) -> Act:
    limits = SidewaysLimits()
    return lambda road: limits.apply(road.columns, road.vehicles, road.outside, road.asked)


def _bends(setting: Setting) -> Act:
    limits = BendLimits(setting.network)
    return lambda road: limits.apply(road.columns, road.vehicles, road.outside)


def _cyclists(setting: Setting) -> Act | None:
    if not setting.plan.riders:
        return None
    side = CyclistsSide(setting.network)
    return lambda road: side.apply(road.columns, road.vehicles)


def _rescue_lane(setting: Setting) -> Act | None:
    if not setting.plan.duty:
        return None
    filtering = any(vehicle.filters for vehicle in (*setting.plan.groups, *setting.plan.riders))
    lane, emvs = RescueLane(setting.network, filtering=filtering, siren=setting.policy.siren), setting.emvs

    def act(road: Road) -> None:
        lane.apply(road.columns, road.vehicles, road.outside, emvs)
        road.asked.update(lane.keeping)

    return act


def _yellow(setting: Setting) -> Act | None:
    drivers = DriversAtYellow(setting.network)
    return (lambda road: drivers.apply(road.last, road.reported)) if drivers.movements else None


def _continuity(setting: Setting) -> Act:
    continuity = LaneContinuity(setting.network)

    def act(road: Road) -> None:
        moved = [road.reported[actor_id].name for actor_id in road.mirror.realigned if actor_id in road.reported]
        continuity.correct(road.columns, {*road.mirror.places, *moved})

    return act


RULES: Final = (
    Rule("caution", Moment.CAUTION, _caution, "drivers wait for vehicles from outside, and for people on crossings"),
    Rule("oncoming", Moment.CAUTION, _oncoming, "drivers who meet an EMV with a siren slow down and keep right"),
    Rule("yellow", Moment.CAUTION, _yellow, "who could not stop gently at yellow drives on"),
    Rule("stand-offs", Moment.ORDERS, _stand_offs, "for whom drivers on a junction need not wait"),
    Rule("route ends", Moment.ORDERS, _route_ends, "EMVs that SUMO drives stop where their route ends"),
    Rule("gap out", Moment.ORDERS, _gap_out, "a green waits for the platoon and ends behind it"),
    Rule("jam", Moment.ORDERS, _jam, "the head of a jam stands, or stops and goes"),
    Rule("rescue lane", Moment.MOTION, _rescue_lane, "drivers in slow traffic open a rescue lane; some riders filter"),
    Rule("sideways", Moment.MOTION, _sideways, "vehicles move sideways by driving"),
    Rule("bends", Moment.MOTION, _bends, "vehicles slow down for the bends ahead"),
    Rule("cyclists", Moment.MOTION, _cyclists, "cyclists ride in the middle of a cycle lane, else on the right"),
    Rule("continuity", Moment.CORRECTION, _continuity, "who changes to a lane of another length stays where it is"),
)
"""Every rule for SUMO's drivers, in the order in which they act within their moment."""


def acts_of(setting: Setting, rules: Sequence[Rule] = RULES) -> dict[Moment, tuple[Act, ...]]:
    """What the rules of an episode do, by the moment at which they do it."""
    made = [(rule.moment, rule.make(setting)) for rule in rules]
    return {moment: tuple(act for when, act in made if when is moment and act is not None) for moment in Moment}
