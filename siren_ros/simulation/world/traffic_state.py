"""What SUMO reports at one step, as structures of arrays, and the discrete events of an episode.

Two episodes that have the state hash in common at every step are the same.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntFlag, StrEnum
from hashlib import blake2b
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Codes, Floats, Ids, dtypes_of
from siren_ros.base.tables.brief import Brief
from siren_ros.simulation.world.actors import (
    ACTOR_STATE_DTYPES,
    HEADING,
    LEFTWARD,
    MIRROR,
    NO_ACTOR,
    PARTS,
    SIDED,
    ActorDescription,
    ActorStates,
)


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
    detail: Mapping[str, float | int | str] = field(default_factory=dict, metadata={MIRROR: "details"})
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
