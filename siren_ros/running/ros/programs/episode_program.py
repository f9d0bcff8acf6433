"""The program ``cosim``: starts the nodes of one episode, controls the lockstep, and informs the user.

It displays the progress, and prints a summary at the end.
"""

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import Any, Final, TextIO

import numpy as np
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future
from tqdm import tqdm

from siren_ros.base.numerics.units import STEP_S, STEPS_PER_S
from siren_ros.data.datasets.files import LiveExport
from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.conversions import from_actor_states, from_episode_outcome
from siren_ros.data.lockstep import LockstepState, Stage, once
from siren_ros.data.recording.bag_folder import read_message_counts, working_path
from siren_ros.errors import EXIT_FAILED, EXIT_OK, InputError, SirenError
from siren_ros.running.generation.closed_loop import AnswerTimes
from siren_ros.running.ros.node_configs import CosimConfig
from siren_ros.running.ros.parameters import check_names, declare_config
from siren_ros.running.ros.participants.master import LockstepMaster
from siren_ros.running.ros.participants.watchdog import HangWatch, awaited_by, is_compiling
from siren_ros.running.ros.programs.composition import Composition, EpisodePlan, InProcess, OutOfProcess, plan_episode
from siren_ros.running.ros.programs.processes import Awaited, Interrupt, PreparationInterruptedError, Waiting
from siren_ros.running.ros.programs.program import start_ros
from siren_ros.running.ros.transport.dds import check_alone, in_free_domain
from siren_ros.running.ros.transport.endpoints import PublisherWatch, create_input, create_wall_timer, direct
from siren_ros.simulation.scenario.episode import EpisodeEnd, EpisodeOutcome
from siren_ros.simulation.world.actors import ActorStates, Mode

PLAIN_EVERY_STEPS = 5 * STEPS_PER_S
UPDATE_EVERY_STEPS = 4
"""Only every such step is decoded for the display."""


class ProgressDisplay:
    """A progress bar on a terminal, otherwise a line every few simulated seconds."""

    def __init__(self, steps: int, stream: TextIO = sys.stderr) -> None:
        self.step = -1
        """The step that began last; −1 before the first."""
        self._steps = steps
        self._stream = stream
        self._began_s: float | None = None
        self._text = ""
        self._bar = tqdm(
            total=steps,
            file=stream,
            disable=not stream.isatty(),
            unit="step",
            leave=False,
            bar_format="{l_bar}{bar}| {n_fmt}/{total_fmt} steps {postfix}",
        )

    @property
    def wall_s(self) -> float:
        """Wall time since the first step began."""
        return 0.0 if self._began_s is None else time.monotonic() - self._began_s

    def show_states(self, states: ActorStates, emv_id: int) -> None:
        """Update the display with the states of the vehicles."""
        rows = np.flatnonzero(states.actor_id == emv_id)
        yielding = sum(Mode(int(mode)).is_yielding for mode in states.mode)
        emv = "EMV not there yet"
        if rows.size:
            row = int(rows[0])
            mode = Mode(int(states.mode[row])).name.lower()
            emv = f"EMV {states.speed_mps[row] * 3.6:3.0f} km/h {mode}"
        self._text = f"{emv}, {yielding} yielding"

    def begin_step(self, step: int) -> None:
        """Update the display at the start of a step."""
        self.step = step
        if self._began_s is None:
            self._began_s = time.monotonic()
        factor = step * STEP_S / self.wall_s if step and self.wall_s else 0.0
        line = f"{step * STEP_S:5.1f} s simulated, real-time factor {factor:.1f}, {self._text}"
        with suppress(OSError):  # the terminal is closed, and SIGHUP will follow
            if not self._bar.disable:
                self._bar.set_postfix_str(line, refresh=False)
                self._bar.update(step - self._bar.n)
            elif step and step % PLAIN_EVERY_STEPS == 0:
                print(f"{step}/{self._steps} steps, {line}", file=self._stream, flush=True)

    def close(self) -> None:
        """Remove the bar."""
        with suppress(OSError):
            self._bar.close()


def time_table(busy_s: Mapping[str, float], wall_s: float) -> list[str]:
    """Table of the wall time by node, most expensive first."""
    rows = sorted(busy_s.items(), key=lambda item: (-item[1], item[0]))
    rest_s = max(0.0, wall_s - sum(busy_s.values()))
    rows.append(("lockstep and transport", rest_s))
    return [f"  {name:<24}{value:7.2f} s  {100 * value / wall_s if wall_s else 0:5.1f} %" for name, value in rows]


