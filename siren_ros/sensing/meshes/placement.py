"""Poses and sizes of the vehicles' shapes at one step, as a structure of arrays."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats
from siren_ros.sensing.meshes.mesh import VehicleShape
from siren_ros.simulation.world.actors import (
    ACTOR_STATE_DTYPES,
    NO_ACTOR,
    ActorClass,
    ActorDescription,
    ActorStates,
    rows_of_ids,
)


@dataclass(frozen=True)
class EgoVehicle:
    """The vehicle with the sensors. The sensors do not see it, but its lamps light the street."""

    x_m: float
    y_m: float
    yaw_rad: float
    length_m: float
    lights: int


@dataclass(frozen=True, eq=False)
class VehiclePlacement:
    """Vehicles that can be seen, rows sorted by ``actor_id``; poses of ``base_link`` in the ``map`` frame.

    A shape is scaled per axis so that it fills its actor's described length, width and height exactly.
    """

    actor_id: npt.NDArray[np.uint32]
    actor_class: npt.NDArray[np.uint8]
    x_m: Floats
    y_m: Floats
    z_m: Floats
    yaw_rad: Floats
    vx_mps: Floats
    vy_mps: Floats
    yaw_rate_radps: Floats
    steer_rad: Floats
    lights: npt.NDArray[np.uint8]
    scale: Floats
    """Scale of the shape along each axis, shape ``(N, 3)``."""
    size_m: Floats
    """Length, width, height of each actor, shape ``(N, 3)``."""
    colour_rgb: npt.NDArray[np.uint8]
    """Colour of each actor, shape ``(N, 3)``."""
    ego: EgoVehicle | None = None

    def __len__(self) -> int:
        return len(self.actor_id)

    def distance_m(self, x_m: float, y_m: float) -> Floats:
        """Horizontal distance of each vehicle's centre from a point, shape ``(N,)``."""
        return np.hypot(self.x_m - x_m, self.y_m - y_m)


_OF_STATES: Final = tuple(field.name for field in fields(VehiclePlacement) if field.name in ACTOR_STATE_DTYPES)


class Catalogue:
    """Sizes, classes and colours of all actors as arrays, so that a step selects rows without a loop over actors."""

    def __init__(self, shapes: Mapping[ActorClass, VehicleShape]) -> None:
        """Store the shapes; an actor is added when it is first placed."""
        self._shapes = shapes
        self._actor_id = np.empty(0, np.uint32)
        self._add({}, np.empty(0, np.uint32))

    def place(
        self, states: ActorStates, descriptions: Mapping[int, ActorDescription], hidden_id: int = NO_ACTOR
    ) -> VehiclePlacement:
        """Place all actors of a step except ``hidden_id``, the vehicle with the sensors.

        The sensors may be inside its bodywork.
        """
        visible = states.select(np.flatnonzero(states.actor_id != hidden_id))
        rows = rows_of_ids(self._actor_id, visible.actor_id)
        if np.any(rows < 0):
            self._add(descriptions, visible.actor_id)
            rows = rows_of_ids(self._actor_id, visible.actor_id)
        return VehiclePlacement(
            **{name: getattr(visible, name) for name in _OF_STATES},
            actor_class=self._class[rows],
            scale=self._scale[rows],
            size_m=self._size[rows],
            colour_rgb=self._colour[rows],
            ego=_ego_vehicle(states, descriptions, hidden_id),
        )

    def _add(self, descriptions: Mapping[int, ActorDescription], actor_id: npt.NDArray[np.uint32]) -> None:
        """Store the descriptions of these actors and forget all others."""
        self._actor_id = actor_id
        actors = [descriptions[int(number)] for number in actor_id]
        shapes = [self._shapes[actor.actor_class] for actor in actors]
        self._class = np.array([int(a.actor_class) for a in actors], dtype=np.uint8)
        self._size = np.array([(a.length_m, a.width_m, a.height_m) for a in actors], dtype=np.float64).reshape(-1, 3)
        shape_size = np.array([(s.length_m, s.width_m, s.height_m) for s in shapes], dtype=np.float64).reshape(-1, 3)
        self._scale = self._size / shape_size
        self._colour = np.array([a.colour_rgb for a in actors], dtype=np.uint8).reshape(-1, 3)


def _ego_vehicle(states: ActorStates, descriptions: Mapping[int, ActorDescription], actor_id: int) -> EgoVehicle | None:
    """The vehicle with the sensors, found by its id; None if it is not among the states."""
    rows = np.flatnonzero(states.actor_id == actor_id)
    if len(rows) == 0:
        return None
    row = int(rows[0])
    x_m, y_m, yaw_rad = (float(values[row]) for values in (states.x_m, states.y_m, states.yaw_rad))
    return EgoVehicle(x_m, y_m, yaw_rad, descriptions[actor_id].length_m, int(states.lights[row]))
