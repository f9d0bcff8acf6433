"""View of all controllers: the actors at one step, and constant facts of an episode."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Ids, Rows
from siren_ros.base.numerics.braking import braking_distance_m
from siren_ros.base.numerics.compiled import compiled
from siren_ros.base.numerics.units import steps_from_s
from siren_ros.simulation.behaviour.driving.lane_path import lanes_along, nearest_on_lane, path_on_lanes
from siren_ros.simulation.behaviour.driving.tracked_path import LanePath, Navigation
from siren_ros.simulation.conflicts.course import CourseBook, Outlook
from siren_ros.simulation.conflicts.junction_approach import NOBODY, LineBook, Outlines, outlines_of, people_at
from siren_ros.simulation.conflicts.yielding import JunctionRoom, Margins
from siren_ros.simulation.dynamics.vehicle_model import VehicleParameters
from siren_ros.simulation.roads.road_network import RoadNetwork, mirror_image
from siren_ros.simulation.roads.routing import rescue_sides
from siren_ros.simulation.scenario.driver_parameters import CivilianDriver, DriverParameters, EmvDriver
from siren_ros.simulation.scenario.paper import (
    PAPER_CONSTANTS,
    PAPER_SPEEDS,
    ControlConstants,
    LevelPolicy,
    TargetSpeeds,
)
from siren_ros.simulation.scenario.presets import DriverPreset
from siren_ros.simulation.world.actors import (
    NO_ACTOR,
    TWO_WHEELED,
    ActorClass,
    ActorDescription,
    Indices,
    Lights,
    TrafficState,
    indicator_to,
    rows_of_ids,
)
from siren_ros.simulation.world.commands import VehicleCommands

_INDICATORS: Final = int(Lights.INDICATORS)


@dataclass(frozen=True)
class Body:
    """Half length and half width of a footprint."""

    half_length_m: float
    half_width_m: float


@dataclass(frozen=True)
class ActorTable:
    """Descriptions of all present actors; arrays sorted by id."""

    by_id: Mapping[int, ActorDescription]
    actor_id: Ids
    length_m: Floats
    width_m: Floats
    is_emv: npt.NDArray[np.bool_]
    walks: npt.NDArray[np.bool_]
    rides: npt.NDArray[np.bool_]
    """Whether an actor is a cyclist or motorcyclist."""

    @classmethod
    def of(cls, descriptions: Mapping[int, ActorDescription]) -> "ActorTable":
        """Make the table from descriptions."""
        rows = [descriptions[actor_id] for actor_id in sorted(descriptions)]
        return cls(
            by_id=dict(descriptions),
            actor_id=np.array([row.actor_id for row in rows], dtype=np.uint32),
            length_m=np.array([row.length_m for row in rows], dtype=np.float64),
            width_m=np.array([row.width_m for row in rows], dtype=np.float64),
            is_emv=np.array([row.is_emv for row in rows], dtype=np.bool_),
            rides=np.array([row.actor_class in TWO_WHEELED for row in rows], dtype=np.bool_),
            walks=np.array([row.actor_class is ActorClass.PEDESTRIAN for row in rows], dtype=np.bool_),
        )

    @classmethod
    @cache
    def empty(cls) -> "ActorTable":
        """Make a table without actors."""
        return cls.of({})

    def updated(self, traffic: TrafficState) -> "ActorTable":
        """The table after the spawns and removals of a step."""
        if not traffic.spawned and len(traffic.removed) == 0:
            return self
        gone = {int(actor_id) for actor_id in traffic.removed}
        left = {key: value for key, value in self.by_id.items() if key not in gone}
        return self.of(left | {actor.actor_id: actor for actor in traffic.spawned})


SEEN_COS, SEEN_SIN, SEEN_SPEED, SEEN_HALF_LENGTH, SEEN_HALF_WIDTH, SEEN_SQUARE = range(3, 9)
"""Rows of ``Surroundings.bodies`` after ``X``, ``Y`` and ``YAW``; the last is the square of the speed."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Poses and sizes of all actors at one step, row by row those of the ``TrafficState``; frame ``map``."""

    actor_id: Ids
    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    cos: Floats
    sin: Floats
    speed_mps: Floats
    half_length_m: Floats
    half_width_m: Floats
    is_emv: npt.NDArray[np.bool_]
    outlook: Outlook | None = None
    """Predicted paths of all vehicles; None means straight ahead."""
    people: Floats = field(default_factory=lambda: NOBODY)
    """Pedestrians, as ``people_at`` gives them."""
    riders: Rows = field(default_factory=lambda: np.empty(0, np.intp))
    """Rows of cyclists and motorcyclists."""

    @cached_property
    def bodies(self) -> Floats:
        """All as one array, shape ``(9, N)``: ``X``, ``Y``, ``YAW`` and then ``SEEN_COS`` until ``SEEN_SQUARE``.

        The square is as Python's ``v**2`` gives it.
        """
        poses, motion = (self.x_m, self.y_m, self.yaw_rad, self.cos, self.sin), self.speed_mps
        squares = np.power(motion, np.full(len(motion), 2.0))
        return np.array((*poses, motion, self.half_length_m, self.half_width_m, squares))

    @classmethod
    def seen(
        cls,
        traffic: TrafficState,
        table: ActorTable,
        book: CourseBook | None = None,
        crossings: Outlines | None = None,
    ) -> "Surroundings":
        """Actors of a step; with the map's courses, also an outlook on their paths.

        People on foot count where the crossings are given.

        Raises:
            KeyError: an actor of the step was never described.
        """
        if len(table.actor_id) == len(traffic) and (table.actor_id == traffic.actor_id).all():
            rows: npt.NDArray[np.intp] | slice = slice(None)
        else:
            rows = rows_of_ids(table.actor_id, traffic.actor_id)
            if np.any(rows < 0):
                raise KeyError(int(traffic.actor_id[np.argmax(rows < 0)]))
        half_length, half_width = 0.5 * table.length_m[rows], 0.5 * table.width_m[rows]
        poses = (traffic.x_m, traffic.y_m, traffic.yaw_rad, np.cos(traffic.yaw_rad), np.sin(traffic.yaw_rad))
        outlook = None if book is None else Outlook(traffic, book, half_length, half_width)
        people, (walkers,) = NOBODY, np.nonzero(table.walks[rows])
        if crossings is not None and len(walkers):
            walking = traffic.x_m, traffic.y_m, traffic.yaw_rad, traffic.speed_mps
            x_m, y_m, yaw_rad, speed_mps = (column[walkers] for column in walking)
            people = people_at(traffic.actor_id[walkers], (x_m, y_m, yaw_rad, speed_mps), crossings)
        sizes = half_length, half_width, table.is_emv[rows]
        return cls(
            traffic.actor_id, *poses, traffic.speed_mps, *sizes, outlook, people, np.flatnonzero(table.rides[rows])
        )

    def near(self, x_m: float, y_m: float, radius_m: float, but: int = -1) -> npt.NDArray[np.intp]:
        """Rows of the actors within a radius, except row ``but``."""
        return _near(self.x_m, self.y_m, x_m, y_m, radius_m, but)


