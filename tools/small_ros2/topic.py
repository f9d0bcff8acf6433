"""``ros2 topic list``, ``info``, ``echo`` and ``hz``."""

import argparse
import re
import sys
import time
from collections import deque
from typing import Any

import numpy as np
from rclpy.qos import HistoryPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosidl_runtime_py import message_to_yaml

from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.topics import Topic
from siren_ros.running.ros.node_configs import DEFAULT_PARTICIPANTS, OPTIONAL_PARTICIPANTS
from siren_ros.running.ros.transport.endpoints import qos_of
from small_ros2.errors import CommandError
from small_ros2.ros_graph import (
    DISCOVERY_S,
    discovered_topics,
    matching_qos,
    message_class,
    observer,
    spin_until,
    type_of_topic,
)

REPORT_PERIOD_S = 1.0
TRUNCATE_LENGTH = 128
"""Longer arrays and strings are cut, as the real ``ros2 topic echo`` does."""
WINDOW = 10_000
SIREN_NODES = frozenset({"cosim", *DEFAULT_PARTICIPANTS, *OPTIONAL_PARTICIPANTS})


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the verbs."""
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    listing = verbs.add_parser("list", help="list the topics")
    listing.add_argument("-t", "--show-types", action="store_true", help="also print the types")
    listing.set_defaults(main=list_topics)

    info = verbs.add_parser("info", help="print the type and the numbers of publishers and subscriptions of a topic")
    info.add_argument("topic", help="name of the topic")
    info.add_argument("--verbose", "-v", action="store_true", help="also print each one's node and quality of service")
    info.set_defaults(main=print_info)

    echo = verbs.add_parser("echo", help="print the messages of a topic")
    echo.add_argument("topic", help="name of the topic")
    echo.add_argument("type", nargs="?", help="its type, where nobody publishes it yet")
    echo.add_argument("--once", action="store_true", help="end after the first message")
    echo.add_argument("--raw", action="store_true", help="print the serialised bytes")
    echo.add_argument("--full-length", "-f", action="store_true", help="do not cut long arrays and strings")
    echo.set_defaults(main=echo_topic)

    rate = verbs.add_parser("hz", help="print how often messages arrive")
    rate.add_argument("topic", help="name of the topic")
    rate.add_argument("--window", "-w", type=int, default=WINDOW, help=f"number of intervals averaged ({WINDOW})")
    rate.set_defaults(main=measure_rate)

    for verb in (listing, info, echo, rate):
        verb.add_argument(
            "--spin-time",
            type=float,
            default=DISCOVERY_S,
            metavar="S",
            help=f"at most so many s of discovery ({DISCOVERY_S})",
        )


def full_name(topic: str) -> str:
    """The topic's name from the root."""
    return topic if topic.startswith("/") else f"/{topic}"


def list_topics(arguments: argparse.Namespace) -> int:
    """Prints the topics, sorted."""
    with observer("small_ros2_topic_list") as node:
        for name, types in sorted(discovered_topics(node, arguments.spin_time).items()):
            print(f"{name} [{', '.join(types)}]" if arguments.show_types else name)
    return 0


def with_depth(endpoint: TopicEndpointInfo, topic: str) -> TopicEndpointInfo:
    """An endpoint with its history, where that is known.

    Fast DDS does not tell others the history of an endpoint, so that the real ros2 prints UNKNOWN. What SIREN's own
    nodes have is in their table of topics.
    """
    declared = declared_topic(topic, endpoint.topic_type)
    if endpoint.qos_profile.history == HistoryPolicy.UNKNOWN and declared and endpoint.node_name in SIREN_NODES:
        endpoint.qos_profile.history = HistoryPolicy.KEEP_LAST
        endpoint.qos_profile.depth = qos_of(declared).depth
    return endpoint


def declared_topic(name: str, type_name: str) -> Topic | None:
    """The topic of SIREN's table that has this name, with any sensor and any carrier."""
    for declared in vars(topics).values():
        if isinstance(declared, Topic) and declared.type_name == type_name:
            words = (re.escape(word) for word in declared.name.split("{sensor}"))
            pattern = "[^/]+".join(words).replace(f"/{topics.EMV_CARRIER}/", "/[^/]+/")
            if re.fullmatch(pattern, name):
                return declared
    return None


def print_info(arguments: argparse.Namespace) -> int:
    """Prints who publishes and subscribes, in the real ros2's layout."""
    topic = full_name(arguments.topic)
    with observer("small_ros2_topic_info") as node:
        known = discovered_topics(node, arguments.spin_time)
        if topic not in known:
            raise CommandError(f"topic '{topic}' is not there")
        publishers = node.get_publishers_info_by_topic(topic)
        subscriptions = node.get_subscriptions_info_by_topic(topic)
        print(f"Type: {', '.join(known[topic])}")
        for title, endpoints in (("Publisher", publishers), ("Subscription", subscriptions)):
            print(f"{title} count: {len(endpoints)}")
            if arguments.verbose:
                print("".join(f"\n{with_depth(endpoint, topic)}\n" for endpoint in endpoints))
    return 0


def echo_topic(arguments: argparse.Namespace) -> int:
    """Prints each message as a YAML document until Ctrl-C, or the first one only."""
    topic = full_name(arguments.topic)
    printed = 0

    def show(message: Any) -> None:
        nonlocal printed
        if printed and arguments.once:
            return
        printed += 1
        text = (
            f"{message!r}\n"
            if arguments.raw
            else message_to_yaml(message, truncate_length=None if arguments.full_length else TRUNCATE_LENGTH)
        )
        sys.stdout.write(f"{text}---\n")
        sys.stdout.flush()

    with observer("small_ros2_topic_echo") as node:
        type_name = arguments.type or type_of_topic(node, topic, arguments.spin_time)
        node.create_subscription(message_class(type_name), topic, show, matching_qos(node, topic), raw=arguments.raw)
        spin_until(node, lambda: arguments.once and printed > 0)
    return 0


def rate_report(arrivals_s: deque[float]) -> str:
    """The mean rate of arrivals and the spread of their intervals, in the real ros2's words."""
    intervals_s = np.diff(np.array(arrivals_s))
    return (
        f"average rate: {1.0 / intervals_s.mean():.3f}\n"
        f"\tmin: {intervals_s.min():.3f}s max: {intervals_s.max():.3f}s "
        f"std dev: {intervals_s.std():.5f}s window: {len(intervals_s)}"
    )


def measure_rate(arguments: argparse.Namespace) -> int:
    """Prints once a second how often messages have arrived, by the wall clock, until Ctrl-C."""
    if arguments.window < 1:
        raise CommandError(f"--window: {arguments.window} cannot be used; allowed: 1 and more", exit_code=2)
    topic = full_name(arguments.topic)
    arrivals_s: deque[float] = deque(maxlen=arguments.window + 1)
    next_report_s = time.monotonic() + REPORT_PERIOD_S

    def report_when_due() -> bool:
        nonlocal next_report_s
        if time.monotonic() >= next_report_s and len(arrivals_s) > 1:
            print(rate_report(arrivals_s), flush=True)
            next_report_s = time.monotonic() + REPORT_PERIOD_S
        return False

    with observer("small_ros2_topic_hz") as node:
        node.create_subscription(
            message_class(type_of_topic(node, topic, arguments.spin_time)),
            topic,
            lambda _: arrivals_s.append(time.monotonic()),
            matching_qos(node, topic),
            raw=True,
        )
        spin_until(node, report_when_due)
    return 0
