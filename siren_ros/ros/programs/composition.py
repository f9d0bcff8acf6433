"""The nodes of one episode, in this process or one process each."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from typing import Any, Protocol

from rclpy.parameter import Parameter

from siren_ros.errors import SirenError
from siren_ros.interfaces.lockstep_reports import Phase
from siren_ros.params.parameter_field import Value
from siren_ros.ros.participants.hang_watch import Work, overdue
from siren_ros.ros.programs.program import PARENT_VARIABLE

TERMINATE_S = 1.0
FLUSH_S = 1.0
"""Longest time for which a listener that hangs delays the end of an episode."""
Overrides = Mapping[str, Value]


NodeType = Callable[..., Any]
"""Makes a node, as the class of a participant does: ``make(name, parameter_overrides=...)``."""


class Composition(Protocol):
    """Participants that run somewhere."""

    def failure(self) -> str:
        """What went wrong outside the lockstep's reports, naming the participant; empty: nothing."""

    def gone(self) -> tuple[str, ...]:
        """Participants that no longer answer."""

    def closed(self) -> tuple[str, ...]:
        """Participants that have closed in order."""

    def hanging(self, limits: Mapping[Phase, float]) -> str:
        """Which participant blocks the lockstep itself, and where; empty: none."""

    def works(self) -> tuple[Work | None, ...]:
        """What the participants of this process are doing now."""

    def exit_code(self) -> int:
        """Exit code of a participant that refused its input, 0 otherwise."""

    def stop(self, timeout_s: float, late: Collection[str] = ()) -> None:
        """Wait for the participants to finish, and end those that do not.

        Args:
            timeout_s: For all of them together.
            late: Participants that get no more time.
        """


class InProcess:
    """All participants as nodes of this process, on one executor."""

    def __init__(self, executor: Any, node_types: Mapping[str, NodeType], overrides: Mapping[str, Overrides]) -> None:
        """Make the nodes.

        Args:
            executor: Runs their callbacks.
            node_types: What makes the node of each name.
            overrides: The participants and their parameters, in the order in which they are made.

        Raises:
            SirenError: A node refuses its parameters; the others are discarded.
        """
        self.nodes: list[Any] = []
        self._executor = executor
        self._node_types = node_types
        try:
            for name, values in overrides.items():
                self._add(name, values)
        except SirenError:
            for node in self.nodes:
                node.discard()
            raise

    def _add(self, name: str, values: Overrides) -> None:
        parameters = [Parameter(key, value=value) for key, value in values.items()]
        node = self._node_types[name](name, parameter_overrides=parameters)
        self.nodes.append(node)
        self._executor.add_node(node)

    def failure(self) -> str:
        """Empty: within one process every failure is reported."""
        return ""

    def gone(self) -> tuple[str, ...]:
        """Empty: the nodes exist as long as this process."""
        return ()

    def closed(self) -> tuple[str, ...]:
        """Nodes that have finished."""
        return tuple(node.get_name() for node in self.nodes if node.finished)

    def hanging(self, limits: Mapping[Phase, float]) -> str:
        """The node whose callback has not returned in time."""
        return overdue(self.works(), limits, time.monotonic())

    def works(self) -> tuple[Work | None, ...]:
        """Of each node the callback that has not returned yet."""
        return tuple(node.work for node in tuple(self.nodes))

    def exit_code(self) -> int:
        """0: bad input raises when the nodes are made."""
        return 0

    def stop(self, timeout_s: float, late: Collection[str] = ()) -> None:  # noqa: ARG002 - the protocol
        """Let what was published reach outside subscribers, then destroy the nodes."""
        deadline_s = time.monotonic() + min(timeout_s, FLUSH_S)
        for node in self.nodes:
            node.flush(max(0.0, deadline_s - time.monotonic()))
            self._executor.remove_node(node)
            node.destroy_node()
        self.nodes.clear()


class OutOfProcess:
    """Each participant in its own process and process group, so that Ctrl-C reaches only this process."""

    def __init__(self, modules: Mapping[str, str], overrides: Mapping[str, Overrides], ros_args: list[str]) -> None:
        """Start the processes.

        Args:
            modules: The module that runs each node as a program.
            overrides: The participants and their parameters.
            ros_args: This program's own arguments after ``--ros-args``; every participant gets them too.
        """
        environment = {**os.environ, PARENT_VARIABLE: str(os.getpid())}
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        for name, values in overrides.items():
            arguments = [f"{key}:={json.dumps(value)}" for key, value in values.items()]
            flags = [part for argument in arguments for part in ("-p", argument)]
            command = [sys.executable, "-m", modules[name], "--ros-args", *ros_args, *flags]
            self._processes[name] = subprocess.Popen(  # noqa: S603 - our own modules, no shell
                command, env=environment, stdin=subprocess.DEVNULL, start_new_session=True
            )

    def failure(self) -> str:
        """Which process has ended before its time, and how."""
        for name in self.gone():
            code = int(self._processes[name].returncode)
            how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
            return f"{name}: its process ended early ({how})"
        return ""

    def gone(self) -> tuple[str, ...]:
        """Participants whose processes have ended with an error."""
        return tuple(name for name, process in self._processes.items() if process.poll())

    def closed(self) -> tuple[str, ...]:
        """Participants whose processes have ended without an error."""
        return tuple(name for name, process in self._processes.items() if process.poll() == 0)

    def hanging(self, limits: Mapping[Phase, float]) -> str:  # noqa: ARG002 - the protocol
        """Empty: the lockstep has its own process."""
        return ""

    def works(self) -> tuple[Work | None, ...]:
        """None: they are in other processes."""
        return ()

    def exit_code(self) -> int:
        """The first exit code other than 0 of a process that ended by itself."""
        codes = (process.poll() for process in self._processes.values())
        return next((code for code in codes if code is not None and code > 0), 0)

    def stop(self, timeout_s: float, late: Collection[str] = ()) -> None:
        """Wait for the processes, then terminate them, then kill them."""
        _wait([process for name, process in self._processes.items() if name not in late], timeout_s)
        for send in (subprocess.Popen.terminate, subprocess.Popen.kill):
            running = [process for process in self._processes.values() if process.poll() is None]
            for process in running:
                send(process)
            _wait(running, TERMINATE_S)


def _wait(processes: "list[subprocess.Popen[bytes]]", timeout_s: float) -> None:
    deadline_s = time.monotonic() + timeout_s
    for process in processes:
        with suppress(subprocess.TimeoutExpired):
            process.wait(max(0.0, deadline_s - time.monotonic()))
