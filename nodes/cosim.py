"""``cosim``: one whole episode. Starts the nodes, drives the lockstep, tells the user how it goes."""

import os
import sys
import time
from dataclasses import fields
from importlib import import_module
from typing import Final

import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node

from siren_ros.errors import EXIT_FAILED, EXIT_OK, SirenError
from siren_ros.interfaces import topics
from siren_ros.interfaces.conversions import from_actor_states
from siren_ros.interfaces.episode_conversions import from_episode_outcome
from siren_ros.lockstep.tick_join import once
from siren_ros.ros.parameters.node_configs import DEFAULT_PARTICIPANTS, OPTIONAL_PARTICIPANTS, CosimConfig
from siren_ros.ros.parameters.parameter_overrides import check_names
from siren_ros.ros.parameters.parameters import declare_config
from siren_ros.ros.participants.hang_watch import HangWatch, limits_s
from siren_ros.ros.participants.master import LockstepMaster
from siren_ros.ros.programs.composition import Composition, InProcess, OutOfProcess
from siren_ros.ros.programs.episode_plan import plan_episode
from siren_ros.ros.programs.interrupt import Interrupt
from siren_ros.ros.programs.program import start_ros
from siren_ros.ros.programs.progress import Progress
from siren_ros.ros.programs.summary import closing_summary
from siren_ros.ros.transport import wire
from siren_ros.ros.transport.domain import check_alone, in_free_domain
from siren_ros.ros.transport.endpoints import create_input
from siren_ros.ros.transport.publisher_watch import PublisherWatch
from siren_ros.scenario.episode import EpisodeEnd, EpisodeOutcome

SPIN_S = 0.05
STOP_S = 10.0
MODULES: Final = {name: f"siren_nodes.{name}" for name in (*DEFAULT_PARTICIPANTS, *OPTIONAL_PARTICIPANTS)}
"""Module of every participant that this program starts: it holds the node, and runs it as a program."""
FIRST_EMV = 1
"""Emergency vehicles have the first actor ids."""


class Cosim(Node):
    """The master of one episode; the participants run in this process or in their own."""

    def __init__(self) -> None:
        super().__init__("cosim")
        self.began_s = time.monotonic()
        check_names(self._parameter_overrides, [field.name for field in fields(CosimConfig)])
        self.config = declare_config(self, CosimConfig)
        self.plan = plan_episode(self.config)
        self.outcome: EpisodeOutcome | None = None
        self.progress = Progress(self.plan.steps)
        self.master = LockstepMaster(
            self, self.plan.lockstep(self.config), self.config.realtime_factor, self.plan.settle_s
        )
        self.master.on_step_begun = self.progress.begin_step
        create_input(self, topics.OUTCOME, self._on_outcome, PublisherWatch(self, topics.OUTCOME, self.master.fail))
        create_input(self, topics.ACTORS, self._on_actors)

    def _on_actors(self, cdr: bytes) -> None:
        if self.progress.wants_states(self.master.state.step):
            with self.master.failing_on_error():
                self.progress.show_states(from_actor_states(wire.decode(topics.ACTORS, cdr)), FIRST_EMV)

    def _on_outcome(self, cdr: bytes) -> None:
        with self.master.failing_on_error():
            once(topics.OUTCOME, self.outcome)
            self.outcome = from_episode_outcome(wire.decode(topics.OUTCOME, cdr))


def run_episode(cosim: Cosim, interrupt: Interrupt) -> int:
    """Run the episode of a master to its end; returns the program's exit code."""
    executor = EventsExecutor()
    executor.add_node(cosim)
    overrides = cosim.plan.overrides
    ros_args = sys.argv[sys.argv.index("--ros-args") + 1 :] if "--ros-args" in sys.argv else []
    node_types = {} if cosim.config.processes else {name: import_module(MODULES[name]).NODE for name in overrides}
    check_alone(cosim, cosim.began_s)
    composition: Composition = (
        OutOfProcess(MODULES, overrides, ros_args)
        if cosim.config.processes
        else InProcess(executor, node_types, overrides)
    )
    limits = limits_s(cosim.master.config)
    watch = HangWatch(lambda: composition.hanging(limits), give_up)
    try:
        while not cosim.master.closed:
            executor.spin_once(timeout_sec=SPIN_S)
            if interrupt:
                cosim.master.interrupt(f"stopped by {interrupt.signal_name}")
            if failure := composition.failure():
                cosim.master.fail(failure, composition.gone())
            cosim.master.learn_closed(composition.closed())
    finally:
        watch.stop()
        cosim.progress.close()
        composition.stop(STOP_S, cosim.master.state.late)
        executor.shutdown()
    state = cosim.master.state
    print("\n".join(closing_summary(cosim.plan, state, cosim.outcome, cosim.progress.wall_s)))
    if state.end is EpisodeEnd.COMPLETE:
        return EXIT_OK
    print(f"cosim: {state.reason}", file=sys.stderr)
    return composition.exit_code() or EXIT_FAILED


def give_up(reason: str) -> None:
    """End this process: a node hangs in it, and the executor with the node."""
    print(f"cosim: {reason}; `siren recover` completes the bag", file=sys.stderr, flush=True)
    os._exit(EXIT_FAILED)


def main() -> int:
    """Run one episode as the parameters say."""
    interrupt = Interrupt("cosim")

    def episode() -> int:
        start_ros()
        try:
            return run_episode(Cosim(), interrupt)
        finally:
            rclpy.try_shutdown()

    try:
        return in_free_domain(episode, lambda line: print(f"cosim: {line}", file=sys.stderr))
    except SirenError as error:
        print(error, file=sys.stderr)
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
