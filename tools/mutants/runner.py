"""Runs the tests for each mutant, several at a time."""

import importlib
import json
import os
import signal
import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from mutants.baseline import Baseline, baseline_from, measure
from mutants.child import Watch, fork, run_pytest
from mutants.copies import changed_file, copy_working_tree
from mutants.mutations import Mutant

START_S: Final = 40.0
"""Processor time for loading the project, and for compiling loops that were changed."""
PATIENCE: Final = 5.0
"""A changed program may take so many times as long before it counts as hanging."""


@dataclass(frozen=True)
class Fate:
    """What became of a mutant."""

    mutant: Mutant
    outcome: str
    """``caught`` or ``survived``."""
    by: str = ""
    """The test that noticed, or what ended the process."""
    tests: int = 0
    """How many tests could have noticed."""


@dataclass(frozen=True)
class Task:
    """A mutant with the tests that can notice it, in their order."""

    mutant: Mutant
    tests: list[str]
    expected_s: float
    """Processor time of these tests over the unchanged code."""


class Runner:
    """Copies of the repository, and the processes that work in them."""

    def __init__(self, repository: Path, scratch: Path, jobs: int, start_s: float = START_S) -> None:
        """Copy the working tree once per job.

        Args:
            repository: The working tree.
            scratch: A folder for the copies.
            jobs: How many processes may run at a time.
            start_s: Processor time that a process may need beyond that of its tests.
        """
        self._start_s = start_s
        self._copies = [scratch / str(number) / "repository" for number in range(jobs)]
        for copy in self._copies:
            copy_working_tree(repository, copy)

    def baseline(self, places: Sequence[str], package: str, slow_s: float) -> Baseline:
        """Run the tests over the unchanged code, and load the libraries that they need into this process.

        Raises:
            RuntimeError: The tests could not be run.
        """
        answer = self._copies[0].parent / "answer.json"
        pid = fork(lambda: measure(places, package), answer, self._copies[0])
        os.waitpid(pid, 0)
        if not answer.exists():
            raise RuntimeError(f"the tests could not be run\n{answer.with_suffix('.log').read_text()}")
        found = json.loads(answer.read_text())
        if found["code"] not in {0, 1}:
            raise RuntimeError(f"pytest ended with {found['code']}\n{answer.with_suffix('.log').read_text()}")
        result = baseline_from(found, slow_s)
        os.environ.update(result.environment)
        _load(result.loaded)
        return result

    def run(self, tasks: Iterable[Task], report: Callable[[Fate], None]) -> None:
        """Run the tests for each mutant; its fate is reported when it is known."""
        waiting = iter(tasks)
        free = list(self._copies)
        running: dict[int, _Run] = {}
        more = True
        try:
            while more or running:
                while free and more:
                    task = next(waiting, None)
                    if task is None:
                        more = False
                    elif not task.tests:
                        report(Fate(task.mutant, "survived"))
                    else:
                        run = _Run(free.pop(), task, self._start_s)
                        running[run.pid] = run
                for pid in _ended(running):
                    run = running.pop(pid)
                    report(run.finish())
                    free.append(run.copy)
                time.sleep(0.01)
        finally:
            for run in running.values():
                run.finish()


class _Run:
    """One mutant's tests in a process."""

    def __init__(self, copy: Path, task: Task, start_s: float) -> None:
        self.copy = copy
        self._task = task
        self._answer = copy.parent / "answer.json"
        self._stack = ExitStack()
        file = task.mutant.file
        source = (copy / file).read_text(encoding="utf-8")
        self._stack.enter_context(changed_file(copy / file, task.mutant.text(source)))
        limit_s = start_s + PATIENCE * task.expected_s
        self.end = time.monotonic() + 10.0 * limit_s
        self.pid = fork(lambda: _outcome(task.tests), self._answer, copy, limit_s)

    def finish(self) -> Fate:
        """End what is left of the process, restore the file and say what became of the mutant."""
        with suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        with suppress(ChildProcessError):
            os.waitpid(self.pid, 0)
        self._stack.close()
        mutant, tests = self._task.mutant, len(self._task.tests)
        if not self._answer.exists():
            return Fate(mutant, "caught", "time limit or crash", tests)
        answer = json.loads(self._answer.read_text())
        if answer["code"] in _NOTHING_FAILED:
            return Fate(mutant, "survived", tests=tests)
        return Fate(mutant, "caught", answer["by"] or "import", tests)


_NOTHING_FAILED: Final = {0, 5}
"""pytest's exit codes: all passed, nothing collected."""


def _outcome(tests: Sequence[str]) -> dict[str, Any]:
    watch = Watch(tests)
    code = run_pytest(watch, sorted({name.partition("::")[0] for name in tests}), stop=True)
    return {"code": code, "by": next(iter(watch.failed), "")}


def _ended(running: dict[int, _Run]) -> list[int]:
    """The processes that have ended or have had their time."""
    ended = []
    for pid, run in running.items():
        done, _ = os.waitpid(pid, os.WNOHANG)
        if done or time.monotonic() > run.end:
            ended.append(pid)
    return ended


def _load(modules: Iterable[str]) -> None:
    """Load libraries, so that the processes of the mutants need not."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in modules:
            with suppress(Exception):
                importlib.import_module(name)
