"""Sensing step by step, where a step's measurements may end after the next step has begun."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

from siren_ros.sensor_messages.mounted_suite import MountedSuite
from siren_ros.sensor_messages.observation_messages import Published, shared_messages
from siren_ros.sensors.rig.observations import Observations, Sensing
from siren_ros.world.actors import ActorDescription, ActorStates
from siren_ros.world.traffic_state import SignalState


class TrailingSensing:
    """Measures with the suites of an episode, and knows of which steps all messages are out."""

    def __init__(self, suites: Sequence[MountedSuite], *, trails: bool) -> None:
        """Begin before the first step.

        Args:
            suites: The suites of the episode.
            trails: Whether a step's measurements may be finished within the next step.
        """
        self._suites = tuple(suites)
        self._trails = trails
        self._begun: tuple[ActorStates, list[Sensing]] | None = None
        self._unreported: list[int] = []
        self._busy_s = 0.0

    @property
    def under_way(self) -> bool:
        """Whether a step has begun whose measurements are not published."""
        return self._begun is not None

    def step(
        self, states: ActorStates, actors: Mapping[int, ActorDescription], signals: Iterable[SignalState]
    ) -> Iterator[Published]:
        """Begin to measure at a step; yield the messages that can be published now, each with its topic.

        The measurements of the step before end first. Their messages come after this step's measurements have begun,
        so that publishing runs in parallel with them.

        Args:
            states: All actors at the step.
            actors: Their descriptions, by id.
            signals: The traffic lights.

        Raises:
            EpisodeError: A carrier has left the map.
        """
        earlier = self._end()
        located = [suite.locate(states) for suite in self._suites]
        yield from shared_messages(states, actors, [transform for transforms, _ in located for transform in transforms])
        yield from (odometry for _, odometry in located)
        begun = [suite.rig.begin(states, actors, signals, suite.messages.carrier_id) for suite in self._suites]
        self._begun = (states, begun)
        yield from earlier
        if not self._trails or not any(sensing.under_way for sensing in begun):
            yield from self.finish()

    def finish(self) -> Iterator[Published]:
        """The messages of the step that has begun, after waiting for its measurements; none where none has."""
        yield from self._end()

    def finished_steps(self, busy_s: float) -> Iterator[tuple[int, float]]:
        """Steps whose messages are all out and that were not given before, each with the wall time spent since.

        Args:
            busy_s: Wall time that the caller spent on sensing since the call before.
        """
        self._busy_s += busy_s
        while self._unreported:
            yield self._unreported.pop(0), self._busy_s
            self._busy_s = 0.0

    def _end(self) -> Iterator[Published]:
        """Wait for the measurements that have begun, at once; their messages are made when they are asked for."""
        if self._begun is None:
            return iter(())
        (states, begun), self._begun = self._begun, None
        return self._messages(states, [sensing.finish() for sensing in begun])

    def _messages(self, states: ActorStates, seen: Sequence[Observations]) -> Iterator[Published]:
        for suite, observations in zip(self._suites, seen, strict=True):
            yield from suite.messages.of_step(states, observations)
        self._unreported.append(states.step)
