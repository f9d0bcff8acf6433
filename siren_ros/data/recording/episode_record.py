"""The record of an episode: its bag's content in memory, and the builder that makes it message by message.

Predicates, evaluation, pictures and exporters read the record. The builder takes messages of a bag, or those that the
recorder writes. It checks them before they are used, because a bag may come from an untrusted source.
"""

import math
from bisect import bisect_left
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Brief, Floats, Ids, Rows
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.interfaces import conversions, topics
from siren_ros.data.interfaces.conversions import EpisodeClosing, from_av_control
from siren_ros.errors import BagError, InputError
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import RoadNetwork, mirror_image, mirrored_network
from siren_ros.simulation.scenario.episode import EpisodeDescription, EpisodeEnd, EpisodeOutcome
from siren_ros.simulation.world.actors import (
    ACTOR_STATE_DTYPES,
    NO_ACTOR,
    PEOPLE_CLASSES,
    TRAFFIC_STATE_DTYPES,
    ActorClass,
    ActorDescription,
    ActorStates,
    Event,
    EventKind,
    TrafficState,
)
from siren_ros.simulation.world.commands import AV_SOURCE, COMMAND_DTYPES, VehicleCommands, av_commands

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
    """Hash of the state by step, as the simulation computed it (``siren_ros.simulation.world.actors``)."""
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

    @cached_property
    def _signal_states(self) -> Mapping[str, Mapping[int, str]]:
        """State strings of all traffic lights by step."""
        states: dict[str, dict[int, str]] = {}
        for traffic in self.traffic:
            for signal in traffic.signals:
                states.setdefault(signal.signal_id, {})[traffic.step] = signal.state
        return states

    def signal_states(self, signal_id: str) -> Mapping[int, str]:
        """State string of a traffic light by step; empty where none was recorded.

        Raises:
            InputError: The map has no such signal.
        """
        states = self._signal_states.get(signal_id, {})
        if not states:
            known = {movement.signal_id for movement in self.network.connections if movement.signal_id is not None}
            if signal_id not in known:
                raise InputError("signal_id", signal_id, f"one of {', '.join(sorted(known))}")
        return states


LAST_STEP: Final = 2**31
"""Largest step number that is accepted: three years of simulated time."""
LONGEST_S: Final = 1e8
_OF_OTHER_LENGTH: Final = frozenset({"removed", "route_offset", "route_edges"})
_TRAFFIC_COLUMNS: Final = tuple(name for name in TRAFFIC_STATE_DTYPES if name not in _OF_OTHER_LENGTH)
RECORD_TOPICS: Final = (
    *(topics.EPISODE, topics.MAP, topics.TRAFFIC, topics.EMV_COMMANDS, topics.YIELD_COMMANDS),
    *(topics.AV_CONTROL, topics.ACTORS, topics.EVENTS, topics.EPISODE_END, topics.OUTCOME),
)
"""The topics of a record; messages on other topics are only counted."""
Reading: TypeAlias = Callable[[Callable[[Any], Any], Any], Any]
"""Applies a conversion to a message; it may return an earlier result for the same message."""


def check_columns(columns: ActorStates | TrafficState | VehicleCommands, names: Collection[str]) -> None:
    """Check columns of a message; BagError unless these have the same length and the step is in range."""
    what = f"{type(columns).__name__} of step {columns.step}"
    if not 0 <= columns.step < LAST_STEP:
        raise BagError(what, f"steps from 0 to {LAST_STEP - 1}")
    if len({len(getattr(columns, name)) for name in names}) > 1:
        raise BagError(what, "columns of one length")


def check_traffic(traffic: TrafficState) -> None:
    """Check a traffic state like ``check_columns``; its routes must also lie within their list."""
    check_columns(traffic, _TRAFFIC_COLUMNS)
    ends = traffic.route_offset
    bounded = len(ends) == 0 or (ends[0] >= 0 and ends[-1] <= len(traffic.route_edges))
    if len(ends) not in {0, len(traffic.actor_id) + 1} or not bounded or (ends[1:] < ends[:-1]).any():
        raise BagError(f"TrafficState of step {traffic.step}", "routes that lie within route_edges")


