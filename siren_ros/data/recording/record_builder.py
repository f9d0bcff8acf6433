"""Builds an ``EpisodeRecord`` message by message, from a bag or while the recorder writes one.

The messages are checked before they are used, because a bag may come from an untrusted source.
"""

import math
from bisect import bisect_left
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any, Final, Protocol, TypeAlias, TypeVar

import numpy as np

from siren_ros.data.interfaces import conversions, episode_conversions, topics
from siren_ros.data.interfaces.conversions import from_av_control
from siren_ros.data.interfaces.episode_conversions import EpisodeClosing
from siren_ros.data.recording.episode_record import EpisodeRecord, TopicRecord
from siren_ros.errors import BagError
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.scenario.episode import EpisodeDescription, EpisodeEnd, EpisodeOutcome
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, NO_ACTOR, ActorDescription, ActorStates
from siren_ros.simulation.world.commands import AV_SOURCE, COMMAND_DTYPES, VehicleCommands, av_commands
from siren_ros.simulation.world.traffic_state import TRAFFIC_STATE_DTYPES, Event, TrafficState

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


class _Stepped(Protocol):
    @property
    def step(self) -> int: ...


Item = TypeVar("Item", bound=_Stepped)


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
        description = episode_conversions.from_episode_description(message)
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
        self._closing = episode_conversions.from_episode_end(message)

    def _take_outcome(self, message: Any) -> None:
        self._outcome = episode_conversions.from_episode_outcome(message)

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
