"""SUMO's drivers wait for vehicles that are driven from outside, where their ways meet.

SUMO lets its drivers give way by the time at which others have announced to arrive at a junction. A vehicle that is
moved from outside announces nothing, and one that runs a red signal is nobody's foe: SUMO would drive through it. So
its drivers are slowed here by the same rule by which the outside ones are driven.
"""

from collections.abc import Container, Mapping
from dataclasses import dataclass
from typing import Any, Final

import libsumo
import numpy as np

from siren_ros.conflicts.course import CourseBook, Outlook
from siren_ros.conflicts.yielding import Approach, Wait, YieldingConfig, stop_brake_mps2, wait_for
from siren_ros.conflicts.zones import SAME_DIRECTION, Zone, meeting_zones
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.compiled import compiled
from siren_ros.numerics.units import STEP_S
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.traffic.config import CautionConfig
from siren_ros.traffic.demand.plan import PlannedVehicle
from siren_ros.world.actors import Owner
from siren_ros.world.traffic_state import TrafficFlags, TrafficState

# No parameters: SUMO's codes.
_HARD_BRAKE_MODE: Final = 27
"""SUMO's speed mode 31 without its limit of deceleration (https://sumo.dlr.de/docs/TraCI: speed mode)."""
_FREE_MODE: Final = 31


@dataclass(frozen=True)
class Caution:
    """What one driver of SUMO does at this step."""

    actor_id: int
    other_id: int
    wait: Wait


def cautions(
    traffic: TrafficState,
    outlook: Outlook,
    config: CautionConfig,
    waiting: Container[int] = (),
    inattentive: Container[int] = (),
) -> tuple[Caution, ...]:
    """The waits of SUMO's drivers.

    They wait for vehicles that are driven from outside, and, where their bodies would touch, for each other on
    junctions: SUMO's waiting places there reach into the ways of others. Into bodies ahead they do not drive anywhere:
    SUMO knows of no corner that reaches into the next lane. Actors who waited at the step before (``waiting``) would go
    on if they need not; ``inattentive`` ones do not see vehicles from outside that come across their way.

    Returns:
        The strictest wait of each, sorted by actor.
    """
    inside = traffic.owner == Owner.SUMO
    speed = np.where(inside, traffic.sumo_speed_mps, traffic.speed_mps)
    held = np.array([actor in waiting for actor in traffic.actor_id.tolist()], dtype=np.bool_)
    accel = np.where(held, np.maximum(traffic.sumo_accel_mps2, 0.0), traffic.sumo_accel_mps2)
    counts = ~inside | ((traffic.flags & TrafficFlags.ON_JUNCTION) != 0)
    poses = traffic.x_m, traffic.y_m, np.cos(traffic.yaw_rad), np.sin(traffic.yaw_rad)
    limits = config.ahead_s, config.more_m, config.far_m, config.rolling_mps, config.beside_m
    pairs = _near_pairs(poses, speed, outlook.half_length_m, inside, counts, limits)
    if not len(pairs):
        return ()
    rows, places = np.unique(pairs, return_inverse=True)
    margin_m = np.where(inside[rows], 0.0, config.margin_m)
    ways = outlook.ways(rows, config.ahead_s * speed[rows] + config.more_m, margin_m)
    met: dict[int, list[tuple[int, YieldingConfig, Zone]]] = {}
    zones = meeting_zones(ways, ways, places.reshape(pairs.shape))
    for (row, other), zone in zip(pairs.tolist(), zones, strict=True):
        if zone is not None and (inside[other] or zone.leads or int(traffic.actor_id[row]) not in inattentive):
            met.setdefault(row, []).append((other, config.among if inside[other] else config.yielding, zone))
    slowed = []
    for row, meetings in met.items():
        waits = _waits(row, meetings, (speed, accel), outlook, bool(held[row]), config)
        if waits:
            other, wait = min(waits, key=lambda other_and_wait: other_and_wait[1].speed_mps)
            slowed.append(Caution(int(traffic.actor_id[row]), int(traffic.actor_id[other]), wait))
    return tuple(slowed)


@compiled
def _near_pairs(poses: Any, speed_mps: Any, half_length_m: Any, inside: Any, counts: Any, limits: Any) -> Any:
    """Pairs of a vehicle of SUMO and another one, shape ``(P, 2)``, that counts or crosses in reach, or is close ahead.

    Long vehicles at an angle reach far aside: the tail of a bus that changes lanes.
    Maps have roads that cross before their junction begins; so crossing does not ask where it happens.
    ``poses`` holds x, y, and the yaw's cosine and sine; ``limits`` the fields of ``CautionConfig`` that count here.
    """
    x_m, y_m, cos, sin = poses
    ahead_s, more_m, far_m, rolling_mps, beside_m = limits
    n = len(x_m)
    pairs = np.empty((n * n, 2), np.intp)
    count = 0
    for row in range(n):
        if not inside[row]:
            continue
        for other in range(n):
            dx, dy = x_m[other] - x_m[row], y_m[other] - y_m[row]
            apart = np.hypot(dx, dy)
            reach = min(ahead_s * (speed_mps[row] + speed_mps[other]) + 2.0 * more_m, far_m)
            ahead = cos[row] * dx + sin[row] * dy
            if other == row or (apart >= reach and not 0.0 < ahead < speed_mps[row] + more_m):
                continue
            along = abs(cos[row] * cos[other] + sin[row] * sin[other])
            moving = speed_mps[row] > rolling_mps and speed_mps[other] > rolling_mps
            cross = moving and along < SAME_DIRECTION and ahead > -more_m
            near = (counts[other] or cross) and apart < reach
            if not near and 0.0 < ahead < speed_mps[row] + more_m:
                beside = beside_m + half_length_m[other] * abs(cos[row] * sin[other] - sin[row] * cos[other])
                near = abs(cos[row] * dy - sin[row] * dx) < beside
            if near:
                pairs[count, 0], pairs[count, 1] = row, other
                count += 1
    return pairs[:count]


