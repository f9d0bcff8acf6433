"""What every controller sees of the actors at one step, and what is known about each actor."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np
import numpy.typing as npt

from siren_ros.conflicts.course import CourseBook
from siren_ros.conflicts.outlook import Outlook
from siren_ros.numerics.arrays import Floats, Ids
from siren_ros.numerics.compiled import Array, compiled
from siren_ros.world.actors import ActorClass, ActorDescription, rows_of_ids
from siren_ros.world.traffic_state import TrafficState


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
