"""Where the vehicles' shapes stand at one step, as a structure of arrays."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from siren_ros.sensors.scene.mesh import VehicleShape
from siren_ros.world.actors import NO_ACTOR, ActorClass, ActorDescription, ActorStates

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Placement:
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
    """Shape ``(N, 3)``."""
    size_m: Floats
    """Length, width, height of each actor, shape ``(N, 3)``."""
    colour_rgb: npt.NDArray[np.uint8]
    """Shape ``(N, 3)``."""

    def __len__(self) -> int:
        return len(self.actor_id)

    def distance_m(self, x_m: float, y_m: float) -> Floats:
        """Horizontal distance of each vehicle's centre from a point, shape ``(N,)``."""
        return np.hypot(self.x_m - x_m, self.y_m - y_m)


def place_vehicles(
    states: ActorStates,
    descriptions: Mapping[int, ActorDescription],
    shapes: Mapping[ActorClass, VehicleShape],
    hidden_id: int = NO_ACTOR,
) -> Placement:
    """Shapes of all actors of a step except ``hidden_id``, the sensors' own carrier.

    The carrier is left out because the paper's mounts lie inside the bodywork of an ambulance or a fire truck.
    """
    visible = states.select(states.actor_id != hidden_id)
    actors = [descriptions[int(actor_id)] for actor_id in visible.actor_id]
    size = np.array([(a.length_m, a.width_m, a.height_m) for a in actors], dtype=np.float64).reshape(-1, 3)
    shape = np.array(
        [(s.length_m, s.width_m, s.height_m) for s in (shapes[a.actor_class] for a in actors)], dtype=np.float64
    ).reshape(-1, 3)
    return Placement(
        actor_id=visible.actor_id,
        actor_class=np.array([int(a.actor_class) for a in actors], dtype=np.uint8),
        x_m=visible.x_m,
        y_m=visible.y_m,
        z_m=visible.z_m,
        yaw_rad=visible.yaw_rad,
        vx_mps=visible.vx_mps,
        vy_mps=visible.vy_mps,
        yaw_rate_radps=visible.yaw_rate_radps,
        steer_rad=visible.steer_rad,
        lights=visible.lights,
        scale=size / shape,
        size_m=size,
        colour_rgb=np.array([a.colour_rgb for a in actors], dtype=np.uint8).reshape(-1, 3),
    )