@compiled
def _near(xs_m: Floats, ys_m: Floats, x_m: float, y_m: float, radius_m: float, but: int) -> Rows:
    rows = np.empty(xs_m.shape[0], np.intp)
    count = 0
    for row in range(xs_m.shape[0]):
        dx, dy = xs_m[row] - x_m, ys_m[row] - y_m
        if dx * dx + dy * dy < radius_m * radius_m and row != but:
            rows[count] = row
            count += 1
    return rows[:count]


STEER_RATE_SHARE: Final = 0.8
"""Share of the vehicle's steering rate that a path may need."""


@dataclass(frozen=True)
class BehaviourWorld:
    """Constant facts of an episode."""

    network: RoadNetwork
    policy: LevelPolicy
    vehicles: Mapping[ActorClass, VehicleParameters]
    preset: DriverPreset
    seed: int
    av_id: int = NO_ACTOR
    """A civilian with an external controller; it does not yield by itself."""
    constants: ControlConstants = PAPER_CONSTANTS
    speeds: TargetSpeeds = PAPER_SPEEDS
    duty: bool = False
    """Whether drivers keep a rescue lane open in slow traffic out of town."""
    config: DriverParameters = field(default_factory=DriverParameters)
    left_hand: bool = False
    """Whether traffic keeps left; ``network`` is then the map's mirror image, in which all drivers decide."""

    def seen(self, traffic: TrafficState) -> TrafficState:
        """Traffic of the map in the drivers' view (mirrored for left-hand traffic)."""
        return mirror_image(traffic) if self.left_hand else traffic

    def said(self, commands: VehicleCommands) -> VehicleCommands:
        """Drivers' commands in the frame of the map."""
        return mirror_image(commands) if self.left_hand else commands

    @cached_property
    def edge_of_lane(self) -> Indices:
        """Edge of each lane of the network."""
        return np.array([lane.edge for lane in self.network.lanes], dtype=np.int32)

    @cached_property
    def lane_length_m(self) -> Floats:
        """Length of each lane."""
        return np.array([lane.length_m for lane in self.network.lanes])

    @cached_property
    def rescue_sides(self) -> npt.NDArray[np.int8]:
        """Side to which drivers of each lane move for a rescue lane."""
        return rescue_sides(self.network)

    @cached_property
    def courses(self) -> CourseBook:
        """Courses along the lanes of the network."""
        return CourseBook(self.network)

    @cached_property
    def crossings(self) -> Outlines:
        """Outlines of the crossings of the network."""
        return outlines_of(self.network)

    @cached_property
    def junction_room(self) -> JunctionRoom:
        """Places on the map's junctions where the paths of others begin."""
        return JunctionRoom(self.network)

    @cached_property
    def emv_navigator(self) -> Navigation:
        """How EMVs drive at this level: how early they count with crossing vehicles, how close they follow and pass."""
        emv, attention = self.config.emv_driver, self.preset.attention
        horizon_s = min(Margins().horizon_s, attention.emv_horizon_s)
        conflicts = Margins.of(emv.conflicts, attention.emv_pet_s, horizon_s)
        gap_m = emv.escape_gap_m if self.policy.corridor else emv.driving.standstill_gap_m
        return Navigation.by(emv.driving, conflicts=conflicts, standstill_gap_m=gap_m)

    @cached_property
    def civilian_navigator(self) -> Navigation:
        """Navigation of civilians."""
        civilian, usual = self.config.civilian_driver, Margins()
        return Navigation.by(civilian.driving, conflicts=Margins.of(civilian.conflicts, usual.after_s, usual.horizon_s))

    @cached_property
    def room_navigator(self) -> Navigation:
        """Navigation of a civilian that moves up close behind others to make way."""
        return replace(
            self.civilian_navigator, standstill_gap_m=self.config.civilian_driver.pull_over.room_standstill_gap_m
        )

    @cached_property
    def lines(self) -> LineBook:
        """Speeds of EMVs at lines at which others have the right of way."""
        return LineBook(self.network, self.config.emv_driver.lines, self.preset.attention, self.seed)

    @cached_property
    def drivers(self) -> Mapping[tuple[ActorClass, bool], Navigation]:
        """Navigation by class and by whether it is an EMV, with the limit of the vehicle's steering."""
        drivers = {}
        for actor_class, vehicle in self.vehicles.items():
            for is_emv in (False, True):
                base = self.config.emv_driver.driving if is_emv else self.config.civilian_driver.driving
                rate = vehicle.curvature_rate_1pms(STEER_RATE_SHARE)
                drivers[actor_class, is_emv] = Navigation.by(base, curvature_rate_1pms=rate)
        return drivers

    @cached_property
    def _last_view(self) -> list[tuple[ActorTable, "StepView"]]:
        return []

    def view(self, traffic: TrafficState, before: ActorTable) -> "StepView":
        """View of a step for all guards, given the actors that were present before.

        The last one is remembered: the controllers of EMVs and of civilians share it where they share the world.
        """
        last = self._last_view
        if not (last and last[0][0] is before and last[0][1].traffic is traffic):
            actors = before.updated(traffic)
            seen = Surroundings.seen(traffic, actors, self.courses, self.crossings)
            last[:] = [(before, StepView(self, traffic, seen, actors))]
        return last[0][1]

    @cached_property
    def hold_navigator(self) -> Navigation:
        """Navigation of a civilian that brakes to the hold: comfortable."""
        return replace(self.civilian_navigator, ease_off_mps2=self.civilian_navigator.comfort_brake_mps2)

    @property
    def cooldown_steps(self) -> int:
        """Least number of steps between two forced lane changes of one vehicle."""
        return steps_from_s(self.constants.lane_change_cooldown_s)


