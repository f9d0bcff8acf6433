"""``recorder``: writes the bag and judges the outcome."""

import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.conversions import EpisodeClosing
from siren_ros.data.interfaces.messages import typestore
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.recording.bag_folder import default_bag_path_of
from siren_ros.data.recording.bag_writer import BagOptions
from siren_ros.data.recording.recorder import EpisodeRecorder
from siren_ros.data.sensor_messages.sensor_topics import topics_of
from siren_ros.running.ros.node_configs import RecorderConfig
from siren_ros.running.ros.participants.participant import Participant
from siren_ros.running.ros.programs.program import run_program
from siren_ros.scoring.judging.outcome import judge
from siren_ros.simulation.scenario.episode import EpisodeDescription


class Recorder(Participant[RecorderConfig]):
    """Writes the bag; a step is done for it when all messages of the step are there."""

    config_type = RecorderConfig
    outputs = (topics.OUTCOME,)

    def __init__(self, name: str, **node_options: Any) -> None:
        super().__init__(name, **node_options)
        self._busy_s = 0.0
        latched = frozenset(topic.name for topic in topics.FIXED_TOPICS.values() if topic.latched)
        bag = Path(self.config.bag) if self.config.bag else None
        options = BagOptions(overwrite=self.config.overwrite)
        self._recorder = EpisodeRecorder(bag, typestore(), latched, judge, wire.decode, wire.content, options)
        self._recorder.on_step_recorded = self._on_step_recorded
        self._listening: set[str] = set()
        self._listen(topics.CORE_TOPICS)

    def _listen(self, topics_: tuple[Topic, ...]) -> None:
        for topic in topics_:
            if topic.name not in self._listening and topic != topics.OUTCOME:
                self._listening.add(topic.name)
                self.add_raw_input(topic, partial(self._on_message, topic))

    def prepare(self, episode: EpisodeDescription, map_xml: bytes) -> None:  # noqa: ARG002 - the interface of all nodes
        """Subscribe to what this episode's sensors and its AV bring."""
        expected = topics_of(episode)
        self._listen(expected)
        self._recorder.expect(expected, default_bag_path_of(episode))

    def is_connected(self) -> bool:
        """Whether every topic that is recorded has its publisher."""
        return super().is_connected() and all(self.count_publishers(name) for name in self._listening)

    def _on_message(self, topic: Topic, cdr: bytes) -> None:
        began = time.perf_counter()
        self._recorder.take(topic, cdr)
        self._busy_s += time.perf_counter() - began

    def _on_step_recorded(self, step: int) -> None:
        busy_s, self._busy_s = self._busy_s, 0.0
        self.step_finished(step, busy_s)

    def discard(self) -> None:
        """Leave nothing behind of an episode that could not be set up."""
        self._recorder.discard()

    @property
    def steps_done(self) -> int:
        """Number of steps of which every message is recorded."""
        return self._recorder.steps_recorded

    def close(self, closing: EpisodeClosing) -> None:
        """Judge the episode, complete the bag, tell the outcome."""
        _, _, message = self._recorder.close(closing)
        self.send(topics.OUTCOME, message)


NODE = Recorder
main = partial(run_program, NODE, "recorder")

if __name__ == "__main__":
    sys.exit(main())
