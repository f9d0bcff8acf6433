"""A running episode as data of the page: first all that is known, then updates.

Both are files of the format that the page of a recorded episode holds. A file of what is new has rows of the new frames
alone, and counts frames from its own first one. Frames may be more than a step apart: not all steps are heard
(``siren_ros/running/ros/transport/copies.py``).
"""

import threading
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from siren_ros.data.interfaces import topics
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.recording.record_builder import RecordBuilder
from siren_ros.reports.episode_page.build import FORMAT, episode_data, events_of
from siren_ros.reports.episode_page.columns import QUICK, ColumnFile
from siren_ros.reports.episode_page.motion import add_motion
from siren_ros.reports.episode_page.parts import signals_of
from siren_ros.sensing.meshes.mesh import StaticScene
from siren_ros.sensing.scene.kept_scenes import kept_scene
from siren_ros.sensing.scene.kerbside import scene_config_of
from siren_ros.simulation.world.actors import ActorStates

_SETTING: Final = (topics.EPISODE.name, topics.MAP.name)
NO_WHY: Final = "Not known while an episode runs; the page of its bag says it."
LIVE_TOPICS: Final = topics.OBSERVED | {
    topic.name: topic for topic in (topics.EPISODE, topics.MAP, topics.ROSTER, topics.EPISODE_END, topics.OUTCOME)
}
"""Topics to subscribe to, by the name that they have in an episode."""


@dataclass(frozen=True)
class Place:
    """Position of a reader in an episode."""

    step: int = -1
    """The last step that the reader has."""
    judged: bool = False
    """Whether the reader has the outcome."""


class LiveEpisode:
    """One episode, from the first message received. One thread adds messages, others read."""

    def __init__(self) -> None:
        """Start without messages."""
        self._builder = RecordBuilder()
        self._latest: dict[str, int] = dict.fromkeys(topics.OBSERVED, -1)
        self._heard: set[str] = set()
        self._from_start = False
        self._adding, self._preparing = threading.Lock(), threading.Lock()
        self._scene: StaticScene | None = None
        self._begin: tuple[bytes, Place] | None = None

    def belongs(self, topic: str) -> bool:
        """Whether a message can belong to this episode; otherwise it is the first of the next one."""
        return topic not in _SETTING or not self._heard & {topic, topics.EPISODE_END.name}

    def add(self, topic: str, message: Any) -> None:
        """Add a message of a topic of ``LIVE_TOPICS``.

        Raises:
            SirenError: Its content cannot be used.
        """
        with self._adding:
            self._builder.add(topic, message)
            self._heard.add(topic)
            if topic in self._latest:
                self._latest[topic] = int(message.step)
                self._from_start |= message.step == 0

    @property
    def is_set(self) -> bool:
        """Whether its description and its map are known."""
        return self._heard.issuperset(_SETTING)

    @property
    def progress(self) -> tuple[int, bool]:
        """The last complete step, and whether the outcome is known; -1 before there is data to show.

        DDS keeps the order of a topic's messages, and not that of different topics.
        """
        introduced = self._from_start or topics.ROSTER.name in self._heard
        return min(self._latest.values()) if introduced and self.is_set else -1, topics.OUTCOME.name in self._heard

    def prepare(self) -> None:
        """Make the scene, which takes seconds in a town; otherwise the first reader waits for it.

        Raises:
            BagError: Before description and map are known.
        """
        with self._preparing:
            if self._scene is None:
                setting = self._part(range(0))
                config = scene_config_of(setting.description.template_values)
                self._scene = kept_scene(setting.network, setting.description.seed, config)

    def since(self, place: Place) -> tuple[bytes, Place]:
        """New data for a reader and its new position; from the default position, the whole episode so far.

        Call it where ``progress`` is beyond the place.
        """
        if place.step < 0:
            self.prepare()
            with self._preparing:
                if self._begin is None:
                    last, _ = self.progress
                    part = self._part(range(last + 1))
                    self._begin = episode_data(part, NO_WHY, live=self._scene), Place(last)
            return self._begin
        last, judged = self.progress
        record = self._part(range(place.step + 1, last + 1))
        file = ColumnFile()
        head = {
            "format": FORMAT,
            "actors": add_motion(file, record),
            "events": events_of(record),
            "signals": signals_of(record),
        }
        return file.packed({**head, **(_end_of(record) if judged else {})}, QUICK), Place(last, judged)

    def _part(self, steps: range) -> EpisodeRecord:
        """Record of some steps, as received."""
        with self._adding:
            record = self._builder.build(steps=steps)
        return replace(record, states=tuple(_known(state, record.actors) for state in record.states))


def _known(state: ActorStates, actors: Collection[int]) -> ActorStates:
    """The state without actors that have no description."""
    known = np.isin(state.actor_id, list(actors))
    return state if known.all() else state.select(known)


def _end_of(record: EpisodeRecord) -> Mapping[str, Any]:
    """The end of the episode for the head of the data; empty while it runs."""
    outcome = record.outcome
    if outcome is None:
        return {}
    holds, text = outcome.predicate_holds, str(outcome.measures.get("predicate", ""))
    verdict = None if holds is None else {"holds": holds, "text": text, "parts": []}
    return {"ended": outcome.end.value, "verdict": verdict}
