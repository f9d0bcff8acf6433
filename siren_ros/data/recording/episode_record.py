"""The record of an episode: its bag's content in memory, for predicates, evaluation, pictures and exporters."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Ids, Rows
from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.tables.brief import Brief
from siren_ros.errors import InputError
from siren_ros.simulation.roads.mirror_image import mirrored_network
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.scenario.episode import EpisodeDescription, EpisodeOutcome
from siren_ros.simulation.world.actors import (
    ACTOR_STATE_DTYPES,
    NO_ACTOR,
    PEOPLE_CLASSES,
    ActorClass,
    ActorDescription,
    ActorStates,
)
from siren_ros.simulation.world.commands import VehicleCommands
from siren_ros.simulation.world.mirror_image import mirror_image
from siren_ros.simulation.world.traffic_state import Event, EventKind, TrafficState

Steps = npt.NDArray[np.int64]
_EVENT_KINDS: Final = frozenset(EventKind)


@dataclass(frozen=True)
class TopicRecord(Brief):
    """The messages of one topic: number, size and times."""

    name: str
    type_name: str
    count: int
    size_bytes: int
    """Size of the messages, serialised and uncompressed."""
    times_ns: Steps
    """Log time of every message, in order."""
    stamp_mismatches: int
    """Number of messages whose stamp differs from their log time; 0 for types that do not begin with a stamp."""


@dataclass(frozen=True)
class StateRows(ActorStates):
    """States of one or many actors over time: the columns of ``ActorStates`` with a step for each row."""

    step: Steps  # type: ignore[assignment] # one for each row in place of one for all

    @property
    def time_s(self) -> Floats:
        """Simulated time of each row."""
        return self.step * STEP_S

    @property
    def xy_m(self) -> Floats:
        """Positions, shape ``(M, 2)``."""
        return np.stack((self.x_m, self.y_m), axis=-1)

    @property
    def driven_m(self) -> Floats:
        """Distance driven up to each row of one actor's track."""
        return np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(self.x_m), np.diff(self.y_m)))))


