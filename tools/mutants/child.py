"""One run of pytest in a process of its own, forked from one that has loaded the libraries but not the project."""

import importlib
import json
import os
import resource
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

MEMORY_BYTES = 16 << 30
"""A change can make a loop endless that collects things."""


def fork(work: Callable[[], Any], answer: Path, folder: Path, cpu_s: float | None = None) -> int:
    """Do some work in a child process; its answer is written as JSON.

    Args:
        work: What the child does; its result goes into ``answer``. A child that fails leaves no answer.
        answer: The file for the result.
        folder: Where the child works: a copy of the repository, from which the project is imported.
        cpu_s: The processor time after which the system ends the child.

    Returns:
        The child's process id, which is also the id of its process group.
    """
    answer.unlink(missing_ok=True)
    sys.stdout.flush()
    pid = os.fork()
    if pid:
        with suppress(PermissionError, ProcessLookupError):
            os.setpgid(pid, pid)
        return pid
    code = 1
    try:
        os.setpgid(0, 0)
        log = os.open(answer.with_suffix(".log"), os.O_RDWR | os.O_CREAT | os.O_TRUNC)
        for stream in (1, 2):
            os.dup2(log, stream)
        if cpu_s is not None:
            resource.setrlimit(resource.RLIMIT_CPU, (int(cpu_s) + 1, int(cpu_s) + 2))
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
        os.chdir(folder)
        # The project's own link to its source, if it is installed, comes after the path.
        sys.path[:] = [str(folder), *(entry for entry in sys.path if entry not in {"", str(Path.cwd())})]
        os.environ["PYTHONPATH"] = str(folder)
        sys.dont_write_bytecode = True
        importlib.invalidate_caches()
        result = work()
        answer.write_text(json.dumps(result))
        code = 0
    except BaseException:  # noqa: BLE001 - a child must not go on as its parent
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return 0


class Watch:
    """A pytest plugin: runs some tests in a given order and keeps what became of each."""

    def __init__(self, chosen: Sequence[str] | None = None) -> None:
        """Take the tests to run by their ids (None: all)."""
        self._order = None if chosen is None else {name: number for number, name in enumerate(chosen)}
        self.seconds: dict[str, float] = {}
        self.failed: list[str] = []

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        """Keep the chosen tests, in their order."""
        order = self._order
        if order is not None:
            items[:] = sorted((item for item in items if item.nodeid in order), key=lambda item: order[item.nodeid])

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Its time begins."""
        self.seconds[nodeid] = -time.process_time()

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        """Note the processor time."""
        self.seconds[nodeid] += time.process_time()

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Note a failure."""
        if report.failed:
            self.failed.append(report.nodeid)


def run_pytest(watch: Watch, places: Sequence[str], *, stop: bool, also: Sequence[object] = ()) -> int:
    """Run pytest in this process over files or folders; properties are drawn alike every time and not shrunk."""
    import hypothesis  # noqa: PLC0415 - it must be loaded in the child, before the tests are
    import pytest  # noqa: PLC0415 - the same

    hypothesis.settings.register_profile(
        "mutants",
        derandomize=True,
        database=None,
        deadline=None,
        phases=(hypothesis.Phase.explicit, hypothesis.Phase.generate),
        suppress_health_check=list(hypothesis.HealthCheck),
    )
    hypothesis.settings.load_profile("mutants")
    options = [
        "-q",
        "-n",
        "0",
        "-p",
        "no:cacheprovider",
        "--tb=no",
        "--no-header",
        "--assert=plain",
        *(["-x"] if stop else []),
    ]
    return int(pytest.main([*options, *places], plugins=[watch, *also]))
