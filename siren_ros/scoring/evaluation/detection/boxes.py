"""Boxes as arrays: labels and detections, nuScenes' attributes, and the class names that are scored.

The boxes of other programs are checked and converted to the map frame.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Final, Self, TypeVar

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Codes, Flags, Floats, Ids, Rows
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.episode import SeenEpisodes
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


@dataclass(frozen=True)
class FoundSet:
    """Detections of one detector, and the frames that they cover."""

    name: str
    """Name of the detector, given by the user."""
    format: str
    boxes: FoundBoxes
    scored: Flags
    """Frames that are scored: those that the format contains, shape ``(F,)``."""
    has_velocity: bool
    """Whether velocities are known; without them the devkit uses a velocity error of 1 m/s."""
    has_attributes: bool = False
    """Whether the format has attributes; otherwise they follow from velocities, for labels and detections."""
    seen: SeenEpisodes | None = None
    """Episodes on which the detector was trained; None if unknown or if it was not trained."""


MOST_BOXES: Final = 500
"""nuScenes' limit of boxes per frame."""
_UNIT_TOLERANCE: Final = 1e-3


@dataclass(frozen=True)
class StatedBoxes:
    """Columns of a file, one row per box, in the format's own frame."""

    frame: Rows
    """Number of the frame, shape ``(N,)``."""
    centre_m: Floats
    """Centre of the volume, shape ``(N, 3)``."""
    size_m: Floats
    """Length, width, height, shape ``(N, 3)``."""
    rotation_wxyz: Floats
    """Unit quaternions, shape ``(N, 4)``."""
    velocity_mps: Floats
    """Velocity, shape ``(N, 2)``; NaN in all rows of a format without velocities."""
    score: Floats
    label: npt.NDArray[np.str_]
    attribute: Codes | None = None
    """Indices into ``ATTRIBUTES``; None for a format without attributes, which then follow from the velocity."""


def quaternions_of_yaw(yaw_rad: Floats) -> Floats:
    """Rotations about the vertical axis, w first, shape ``(N, 4)``."""
    half = yaw_rad / 2.0
    return np.stack((np.cos(half), np.zeros_like(half), np.zeros_like(half), np.sin(half)), axis=-1)


def yaws_of_quaternions(rotation_wxyz: Floats) -> Floats:
    """Direction of the rotated x axis in the plane, shape ``(N,)``."""
    w, x, y, z = rotation_wxyz.T
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def check_boxes(source: str, boxes: StatedBoxes, name_of: Callable[[int], str], *, with_velocity: bool) -> None:
    """Check that boxes are meaningful; ``source`` and ``name_of`` name the file and a frame in the error.

    Raises:
        InputError: The first box that cannot be used, with the reason. Where the format has velocities, each box needs
            one.
    """
    length = np.linalg.norm(boxes.rotation_wxyz, axis=1)
    lost = ~np.isfinite(boxes.velocity_mps).all(axis=1) & with_velocity
    checks: tuple[tuple[Flags, str, Floats, str], ...] = (
        (~np.isfinite(boxes.centre_m).all(axis=1), "centre", boxes.centre_m, "finite numbers"),
        (~(np.isfinite(boxes.size_m) & (boxes.size_m > 0.0)).all(axis=1), "size", boxes.size_m, "sizes above 0"),
        (~(abs(length - 1.0) < _UNIT_TOLERANCE), "rotation", boxes.rotation_wxyz, "quaternions of length 1"),
        (~((boxes.score >= 0.0) & (boxes.score <= 1.0)), "score", boxes.score, "scores from 0 to 1"),
        (lost, "velocity", boxes.velocity_mps, "finite numbers"),
    )
    first = min((int(bad.argmax()) for bad, *_ in checks if bad.any()), default=None)
    if first is not None:
        _, name, values, allowed = next(check for check in checks if check[0][first])
        frame = int(boxes.frame[first])
        number = int((boxes.frame[:first] == frame).sum())
        given = f"{name} {np.round(np.atleast_1d(values[first]), 6).tolist()}"
        raise InputError("detections", f"{source}: {name_of(frame)}, box {number}: {given}", allowed)
    counts = np.bincount(boxes.frame)
    if counts.size and counts.max() > MOST_BOXES:
        frame = int((counts > MOST_BOXES).argmax())
        allowed = f"at most {MOST_BOXES} boxes in a frame"
        raise InputError("detections", f"{source}: {name_of(frame)}: {counts[frame]} boxes", allowed)


def in_map(boxes: StatedBoxes, map_from_stated: Floats) -> FoundBoxes:
    """Convert boxes to the ``map`` frame with each box's transform, shape ``(N, 4, 4)``."""
    turn, shift = map_from_stated[:, :3, :3], map_from_stated[:, :3, 3]
    yaw = yaws_of_quaternions(boxes.rotation_wxyz)
    ahead = np.einsum("nij,nj->ni", turn, np.stack((np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)), axis=-1))
    velocity = np.einsum("nij,nj->ni", turn[:, :2, :2], boxes.velocity_mps)
    return FoundBoxes(
        frame=boxes.frame,
        centre_m=np.einsum("nij,nj->ni", turn, boxes.centre_m) + shift,
        size_m=boxes.size_m,
        yaw_rad=np.arctan2(ahead[:, 1], ahead[:, 0]),
        velocity_mps=velocity,
        attribute=attributes_of(velocity) if boxes.attribute is None else boxes.attribute,
        score=boxes.score,
        label=boxes.label,
    )
