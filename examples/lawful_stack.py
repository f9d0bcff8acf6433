"""A stack that passes the exam: a ROS node with a driver of the library; one of your own takes the place of DRIVER.

./env siren exam --av 'python examples/lawful_stack.py' --rulebook california --out exam/
"""

import signal
from contextlib import suppress
from importlib import import_module
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from siren_ros import AvController

DRIVER = "lawful-california"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def message_class(type_name: str) -> Any:
    """The class of a type such as ``siren_msgs/msg/AvControl``."""
    package, _, name = type_name.split("/")
    return getattr(import_module(f"{package}.msg"), name)


class Stack(Node):
    """Answers the traffic state and the actor states of a step with ``/av/control_cmd``."""

    def __init__(self) -> None:
        super().__init__("lawful_stack")
        self.av = AvController(DRIVER)
        self.control = None
        for topic, kind in self.av.INPUTS.items():
            quality = LATCHED if topic in self.av.LATCHED else 8
            take = lambda cdr, topic=topic: self.on_message(topic, cdr)  # noqa: E731
            self.create_subscription(message_class(kind), topic, take, quality, raw=True)

    def on_message(self, topic: str, cdr: bytes) -> None:
        """Publish the answer when the messages of a step are there."""
        answer = self.av.take(topic, cdr)
        if answer is not None and self.control is not None:
            self.control.publish(answer)

    def get_ready(self) -> None:
        """The publisher comes last: with it, the episode begins."""
        heard = all(self.count_publishers(topic) for topic in self.av.INPUTS if topic not in self.av.LATCHED)
        if self.control is None and heard and self.av.ready:
            topic, kind = self.av.OUTPUT
            self.control = self.create_publisher(message_class(kind), topic, 8)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)  # its handlers may raise RCLError
    stack = Stack()
    with suppress(KeyboardInterrupt):  # Ctrl-C or SIGTERM
        while not stack.av.ended:
            stack.get_ready()
            rclpy.spin_once(stack, timeout_sec=0.05)
