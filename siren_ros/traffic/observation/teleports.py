"""Vehicles that are suddenly elsewhere: SUMO's own teleports, and jumps that it does not call so."""

from collections.abc import Container, Iterable

import numpy as np

from siren_ros.numerics.arrays import Codes, Floats, Ids
from siren_ros.numerics.units import STEP_S
from siren_ros.traffic.sumo.readings import Readings
from siren_ros.world.actors import Owner, rows_of_ids
from siren_ros.world.events import Event, EventKind
from siren_ros.world.traffic_state import TrafficState


def find_teleports(
    step: int,
    ids: Ids,
    readings: Readings,
    lengths_m: Floats,
    owner: Codes,
    started: Iterable[int],
    moved_on_purpose: Container[int],
    last: TrafficState | None,
    jump_m: float,
) -> list[Event]:
    """Teleport events of one step, by actor id.

    Args:
        step: Present step.
        ids: Actors of the readings' rows.
        readings: SUMO's present poses.
        lengths_m: Of the vehicles. What counts is the front bumper, which SUMO moves; the rod behind it may swing.
        owner: Owner of each row; only vehicles that SUMO owned at both steps can jump.
        started: Actors that SUMO began to teleport.
        moved_on_purpose: Actors that were put somewhere else at this step.
        last: The step before.
        jump_m: Least distance beyond what a vehicle's speed explains.
    """
    found = dict.fromkeys(started, "sumo")
    if last is not None:
        rows = rows_of_ids(last.actor_id, ids)
        now_x, now_y = _fronts(readings.x_m, readings.y_m, readings.yaw_rad, lengths_m)
        then_x, then_y = _fronts(last.sumo_x_m[rows], last.sumo_y_m[rows], last.sumo_yaw_rad[rows], lengths_m)
        moved = np.hypot(now_x - then_x, now_y - then_y)
        explained = np.maximum(readings.speed_mps, last.sumo_speed_mps[rows]) * STEP_S
        stayed = (rows >= 0) & (owner == Owner.SUMO) & (last.owner[rows] == Owner.SUMO)
        for row in np.flatnonzero(stayed & (moved > explained + jump_m)):
            if int(ids[row]) not in moved_on_purpose:
                found.setdefault(int(ids[row]), "jump")
    if not found:
        return []
    row_of = {int(actor_id): row for row, actor_id in enumerate(ids)}
    events = []
    for actor_id, reason in sorted(found.items()):
        row = row_of.get(actor_id)
        x, y = (0.0, 0.0) if row is None else (float(readings.x_m[row]), float(readings.y_m[row]))
        events.append(Event(step, EventKind.TELEPORT, actor_id, x_m=x, y_m=y, detail={"reason": reason}))
    return events


def _fronts(x_m: Floats, y_m: Floats, yaw_rad: Floats, lengths_m: Floats) -> tuple[Floats, Floats]:
    return x_m + 0.5 * lengths_m * np.cos(yaw_rad), y_m + 0.5 * lengths_m * np.sin(yaw_rad)
