"""The tests of a folder over the unchanged code: which pass, how long they take, which lines each of them runs."""

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from mutants.child import Watch, run_pytest

SLOW_S: Final = 6.0
"""Tests that need more processor time than this are not run for each change."""


@dataclass(frozen=True)
class Baseline:
    """What is known of a folder's tests before anything is changed."""

    seconds: dict[str, float]
    """Processor time of each test that is run for the mutants, by its id."""
    left_out: list[str]
    """Tests that are too slow, or fail in a copy of the repository."""
    lines: dict[str, dict[int, list[str]]]
    """Per file and line the tests that run it, themselves or by what they share; none for a line of an import."""
    loaded: list[str]
    """Modules that the tests loaded, without the project's own."""
    environment: dict[str, str]
    """Variables that the project set while it was loaded."""

    def tests_for(self, file: str, line: int, mirror: str) -> list[str]:
        """The tests that can notice a change of a line, the mirrored file's first, then quick ones first.

        A line that no test was seen to run may be compiled (numba's code is not traced) or run while the module was
        imported: then these are all tests that run anything of the file, or all tests of the folder. A test that calls
        a compiled loop directly runs nothing that is traced: the mirrored file's tests are always among them.
        """
        of_file = self.lines.get(file, {})
        found = set(of_file.get(line, ()))
        if not found:
            found = {name for names in of_file.values() for name in names} or set(self.seconds)
            found |= {name for name in self.seconds if name.startswith(mirror)}
        found &= self.seconds.keys()
        return sorted(found, key=lambda name: (not name.startswith(mirror), self.seconds[name], name))


def measure(places: Sequence[str], package: str) -> dict[str, Any]:
    """Run the tests once; to be done in a child process, in a copy of the repository.

    Args:
        places: Files and folders of tests.
        package: The folder whose lines are noted.
    """
    import coverage  # noqa: PLC0415 - it must trace the child alone

    from mutants.noted_lines import LineNotes  # noqa: PLC0415 - it needs pytest, which the parent must not have loaded

    before = dict(os.environ)
    tracer = coverage.Coverage(data_file=None, source=[package], config_file=False, messages=False)
    watch, notes = Watch(), LineNotes(tracer, package.split("/", maxsplit=1)[0])
    tracer.start()
    code = run_pytest(watch, places, stop=False, also=[notes])
    tracer.stop()
    data = tracer.get_data()
    here = Path.cwd()
    lines = {
        Path(file).relative_to(here).as_posix(): notes.tests_by_line(Path(file), data.contexts_by_lineno(file))
        for file in data.measured_files()
    }
    return {
        "code": code,
        "failed": watch.failed,
        "seconds": watch.seconds,
        "lines": lines,
        "loaded": _libraries(here),
        "environment": {key: value for key, value in os.environ.items() if before.get(key) != value},
    }


def _libraries(repository: Path) -> list[str]:
    """Modules of installed packages, which are the same for every mutant."""
    names = []
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if file and "site-packages" in file and not Path(file).is_relative_to(repository):
            names.append(name)
    return names


def baseline_from(answer: dict[str, Any], slow_s: float = SLOW_S) -> Baseline:
    """The child's answer as a baseline."""
    dropped = {name for name, seconds in answer["seconds"].items() if seconds > slow_s} | set(answer["failed"])
    return Baseline(
        {name: seconds for name, seconds in answer["seconds"].items() if name not in dropped},
        sorted(dropped),
        {file: {int(line): names for line, names in of_file.items()} for file, of_file in answer["lines"].items()},
        answer["loaded"],
        {key: value for key, value in answer["environment"].items() if not key.startswith(("PYTEST", "COV"))},
    )
