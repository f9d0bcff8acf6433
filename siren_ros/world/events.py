"""Discrete happenings of an episode, each with its step, actor and place."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from siren_ros.world.actors import NO_ACTOR


class EventKind(StrEnum):
    """The closed list of what can be recorded as an event."""

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
    """A vehicle in SUMO was brought back to the simulated one, which could not follow it."""
    TELEPORT = "teleport"


@dataclass(frozen=True)
class Event:
    """One happening at one step, in the ``map`` frame."""

    step: int
    kind: EventKind
    actor_id: int
    other_id: int = NO_ACTOR
    """The second actor where there is one: the EMV that is yielded to, the collision's partner."""
    x_m: float = 0.0
    y_m: float = 0.0
    detail: Mapping[str, float | int | str] = field(default_factory=dict)
    """What belongs to this kind: ``impact_speed_mps``, ``signal_state``, ``junction``, ``reason``, …"""
