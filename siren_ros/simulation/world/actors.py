"""Actors: what they are, and their states at one step as a structure of arrays."""

from dataclasses import dataclass, field
from enum import IntEnum, IntFlag
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Codes, Columns, Floats, Ids, dtypes_of
from siren_ros.base.tables.brief import Brief

NO_ACTOR: Final = 0
"""Actor ids start at 1, so that 0 can say "none" (a LiDAR return on the static scene, no leader)."""
FIRST_PARKED_ID: Final = 50_000
"""Ids from here on are vehicles parked in the scene: sensors see and label them, traffic does not know them.

Points and pictures have ids of 16 bits."""


class ActorClass(IntEnum):
    """Body type; sets shape, mass and the vehicle model's parameters."""

    HATCHBACK = 0
    SEDAN = 1
    ESTATE = 2
    SUV = 3
    VAN = 4
    PICKUP = 5
    BUS = 6
    TRUCK = 7
    AMBULANCE = 8
    FIRE_TRUCK = 9
    POLICE = 10
    MOTORCYCLE = 11
    BICYCLE = 12
    PEDESTRIAN = 13

    @property
    def is_emergency(self) -> bool:
        """Whether vehicles of this class are emergency vehicles."""
        return self in EMERGENCY_CLASSES


EMERGENCY_CLASSES: Final = frozenset({ActorClass.AMBULANCE, ActorClass.FIRE_TRUCK, ActorClass.POLICE})
TWO_WHEELED: Final = frozenset({ActorClass.MOTORCYCLE, ActorClass.BICYCLE})
PEOPLE_CLASSES: Final = frozenset({*TWO_WHEELED, ActorClass.PEDESTRIAN})
"""Classes that the demand of a template has as people, and that scores have in rows of their own."""
VEHICLE_CLASSES: Final = tuple(member for member in ActorClass if member is not ActorClass.PEDESTRIAN)


class Owner(IntEnum):
    """Which program decides an actor's motion at a step (paper, table of control ownership)."""

    SUMO = 0
    ROS = 1


class Lights(IntFlag):
    """The lights that an actor shows and the siren that it sounds, as flags."""

    NONE = 0
    BRAKE = 1
    INDICATOR_LEFT = 2
    INDICATOR_RIGHT = 4
    INDICATORS = INDICATOR_LEFT | INDICATOR_RIGHT
    BEACON = 8
    SIREN = 16


def indicator_to(move: float) -> int:
    """The indicator for a move to the left (above 0) or to the right."""
    return int(Lights.INDICATOR_LEFT if move > 0.0 else Lights.INDICATOR_RIGHT)


class Mode(IntEnum):
    """The active behaviour of an actor (paper, Algorithms 1 and 2)."""

    NOMINAL = 0
    ROUTE_FOLLOW = 1
    FORCED_LANE_CHANGE = 2
    COPY_SUMO = 3
    GAP_ESCAPE = 4
    YIELD_REACTING = 5
    """The driver has noticed the siren and has not yet reacted."""
    YIELD_DEFERRED = 6
    """The driver has to yield, but cannot at this step."""
    YIELD_LANE_CHANGE = 7
    YIELD_KEEP_LANE = 8
    """The lane is cleared. SUMO drives again, keeps the vehicle in its new lane and slows it down until the EMV has
    passed."""
    YIELD_PULL_OVER = 9
    YIELD_HOLD = 10
    REJOIN = 11
    """The yield is over. The navigator leads the vehicle back to its lane before SUMO takes over."""
    EXTERNAL = 12
    """A program outside the platform drives the vehicle: the AV under test."""
    STOPPED = 13
    """The vehicle had a contact. It brakes to a standstill and stays there."""

    @property
    def is_yielding(self) -> bool:
        """Whether the actor is in any phase of a yield response."""
        return Mode.YIELD_REACTING <= self <= Mode.YIELD_HOLD


