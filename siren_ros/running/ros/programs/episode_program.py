"""The program ``cosim``: starts the nodes of one episode, controls the lockstep, and informs the user."""

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import fields
from importlib import import_module
from typing import Any, Final

import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future
from tqdm import tqdm

from siren_ros.data.datasets.kitti.live_export import LiveExport
from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.conversions import from_actor_states
from siren_ros.data.interfaces.episode_conversions import from_episode_outcome
from siren_ros.data.lockstep import LockstepState, Stage, once
from siren_ros.errors import EXIT_FAILED, InputError, SirenError
from siren_ros.running.ros.node_configs import CosimConfig
from siren_ros.running.ros.parameters import check_names, declare_config
from siren_ros.running.ros.participants.hang_watch import HangWatch, awaited_by
from siren_ros.running.ros.participants.master import LockstepMaster
from siren_ros.running.ros.participants.working_clock import is_compiling
from siren_ros.running.ros.programs.composition import Composition, EpisodePlan, InProcess, OutOfProcess, plan_episode
from siren_ros.running.ros.programs.processes import Awaited, Interrupt, PreparationInterruptedError, Waiting
from siren_ros.running.ros.programs.program import start_ros
from siren_ros.running.ros.programs.progress import UPDATE_EVERY_STEPS, ProgressDisplay, closing_summary, verdict
from siren_ros.running.ros.transport.direct import direct
from siren_ros.running.ros.transport.domain import check_alone, in_free_domain
from siren_ros.running.ros.transport.endpoints import PublisherWatch, create_input, create_wall_timer
from siren_ros.simulation.scenario.episode import EpisodeEnd, EpisodeOutcome

SPIN_S: Final = 0.05
"""Interval at which the program checks signals and ended processes."""
STOP_S: Final = 10.0
FIRST_EMV: Final = 1
"""Id of the first EMV: emergency vehicles have the first actor ids."""
_COMPILING: Final = "it compiles loops, for this and all later episodes"


class Cosim(Node):
    """Master of one episode; participants run in this process or in their own."""

    def __init__(self) -> None:
        super().__init__("cosim")
        self.began_s = time.monotonic()
        check_names(self._parameter_overrides, [field.name for field in fields(CosimConfig)])
        self.config = declare_config(self, CosimConfig)
        self.plan = plan_episode(self.config)
        self.outcome: EpisodeOutcome | None = None
        self.progress = ProgressDisplay(self.plan.steps)
        self.master = LockstepMaster(
            self, self.plan.lockstep(self.config), self.config.realtime_factor, self.plan.settle_s
        )
        self.master.on_step_begun = self.progress.begin_step
        create_input(self, topics.OUTCOME, self._on_outcome, PublisherWatch(self, topics.OUTCOME, self.master.fail))
        create_input(self, topics.ACTORS, self._on_actors)
        self._pause: Future[None] = Future()
        self.master.on_closed = self._end_spin
        create_wall_timer(self, SPIN_S, self._end_spin)

    def spin_a_while(self, executor: EventsExecutor) -> None:
        """Run callbacks for ``SPIN_S`` or until the episode's end; a busy executor would not keep its timeout."""
        self._pause = Future()
        executor.spin_until_future_complete(self._pause, SPIN_S)

    def _end_spin(self) -> None:
        self._pause.set_result(None)

    def _on_actors(self, cdr: bytes) -> None:
        if self.master.state.step % UPDATE_EVERY_STEPS == 0:
            with self.master.failing_on_error():
                states = wire.content(from_actor_states, wire.decode(topics.ACTORS, cdr))
                self.progress.show_states(states, FIRST_EMV)

    def _on_outcome(self, cdr: bytes) -> None:
        with self.master.failing_on_error():
            once(topics.OUTCOME, self.outcome)
            self.outcome = from_episode_outcome(wire.decode(topics.OUTCOME, cdr))

    def connect_directly(self, executor: EventsExecutor, nodes: Sequence[Node]) -> None:
        """Let the nodes of this process exchange messages directly from the first step to the last."""

        def begin_step(step: int) -> None:
            if step == 0:
                direct.start(executor, (self, *nodes))
            self.progress.begin_step(step)

        self.master.on_step_begun = begin_step
        self.master.on_ending = direct.stop

    def awaited(self, composition: Composition) -> Awaited:
        """What the episode waits for; empty while a step is delayed for the wall clock."""
        state = self.master.state
        if state.stage is Stage.STEPPING and state.step > self.progress.step:
            return Awaited("", state.step)
        what = awaited_by(state, self.master.config, self.plan.nodes, composition.works())
        closing = state.stage in {Stage.CLOSING, Stage.CLOSED}
        return Awaited(
            what,
            "closing" if closing else state.step,
            _COMPILING if is_compiling() or self.master.hears_of_compiling else "",
        )