def check_description(description: EpisodeDescription) -> None:
    """Check a description; BagError unless its duration is finite, not negative and at most ``LONGEST_S``."""
    if not (math.isfinite(description.duration_s) and 0.0 <= description.duration_s <= LONGEST_S):
        raise BagError(f"duration_s {description.duration_s}", f"a number from 0 to {LONGEST_S:g}")


def outcome_of_what_is_held(
    outcome: EpisodeOutcome | None, closing: EpisodeClosing | None, steps: Sequence[int]
) -> EpisodeOutcome | None:
    """The recorded outcome, or a failure that says which steps a bag lacks.

    ``steps`` are the numbers of the steps whose actor states the bag holds, in its order.
    """
    if outcome is None or outcome.end is not EpisodeEnd.COMPLETE:
        return outcome
    closed = outcome.steps if closing is None else max(outcome.steps, closing.steps)
    if list(steps) == list(range(closed)):
        return outcome
    held = len({step for step in steps if step < closed})
    reason = f"the bag holds {held} of the {closed} steps that were closed"
    if held == closed:
        reason = f"the bag holds more than the {closed} steps that were closed"
    return replace(outcome, end=EpisodeEnd.FAILED, reason=reason, predicate_holds=None)


def read_anew(read: Callable[[Any], Any], message: Any) -> Any:
    """Convert a message without a cache."""
    return read(message)


Item = TypeVar("Item", ActorStates, TrafficState, Event)


def _of_steps(items: Sequence[Item], steps: range | None) -> tuple[Item, ...]:
    """Select the items of some steps from a sequence in the order of steps; without steps, select all."""
    if steps is None:
        return tuple(items)
    first, end = (bisect_left(items, step, key=lambda item: item.step) for step in (steps.start, steps.stop))
    return tuple(items[first:end])


class _TopicCounter:
    def __init__(self, type_name: str) -> None:
        self.type_name = type_name
        self.times_ns: list[int] = []
        self.size_bytes = 0
        self.stamp_mismatches = 0

    def record(self, name: str) -> TopicRecord:
        times_ns = np.array(self.times_ns, dtype=np.int64)
        return TopicRecord(name, self.type_name, len(times_ns), self.size_bytes, times_ns, self.stamp_mismatches)


