"""Finds contacts between vehicles from overlapping boxes, reports each once, and computes their effect.

Two vehicles in contact go on together along the contact's normal, and do not overlap.
"""

from dataclasses import dataclass, replace
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import shapely

from siren_ros.base.numerics.arrays import Flags, Floats, Ids, Rows
from siren_ros.base.numerics.compiled import box_gap_m, compiled
from siren_ros.base.numerics.geometry import footprint_corners, separation_m
from siren_ros.simulation.dynamics.vehicle_model import BodyState, ParameterTable

SEPARATION_GAP_M: Final = 0.1
"""A contact ends when the boxes are this far apart."""
_CLOSING_MPS: Final = 1e-6
_LONGEST_S: Final = 0.5
"""Longest duration of an overlap, since bodies in contact are moved apart at each step."""
_ROW, _OTHER, _GAP = range(3)
"""Columns of close pairs."""

Pairs: TypeAlias = tuple[tuple[int, int], ...]
"""Pairs of actor ids or of rows, the smaller first, sorted."""


@dataclass(frozen=True)
class Footprints:
    """Oriented boxes in motion, ``map`` frame, each array of shape ``(N,)``; rows sorted by ``actor_id``."""

    actor_id: Ids
    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    vx_mps: Floats
    vy_mps: Floats
    yaw_rate_radps: Floats
    length_m: Floats
    width_m: Floats
    walks: Flags
    """Whether an actor is a pedestrian; two pedestrians who pass each other have no contact."""


class Contact(NamedTuple):
    """Two vehicles that begin to touch, the smaller id first."""

    actor_id: int
    other_id: int
    x_m: float
    """Centroid of the overlap."""
    y_m: float
    impact_speed_mps: float
    """Closing speed at the place of contact along the contact's normal."""


def find_contacts(boxes: Footprints, touching: Pairs) -> tuple[tuple[Contact, ...], Pairs]:
    """Contacts that begin at this step, sorted by pair, and the pairs that touch now.

    ``touching`` are the pairs that touched at the step before, as this function returned them.
    """
    close = _close_pairs(boxes)
    if not len(close):
        return (), ()
    corners = footprint_corners(boxes.x_m, boxes.y_m, boxes.yaw_rad, boxes.length_m, boxes.width_m)
    contacts: list[Contact] = []
    pairs: list[tuple[int, int]] = []
    for row, other, gap in close.tolist():
        a, b = int(row), int(other)
        pair = int(boxes.actor_id[a]), int(boxes.actor_id[b])
        if pair in touching or gap <= 0.0:
            pairs.append(pair)
            if pair not in touching:
                contacts.append(_contact(boxes, corners, a, b))
    return tuple(contacts), tuple(pairs)


def any_close(x_m: Floats, y_m: Floats, yaw_rad: Floats, length_m: Floats, width_m: Floats, walks: Flags) -> bool:
    """Whether any two boxes are near enough for a contact, as in ``find_contacts``."""
    return len(_close(x_m, y_m, yaw_rad, length_m, width_m, walks)) > 0


def overlapping(boxes: Footprints, pairs: Pairs) -> Pairs:
    """Rows of the pairs whose boxes overlap."""
    if not pairs:
        return ()
    rows = np.searchsorted(boxes.actor_id, np.array(pairs, dtype=np.uint32))
    corners = footprint_corners(boxes.x_m, boxes.y_m, boxes.yaw_rad, boxes.length_m, boxes.width_m)
    deep = separation_m(corners[rows[:, 0]], corners[rows[:, 1]]) < 0.0
    return tuple((int(a), int(b)) for a, b in rows[deep])


def _close_pairs(boxes: Footprints) -> Floats:
    """Rows of the pairs within the separation gap, the smaller row first, sorted, and the gap; shape ``(M, 3)``."""
    found = _close(boxes.x_m, boxes.y_m, boxes.yaw_rad, boxes.length_m, boxes.width_m, boxes.walks)
    return found[np.lexsort((found[:, _OTHER], found[:, _ROW]))]


def _close(x_m: Floats, y_m: Floats, yaw_rad: Floats, length_m: Floats, width_m: Floats, walks: Flags) -> Floats:
    """``_find_close`` within the separation gap; numpy sorts, since numba's sorting takes seconds to compile."""
    order = np.argsort(x_m, kind="stable")
    return _find_close(order, x_m, y_m, yaw_rad, length_m, width_m, walks, SEPARATION_GAP_M)


@compiled
def _find_close(
    order: Rows, x: Floats, y: Floats, yaw: Floats, length: Floats, width: Floats, walks: Flags, within_m: float
) -> Floats:
    """Pairs of boxes nearer than a gap, except two pedestrians: ``(M, 3)`` with both rows and the gap.

    Boxes are looked at in the ``order`` of x, each with those near it.
    """
    n, count = len(x), 0
    radius, found = np.empty(n), np.empty((8, 3))
    for a in range(n):
        radius[a] = np.sqrt(length[a] ** 2 + width[a] ** 2)
    widest = radius.max() if n else 0.0
    for i in range(n):
        for j in range(i + 1, n):
            a, b = min(order[i], order[j]), max(order[i], order[j])
            dx, dy = x[b] - x[a], y[b] - y[a]
            if abs(dx) > within_m + widest:
                break
            reach = within_m + 0.5 * (radius[a] + radius[b])
            if dx * dx + dy * dy >= reach * reach or (walks[a] and walks[b]):
                continue
            pose, other = (x[a], y[a], np.cos(yaw[a]), np.sin(yaw[a])), (x[b], y[b], np.cos(yaw[b]), np.sin(yaw[b]))
            gap = box_gap_m(pose, other, 0.5 * length[a], 0.5 * width[a], 0.5 * length[b], 0.5 * width[b])
            if gap < within_m:
                if count == len(found):
                    found = np.concatenate((found, np.empty_like(found)))
                found[count, _ROW], found[count, _OTHER], found[count, _GAP] = a, b, gap
                count += 1
    return found[:count]


