"""What the controllers are given for a whole episode, and what they share at one step."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from siren_ros.behaviour.config import BehaviourConfig, JunctionEntryConfig, NavigatorConfig
from siren_ros.behaviour.driving.surroundings import ActorTable, Surroundings
from siren_ros.conflicts.course import CourseBook
from siren_ros.dynamics.parameters import VehicleParameters
from siren_ros.numerics.units import steps_from_s
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.scenario.levels import LevelPolicy
from siren_ros.scenario.paper_constants import PAPER_CONSTANTS, PAPER_SPEEDS, ControlConstants, TargetSpeeds
from siren_ros.scenario.presets import DriverPreset
from siren_ros.world.actors import NO_ACTOR, ActorClass
from siren_ros.world.traffic_state import Indices, TrafficState


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
