"""What a person sees while an episode runs, and at its end."""

import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import TextIO

import numpy as np
from tqdm import tqdm

from siren_ros.numerics.units import STEP_S, STEPS_PER_S
from siren_ros.world.actors import ActorStates, Mode

PLAIN_EVERY_STEPS = 5 * STEPS_PER_S
UPDATE_EVERY_STEPS = 4


class Progress:
    """A progress bar on a terminal, a line every few simulated seconds elsewhere."""

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

    def wants_states(self, step: int) -> bool:
        """Whether the states of a step are worth decoding for the display."""
        return step % UPDATE_EVERY_STEPS == 0

    def show_states(self, states: ActorStates, emv_id: int) -> None:
        """Take in what the vehicles do."""
        rows = np.flatnonzero(states.actor_id == emv_id)
        yielding = sum(Mode(int(mode)).is_yielding for mode in states.mode)
        emv = "EMV not there yet"
        if rows.size:
            row = int(rows[0])
            mode = Mode(int(states.mode[row])).name.lower()
            emv = f"EMV {states.speed_mps[row] * 3.6:3.0f} km/h {mode}"
        self._text = f"{emv}, {yielding} yielding"

    def begin_step(self, step: int) -> None:
        """A step begins."""
        self.step = step
        if self._began_s is None:
            self._began_s = time.monotonic()
        factor = step * STEP_S / self.wall_s if step and self.wall_s else 0.0
        line = f"{step * STEP_S:5.1f} s simulated, real-time factor {factor:.1f}, {self._text}"
        with suppress(OSError):  # the terminal is closed, and SIGHUP is under way
            self._show(step, line)

    def _show(self, step: int, line: str) -> None:
        if not self._bar.disable:
            self._bar.set_postfix_str(line, refresh=False)
            self._bar.update(step - self._bar.n)
        elif step and step % PLAIN_EVERY_STEPS == 0:
            print(f"{step}/{self._steps} steps, {line}", file=self._stream, flush=True)

    def close(self) -> None:
        """Take the bar away."""
        with suppress(OSError):
            self._bar.close()


def time_table(busy_s: Mapping[str, float], wall_s: float) -> list[str]:
    """Lines that say where the wall time went, the most expensive node first."""
    rows = sorted(busy_s.items(), key=lambda item: (-item[1], item[0]))
    rest_s = max(0.0, wall_s - sum(busy_s.values()))
    rows.append(("lockstep and transport", rest_s))
    return [f"  {name:<24}{value:7.2f} s  {100 * value / wall_s if wall_s else 0:5.1f} %" for name, value in rows]
