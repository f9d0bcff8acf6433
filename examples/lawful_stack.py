"""A stack that passes the exam: a ROS node with the library's seat; a driver of your own takes the place of DRIVER.

./env siren exam --av 'python examples/lawful_stack.py' --rulebook california --out exam/
"""

from typing import Any

import rclpy
from rclpy.node import Node

from siren_ros.interfaces import topics, wire
from siren_ros.interfaces.conversions import from_actor_states, from_path, from_traffic_state, to_av_control
from siren_ros.interfaces.episode_conversions import from_episode_description
from siren_ros.roads.net_parser import parse_road_network
from siren_ros.ros.transport.endpoints import create_input, create_output
from siren_ros.seat.drivers.drivers import driver_of
from siren_ros.seat.seated import SeatedDriver

DRIVER = driver_of("lawful-california")


class Stack(Node):
    """Answers the traffic state and the actor states of a step with ``/av/control_cmd``."""

    def __init__(self) -> None:
        super().__init__("lawful_stack")
        self.got: dict[str, Any] = {}
        self.seated: SeatedDriver | None = None
        self.control = None
        for topic in (topics.EPISODE, topics.MAP, topics.AV_ROUTE, topics.EPISODE_END, topics.TRAFFIC, topics.ACTORS):
            create_input(self, topic, lambda cdr, topic=topic: self.on_message(topic, wire.decode(topic, cdr)))

    def on_message(self, topic: topics.Topic, message: Any) -> None:
        """Keep the newest message of each topic; answer when both of a step are there."""
        self.got[topic.name] = message
        states, traffic = (self.got.get(one.name) for one in (topics.ACTORS, topics.TRAFFIC))
        if topic in {topics.TRAFFIC, topics.ACTORS} and states and traffic and states.step == traffic.step:
            answer = self.seated.answer(from_actor_states(states), from_traffic_state(traffic))
            self.control.publish(wire.encode(topics.AV_CONTROL, to_av_control(answer)))

    def get_ready(self) -> None:
        """Take the seat when the way is known. The publisher comes last: with it, the episode begins."""
        known = [self.got.get(topic.name) for topic in (topics.EPISODE, topics.MAP, topics.AV_ROUTE)]
        heard = all(self.count_publishers(topic.name) for topic in (topics.TRAFFIC, topics.ACTORS))
        if self.control is None and heard and all(known):
            network, av_id = parse_road_network(known[1].data.encode()), from_episode_description(known[0]).av_id
            self.seated = SeatedDriver(DRIVER, network, from_path(known[2]), av_id)
            self.control = create_output(self, topics.AV_CONTROL)


if __name__ == "__main__":
    rclpy.init()
    stack = Stack()
    while topics.EPISODE_END.name not in stack.got:
        stack.get_ready()
        rclpy.spin_once(stack, timeout_sec=0.05)
