"""Every mechanism that limits a driver's speed, in the order in which they act.

``navigate`` runs through the table ``MECHANISMS`` for each vehicle that SUMO does not drive. SUMO's own drivers follow
SUMO's car-following model; ``traffic`` limits them further, in this order:

1. ``roads.maps.map_compiler.with_speed_limit``: the map's speed limits, lowered to the template's.
2. ``traffic.demand.plan.DriverPopulation``: the wished speed, by each driver's factor on the limit.
3. ``traffic.sumo.driving_corrections.BendLimits``: bends ahead, by their lateral acceleration.
4. ``traffic.sumo.caution.CautiousDrivers``: vehicles that are driven from outside, where the ways meet.
5. ``traffic.sumo.driving_corrections.SidewaysLimits``: the speed sideways, as a share of the speed.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from siren_ros.behaviour.config import NavigatorConfig
from siren_ros.behaviour.driving.civilian_unit import YieldUnit
from siren_ros.behaviour.driving.collision_watch import CollisionWatch, stricter
from siren_ros.behaviour.driving.emv_speed_limits import anticipated_limit, entry_limit, passage_limit
from siren_ros.behaviour.driving.emv_unit import EmvUnit
from siren_ros.behaviour.driving.free_space import SpeedLimit
from siren_ros.behaviour.driving.navigator import (
    DriveCommand,
    NavigatorState,
    manoeuvring_limit,
    press_pedals,
    steer_along,
)
from siren_ros.behaviour.driving.step_view import Ego
from siren_ros.behaviour.paths.tracked_path import TrackedPath
from siren_ros.world.actors import NO_ACTOR, Mode

_UNLIMITED: Final = SpeedLimit()
_SIDEWAYS_MODES: Final = frozenset({Mode.YIELD_PULL_OVER, Mode.REJOIN})


@dataclass(frozen=True, eq=False)
class Drive:
    """One driver on a path at one step."""

    unit: EmvUnit | YieldUnit
    ego: Ego
    path: TrackedPath
    progress_m: float
    target_mps: float
    """Speed that the mode asks for."""
    config: NavigatorConfig


def _target(drive: Drive) -> SpeedLimit:
    easing = drive.ego.speed_mps - drive.config.ease_off_mps2 / drive.config.speed_gain_1ps
    return SpeedLimit(max(drive.target_mps, easing))


def _path(drive: Drive) -> SpeedLimit:
    ahead_m = drive.ego.speed_mps * drive.config.reaction_s
    return SpeedLimit(
        min(drive.path.speed_cap_mps(drive.progress_m), drive.path.speed_cap_mps(drive.progress_m + ahead_m))
    )


def _collision(drive: Drive) -> SpeedLimit:
    unit, ego = drive.unit, drive.ego
    if unit.gap_escape_active if isinstance(unit, EmvUnit) else unit.phase is Mode.YIELD_HOLD:
        return _UNLIMITED
    watch = CollisionWatch(drive.path, drive.progress_m, ego.row, drive.target_mps, ego.seen, drive.config)
    leaders = not (isinstance(unit, EmvUnit) and unit.corridor)
    return stricter(watch.leaders() if leaders else None, watch.meetings(leaders=leaders)) or _UNLIMITED


def _passage(drive: Drive) -> SpeedLimit:
    unit = drive.unit
    return passage_limit(unit, drive.ego) if isinstance(unit, EmvUnit) and unit.between else _UNLIMITED


def _anticipation(drive: Drive) -> SpeedLimit:
    unit = drive.unit
    return anticipated_limit(unit, drive.ego) if isinstance(unit, EmvUnit) and not unit.between else _UNLIMITED


def _entry(drive: Drive) -> SpeedLimit:
    return entry_limit(drive.ego) if isinstance(drive.unit, EmvUnit) else _UNLIMITED


def _manoeuvring(drive: Drive) -> SpeedLimit:
    sideways = isinstance(drive.unit, YieldUnit) and drive.unit.phase in _SIDEWAYS_MODES
    return manoeuvring_limit(drive.unit.navigator, drive.ego) if sideways else _UNLIMITED


@dataclass(frozen=True)
class Mechanism:
    """One mechanism: what it asks of a driver, and in one line why."""

    name: str
    limit: Callable[[Drive], SpeedLimit]
    purpose: str


MECHANISMS: Final = (
    Mechanism("target", _target, "the mode's speed (paper, table of target speeds), come to by easing off"),
    Mechanism("path", _path, "bends ahead, what the steering can follow, and a stop at the path's end"),
    Mechanism("collision", _collision, "vehicles ahead on the path, and those whose way meets it; off in a gap escape"),
    Mechanism("passage", _passage, "EMV in the corridor and in a gap escape: space beside its footprint"),
    Mechanism("anticipation", _anticipation, "EMV elsewhere: vehicles ahead, with gentle braking in good time"),
    Mechanism("junction entry", _entry, "EMV: red lights ahead"),
    Mechanism("manoeuvring", _manoeuvring, "civilians who pull over or come back: space around the whole body"),
)
"""Every mechanism that limits the speed of a vehicle that SUMO does not drive, in the order in which they act."""


def navigate(
    unit: EmvUnit | YieldUnit,
    ego: Ego,
    target_mps: float,
    config: NavigatorConfig,
    mechanisms: Sequence[Mechanism] = MECHANISMS,
) -> tuple[NavigatorState, DriveCommand, int]:
    """One step along the path of a unit: steering, pedals and the actor that blocks the way, ``NO_ACTOR`` without one.

    The lowest speed and the hardest braking of all mechanisms hold, and the blocker of the first one that has one.
    Without a path the vehicle brakes to a standstill and keeps its wheels straight.
    """
    state, speed = unit.navigator, ego.speed_mps
    if state.path is None:
        pedals = press_pedals(speed, 0.0, 0.0, 0.0, ego.vehicle, config)
        return replace(state, integral_mps2=0.0), DriveCommand(0.0, pedals.brake, 0.0, False), NO_ACTOR
    progress, left = state.path.curve.nearest_to(state.progress_m, *ego.place)
    drive = Drive(unit, ego, state.path, progress, target_mps, config)
    limits = [mechanism.limit(drive) for mechanism in mechanisms]
    must_brake = max(limit.brake_mps2 for limit in limits) if speed > config.rolling_mps else 0.0
    wanted = min(limit.speed_mps for limit in limits)
    pedals = press_pedals(speed, wanted, must_brake, state.integral_mps2, ego.vehicle, config)
    steer = steer_along(state.path, progress, left, ego.pose[2], speed, ego.vehicle, config)
    return (
        NavigatorState(state.path, progress, left, pedals.integral_mps2),
        DriveCommand(pedals.throttle, pedals.brake, steer, False),
        next((limit.blocker_id for limit in limits if limit.blocker_id != NO_ACTOR), NO_ACTOR),
    )
