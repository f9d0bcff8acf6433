"""What every controller sees: the actors at one step, and the facts that hold for a whole episode."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import cast

import numpy as np
import numpy.typing as npt

from siren_ros.behaviour.config import BehaviourConfig, JunctionEntryConfig, NavigatorConfig
from siren_ros.conflicts.course import CourseBook, Outlook
from siren_ros.dynamics.parameters import VehicleParameters
from siren_ros.numerics.arrays import Floats, Ids
from siren_ros.numerics.compiled import Array, compiled
from siren_ros.numerics.units import steps_from_s
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.scenario.paper import PAPER_CONSTANTS, PAPER_SPEEDS, ControlConstants, LevelPolicy, TargetSpeeds
from siren_ros.scenario.presets import DriverPreset
from siren_ros.world.actors import NO_ACTOR, ActorClass, ActorDescription, rows_of_ids
from siren_ros.world.traffic_state import Indices, TrafficState


@dataclass(frozen=True)
class ActorTable:
    """Descriptions of the actors in the simulation; arrays sorted by id."""

    by_id: Mapping[int, ActorDescription]
    actor_id: Ids
    length_m: Floats
    width_m: Floats
    is_emv: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, descriptions: Mapping[int, ActorDescription]) -> "ActorTable":
        """The table of some descriptions."""
        rows = [descriptions[actor_id] for actor_id in sorted(descriptions)]
        return cls(
            by_id=dict(descriptions),
            actor_id=np.array([row.actor_id for row in rows], dtype=np.uint32),
            length_m=np.array([row.length_m for row in rows], dtype=np.float64),
            width_m=np.array([row.width_m for row in rows], dtype=np.float64),
            is_emv=np.array([row.is_emv for row in rows], dtype=np.bool_),
        )

    @classmethod
    def empty(cls) -> "ActorTable":
        """No actors yet."""
        return cls.of({})

    def updated(self, traffic: TrafficState) -> "ActorTable":
        """The table after the spawns and removals of a step."""
        if not traffic.spawned and len(traffic.removed) == 0:
            return self
        gone = {int(actor_id) for actor_id in traffic.removed}
        left = {key: value for key, value in self.by_id.items() if key not in gone}
        return self.of(left | {actor.actor_id: actor for actor in traffic.spawned})

    def class_of(self, actor_id: int) -> ActorClass:
        """Body type of an actor."""
        return self.by_id[actor_id].actor_class


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
    """Where everybody will go; straight on without it."""

    @classmethod
    def seen(cls, traffic: TrafficState, table: ActorTable, book: CourseBook | None = None) -> "Surroundings":
        """The actors of a step.

        Args:
            traffic: The step.
            table: Descriptions of all actors.
            book: Courses of the map.

        Raises:
            KeyError: an actor of the step was never described.
        """
        if len(table.actor_id) == len(traffic) and np.array_equal(table.actor_id, traffic.actor_id):
            rows: npt.NDArray[np.intp] | slice = slice(None)
        else:
            rows = rows_of_ids(table.actor_id, traffic.actor_id)
            if np.any(rows < 0):
                raise KeyError(int(traffic.actor_id[np.argmax(rows < 0)]))
        half_length, half_width = 0.5 * table.length_m[rows], 0.5 * table.width_m[rows]
        return cls(
            actor_id=traffic.actor_id,
            x_m=traffic.x_m,
            y_m=traffic.y_m,
            yaw_rad=traffic.yaw_rad,
            cos=np.cos(traffic.yaw_rad),
            sin=np.sin(traffic.yaw_rad),
            speed_mps=traffic.speed_mps,
            half_length_m=half_length,
            half_width_m=half_width,
            is_emv=table.is_emv[rows],
            outlook=None if book is None else Outlook(traffic, book, half_length, half_width),
        )

    def near(self, x_m: float, y_m: float, radius_m: float, but: int = -1) -> npt.NDArray[np.intp]:
        """Rows of the actors within a radius, without row ``but``."""
        return cast("npt.NDArray[np.intp]", _near(self.x_m, self.y_m, x_m, y_m, radius_m, but))


@compiled
def _near(xs_m: Array, ys_m: Array, x_m: float, y_m: float, radius_m: float, but: int) -> Array:
    rows = np.empty(xs_m.shape[0], np.intp)
    count = 0
    for row in range(xs_m.shape[0]):
        dx, dy = xs_m[row] - x_m, ys_m[row] - y_m
        if dx * dx + dy * dy < radius_m * radius_m and row != but:
            rows[count] = row
            count += 1
    return rows[:count]


@dataclass(frozen=True)
class BehaviourWorld:
    """Everything that does not change during an episode."""

    network: RoadNetwork
    policy: LevelPolicy
    vehicles: Mapping[ActorClass, VehicleParameters]
    preset: DriverPreset
    seed: int
    av_id: int = NO_ACTOR
    """A civilian that an external controller drives: it does not yield by itself."""
    constants: ControlConstants = PAPER_CONSTANTS
    speeds: TargetSpeeds = PAPER_SPEEDS
    config: BehaviourConfig = field(default_factory=BehaviourConfig)

    @cached_property
    def edge_of_lane(self) -> Indices:
        """Edge of each lane of the network."""
        return np.array([lane.edge for lane in self.network.lanes], dtype=np.int32)

    @cached_property
    def courses(self) -> CourseBook:
        """Courses along the lanes of the network."""
        return CourseBook(self.network)

    @cached_property
    def emv_navigator(self) -> NavigatorConfig:
        """How EMVs drive at this level: how early they count with crossing vehicles, how close they follow."""
        emv, horizon_s = self.config.emv, self.preset.attention.emv_horizon_s
        conflicts = emv.navigator.conflicts
        nearer = replace(conflicts, horizon_s=min(conflicts.horizon_s, horizon_s))
        gap_m = emv.escape_gap_m if self.policy.corridor else emv.navigator.standstill_gap_m
        return replace(emv.navigator, conflicts=nearer, standstill_gap_m=gap_m)

    @cached_property
    def room_navigator(self) -> NavigatorConfig:
        """How a civilian moves up close behind others to make room."""
        return replace(self.config.civilian_navigator, standstill_gap_m=self.config.pull_over.room_standstill_gap_m)

    @cached_property
    def junction_entry(self) -> JunctionEntryConfig:
        """How EMVs come to red lights, no slower than the preset's driver."""
        config = self.config.junction_entry
        return replace(config, speed_mps=max(config.speed_mps, self.preset.attention.emv_red_mps))

    @property
    def cooldown_steps(self) -> int:
        """Steps between two forced lane changes of one vehicle."""
        return steps_from_s(self.constants.lane_change_cooldown_s)


@dataclass(frozen=True, eq=False)
class StepView:
    """One step as every guard sees it."""

    world: BehaviourWorld
    traffic: TrafficState
    seen: Surroundings
    actors: ActorTable

    @property
    def step(self) -> int:
        """Number of the step."""
        return self.traffic.step

    def pose(self, row: int) -> tuple[float, float, float]:
        """x, y and yaw of an actor."""
        seen = self.seen
        return float(seen.x_m[row]), float(seen.y_m[row]), float(seen.yaw_rad[row])

    def navigator_config(self, row: int) -> NavigatorConfig:
        """The navigator's parameters for an actor, with the limit of its own steering."""
        config, vehicle = self.world.config, self.vehicle(row)
        base = config.emv.navigator if self.seen.is_emv[row] else config.civilian_navigator
        rate = base.steer_rate_share * vehicle.max_steer_rate_radps / vehicle.wheelbase_m
        return replace(base, curvature_rate_1pms=rate)

    def vehicle(self, row: int) -> VehicleParameters:
        """Vehicle parameters of an actor."""
        return self.world.vehicles[self.actors.class_of(int(self.seen.actor_id[row]))]