def run_episode(
    cosim: Cosim,
    module_of: Callable[[str], str],
    give_up: Callable[[str], None],
    interrupt: Interrupt,
    waiting: Waiting,
) -> int:
    """Run a master's episode to its end; returns the program's exit code.

    Args:
        cosim: The master.
        module_of: The module of a participant, which holds its node as ``NODE`` and runs it as a program.
        give_up: Ends this process, and says why: a node hangs in it, and the executor with the node.
        interrupt: Whether the user wants it to end.
        waiting: Says what the episode waits for.

    Raises:
        InputError: The domain is taken, or a node refuses its parameters.
        PreparationInterruptedError: The user stopped it before all nodes were there.
    """
    executor = EventsExecutor()
    executor.add_node(cosim)
    composition = _composed(cosim, module_of, executor, interrupt, waiting)
    cosim.master.begin()
    waiting.ask = lambda: cosim.awaited(composition)
    watch = HangWatch(lambda: composition.hanging(cosim.master.config), give_up)
    if isinstance(composition, InProcess):
        cosim.connect_directly(executor, composition.nodes)
    try:
        while not cosim.master.closed:
            cosim.spin_a_while(executor)
            if interrupt:
                cosim.master.interrupt(_stopped_by(interrupt))
            if failure := composition.failure():
                cosim.master.fail(failure, composition.gone())
            cosim.master.learn_closed(composition.closed())
    finally:
        watch.stop()
        direct.stop()
        cosim.progress.close()
        composition.stop(STOP_S, cosim.master.state.late)
        executor.shutdown()
    state = _with_export(cosim.plan, cosim.master.state, overwrite=cosim.config.overwrite)
    told = closing_summary(cosim.plan, state, cosim.outcome, cosim.progress.wall_s, cosim.master.answer_s)
    print("\n".join(told), flush=True)
    if state.end is not EpisodeEnd.COMPLETE:
        print(f"cosim: {state.reason}", file=sys.stderr, flush=True)
    failed = composition.exit_code() or EXIT_FAILED
    code, line = verdict(state.end, cosim.outcome, strict=cosim.config.strict, failed=failed)
    print(line)
    return code


def _composed(
    cosim: Cosim, module_of: Callable[[str], str], executor: EventsExecutor, interrupt: Interrupt, waiting: Waiting
) -> Composition:
    """Start the participants of an episode, in this process or in their own."""
    plan = cosim.plan
    if cosim.config.processes:
        ros_args = sys.argv[sys.argv.index("--ros-args") + 1 :] if "--ros-args" in sys.argv else []
        check_alone(cosim, cosim.began_s)
        return OutOfProcess({name: module_of(name) for name in plan.overrides}, plan.overrides, ros_args)

    def part_of(name: str, make: Callable[..., Any]) -> Callable[..., Any]:
        def make_visibly(*arguments: Any, **options: Any) -> Any:
            _check_stopped(interrupt)
            waiting.expect(f"{name} to be set up")
            return make(*arguments, **options)

        return make_visibly

    node_types = {}
    for name in plan.overrides:
        _check_stopped(interrupt)
        waiting.expect(f"{name} and its libraries to be loaded")
        node_types[name] = part_of(name, import_module(module_of(name)).NODE)
    check_alone(cosim, cosim.began_s)
    with interrupt.ending_at_once():
        return InProcess(executor, node_types, plan.overrides)


def _check_stopped(interrupt: Interrupt) -> None:
    if interrupt:
        raise PreparationInterruptedError(_stopped_by(interrupt))


def _stopped_by(interrupt: Interrupt) -> str:
    return f"stopped by {interrupt.signal_name}"


def _with_export(plan: EpisodePlan, state: LockstepState, *, overwrite: bool) -> LockstepState:
    """Publish the KITTI folder of a complete episode, or remove that of an incomplete one."""
    if plan.kitti is None:
        return state
    export = LiveExport(plan.kitti, overwrite=overwrite)
    if state.end is not EpisodeEnd.COMPLETE:
        export.drop()
        return state
    try:
        export.publish()
    except InputError as error:
        return state._replace(end=EpisodeEnd.FAILED, reason=f"kitti_exporter: {error}")
    return state


def run(module_of: Callable[[str], str], give_up: Callable[[str], None], interrupt: Interrupt, waiting: Waiting) -> int:
    """Run one episode by the parameters; the arguments are those of ``run_episode``."""
    waiting.say = lambda line: tqdm.write(line, file=sys.stderr)

    def episode() -> int:
        _check_stopped(interrupt)
        start_ros()
        try:
            return run_episode(Cosim(), module_of, give_up, interrupt, waiting)
        finally:
            rclpy.try_shutdown()

    try:
        return in_free_domain(episode, lambda line: print(f"cosim: {line}", file=sys.stderr))
    except PreparationInterruptedError as error:
        print(f"episode interrupted before its first step: {error}", flush=True)
        print(f"cosim: {error}", file=sys.stderr, flush=True)
        code, line = verdict(EpisodeEnd.INTERRUPTED, None, strict=False)
        print(line)
        return code
    except SirenError as error:
        print(error, file=sys.stderr)
        return error.exit_code
