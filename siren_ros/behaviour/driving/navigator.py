"""The waypoint navigator: the one controller that drives every vehicle that SUMO does not drive."""

from dataclasses import dataclass, field, replace
from typing import Final

from siren_ros.behaviour.config import NavigatorConfig
from siren_ros.behaviour.driving.collision_watch import CollisionSnapshot, stricter, watch_path
from siren_ros.behaviour.driving.conflict_watch import watch_conflicts
from siren_ros.behaviour.driving.free_space import SpeedLimit
from siren_ros.behaviour.driving.path_tracking import steer_along
from siren_ros.behaviour.driving.speed_control import press_pedals
from siren_ros.behaviour.driving.surroundings import Surroundings
from siren_ros.behaviour.paths.tracked_path import TrackedPath
from siren_ros.dynamics.parameters import VehicleParameters

_ROLLING_MPS: Final = 0.3
"""Slower vehicles come to a stand without more braking."""
DONE_M: Final = 0.5
"""Distance from the path's end at which the path counts as driven."""


@dataclass(frozen=True)
class DriveCommand:
    """Pedals and wheel angle for one step."""

    throttle: float
    brake: float
    steer_rad: float
    hand_brake: bool


FULL_BRAKE: Final = DriveCommand(throttle=0.0, brake=1.0, steer_rad=0.0, hand_brake=True)
"""Stationary hold (paper, Algorithm 2)."""


@dataclass(frozen=True, eq=False)
class NavigatorState:
    """The path that is followed, and how far."""

    path: TrackedPath | None = None
    progress_m: float = 0.0
    left_m: float = 0.0
    """Offset from the path at the last step."""
    integral_mps2: float = 0.0

    def following(self, path: TrackedPath, x_m: float, y_m: float) -> "NavigatorState":
        """The state after ``SetWaypoints``: a new path, entered at the place nearest to a point."""
        progress, left = path.curve.project_one(x_m, y_m)
        return NavigatorState(path, progress, left, self.integral_mps2)

    @property
    def remaining_m(self) -> float:
        """Path left, 0 without one."""
        return self.path.length_m - self.progress_m if self.path is not None else 0.0

    @property
    def done(self) -> bool:
        """Whether the path has been driven to its end."""
        return self.path is None or self.remaining_m < DONE_M


@dataclass(frozen=True, eq=False)
class Situation:
    """What one vehicle drives in at one step."""

    seen: Surroundings
    row: int
    """Of the vehicle in ``seen``."""
    vehicle: VehicleParameters
    target_mps: float
    watch: bool = True
    """Whether the collision handling is on."""
    watch_leaders: bool = True
    """Whether it watches vehicles ahead on the path; else ``limit`` stands for them."""
    limit: SpeedLimit = field(default_factory=SpeedLimit)
    """Besides the target and the path's own limits."""


def navigate(
    state: NavigatorState, situation: Situation, config: NavigatorConfig
) -> tuple[NavigatorState, DriveCommand, CollisionSnapshot | None]:
    """One step along the path: steering, pedals and the actor that blocks the way.

    Without a path the vehicle brakes to a standstill and keeps its wheels straight.
    """
    seen, row, path = situation.seen, situation.row, state.path
    speed = float(seen.speed_mps[row])
    if path is None:
        pedals = press_pedals(speed, 0.0, 0.0, 0.0, situation.vehicle, config)
        return replace(state, integral_mps2=0.0), DriveCommand(0.0, pedals.brake, 0.0, False), None
    progress, left = path.curve.nearest_to(state.progress_m, float(seen.x_m[row]), float(seen.y_m[row]))
    cap = min(path.speed_cap_mps(progress), path.speed_cap_mps(progress + speed * config.reaction_s))
    wanted = min(max(situation.target_mps, speed - config.ease_off_mps2 / config.speed_gain_1ps), cap)
    threat, must_brake = None, 0.0
    if situation.watch:
        target = situation.target_mps
        leaders = situation.watch_leaders
        led = watch_path(path, progress, row, target, seen, config) if leaders else None
        met = watch_conflicts(path, progress, row, target, seen, config, leaders=leaders)
        threat = stricter(led, met)
    if threat is not None:
        wanted, must_brake = min(wanted, threat.safe_speed_mps), threat.must_brake_mps2
    wanted = min(wanted, situation.limit.speed_mps)
    if speed > _ROLLING_MPS:
        must_brake = max(must_brake, situation.limit.brake_mps2)
    pedals = press_pedals(speed, wanted, must_brake, state.integral_mps2, situation.vehicle, config)
    steer = steer_along(path, progress, left, float(seen.yaw_rad[row]), speed, situation.vehicle, config)
    return (
        NavigatorState(path, progress, left, pedals.integral_mps2),
        DriveCommand(pedals.throttle, pedals.brake, steer, False),
        threat.snapshot if threat is not None else None,
    )