@dataclass(frozen=True, eq=False)
class StepView:
    """View of one step for all guards."""

    world: BehaviourWorld
    traffic: TrafficState
    seen: Surroundings
    actors: ActorTable

    @property
    def step(self) -> int:
        """Number of the step."""
        return self.traffic.step

    @property
    def network(self) -> RoadNetwork:
        """The map."""
        return self.world.network

    @property
    def emv_driver(self) -> EmvDriver:
        """Parameters of the EMVs' drivers."""
        return self.world.config.emv_driver

    @property
    def civilian_driver(self) -> CivilianDriver:
        """Parameters of the civilians' drivers."""
        return self.world.config.civilian_driver

    def ego(self, row: int) -> "Ego":
        """View of the driver in a row."""
        seen = self.seen
        x, y, yaw, cos, sin, speed, *size, _ = seen.bodies[:, row].tolist()
        known = int(seen.actor_id[row]), bool(seen.is_emv[row]), int(self.traffic.lane[row])
        return Ego(self.world, self.traffic, seen, self.actors, row, *known, (x, y, yaw), (cos, sin), speed, *size)


_FAR_BRAKE_MPS2: Final = 1.8
"""Deceleration for the range of a fast EMV: it looks as far as it needs to stop, above 61 km/h farther than the paper's
80 m."""


