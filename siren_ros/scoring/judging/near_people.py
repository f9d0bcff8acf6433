"""Checks how vehicles treat people: contacts with unprotected people, and speeds near people on crossings."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from siren_ros.base.numerics.arrays import Flags, Floats, Points, Rows
from siren_ros.base.numerics.compiled import COS, SIN, X, Y, compiled
from siren_ros.base.numerics.geometry import footprint_corners
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.scoring.judging.physics import PAPER_PRESET
from siren_ros.scoring.judging.verdict import Moment, Part, at_most, moments_of
from siren_ros.simulation.world.traffic_state import Event, EventKind

WALKING_PACE_MPS: Final = 2.0
"""Largest speed at which vehicles should pass people on a crossing, 7 km/h."""
NEAR_WAY_M: Final = 2.0
"""A person on a crossing is near a vehicle within this distance of the area that it sweeps there."""


@dataclass(frozen=True)
class NearPass:
    """A vehicle's passage over a crossing with a person near its path, at the vehicle's fastest step."""

    actor_id: int
    walker_id: int
    step: int
    speed_mps: float


def contacts_with_people(record: EpisodeRecord) -> tuple[Event, ...]:
    """Contacts of vehicles with pedestrians, cyclists and motorcyclists."""
    people = set(record.people_ids.tolist())
    return tuple(event for event in record.events_of(EventKind.COLLISION) if {event.actor_id, event.other_id} & people)


def near_passes(record: EpisodeRecord) -> tuple[NearPass, ...]:
    """Find every passage of a vehicle over a crossing with a pedestrian within 2 m of the area that it sweeps."""
    if not len(record.walker_ids):
        return ()
    rows = record.rows
    walks = np.isin(rows.actor_id, record.walker_ids)
    walkers, vehicles = np.flatnonzero(walks), np.flatnonzero(~walks)
    half_m = np.array([(0.5 * actor.length_m, 0.5 * actor.width_m) for actor in record.actors.values()])
    sizes_m = half_m[np.searchsorted(np.array(list(record.actors), np.uint32), rows.actor_id)]
    found: list[NearPass | None] = []
    for outline in record.network.crossings:
        area = shapely.Polygon(outline)
        across = walkers[shapely.contains_xy(area, rows.x_m[walkers], rows.y_m[walkers])]
        across = across[np.argsort(rows.step[across], kind="stable")]
        passages = _passages(record, area, vehicles, sizes_m) if len(across) else ()
        found += [_fastest(record, passage, across, sizes_m) for passage in passages]
    return tuple(near for near in found if near is not None)


def _passages(record: EpisodeRecord, area: shapely.Polygon, vehicles: Rows, sizes_m: Points) -> Iterator[Rows]:
    """Rows of each vehicle's consecutive steps on a crossing."""
    rows, (half_length, half_width) = record.rows, sizes_m[vehicles].T
    west, south, east, north = area.bounds
    around = np.hypot(half_length, half_width)
    x, y = rows.x_m[vehicles], rows.y_m[vehicles]
    inside = (x > west - around) & (x < east + around) & (y > south - around) & (y < north + around)
    near = vehicles[inside]
    corners = footprint_corners(rows.x_m[near], rows.y_m[near], rows.yaw_rad[near], *(2.0 * sizes_m[near].T))
    shapely.prepare(area)
    near = near[shapely.intersects(area, shapely.polygons(corners))]
    same = (np.diff(rows.actor_id[near]) == 0) & (np.diff(rows.step[near]) == 1)
    yield from np.split(near, np.flatnonzero(~same) + 1) if len(near) else ()


def _fastest(record: EpisodeRecord, passage: Rows, across: Rows, sizes_m: Points) -> NearPass | None:
    """The fastest step of a passage with a person near; ``across`` are people on the crossing, by step."""
    rows = record.rows
    first, last = np.searchsorted(rows.step[across], (rows.step[passage[0]], rows.step[passage[-1]] + 1))
    people = across[first:last]
    poses = rows.x_m[passage], rows.y_m[passage], np.cos(rows.yaw_rad[passage]), np.sin(rows.yaw_rad[passage])
    half_length_m, half_width_m = sizes_m[passage[0]].tolist()
    near = _near(np.stack(poses), rows.xy_m[people], half_length_m, half_width_m, NEAR_WAY_M)
    if not near.any():
        return None
    people = people[near]
    at = passage[rows.step[people] - rows.step[passage[0]]]
    most = int(np.argmax(rows.speed_mps[at]))
    ids = int(rows.actor_id[at[most]]), int(rows.actor_id[people[most]])
    return NearPass(*ids, int(rows.step[at[most]]), float(rows.speed_mps[at[most]]))


@compiled
def _near(poses: Floats, points: Points, half_length_m: float, half_width_m: float, near_m: float) -> Flags:
    """Which points ``(P, 2)`` are near a box in one of some poses: x, y, cosine and sine of the yaw, ``(4, K)``."""
    near = np.zeros(len(points), np.bool_)
    for p in range(len(points)):
        for k in range(poses.shape[1]):
            dx, dy = points[p, X] - poses[X, k], points[p, Y] - poses[Y, k]
            ahead = max(abs(dx * poses[COS, k] + dy * poses[SIN, k]) - half_length_m, 0.0)
            left = max(abs(dy * poses[COS, k] - dx * poses[SIN, k]) - half_width_m, 0.0)
            if ahead * ahead + left * left <= near_m * near_m:
                near[p] = True
                break
    return near


def check_people(record: EpisodeRecord) -> tuple[Part, Part]:
    """Checks: no contact with unprotected people, and walking pace near people on crossings.

    Drawn drivers may crash.
    """
    contacts = contacts_with_people(record)
    places = ", ".join(f"actors {event.actor_id} and {event.other_id} at step {event.step}" for event in contacts)
    passes = near_passes(record)
    worst = max(passes, key=lambda item: item.speed_mps, default=NearPass(0, 0, 0, 0.0))
    faster = sum(item.speed_mps > WALKING_PACE_MPS for item in passes)
    detail = f"actor {worst.actor_id} near {worst.walker_id} at step {worst.step}, {faster} of {len(passes)} passes"
    allowed = 0 if record.description.preset == PAPER_PRESET else np.inf
    fastest = (Moment(worst.step, worst.actor_id),) if passes else ()
    return (
        at_most("contacts_with_people", len(contacts), allowed, places, *moments_of(contacts)),
        at_most("speed_near_people_mps", worst.speed_mps, WALKING_PACE_MPS, detail if passes else "", *fastest),
    )
