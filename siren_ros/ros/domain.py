"""One episode per DDS domain: two in one domain would take each other's messages for their own."""

import os
import time
from typing import Final

from rclpy.node import Node

from siren_ros.interfaces import topics
from siren_ros.world.errors import InputError

VARIABLE: Final = "ROS_DOMAIN_ID"
LARGEST_DOMAIN: Final = 101
"""Up to it every platform has the ports (ROS 2 documentation, "The ROS_DOMAIN_ID")."""
DISCOVERY_S: Final = 0.3
"""Two processes of one machine have found each other by then (tools/environment/fastdds.xml)."""
_POLL_S: Final = 0.01


def check_alone(node: Node, since_s: float) -> None:
    """Make sure that nobody else publishes the clock in this domain, before any node of the episode exists.

    Waits until discovery has had its time, counted from when the node was made: what the program does meanwhile
    (imports, above all) does not cost again.

    Args:
        node: The master's node, whose own publisher of the clock is there already.
        since_s: Monotonic time at which the node was made.

    Raises:
        InputError: Somebody else is there; says how to choose another domain.
    """
    while True:
        publishers = node.get_publishers_info_by_topic(topics.CLOCK.name)
        if len(publishers) > 1:
            domain = int(os.environ.get(VARIABLE) or 0)
            names = ", ".join(sorted({publisher.node_name for publisher in publishers}))
            another = (domain + 1) % (LARGEST_DOMAIN + 1)
            allowed = (
                f"a domain of its own for each episode; another one runs here already ({topics.CLOCK.name} has "
                f"{len(publishers)} publishers: {names}), so choose a free number from 0 to {LARGEST_DOMAIN}, "
                f"for example {VARIABLE}={another}"
            )
            raise InputError(VARIABLE, domain, allowed)
        if time.monotonic() - since_s >= DISCOVERY_S:
            return
        time.sleep(_POLL_S)