@dataclass(frozen=True, eq=False)
class Ego(StepView):
    """View of one driver on a step: its own vehicle, and all others."""

    row: int
    actor_id: int
    is_emv: bool
    lane: int
    """Lane of the front bumper in SUMO; ``NO_LANE`` off the road."""
    pose: tuple[float, float, float]
    """x, y and yaw of the footprint's centre."""
    direction: tuple[float, float]
    """Cosine and sine of the yaw."""
    speed_mps: float
    """Speed over ground."""
    half_length_m: float
    """Half length of the footprint."""
    half_width_m: float

    @property
    def place(self) -> tuple[float, float]:
        """X and y of the footprint's centre."""
        return self.pose[:2]

    @property
    def body(self) -> Body:
        """The footprint."""
        return Body(self.half_length_m, self.half_width_m)

    @property
    def route(self) -> Indices:
        """Edges of the route from the present one (or the one before the junction)."""
        return self.traffic.route_of_row(self.row)

    @property
    def vehicle(self) -> VehicleParameters:
        """Vehicle parameters."""
        own = self.actors.by_id[self.actor_id]
        return self.world.vehicles[own.actor_class].sized(own.length_m, own.width_m, own.height_m)

    def indicators(self, side: int) -> int:
        """Indicators: a move to the left (1) or right (−1), otherwise the next turn, as SUMO shows it."""
        return indicator_to(side) if side else int(self.traffic.lights[self.row]) & _INDICATORS

    @property
    def navigator_config(self) -> Navigation:
        """The navigator's parameters, with the limit of the vehicle's own steering."""
        return self.world.drivers[self.actors.by_id[self.actor_id].actor_class, self.is_emv]

    def far_m(self, least_m: float) -> float:
        """Distance that an EMV looks ahead at its speed, at least ``least_m``."""
        return max(least_m, braking_distance_m(self.speed_mps * self.speed_mps, _FAR_BRAKE_MPS2))

    def near(self, radius_m: float) -> Rows:
        """Rows of the other vehicles within a radius."""
        return self.seen.near(*self.place, radius_m, but=self.row)

    def distance_m(self, row: int) -> float:
        """Distance between the centres of this vehicle and the one in a row."""
        return math.hypot(self.pose[0] - float(self.seen.x_m[row]), self.pose[1] - float(self.seen.y_m[row]))

    def place_on(self, lane: int) -> tuple[float, float, float]:
        """Arc length, offset (left positive) and heading at the nearest place of a lane's centre line."""
        return nearest_on_lane(self.network.lanes[lane].centre, *self.place)

    def line_along(
        self,
        lane: int,
        ahead_m: float,
        behind_m: float = 0.0,
        *,
        length_m: float | None = None,
        civilian: bool = False,
        through_junctions: bool = True,
    ) -> LanePath:
        """Reference line from the vehicle along a lane and the following lanes of the route.

        It looks ``ahead_m`` far, begins ``behind_m`` behind the vehicle and is at most ``length_m`` long (``ahead_m``
        by default); arguments otherwise as for ``lanes_along``.
        """
        at_m = self.place_on(lane)[0]
        lanes, end = lanes_along(self.network, lane, at_m, self.route, ahead_m, civilian, through_junctions)
        return path_on_lanes(self.network, lanes, end, at_m - behind_m, ahead_m if length_m is None else length_m)