def closing_summary(
    plan: EpisodePlan,
    state: LockstepState,
    outcome: EpisodeOutcome | None,
    wall_s: float,
    answer_s: Sequence[float] = (),
) -> list[str]:
    """Lines about the episode's end, its files and its wall time.

    Args:
        plan: The episode with its final bag folder; an episode that did not complete has its partial bag next to it.
        state: The lockstep at the end.
        outcome: The recorder's judgement; None where there is none.
        wall_s: Wall time from the first step to the last.
        answer_s: Wall times to the answers of the program that drives the AV.
    """
    steps = state.steps_closed
    lines = [
        f"episode {state.end.value} after {steps * STEP_S:.2f} s ({steps} steps)"
        + (f": {state.reason}" if state.reason else "")
    ]
    lines += _bag_lines(plan.bag, state.end)
    if plan.kitti is not None and state.end is EpisodeEnd.COMPLETE:
        lines.append(f"KITTI export: {plan.kitti}")
    if plan.no_kitti:
        lines.append(f"no KITTI export: {plan.no_kitti}")
    cut_short = ""
    if plan.is_cut_short and state.end is EpisodeEnd.COMPLETE:
        cut_short = f"cut short by duration_s to {plan.steps * STEP_S:g} of {plan.own_steps * STEP_S:g} s"
    lines += _outcome_lines(outcome, cut_short)
    if wall_s and steps:
        lines.append(f"real-time factor {steps * STEP_S / wall_s:.2f} ({wall_s:.1f} s of wall time)")
        lines += time_table(state.busy_s, wall_s)
    return [*lines, AnswerTimes.of(answer_s).line] if answer_s else lines


def _bag_lines(bag: Path, end: EpisodeEnd) -> list[str]:
    if end is not EpisodeEnd.COMPLETE:
        partial = sorted(bag.parent.glob(f"{bag.name}.partial*"), key=lambda path: path.stat().st_mtime)
        if working_path(bag).is_dir():
            return [f"cut-off bag: {working_path(bag)} (`siren recover {working_path(bag)}` completes it)"]
        return [f"partial bag: {partial[-1]}"] if partial else []
    if not bag.is_dir():
        return []
    size_mb = sum(file.stat().st_size for file in bag.iterdir()) / 1e6
    counts = read_message_counts(bag)
    return [f"bag: {bag} ({size_mb:.1f} MB)"] + [f"  {name:<44}{count:6d}" for name, count in sorted(counts.items())]


def _outcome_lines(outcome: EpisodeOutcome | None, cut_short: str) -> list[str]:
    if outcome is None or not outcome.measures:
        return ["interaction: not judged"]
    word = {True: "verified", False: "did not happen", None: "could not be judged"}[outcome.predicate_holds]
    if cut_short and not outcome.predicate_holds:
        word += f", {cut_short}"
    measures = outcome.measures
    lines = [f"interaction: {word} ({measures.get('predicate', '')})"]
    if "actors" in measures:
        lines.append(
            f"  {measures['actors']} actors, {measures['yields_started']} yields started, "
            f"{measures['yields_completed']} completed, {measures['collisions']} collisions, "
            f"residual p99 {float(measures['residual_p99_m']):.2f} m"
        )
    return lines


def verdict(
    end: EpisodeEnd, outcome: EpisodeOutcome | None, *, strict: bool, failed: int = EXIT_FAILED
) -> tuple[int, str]:
    """Exit code of an episode, and the line that explains it.

    Args:
        end: Whether the episode was made.
        outcome: The recorder's judgement; None where there is none.
        strict: Whether the interaction and collisions count.
        failed: Exit code of an episode that was not made.
    """
    if end is not EpisodeEnd.COMPLETE:
        what = "was interrupted" if end is EpisodeEnd.INTERRUPTED else "failed"
        return failed, f"exit code {failed}: the episode {what}"
    lacking = ("its interaction was not judged",) if outcome is None else outcome.shortcomings
    if not lacking:
        return EXIT_OK, f"exit code {EXIT_OK}: the episode was made, its interaction happened, nothing collided"
    if strict:
        return EXIT_FAILED, f"exit code {EXIT_FAILED}: the episode was made, but {' and '.join(lacking)} (strict)"
    note = f"({' and '.join(lacking)}; strict:=true makes this count)"
    return EXIT_OK, f"exit code {EXIT_OK}: the episode was made {note}"


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
        return OutOfProcess({name: module_of(plan.file_of(name)) for name in plan.overrides}, plan.overrides, ros_args)

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
        node_types[name] = part_of(name, import_module(module_of(plan.file_of(name))).NODE)
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