def _contact(boxes: Footprints, corners: Floats, a: int, b: int) -> Contact:
    outlines = shapely.Polygon(corners[a]), shapely.Polygon(corners[b])
    place = shapely.centroid(shapely.intersection(*outlines))
    if place.is_empty:  # the boxes touch within rounding
        place = shapely.centroid(shapely.shortest_line(*outlines))
    normal = contact_normal(boxes, corners, a, b)
    point = np.array([place.x, place.y])
    closing = float(np.dot(_velocity_at(boxes, a, point) - _velocity_at(boxes, b, point), normal))
    ids = int(boxes.actor_id[a]), int(boxes.actor_id[b])
    return Contact(*ids, float(place.x), float(place.y), impact_speed_mps=max(closing, 0.0))


def _velocity_at(boxes: Footprints, row: int, point: Floats) -> Floats:
    rate = boxes.yaw_rate_radps[row]
    arm_x, arm_y = point[0] - boxes.x_m[row], point[1] - boxes.y_m[row]
    return np.array([boxes.vx_mps[row] - rate * arm_y, boxes.vy_mps[row] + rate * arm_x])


def contact_normal(boxes: Footprints, corners: Floats, a: int, b: int) -> Floats:
    """Unit vector from row a to row b, normal to the side through which the boxes came to overlap.

    Of the four separating axes it is the one on which the overlap began last (swept separating axis test). Where the
    boxes close in on no axis, or have overlapped for too long on all on which they do, it is the one with the smallest
    penetration: they came to overlap by turning.
    """
    axes = np.concatenate([corners[row][[1, 3]] - corners[row][0] for row in (a, b)])
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    apart = np.array([boxes.x_m[b] - boxes.x_m[a], boxes.y_m[b] - boxes.y_m[a]])
    axes = np.where((axes @ apart)[:, None] < 0.0, -axes, axes)
    depth = (corners[a] @ axes.T).max(axis=0) - (corners[b] @ axes.T).min(axis=0)
    relative = np.array([boxes.vx_mps[a] - boxes.vx_mps[b], boxes.vy_mps[a] - boxes.vy_mps[b]])
    closing = axes @ relative
    lasted_s = np.where(closing > _CLOSING_MPS, depth / np.maximum(closing, _CLOSING_MPS), np.inf)
    return np.asarray(axes[np.argmin(lasted_s if lasted_s.min() < _LONGEST_S else depth)])


_ROUNDS: Final = 8
"""Number of passes over all pairs, because a pushed body may hit another one."""
_TOUCHING_M: Final = 1e-3
"""Overlap that remains, so that bodies in contact stay in contact."""


def collide(bodies: BodyState, boxes: Footprints, table: ParameterTable, pairs: Pairs, dt_s: float) -> BodyState:
    """Bodies after the impacts of a step; the change of velocity is part of the mean acceleration.

    ``bodies`` and ``boxes`` are the vehicles at the end of the step, as if they could pass through each other, and
    ``pairs`` the rows that overlap.
    """
    place = np.stack((boxes.x_m, boxes.y_m), axis=-1)
    velocity = np.stack((boxes.vx_mps, boxes.vy_mps), axis=-1)
    before = velocity.copy()
    for _ in range(_ROUNDS):
        moved = [_separate(a, b, place, velocity, boxes, table.mass_kg) for a, b in pairs]
        if not any(moved):
            break
    return _with_motion(bodies, place, velocity - before, dt_s)


def _separate(a: int, b: int, place: Floats, velocity: Floats, boxes: Footprints, mass_kg: Floats) -> bool:
    """Apply one impact to ``place`` and ``velocity`` (shape ``(N, 2)``); returns whether the pair still overlapped."""
    present = replace(boxes, x_m=place[:, 0], y_m=place[:, 1], vx_mps=velocity[:, 0], vy_mps=velocity[:, 1])
    corners = footprint_corners(present.x_m, present.y_m, present.yaw_rad, present.length_m, present.width_m)
    if separation_m(corners[[a]], corners[[b]])[0] > -_TOUCHING_M:
        return False
    normal = contact_normal(present, corners, a, b)
    depth = float((corners[a] @ normal).max() - (corners[b] @ normal).min())
    share = mass_kg[b] / (mass_kg[a] + mass_kg[b])
    apart = (depth - 0.5 * _TOUCHING_M) * normal
    place[a] -= share * apart
    place[b] += (1.0 - share) * apart
    closing = float((velocity[a] - velocity[b]) @ normal)
    if closing > 0.0:
        velocity[a] -= share * closing * normal
        velocity[b] += (1.0 - share) * closing * normal
    return True


def _with_motion(bodies: BodyState, place: Floats, gained: Floats, dt_s: float) -> BodyState:
    """Bodies at other positions, with added velocities in the ``map`` frame."""
    cos, sin = np.cos(bodies.yaw_rad), np.sin(bodies.yaw_rad)
    forward = cos * gained[:, 0] + sin * gained[:, 1]
    left = cos * gained[:, 1] - sin * gained[:, 0]
    return replace(
        bodies,
        x_m=place[:, 0],
        y_m=place[:, 1],
        forward_mps=bodies.forward_mps + forward,
        lateral_mps=bodies.lateral_mps + left,
        accel_mps2=bodies.accel_mps2 + forward / dt_s,
        lateral_accel_mps2=bodies.lateral_accel_mps2 + left / dt_s,
    )
