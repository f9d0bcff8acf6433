"""Keeps one episode per DDS domain, because two would receive each other's messages."""

import errno
import os
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Final

from rclpy.node import Node

from siren_ros.data.interfaces import topics
from siren_ros.errors import InputError

VARIABLE: Final = "ROS_DOMAIN_ID"
LARGEST_DOMAIN: Final = 101
"""Largest domain for which every platform has the ports (ROS 2 documentation, "The ROS_DOMAIN_ID")."""
DISCOVERY_S: Final = 0.3
"""Time in which two processes of one machine discover each other (params/fastdds_localhost.xml)."""
_POLL_S: Final = 0.01
CLAIM: Final = "siren_ros/domain"
"""Prefix of the abstract sockets that claim a domain."""


class DomainTakenError(InputError):
    """Raised if another episode or player uses the domain."""


def in_free_domain(run: Callable[[], int], say: Callable[[str], None]) -> int:
    """Run an episode in the user's domain, or in the first free one if ROS_DOMAIN_ID is not set.

    Args:
        run: Runs the episode in the domain that ROS_DOMAIN_ID names; must raise DomainTakenError before it has done
            anything. Its result is returned.
        say: Gets a line for the user where the domain is not the default one.

    Raises:
        DomainTakenError: The user's domain is taken, or all are.
    """
    if os.environ.get(VARIABLE):
        with claimed_domain():
            return run()
    for number in range(LARGEST_DOMAIN + 1):
        os.environ[VARIABLE] = str(number)
        with suppress(DomainTakenError), claimed_domain():
            if number:
                say(f"lower DDS domains are in use on this machine, so this episode has {VARIABLE}={number}")
            return run()
    raise _taken("in every domain")


@contextmanager
def claimed_domain() -> Iterator[None]:
    """Claim the domain on this machine while an episode runs.

    The claim is an abstract socket (Linux only). It is decided at once, without discovery, and the kernel releases it
    however the process ends. On other systems discovery alone decides.

    Raises:
        DomainTakenError: An episode of this machine holds the domain; says how to choose another one.
    """
    if sys.platform != "linux":
        yield
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as claim:
        try:
            claim.bind(f"\0{CLAIM}/{_domain()}")
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise _taken("on this machine") from error
            raise
        yield


def check_alone(node: Node, since_s: float) -> None:
    """Check that no other program publishes the clock in this domain, before any node of the episode exists.

    Waits until ``DISCOVERY_S`` have passed since the node was made. The program can load modules in this time.

    Args:
        node: The master's node, whose own publisher of the clock is there already.
        since_s: Monotonic time at which the node was made.

    Raises:
        DomainTakenError: Somebody else is there; says how to choose another domain.
    """
    while True:
        publishers = node.get_publishers_info_by_topic(topics.CLOCK.name)
        if len(publishers) > 1:
            names = ", ".join(sorted({publisher.node_name for publisher in publishers}))
            raise _taken(f"{topics.CLOCK.name} has {len(publishers)} publishers: {names}")
        if time.monotonic() - since_s >= DISCOVERY_S:
            return
        time.sleep(_POLL_S)


def _domain() -> int:
    return int(os.environ.get(VARIABLE) or 0)


def _taken(where: str) -> DomainTakenError:
    domain = _domain()
    another = (domain + 1) % (LARGEST_DOMAIN + 1)
    allowed = (
        f"a domain of its own for each episode; another one runs here already ({where}), so choose a free number "
        f"from 0 to {LARGEST_DOMAIN}, for example {VARIABLE}={another}"
    )
    return DomainTakenError(VARIABLE, domain, allowed)
