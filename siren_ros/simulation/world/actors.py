"""Actors: what they are, their states at one step, what SUMO reports of them, and the discrete events of an episode.

The states are structures of arrays. Two episodes that have the state hash in common at every step are the same.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum, IntFlag, StrEnum
from hashlib import blake2b
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Brief, Codes, Columns, Floats, Ids, dtypes_of

Row = TypeVar("Row")
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

    @property
    def body(self) -> "ActorClass":
        """The plain class with such a body, whose rows in tables hold where a class has no row of its own."""
        return _BODIES.get(self, self)


_BODIES: Final = {
    ActorClass.HATCHBACK: ActorClass.SEDAN,
    ActorClass.ESTATE: ActorClass.SEDAN,
    ActorClass.SUV: ActorClass.SEDAN,
    ActorClass.PICKUP: ActorClass.SEDAN,
    ActorClass.AMBULANCE: ActorClass.VAN,
    ActorClass.FIRE_TRUCK: ActorClass.TRUCK,
    ActorClass.POLICE: ActorClass.SEDAN,
}
"""Classes that are not here are plain."""


def by_class(table: Mapping[ActorClass, Row]) -> Mapping[ActorClass, Row]:
    """The table with a row for every class: its own, or that of its body; without those that have neither."""
    rows = {kind: kind if kind in table else kind.body for kind in ActorClass}
    return {kind: table[row] for kind, row in rows.items() if row in table}


EMERGENCY_CLASSES: Final = frozenset({ActorClass.AMBULANCE, ActorClass.FIRE_TRUCK, ActorClass.POLICE})
TWO_WHEELED: Final = frozenset(kind for kind in ActorClass if kind.body in {ActorClass.MOTORCYCLE, ActorClass.BICYCLE})
PEOPLE_CLASSES: Final = frozenset({*TWO_WHEELED, ActorClass.PEDESTRIAN})
"""Classes that the demand of a template has as people, and that scores have in rows of their own."""
MIRRORS_M: Final = 0.4
"""Width of a vehicle's two mirrors, which bodies are measured without."""
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


TURN_LIGHTS: Final = {"l": Lights.INDICATOR_LEFT, "t": Lights.INDICATOR_LEFT, "r": Lights.INDICATOR_RIGHT}
"""The indicator of a movement across a junction, by its direction; bends of the road have none."""


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


MIRRORED_BY: Final = "mirror"
"""Key of a field's metadata: how ``mirror_image`` changes the field. A field without it is the same on both sides."""
LEFTWARD: Final = {MIRRORED_BY: "sign"}
"""Metadata of a field that is positive to the left or counter-clockwise."""
HEADING: Final = {MIRRORED_BY: "yaw"}
"""Metadata of a yaw in (−π, π]."""
SIDED: Final = {MIRRORED_BY: "sides"}
"""Metadata of a code of lights or flags, in which left and right have bits of their own."""
PARTS: Final = {MIRRORED_BY: "parts"}
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


class EventKind(StrEnum):
    """All kinds of events that a record can contain."""

    SIREN_ON = "siren_on"
    SIREN_OFF = "siren_off"
    YIELD_REQUESTED = "yield_requested"
    YIELD_DEFERRED = "yield_deferred"
    YIELD_STARTED = "yield_started"
    YIELD_COMPLETED = "yield_completed"
    """A lane change out of the EMV's lane reached its target lane."""
    YIELD_HELD = "yield_held"
    YIELD_CANCELLED = "yield_cancelled"
    YIELD_RELEASED = "yield_released"
    LANE_CHANGE_REQUESTED = "lane_change_requested"
    LANE_CHANGE_DEFERRED = "lane_change_deferred"
    LANE_CHANGE_STARTED = "lane_change_started"
    LANE_CHANGE_COMPLETED = "lane_change_completed"
    LANE_CHANGE_CANCELLED = "lane_change_cancelled"
    CORRIDOR_ENTERED = "corridor_entered"
    CORRIDOR_LEFT = "corridor_left"
    GAP_ESCAPE_ENTERED = "gap_escape_entered"
    GAP_ESCAPE_REPLANNED = "gap_escape_replanned"
    GAP_ESCAPE_WAITING = "gap_escape_waiting"
    GAP_ESCAPE_LEFT = "gap_escape_left"
    STOP_LINE_CROSSED = "stop_line_crossed"
    JUNCTION_LEFT = "junction_left"
    COLLISION = "collision"
    OWNER_CHANGED = "owner_changed"
    SPAWNED = "spawned"
    REMOVED = "removed"
    REALIGNED = "realigned"
    """A vehicle in SUMO was moved back to its simulated pose, because it could not follow."""
    TELEPORT = "teleport"