def _behind(zone: Zone, own_mps: float, other_mps: float, waits: bool, config: CautionConfig) -> Wait | None:
    """How to brake for a body ahead, None while braking gently later is enough; who brakes for it goes on braking."""
    free = max(zone.blocked_m - config.behind_m, 0.0)
    brake = stop_brake_mps2(max(own_mps - other_mps, 0.0), free)
    late = free <= 0.0 or brake > (config.gentle_mps2 if waits else config.firm_mps2)
    return Wait(other_mps, brake, free) if late else None


def _waits(
    row: int,
    met: list[tuple[int, YieldingConfig, Zone]],
    motion: tuple[Floats, Floats],
    outlook: Outlook,
    waits_already: bool,
    settings: CautionConfig,
) -> list[tuple[int, Wait]]:
    """Vehicles for which the driver in a row has to wait, and how.

    ``met`` holds rows, margins and zones of the vehicles that are met, ``motion`` the speeds and accelerations of all.
    SUMO itself handles vehicles that merge among themselves, and those that lead while there is room.
    """
    speed_mps, accel_mps2 = motion
    own_mps, slowing = float(speed_mps[row]), float(accel_mps2[row])
    waits = []
    for other, config, zone in met:
        if zone.leads:
            behind = _behind(zone, own_mps, float(speed_mps[other]), waits_already, settings)
            waits += [(other, behind)] if behind is not None else []
            continue
        if zone.merges and config is settings.among:
            continue
        top = max(outlook.limit_mps(row, zone.own_in_m), own_mps)
        accel = slowing if slowing < settings.slowing_mps2 else settings.accel_mps2
        other_mps = float(speed_mps[other])
        wait = wait_for(
            zone,
            Approach(own_mps, top, accel, outlook.rank(row, zone.own_in_m)),
            Approach(other_mps, other_mps, min(float(accel_mps2[other]), 0.0), outlook.rank(other, zone.other_in_m)),
            config,
        )
        if wait is not None:
            waits.append((other, wait))
    return waits


class CautiousDrivers:
    """The speeds that are imposed on SUMO's drivers."""

    def __init__(self, network: RoadNetwork, config: CautionConfig) -> None:
        self._book = CourseBook(network)
        self._config = config
        self._slowed: set[str] = set()

    def apply(self, traffic: TrafficState | None, vehicles: Mapping[int, PlannedVehicle]) -> None:
        """Impose speeds for SUMO's next step, and free those who need not wait any more.

        ``traffic`` is the state before that step, None before the first one.
        """
        slowed = {} if traffic is None else self._speeds(traffic, vehicles)
        for name in sorted(self._slowed - slowed.keys()):
            libsumo.vehicle.setSpeed(name, -1.0)
            libsumo.vehicle.setSpeedMode(name, _FREE_MODE)
        for name, speed_mps in slowed.items():
            libsumo.vehicle.setSpeedMode(name, _HARD_BRAKE_MODE)
            libsumo.vehicle.setSpeed(name, speed_mps)
        self._slowed = set(slowed)

    def forget(self, name: str) -> None:
        """Drop a vehicle that has left SUMO, or that is driven from outside from now on."""
        self._slowed.discard(name)

    def _speeds(self, traffic: TrafficState, vehicles: Mapping[int, PlannedVehicle]) -> dict[str, float]:
        known = [vehicles[int(actor_id)] for actor_id in traffic.actor_id]
        half_length_m = np.array([0.5 * vehicle.length_m for vehicle in known])
        outlook = Outlook(traffic, self._book, half_length_m, np.array([0.5 * vehicle.width_m for vehicle in known]))
        speeds = {}
        waiting = {actor_id for actor_id, vehicle in vehicles.items() if vehicle.name in self._slowed}
        inattentive = {actor_id for actor_id, vehicle in vehicles.items() if not vehicle.attentive}
        for caution in cautions(traffic, outlook, self._config, waiting, inattentive):
            row = int(np.searchsorted(traffic.actor_id, caution.actor_id))
            speed = float(traffic.sumo_speed_mps[row])
            vehicle = vehicles[caution.actor_id]
            brake = vehicle.driver.driving.decel_mps2
            if caution.wait.brake_mps2 > brake:
                brake = min(caution.wait.brake_mps2, self._config.most_brake_mps2)
            if caution.wait.speed_mps < speed + self._config.accel_mps2 * STEP_S:
                speeds[vehicle.name] = max(caution.wait.speed_mps, speed - brake * STEP_S, 0.0)
        return speeds
