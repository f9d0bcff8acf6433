"""Boxes as arrays: labels and detections, nuScenes' attributes, and the class names that are scored."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Final, Self, TypeVar

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Codes, Flags, Floats, Ids, Rows
from siren_ros.simulation.world.actors import EMERGENCY_CLASSES, TWO_WHEELED, ActorClass

ATTRIBUTES: Final = (
    *("", "vehicle.moving", "vehicle.stopped", "vehicle.parked"),
    *("cycle.with_rider", "cycle.without_rider"),
    *("pedestrian.moving", "pedestrian.standing", "pedestrian.sitting_lying_down"),
)
"""nuScenes' attributes by code; code 0 means none."""
PARKED: Final = ATTRIBUTES.index("vehicle.parked")
_WITH_RIDER, _WALKS, _STANDS = (
    ATTRIBUTES.index(name) for name in ("cycle.with_rider", "pedestrian.moving", "pedestrian.standing")
)
MOVING_MPS: Final = 0.3
"""A vehicle faster than this is moving, as in the nuScenes export."""


@dataclass(frozen=True)
class Boxes:
    """Boxes of many frames, one row each."""

    frame: Rows
    """Number of the frame, shape ``(N,)``."""
    centre_m: Floats
    """Centre of the volume, shape ``(N, 3)``."""
    size_m: Floats
    """Length, width, height, shape ``(N, 3)``."""
    yaw_rad: Floats
    """Heading, counter-clockwise from x, shape ``(N,)``."""
    velocity_mps: Floats
    """Velocity over ground, x and y, shape ``(N, 2)``; NaN where it is unknown."""
    attribute: Codes
    """Index into ``ATTRIBUTES``, shape ``(N,)``."""

    def __len__(self) -> int:
        return len(self.frame)

    def at(self, rows: Rows | Flags) -> Self:
        """Select some of the boxes."""
        return type(self)(**{column.name: getattr(self, column.name)[rows] for column in fields(self)})


@dataclass(frozen=True)
class TruthBoxes(Boxes):
    """Labelled vehicles and people. All further arrays have shape ``(N,)``."""

    actor_id: Ids
    actor_class: Codes
    lidar_points: Ids
    visible: Floats
    """Visible fraction, 0 to 1."""
    mode: Codes
    """The vehicle's behaviour at that step (``siren_ros.simulation.world.actors.Mode``)."""


@dataclass(frozen=True)
class FoundBoxes(Boxes):
    """Boxes of a detector. All further arrays have shape ``(N,)``."""

    score: Floats
    """Confidence of each detection, 0 to 1."""
    label: npt.NDArray[np.str_]
    """Name of the class, in lower case."""

    @classmethod
    def none(cls) -> Self:
        """A table without boxes."""
        frame, attribute, label = np.zeros(0, np.intp), np.zeros(0, np.uint8), np.zeros(0, np.str_)
        volume, plane, score = np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0)
        return cls(frame, volume, volume, score, plane, attribute, score, label)


Kind = TypeVar("Kind", bound=Boxes)


def joined(parts: Sequence[Kind]) -> Kind:
    """Join several tables of boxes; there must be at least one."""
    columns = {column.name: [getattr(part, column.name) for part in parts] for column in fields(parts[0])}
    return type(parts[0])(**{name: np.concatenate(arrays) for name, arrays in columns.items()})


def attributes_of(velocity_mps: Floats, actor_class: Codes | ActorClass = ActorClass.SEDAN) -> Codes:
    """Attributes from velocities of shape ``(N, 2)``: moving above 0.3 m/s, otherwise stopped; none without velocity.

    Two wheels have a rider at any speed. The class is one for all, or of shape ``(N,)``.
    """
    speed = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1])
    walks, rides = np.isin(actor_class, ActorClass.PEDESTRIAN), np.isin(actor_class, [*TWO_WHEELED])
    moving, standing = np.where(walks, _WALKS, 1), np.where(walks, _STANDS, 2)
    codes = np.where(np.isnan(speed), 0, np.where(speed > MOVING_MPS, moving, standing))
    return np.where(rides, _WITH_RIDER, codes).astype(np.uint8)


CAR: Final = "car"
_EMERGENCY: Final = {member.name.lower(): member for member in sorted(EMERGENCY_CLASSES)}
CLASS_NAMES: Final = (CAR, *_EMERGENCY)
"""Names that a detection can have: ``car`` for every civilian vehicle, as in the paper, and the emergency vehicles."""


PERSON_NAMES: Final = MappingProxyType(
    {
        ActorClass.PEDESTRIAN: ("pedestrian", "person"),
        ActorClass.BICYCLE: ("bicycle", "cyclist"),
        ActorClass.MOTORCYCLE: ("motorcycle", "motorcyclist"),
    }
)
"""Class names that count as a detection of a person: nuScenes' name first, then names of other formats."""


def labels_named(truth: TruthBoxes, name: str) -> Flags:
    """Which labels have this name of ``CLASS_NAMES`` as their correct name, shape ``(N,)``."""
    if name in _EMERGENCY:
        return np.asarray(truth.actor_class == _EMERGENCY[name])
    return ~np.isin(truth.actor_class, [*EMERGENCY_CLASSES])


def names_kinds(detected: FoundBoxes) -> bool:
    """Whether the detector distinguishes kinds of vehicles: some detection has the name of an emergency vehicle."""
    return bool(np.isin(detected.label, [*_EMERGENCY]).any())
