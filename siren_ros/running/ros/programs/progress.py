"""Progress display of an episode, and the summary at its end."""

import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TextIO

import numpy as np
from tqdm import tqdm

from siren_ros.base.numerics.units import STEP_S, STEPS_PER_S
from siren_ros.data.lockstep import LockstepState
from siren_ros.data.recording.bag_folder import read_message_counts, working_path
from siren_ros.errors import EXIT_FAILED, EXIT_OK
from siren_ros.running.generation.answer_times import AnswerTimes
from siren_ros.running.ros.programs.composition import EpisodePlan
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