@dataclass(frozen=True)
class ActorDescription(Brief):
    """The properties of an actor that do not change during an episode."""

    actor_id: int
    name: str
    """The vehicle's id in SUMO."""
    actor_class: ActorClass
    length_m: float
    width_m: float
    height_m: float
    colour_rgb: tuple[int, int, int]
    """Colour of the paint, 0–255 for each of red, green and blue."""
    is_emv: bool = False


MIRROR: Final = "mirror"
"""Key of a field's metadata: how ``mirror_image`` changes the field. A field without it is the same on both sides."""
LEFTWARD: Final = {MIRROR: "sign"}
"""Metadata of a field that is positive to the left or counter-clockwise."""
HEADING: Final = {MIRROR: "yaw"}
"""Metadata of a yaw in (−π, π]."""
SIDED: Final = {MIRROR: "sides"}
"""Metadata of a code of lights or flags, in which left and right have bits of their own."""
PARTS: Final = {MIRROR: "parts"}
"""Metadata of structures within a structure."""


@dataclass(frozen=True)
class ActorStates(Columns):
    """Simulated state of all actors at one step, in the ``map`` frame.

    Every array has shape ``(N,)``; rows are sorted by ``actor_id``. Positions are footprint centres. This is the only
    declaration of the columns in the library: records, conversions, hashes and mirror images take them from here. The
    message ``siren_msgs/ActorStates`` has the same names in the same order.
    """

    step: int
    actor_id: Ids
    x_m: Floats
    y_m: Floats = field(metadata=LEFTWARD)
    z_m: Floats
    yaw_rad: Floats = field(metadata=HEADING)
    vx_mps: Floats
    vy_mps: Floats = field(metadata=LEFTWARD)
    yaw_rate_radps: Floats = field(metadata=LEFTWARD)
    accel_mps2: Floats
    """Acceleration along the vehicle."""
    lateral_accel_mps2: Floats = field(metadata=LEFTWARD)
    steer_rad: Floats = field(metadata=LEFTWARD)
    """Angle of the road wheels, left positive."""
    throttle: Floats
    brake: Floats
    owner: Codes
    mode: Codes
    lights: Codes = field(metadata=SIDED)
    residual_m: Floats
    """Distance between the simulated pose and SUMO's pose of the same actor."""

    @property
    def speed_mps(self) -> Floats:
        """Speed over ground of each row."""
        return np.hypot(self.vx_mps, self.vy_mps)

    def __len__(self) -> int:
        return len(self.actor_id)

    @staticmethod
    def empty(step: int = 0) -> "ActorStates":
        """A step without actors."""
        arrays: dict[str, Any] = {name: np.empty(0, dtype) for name, dtype in ACTOR_STATE_DTYPES.items()}
        return ActorStates(step=step, **arrays)

    def row_of(self, actor_id: int) -> int | None:
        """Row of an actor; None if it is not on the map."""
        row = int(self.actor_id.searchsorted(actor_id))
        return row if row < len(self) and self.actor_id[row] == actor_id else None


RESIDUAL_LIMIT_M: Final = 20.0
"""Largest distance of a simulated vehicle from its pose in SUMO. SUMO's vehicle should have been moved back long
before."""
ACTOR_STATE_DTYPES: Final = dtypes_of(ActorStates)
"""Array fields of ActorStates and their element types, in declaration order."""


def rows_of_ids(actor_id: Ids, ids: Ids) -> npt.NDArray[np.intp]:
    """Row of each id in a sorted id array, −1 where it is absent; shape of ``ids``."""
    if len(actor_id) == 0:
        return np.full(len(ids), -1, dtype=np.intp)
    if len(actor_id) == len(ids) and (actor_id == ids).all():  # both arrays are equal at nearly every step
        return np.arange(len(ids))
    rows = actor_id.searchsorted(ids)
    rows[rows == len(actor_id)] = 0
    rows[actor_id[rows] != ids] = -1
    return rows
