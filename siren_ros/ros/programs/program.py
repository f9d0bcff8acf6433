"""How a node becomes a program: start ROS, spin, turn errors into one line and an exit code."""

import gc
import os
import signal
import sys
from collections.abc import Callable
from typing import Any, Protocol

import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.signals import SignalHandlerOptions

from siren_ros.errors import EXIT_FAILED, EXIT_OK, SirenError
from siren_ros.ros.participants.participant import Participant
from siren_ros.ros.programs.interrupt import Interrupt
from siren_ros.ros.programs.log_folder import choose_log_folder
from siren_ros.ros.programs.parent import Parent
from siren_ros.ros.programs.ros_arguments import quoted, reading_arguments
from siren_ros.ros.transport.fastdds_profile import choose_profile, discovery_as_in_profile
from siren_ros.ros.transport.shared_memory import lack_of_room, remove_abandoned_segments

FLUSH_S = 2.0
SPIN_S = 0.2
SHUTDOWN_S = 3
"""A node was once seen to hang while DDS shut down, after another process had been killed. SIGALRM ends it then."""
PARENT_VARIABLE = "SIREN_PARENT_PID"
"""Environment variable: process id of the program that started a participant, which ends with it."""

_GARBAGE_AFTER = 20_000
"""New objects between two runs of Python's garbage collector. A step makes thousands of objects and no cycles."""


def start_ros(args: list[str] | None = None) -> None:
    """Initialise rclpy without its own signal handlers: an episode must be closed before ROS shuts down.

    Also removes the shared memory of killed programs, gives Fast DDS our profile unless the user has set one, chooses
    a folder for the log where there is no home, and lets Python collect garbage less often.

    Raises:
        InputError: Arguments that ROS cannot read, or the user's folder for ROS's log files cannot be written.
    """
    if PARENT_VARIABLE not in os.environ:
        remove_abandoned_segments()
        if lack := lack_of_room():
            print(lack, file=sys.stderr)
    choose_profile()
    choose_log_folder()
    gc.set_threshold(_GARBAGE_AFTER)
    with reading_arguments(), discovery_as_in_profile():
        rclpy.init(args=quoted(sys.argv if args is None else args), signal_handler_options=SignalHandlerOptions.NO)


class Program(Protocol):
    """A node that knows when it is done."""

    finished: bool

    def flush(self, timeout_s: float) -> None:
        """Wait until what was published has reached its subscribers."""

    def close_early(self, reason: str) -> None:
        """Save what there is to save; raises SirenError where that fails."""

    def destroy_node(self) -> None:
        """Take the node out of the graph."""


def run_participant(make_node: Callable[[str], Participant[Any]], name: str) -> int:
    """Run one participant as a program of its own until its episode is over; returns the exit code."""
    return run_program(make_node, name)


def run_program(make_node: Callable[[str], Program], name: str) -> int:
    """Run one node as a program of its own until it is done or interrupted; returns the exit code.

    The process ends at most ``SHUTDOWN_S`` later, also if DDS does not shut down. The caller does nothing after it.
    """
    interrupt = Interrupt(name)
    parent = Parent(int(os.environ.get(PARENT_VARIABLE) or 0))
    try:
        start_ros()
        with interrupt.ending_at_once():
            node = make_node(name)
    except SirenError as error:
        print(f"{name}: {error}", file=sys.stderr)
        rclpy.try_shutdown()
        return error.exit_code
    executor = EventsExecutor()
    executor.add_node(node)
    stopped = ""
    code = EXIT_OK
    try:
        while not node.finished and not stopped:
            executor.spin_once(timeout_sec=SPIN_S)
            if parent.is_gone:
                stopped = "the end of the program that started it"
            stopped = stopped or interrupt.signal_name
        if stopped:
            print(f"{name}: stopped by {stopped}", file=sys.stderr)
            node.close_early(f"{name}: stopped by {stopped}")
        else:
            node.flush(FLUSH_S)
    except SirenError as error:
        print(f"{name}: {error}", file=sys.stderr)
        code = error.exit_code
    finally:
        signal.alarm(SHUTDOWN_S)  # all that is worth keeping is kept; nothing of Python's runs while C++ waits
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
    return EXIT_FAILED if stopped else code