@dataclass(frozen=True)
class EpisodeRecord(Brief):
    """A whole episode. Tuples over steps are in the order of time."""

    description: EpisodeDescription
    network: RoadNetwork
    actors: Mapping[int, ActorDescription]
    states: tuple[ActorStates, ...]
    traffic: tuple[TrafficState, ...]
    commands: Mapping[str, tuple[VehicleCommands, ...]]
    """Commands by the name of the controlling node."""
    events: tuple[Event, ...]
    outcome: EpisodeOutcome | None
    complete: bool
    """Whether the episode ended as planned and all of its steps have actor states."""
    topics: Mapping[str, TopicRecord]
    """By topic name; empty for a live episode, whose messages are not counted."""
    state_hashes: Mapping[int, int] = field(default_factory=dict)
    """Hash of the state by step, as the simulation computed it (``siren_ros.simulation.world.traffic_state``)."""
    lost_steps: int = 0
    """Number of steps without actor states, before the last step or before the recorded end."""
    map_xml: bytes = b""
    """The compiled SUMO net; empty in a record made by hand."""

    def facts(self) -> dict[str, object]:
        """What the episode is, and its result, as plain values."""
        described, outcome = self.description, self.outcome
        return {
            **{name: getattr(described, name) for name in ("template", "level", "seed")},
            "map": described.map_name,
            "steps": self.steps,
            "duration_s": self.duration_s,
            "actors": len(self.actors),
            "emv_ids": self.emv_ids,
            "events": len(self.events),
            "end": None if outcome is None else outcome.end,
            "interaction": None if outcome is None else outcome.predicate_holds,
            "complete": self.complete,
        }

    @cached_property
    def right_hand(self) -> "EpisodeRecord":
        """The record for judgements that depend on sides: itself if traffic keeps right, otherwise its mirror image."""
        return self.mirrored() if self.network.left_hand else self

    def mirrored(self) -> "EpisodeRecord":
        """The mirror image about the x axis of the ``map`` frame, with traffic on the other side."""
        return replace(
            self,
            network=mirrored_network(self.network),
            states=tuple(map(mirror_image, self.states)),
            traffic=tuple(map(mirror_image, self.traffic)),
            commands={source: tuple(map(mirror_image, rows)) for source, rows in self.commands.items()},
            events=tuple(map(mirror_image, self.events)),
        )

    @property
    def steps(self) -> int:
        """Number of recorded steps."""
        return len(self.states)

    @property
    def duration_s(self) -> float:
        """Simulated time of the recorded steps."""
        return self.steps * STEP_S

    @property
    def emv_ids(self) -> tuple[int, ...]:
        """Emergency vehicles of the episode. The template's predicate judges the first one, which has the sensors."""
        return self.description.emv_ids or tuple(sorted(key for key, actor in self.actors.items() if actor.is_emv))

    def by_emv(self) -> Iterator["EpisodeRecord"]:
        """Yield the record once per EMV, each time with that one as the first; measures refer to the first."""
        for emv_id in self.emv_ids:
            ids = (emv_id, *(other for other in self.emv_ids if other != emv_id))
            yield self if ids == self.emv_ids else replace(self, description=replace(self.description, emv_ids=ids))

    @cached_property
    def walker_ids(self) -> Ids:
        """Ids of the pedestrians."""
        walks = (key for key, actor in self.actors.items() if actor.actor_class is ActorClass.PEDESTRIAN)
        return np.array(sorted(walks), np.uint32)

    @cached_property
    def people_ids(self) -> Ids:
        """Ids of pedestrians and of riders on two wheels."""
        people = (key for key, actor in self.actors.items() if actor.actor_class in PEOPLE_CLASSES)
        return np.array(sorted(people), np.uint32)

    @cached_property
    def rows(self) -> StateRows:
        """All states, sorted by actor and then by step."""
        states = ActorStates.empty(), *self.states
        columns: dict[str, Any] = {
            name: np.concatenate([getattr(state, name) for state in states]) for name in ACTOR_STATE_DTYPES
        }
        steps = np.array([state.step for state in states], dtype=np.int64)
        rows = StateRows(np.repeat(steps, [len(state) for state in states]), **columns)
        return rows.select(np.lexsort((rows.step, rows.actor_id)))

    def rows_of(self, actor_id: int) -> Rows:
        """Indices into ``rows`` of one actor's states, in the order of time; none for an unknown actor."""
        first, last = np.searchsorted(self.rows.actor_id, [actor_id, actor_id + 1])
        return np.arange(first, last)

    def track(self, actor_id: int) -> StateRows:
        """States of one actor in the order of time; empty if it never entered the map.

        Raises:
            InputError: The episode has no such actor.
        """
        track = self.rows.select(self.rows_of(actor_id))
        if not len(track) and actor_id not in {*self.actors, *self.emv_ids, self.description.av_id} - {NO_ACTOR}:
            first, last = min(self.actors, default=NO_ACTOR), max(self.actors, default=NO_ACTOR)
            raise InputError("actor_id", actor_id, f"one of {len(self.actors)} keys of `actors`, {first} to {last}")
        return track

    def events_of(self, kind: EventKind) -> tuple[Event, ...]:
        """The events of one kind, also given as its text, such as ``collision``; in the order of time.

        Raises:
            InputError: There is no such kind.
        """
        if kind not in _EVENT_KINDS:
            raise InputError("kind", kind, f"one of {', '.join(EventKind)}")
        return tuple(event for event in self.events if event.kind == kind)

    def signal_states(self, signal_id: str) -> Mapping[int, str]:
        """State string of a traffic light by step; empty where none was recorded.

        Raises:
            InputError: The map has no such signal.
        """
        states = {
            traffic.step: signal.state
            for traffic in self.traffic
            for signal in traffic.signals
            if signal.signal_id == signal_id
        }
        if not states:
            known = {movement.signal_id for movement in self.network.connections if movement.signal_id is not None}
            if signal_id not in known:
                raise InputError("signal_id", signal_id, f"one of {', '.join(sorted(known))}")
        return states
