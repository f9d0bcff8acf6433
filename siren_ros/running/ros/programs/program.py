"""Runs a node as a program: starts ROS, spins, turns errors into one line and an exit code."""

import gc
import os
import re
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, Protocol

import rclpy
from rclpy._rclpy_pybind11 import UnknownROSArgsError
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.signals import SignalHandlerOptions

from siren_ros.base.params.folders import is_writable, user_folder
from siren_ros.errors import EXIT_FAILED, EXIT_OK, InputError, SirenError
from siren_ros.running.ros.participants.watchdog import announcing
from siren_ros.running.ros.programs.processes import Interrupt, Parent, answer, outside_ros, quoted
from siren_ros.running.ros.transport.dds import (
    choose_profile,
    discovery_as_in_profile,
    lack_of_room,
    remove_abandoned_segments,
)

LOG_VARIABLE: Final = "ROS_LOG_DIR"


def choose_log_folder() -> None:
    """Choose a log folder for rclpy, which cannot start without one, unless the user names one.

    rclpy knows ``ROS_LOG_DIR``, ``ROS_HOME`` and the variable ``HOME``, and no other place.

    Raises:
        InputError: The folder that the user names cannot be written.
    """
    for variable, below in ((LOG_VARIABLE, ""), ("ROS_HOME", "log")):
        if named := os.environ.get(variable):
            if not is_writable(Path(named).expanduser() / below):
                raise InputError(variable, named, "a folder that can be written, for ROS's log files")
            return
    os.environ[LOG_VARIABLE] = str(user_folder(".ros/log"))


_PLACE: Final = re.compile(r", at /.*")
_UNREADABLE: Final = "Couldn't parse"


@contextmanager
def reading_arguments() -> Iterator[None]:
    """Context around ``rclpy.init``, which reads the arguments.

    Raises:
        InputError: Arguments that ROS cannot read.
    """
    try:
        yield
    except UnicodeEncodeError as error:
        raise InputError("arguments", str(error.object), "text in UTF-8") from error
    except UnknownROSArgsError as error:
        raise InputError("arguments", str(error), "arguments that ROS knows, after --ros-args") from error
    except RuntimeError as error:  # rclpy raises RCLError for all problems
        _, unreadable, reason = _PLACE.sub("", str(error)).partition(_UNREADABLE)
        if not unreadable:
            raise
        raise InputError("arguments", reason.strip(), "what ROS can read, such as -p NAME:=VALUE") from error


FLUSH_S = 2.0
SPIN_S = 0.2
SHUTDOWN_S = 3
"""Time limit for the shutdown of DDS, enforced with SIGALRM: a node once hung there after another process was
killed."""
PARENT_VARIABLE = "SIREN_PARENT_PID"
"""Environment variable with the process id of the program that started a participant and ends it."""

_GARBAGE_AFTER = 20_000
"""New objects between runs of Python's garbage collector. A step makes thousands of objects, but no cycles."""


def start_ros(args: list[str] | None = None) -> None:
    """Initialise rclpy without its own signal handlers, because an episode must close before ROS shuts down.

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


class NodeType(Protocol):
    """Protocol of a node class that can run as a program."""

    config_type: type[Any]

    def __call__(self, name: str) -> Any:
        """Make the node."""


def run_program(make_node: NodeType, name: str) -> int:
    """Run one node as a program until it is done or interrupted; returns the exit code.

    A node that has ``finished`` is asked to ``flush(timeout_s)``, until its subscribers have everything; one that
    is interrupted to ``close_early(reason)``, which saves what there is to save. For a node of a class in which
    ``ends_by_signal`` is true, an interruption is the usual end.
    The process ends at most ``SHUTDOWN_S`` later, also if DDS does not shut down. The caller does nothing after it.
    """
    if words := outside_ros(sys.argv[1:]):
        return answer(words, name, make_node.config_type, (make_node.__doc__ or "").partition("\n")[0])
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
    stopped, usual = "", getattr(node, "ends_by_signal", False)
    code = EXIT_OK
    try:
        with announcing(getattr(node, "announce_compiling", lambda: None)):
            while not node.finished and not stopped:
                executor.spin_once(timeout_sec=SPIN_S)
                if parent.is_gone:
                    stopped = "the end of the program that started it"
                stopped = stopped or interrupt.signal_name
        if stopped:
            if not usual:
                print(f"{name}: stopped by {stopped}", file=sys.stderr)
            node.close_early(f"{name}: stopped by {stopped}")
        else:
            node.flush(FLUSH_S)
    except SirenError as error:
        print(f"{name}: {error}", file=sys.stderr)
        code = error.exit_code
    finally:
        signal.alarm(SHUTDOWN_S)  # everything important is saved; Python code cannot run while C++ waits
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
    return EXIT_FAILED if stopped and not usual else code