@dataclass(frozen=True)
class Event:
    """Something that happened at one step, in the ``map`` frame."""

    step: int
    kind: EventKind
    actor_id: int
    other_id: int = NO_ACTOR
    """The second actor, where there is one: the EMV that is yielded to, or the partner of a collision."""
    x_m: float = 0.0
    y_m: float = field(default=0.0, metadata=LEFTWARD)
    detail: Mapping[str, float | int | str] = field(default_factory=dict, metadata={MIRRORED_BY: "details"})
    """Further facts of this kind of event: ``impact_speed_mps``, ``signal_state``, ``junction``, ``reason``, …"""


Indices = npt.NDArray[np.int32]


class TrafficFlags(IntFlag):
    """What SUMO says of one vehicle at one step, as flags."""

    NONE = 0
    RESCUE_LANE = 1
    """An EMV with a siren comes from behind, within its reach (the paper's ``rescueLane``)."""
    WANTS_LEFT = 2
    WANTS_RIGHT = 4
    ON_JUNCTION = 8


@dataclass(frozen=True)
class SignalState:
    """State of one traffic light: one character of SUMO's ``rygGsuoO`` alphabet per controlled link."""

    signal_id: str
    state: str


@dataclass(frozen=True)
class EmvAdvice:
    """What SUMO advises for one emergency vehicle, whether SUMO or ROS drives it."""

    actor_id: int
    lane_change_intent: int = field(metadata=LEFTWARD)
    """Lane change that SUMO would make: +1 left, −1 right, 0 none."""
    leader_id: int
    """Nearest vehicle ahead on the route within the query range, or NO_ACTOR."""
    leader_gap_m: float
    speed_without_control_mps: float
    """The speed that SUMO itself would choose at this step."""
    rescue_count: int
    """Number of vehicles that currently react to this EMV."""


@dataclass(frozen=True)
class TrafficState(Brief):
    """SUMO's state at one step, and the simulated poses that SUMO was given before the step.

    Arrays have shape ``(N,)``, rows sorted by ``actor_id``; poses in the ``map`` frame at the footprint's centre.
    ``sumo_*`` is SUMO's pose at this step; ``x_m … speed_mps`` is the pose that ``vehicle_dynamics`` simulated at the
    step before (for an actor just spawned: SUMO's).
    """

    step: int
    spawned: tuple[ActorDescription, ...]
    removed: Ids
    actor_id: Ids
    owner: Codes
    sumo_x_m: Floats
    sumo_y_m: Floats = field(metadata=LEFTWARD)
    sumo_yaw_rad: Floats = field(metadata=HEADING)
    sumo_speed_mps: Floats
    sumo_accel_mps2: Floats
    x_m: Floats
    y_m: Floats = field(metadata=LEFTWARD)
    yaw_rad: Floats = field(metadata=HEADING)
    speed_mps: Floats
    lane: Indices
    """Index into ``RoadNetwork.lanes`` of the lane that the front bumper is on; −1 off the road."""
    lane_position_m: Floats
    """Distance of the front bumper from the beginning of its lane."""
    lateral_offset_m: Floats = field(metadata=LEFTWARD)
    """Lateral distance of the vehicle from its lane's centre line, left positive."""
    lights: Codes = field(metadata=SIDED)
    flags: Codes = field(metadata=SIDED)
    route_offset: Indices
    """Where each row's part of ``route_edges`` begins, shape ``(N + 1,)``: row i has
    ``route_edges[route_offset[i]:route_offset[i + 1]]``."""
    route_edges: Indices
    """Indices into ``RoadNetwork.edges``: the present edge (or the one before the junction) and those ahead."""
    emvs: tuple[EmvAdvice, ...] = field(metadata=PARTS)
    signals: tuple[SignalState, ...]
    events: tuple[Event, ...] = field(default=(), metadata=PARTS)

    def __len__(self) -> int:
        return len(self.actor_id)

    def route_of_row(self, row: int) -> Indices:
        """Edge indices from the present edge onward of the actor in a row."""
        return self.route_edges[self.route_offset[row] : self.route_offset[row + 1]]


TRAFFIC_STATE_DTYPES: Final = dtypes_of(TrafficState)
"""Array fields of TrafficState and their element types, in declaration order."""


HASH_BYTES: Final = 8
_HASHED: Final = {name: np.dtype(kind).newbyteorder("<") for name, kind in ACTOR_STATE_DTYPES.items()}


def hash_state(states: ActorStates, signals: Sequence[SignalState]) -> int:
    """64-bit BLAKE2b (RFC 7693) over every field of every actor and the state of every traffic light.

    The fields are taken to the last bit, in declaration order, little-endian on every platform; lengths go in as well,
    so that no two states share their bytes. ``states`` and ``signals`` are of the same step.
    """
    digest = blake2b(digest_size=HASH_BYTES)
    digest.update(np.array([states.step, len(states), len(signals)], dtype="<u8").tobytes())
    for name, kind in _HASHED.items():
        digest.update(np.ascontiguousarray(getattr(states, name), kind).data)
    for signal in signals:
        digest.update(f"{signal.signal_id}\0{signal.state}\0".encode())
    return int.from_bytes(digest.digest(), "little")
