"""Every rule that tells SUMO's drivers what SUMO's own models do not know, in the order in which they act.

A new rule is a class in a file of its own and a row of ``RULES``. ``SumoSimulation`` makes the rules of an episode and
calls them at their moments.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags
from siren_ros.simulation.conflicts.people import NOBODY
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.scenario.paper import LEVEL_POLICIES, EmergencyLevel, LevelPolicy
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle, TrafficPlan
from siren_ros.simulation.traffic.sumo.caution import CautiousDrivers
from siren_ros.simulation.traffic.sumo.driving_corrections import (
    BendLimits,
    CyclistsSide,
    LaneContinuity,
    SidewaysLimits,
)
from siren_ros.simulation.traffic.sumo.mirror import Mirror
from siren_ros.simulation.traffic.sumo.oncoming import OncomingDrivers
from siren_ros.simulation.traffic.sumo.population import SumoPopulation
from siren_ros.simulation.traffic.sumo.readings import SumoColumns
from siren_ros.simulation.traffic.sumo.rescue_lane import RescueLane
from siren_ros.simulation.traffic.sumo.signal_timing import GapOut
from siren_ros.simulation.traffic.sumo.stage_orders import JamOrders, RouteEnds
from siren_ros.simulation.traffic.sumo.standoff import StandOffs
from siren_ros.simulation.traffic.sumo.walkers import Walkers
from siren_ros.simulation.world.traffic_state import TrafficState


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
    return lambda road: drivers.apply(road.last, road.reported)


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
    return lambda road: limits.apply(road.columns, road.vehicles, road.outside)


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
    lane, emvs = RescueLane(setting.network, filtering=filtering), setting.emvs
    return lambda road: lane.apply(road.columns, road.vehicles, road.outside, emvs)


def _continuity(setting: Setting) -> Act:
    continuity = LaneContinuity(setting.network)

    def act(road: Road) -> None:
        moved = [road.reported[actor_id].name for actor_id in road.mirror.realigned if actor_id in road.reported]
        continuity.correct(road.columns, {*road.mirror.places, *moved})

    return act


RULES: Final = (
    Rule("caution", Moment.CAUTION, _caution, "drivers wait for vehicles from outside, and for people on crossings"),
    Rule("oncoming", Moment.CAUTION, _oncoming, "drivers who meet an EMV with a siren slow down and keep right"),
    Rule("stand-offs", Moment.ORDERS, _stand_offs, "for whom drivers on a junction need not wait"),
    Rule("route ends", Moment.ORDERS, _route_ends, "EMVs that SUMO drives stop where their route ends"),
    Rule("gap out", Moment.ORDERS, _gap_out, "a green waits for the platoon and ends behind it"),
    Rule("jam", Moment.ORDERS, _jam, "the head of a jam stands, or stops and goes"),
    Rule("sideways", Moment.MOTION, _sideways, "vehicles move sideways by driving"),
    Rule("bends", Moment.MOTION, _bends, "vehicles slow down for the bends ahead"),
    Rule("cyclists", Moment.MOTION, _cyclists, "cyclists ride in the middle of a cycle lane, else on the right"),
    Rule("rescue lane", Moment.MOTION, _rescue_lane, "drivers in slow traffic open a rescue lane; some riders filter"),
    Rule("continuity", Moment.CORRECTION, _continuity, "who changes to a lane of another length stays where it is"),
)
"""Every rule for SUMO's drivers, in the order in which they act within their moment."""


def acts_of(setting: Setting, rules: Sequence[Rule] = RULES) -> dict[Moment, tuple[Act, ...]]:
    """What the rules of an episode do, by the moment at which they do it."""
    made = [(rule.moment, rule.make(setting)) for rule in rules]
    return {moment: tuple(act for when, act in made if when is moment and act is not None) for moment in Moment}
