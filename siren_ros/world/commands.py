"""What the controllers ask of the vehicles at one step, as a structure of arrays."""

from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np

from siren_ros.world.actors import Codes, Floats, Ids
from siren_ros.world.events import Event


@dataclass(frozen=True)
class VehicleCommands:
    """Commands of one controller at one step; rows sorted by ``actor_id``.

    A row with ``owner`` ROS drives the actor by throttle, brake and steering from this step on. A
    row with ``owner`` SUMO hands it back (or leaves it there) and only sets mode and lights. Actors
    without a row belong to SUMO and are in mode NOMINAL.
    """

    step: int
    source: str
    """Name of the controlling node."""
    actor_id: Ids
    owner: Codes
    throttle: Floats
    """0–1."""
    brake: Floats
    """0–1."""
    steer_rad: Floats
    """Wanted road-wheel angle, left positive."""
    hand_brake: Codes
    mode: Codes
    lights: Codes
    """Lights to show; the brake light is added by the vehicle itself."""
    events: tuple[Event, ...] = ()

    def __len__(self) -> int:
        return len(self.actor_id)

    @classmethod
    def empty(cls, step: int, source: str, events: tuple[Event, ...] = ()) -> "VehicleCommands":
        """No commands."""
        arrays: dict[str, Any] = {name: np.empty(0, dtype) for name, dtype in COMMAND_DTYPES.items()}
        return cls(step=step, source=source, events=events, **arrays)


_CODES: Final = frozenset({"owner", "hand_brake", "mode", "lights"})
COMMAND_DTYPES: Final[dict[str, type[np.generic]]] = {
    field.name: np.uint32 if field.name == "actor_id" else np.uint8 if field.name in _CODES else np.float64
    for field in fields(VehicleCommands)
    if field.name not in {"step", "source", "events"}
}
"""Array fields of VehicleCommands and their element types, in declaration order."""