class RecordBuilder:
    """Collects an episode's messages; ``build`` gives the record of what has been added so far."""

    def __init__(self, read: Reading = read_anew) -> None:
        """Begin empty; ``read`` applies a conversion to a message, or returns its earlier result."""
        self._read = read
        self._description: EpisodeDescription | None = None
        self._network: RoadNetwork | None = None
        self._map_xml = b""
        self._actors: dict[int, ActorDescription] = {}
        self._states: list[ActorStates] = []
        self._traffic: list[TrafficState] = []
        self._commands: dict[str, list[VehicleCommands]] = {}
        self._events: list[Event] = []
        self._state_hashes: dict[int, int] = {}
        self._closing: EpisodeClosing | None = None
        self._outcome: EpisodeOutcome | None = None
        self._counters: dict[str, _TopicCounter] = {}
        self._takers: dict[str, Callable[[Any], None]] = {
            topics.EPISODE.name: self._take_description,
            topics.MAP.name: self._take_map,
            topics.TRAFFIC.name: self._take_traffic,
            topics.ROSTER.name: self._take_roster,
            topics.EMV_COMMANDS.name: self._take_commands,
            topics.YIELD_COMMANDS.name: self._take_commands,
            topics.AV_CONTROL.name: self._take_av_control,
            topics.ACTORS.name: self._take_states,
            topics.EVENTS.name: self._take_events,
            topics.EPISODE_END.name: self._take_end,
            topics.OUTCOME.name: self._take_outcome,
        }

    def add(self, topic: str, message: Any) -> None:
        """Add a decoded message, of rclpy or rosbags.

        Topics other than ``RECORD_TOPICS`` and the roster are ignored.
        """
        if topic in self._takers:
            self._takers[topic](message)

    def count(self, topic: str, type_name: str, time_ns: int, size_bytes: int, stamp_ns: int | None) -> None:
        """Count a message of any topic by its log time; ``stamp_ns`` is its stamp, None if the type has none."""
        counter = self._counters.setdefault(topic, _TopicCounter(type_name))
        counter.times_ns.append(time_ns)
        counter.size_bytes += size_bytes
        counter.stamp_mismatches += stamp_ns is not None and stamp_ns != time_ns

    def _take_description(self, message: Any) -> None:
        description = conversions.from_episode_description(message)
        check_description(description)
        self._description = description

    def _take_map(self, message: Any) -> None:
        self._map_xml = str(message.data).encode()
        self._network = parse_road_network(self._map_xml)

    def _take_traffic(self, message: Any) -> None:
        traffic = self._read(conversions.from_traffic_state, message)
        check_traffic(traffic)
        self._traffic.append(traffic)
        self._actors.update({actor.actor_id: actor for actor in traffic.spawned})

    def _take_roster(self, message: Any) -> None:
        known = map(conversions.from_actor_description, message.spawned)
        self._actors.update({actor.actor_id: actor for actor in known})

    def _take_commands(self, message: Any) -> None:
        commands = self._read(conversions.from_vehicle_commands, message)
        check_columns(commands, COMMAND_DTYPES)
        self._commands.setdefault(commands.source, []).append(commands)

    def _take_av_control(self, message: Any) -> None:
        control = from_av_control(message)
        av_id = NO_ACTOR if self._description is None else self._description.av_id
        self._commands.setdefault(AV_SOURCE, []).append(av_commands(control, control.step, av_id))

    def _take_states(self, message: Any) -> None:
        states = self._read(conversions.from_actor_states, message)
        check_columns(states, ACTOR_STATE_DTYPES)
        self._states.append(states)

    def _take_events(self, message: Any) -> None:
        step, state_hash, events = self._read(conversions.from_events, message)
        self._state_hashes[step] = state_hash
        self._events.extend(events)

    def _take_end(self, message: Any) -> None:
        self._closing = conversions.from_episode_end(message)

    def _take_outcome(self, message: Any) -> None:
        self._outcome = conversions.from_episode_outcome(message)

    def build(self, name: str = "episode", steps: range | None = None) -> EpisodeRecord:
        """Build the record of all messages so far; BagError with this name if the description or the map is missing.

        With ``steps``, states, traffic and events are those of these steps alone, which came in order, and the outcome
        is as it was told.
        """
        if self._description is None:
            raise BagError(name, f"a bag with an episode's description on {topics.EPISODE.name}")
        if self._network is None:
            raise BagError(name, f"a bag with the episode's map on {topics.MAP.name}")
        states = _of_steps(self._states, steps)
        numbers = [state.step for state in states]
        held = outcome_of_what_is_held(self._outcome, self._closing, numbers) if steps is None else self._outcome
        ended = self._closing is not None and self._closing.end is EpisodeEnd.COMPLETE
        closed = self._closing.steps if self._closing is not None and ended else 0
        closed = max([closed, *(step + 1 for step in numbers)])
        return EpisodeRecord(
            description=self._description,
            network=self._network,
            map_xml=self._map_xml,
            actors=dict(sorted(self._actors.items())),
            states=states,
            traffic=_of_steps(self._traffic, steps),
            commands={source: tuple(rows) for source, rows in sorted(self._commands.items())},
            events=_of_steps(self._events, steps),
            outcome=held,
            complete=held is not None and held.end is EpisodeEnd.COMPLETE,
            lost_steps=closed - len(set(numbers)),
            topics={topic: counter.record(topic) for topic, counter in sorted(self._counters.items())},
            state_hashes=dict(self._state_hashes),
        )
