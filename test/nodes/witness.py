"""A program that hears every topic of an episode and writes down when each message came, its stamps and its frames.

    witness.py NAME TOPICS.json OUT.json

It takes part in the lockstep under NAME and reports a step when every message that is due at it has arrived, so that a
message that is lost or late ends the episode.
"""

import json
import sys
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from rclpy.node import Node

from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.conversions import Phase, StepReport, from_episode_end, to_step_done
from siren_ros.data.interfaces.messages import time_ns_of
from siren_ros.data.interfaces.topics import Topic
from siren_ros.running.ros.transport.endpoints import create_input, create_output

END = (topics.OUTCOME.name, topics.EPISODE_END.name)


def stamps_of(message: Any) -> list[tuple[int, list[str]]]:
    """Every stamp in a message with the frames that belong to it."""
    if hasattr(message, "clock"):
        return [(time_ns_of(message.clock), [])]
    if hasattr(message, "stamp"):
        return [(time_ns_of(message.stamp), [])]
    stamps = []
    if hasattr(message, "header"):
        frames = [message.header.frame_id]
        frames += [message.child_frame_id] if hasattr(message, "child_frame_id") else []
        stamps.append((time_ns_of(message.header.stamp), frames))
    for part in ("transforms", "markers", "detections", "poses"):
        for item in getattr(message, part, ()):
            stamps += stamps_of(item)
    return stamps


class Witness(Node):
    def __init__(self, name: str, heard: list[Topic]) -> None:
        super().__init__(name)
        self.heard = {topic.name: topic for topic in (*heard, topics.EPISODE_END)}
        self.log: dict[str, list[tuple[int, list[tuple[int, list[str]]]]]] = {topic: [] for topic in self.heard}
        self.step, self.ready, self.over, self.steps = 0, False, False, 0
        self.missing = self.due()
        self.report = create_output(self, topics.STEP_DONE)
        for topic in self.heard.values():
            create_input(self, topic, partial(self.on_message, topic))

    def due(self) -> set[str]:
        periodic = {name for name, topic in self.heard.items() if not topic.latched}
        now = {name for name in periodic if self.step % self.heard[name].period_steps == 0}
        return now if self.step else now | (set(self.heard) - periodic - {*END})

    def on_message(self, topic: Topic, cdr: bytes) -> None:
        message = wire.decode(topic, cdr)
        self.log[topic.name].append((self.step, stamps_of(message)))
        if topic == topics.EPISODE_END:
            self.steps = from_episode_end(message).steps
        if topic.name in END:
            if all(self.log[name] for name in END):
                self.say(Phase.FINAL, max(self.steps - 1, 0))
                self.over = True
            return
        self.missing.discard(topic.name)
        if not self.missing:
            self.step += 1
            self.missing = self.due()
            self.say(Phase.STEP, self.step - 1)

    def say(self, phase: Phase, step: int) -> None:
        message = to_step_done(StepReport(step, self.get_name(), phase))
        self.report.publish(wire.encode(topics.STEP_DONE, message))

    def say_ready(self) -> None:
        if not self.ready and self.report.get_subscription_count() and all(map(self.count_publishers, self.heard)):
            self.ready = True
            self.say(Phase.READY, 0)


def main() -> None:
    name, topics_file, out = sys.argv[1:]
    rclpy.init()
    node = Witness(name, [Topic(*entry) for entry in json.loads(Path(topics_file).read_text(encoding="utf-8"))])
    while not node.over:
        node.say_ready()
        rclpy.spin_once(node, timeout_sec=0.05)
    node.report.wait_for_all_acked()
    Path(out).write_text(json.dumps(node.log), encoding="utf-8")


if __name__ == "__main__":
    main()
