"""Makes the parts of a reproduction: prints the plan, runs commands, stores each part's figures when it is done.

The library doit would replace only the loop over the parts, and its reporter and tasks take more lines (250 in place of
217): it has no plan of what will be due, and it keeps its state apart from ``docs/results.json``, which a clone has.
"""

import json
import shlex
import shutil
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from statistics import fmean
from typing import Any, Final

from siren_ros.base.processes.interrupts import end_program
from siren_ros.errors import InputError, SirenError
from siren_ros.lab.reproduction.parts import FigureFile, Part, inputs_sha256, shown_minutes
from siren_ros.lab.reproduction.results import Figure, PartResult, figures_in, machine, read_results, write_results

_LAST_LINES: Final = 5
"""Number of output lines of a failed command in the error message."""
_STAMP: Final = "inputs_sha256"
"""File in a part's folder with the hash of the inputs that the work in it belongs to."""
Say = Callable[[str], None]


class PartError(SirenError):
    """Raised if a command of a part fails, or does not write the file with its figures."""


@dataclass(frozen=True)
class Step:
    """A part with its state in the plan."""

    part: Part
    inputs_sha256: str
    missing: tuple[str, ...]
    """Files that are missing; with any of these the part is skipped."""
    due: bool

    def __str__(self) -> str:
        what = shown_minutes(self.part.minutes) if self.due else "unchanged"
        if self.missing:
            what = f"skipped, as {', '.join(self.missing)} is not there"
            if any(file in self.part.files for file in self.missing):
                what += "; CONTRIBUTING.md says where it comes from"
        return f"{self.part.name:16} {self.part.about}: {what}"


@dataclass(frozen=True)
class Reproduction:
    """The places of a reproduction: repository, folder for the work, file of results."""

    repository: Path
    out: Path
    results: Path
    workers: int

    def plan(self, parts: Mapping[str, Part], only: Sequence[str] = ()) -> list[Step]:
        """Plan the parts in order, including parts that they need.

        A part is due when its inputs are not those of its figures, or when a part that is due reads its folder and the
        folder is gone.

        Raises:
            InputError: ``only`` names a part that is not there.
        """
        for name in only:
            if name not in parts:
                raise InputError("only", name, f"one or several of {', '.join(parts)}")
        asked = set(only or parts)
        for part in reversed(list(parts.values())):
            if part.name in asked:
                asked.update(part.needs)
        results = read_results(self.results)
        steps: dict[str, Step] = {}
        for part in (part for part in parts.values() if part.name in asked):
            above = [steps[need] for need in part.needs]
            missing = (*part.missing(self.repository), *(step.part.name for step in above if step.missing))
            sha = "" if missing else inputs_sha256(part, self.repository, [step.inputs_sha256 for step in above])
            unchanged = part.name in results and results[part.name].inputs_sha256 == sha
            steps[part.name] = Step(part, sha, missing, not missing and not unchanged)
        read = {need for step in steps.values() if step.due for need in step.part.needs}
        for name in reversed(steps):
            if name in read and not self._work_of(steps[name]):
                steps[name] = replace(steps[name], due=True)
                read.update(steps[name].part.needs)
        return list(steps.values())

    def _work_of(self, step: Step) -> bool:
        """Whether the part's folder contains work with exactly these inputs."""
        stamp = self.out / step.part.name / _STAMP
        return stamp.is_file() and stamp.read_text(encoding="utf-8") == step.inputs_sha256

    def make(self, steps: Sequence[Step], say: Say) -> list[str]:
        """Make the parts that are due; returns a line per failed part. Parts that do not need a failed one continue."""
        for step in steps:
            say(str(step))
        due = [step for step in steps if step.due]
        hashes = {step.part.name: step.inputs_sha256 for step in steps}
        total = shown_minutes(sum(step.part.minutes for step in due))
        say(f"{len(due)} of {len(steps)} parts to make, {total} on two cores")
        failed: dict[str, str] = {}
        for planned in steps:
            step = self._with_new_inputs(planned, hashes)
            if not step.due:
                continue
            name = step.part.name
            say(f"{name} ...")
            try:
                lost = [need for need in step.part.needs if need in failed]
                if lost:
                    raise PartError(f"it needs {', '.join(lost)}")
                result = self._make(step)
            except SirenError as error:
                failed[name] = str(error)
                say(f"{name}: {error}")
                continue
            write_results(self.results, {**read_results(self.results), name: result})
            say(f"{name}: {len(result.figures)} figures, {shown_minutes(result.minutes)}")
        return [f"{name}: {why}" for name, why in failed.items()]

    def _with_new_inputs(self, step: Step, hashes: dict[str, str]) -> Step:
        """The step with inputs computed again, because earlier steps may have written them (for example weights)."""
        if step.missing:
            return step
        above = [hashes[need] for need in step.part.needs]
        sha = inputs_sha256(step.part, self.repository, above)
        hashes[step.part.name] = sha
        return replace(step, inputs_sha256=sha, due=step.due or sha != step.inputs_sha256)

    def _make(self, step: Step) -> PartResult:
        """Run the commands of a part, read its figures, and put its files into the repository.

        Work on the same inputs that was interrupted goes on: the commands themselves resume.
        """
        part, folder = step.part, self.out / step.part.name
        if folder.exists() and not self._work_of(step):
            shutil.rmtree(folder)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / _STAMP).write_text(step.inputs_sha256, encoding="utf-8")
        places = {"out": folder, "workers": self.workers, **{need: self.out / need for need in part.needs}}
        card, begin = machine(), time.monotonic()
        for command in part.commands:
            self._run(command.format(**places), folder / "log.txt")
        minutes = (time.monotonic() - begin) / 60.0
        figures: dict[str, Figure] = {}
        for source in part.figures:
            for file, prefix in _files(folder, source):
                figures |= figures_in(_json(file), source.keep, prefix, source.leave_out)
            figures |= dict(_ratio(text, figures) for text in source.ratios)
            figures |= dict(_mean(text, figures) for text in source.means)
        for target in part.targets:
            if not (folder / target.source).is_file():
                raise PartError(f"{target.source} was not written")
        for target in part.targets:
            shutil.copyfile(folder / target.source, self.repository / target.target)
        return PartResult(step.inputs_sha256, part.commands, card, round(minutes, 1), figures)

    def _run(self, command: str, log: Path) -> None:
        with log.open("a", encoding="utf-8") as output:
            output.write(f"$ {command}\n")
            output.flush()
            try:
                running = subprocess.Popen(  # noqa: S603 - commands of params/reproduction.yaml
                    shlex.split(command),
                    cwd=self.repository,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,  # Ctrl-C reaches only this process, which then ends the command
                )
            except OSError as error:
                raise PartError(f"`{command}`: {error.strerror}") from error
            try:
                code = running.wait()
            except BaseException:
                end_program(running)
                raise
        if code:
            last = log.read_text(encoding="utf-8", errors="replace").splitlines()[-_LAST_LINES:]
            raise PartError(f"`{command}` ended with exit code {code}: {' / '.join(last)}")


def _ratio(text: str, figures: Mapping[str, Figure]) -> tuple[str, Figure]:
    """Compute the figure of ``NAME=A/B``."""
    name, _, ratio = text.partition("=")
    above, _, below = ratio.partition("/")
    try:
        return name, float(figures[above]) / float(figures[below])
    except (KeyError, ValueError, ZeroDivisionError) as error:
        raise PartError(f"{text}: {error!r}") from error


def _mean(text: str, figures: Mapping[str, Figure]) -> tuple[str, Figure]:
    """Compute the figure of ``NAME=PATTERN``."""
    name, _, pattern = text.partition("=")
    try:
        return name, fmean(float(value) for figure, value in figures.items() if fnmatchcase(figure, pattern))
    except ValueError as error:
        raise PartError(f"{text}: {error}") from error


def _files(folder: Path, source: FigureFile) -> list[tuple[Path, str]]:
    """Files with figures, each with the prefix of its names."""
    if "*" not in source.path:
        return [(folder / source.path, source.prefix)]
    found = sorted(folder.glob(source.path))
    if not found:
        raise PartError(f"{source.path} was not written")
    return [(file, ".".join(filter(None, (source.prefix, *file.relative_to(folder).parts[:-1])))) for file in found]


def _json(file: Path) -> Any:
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise PartError(f"{file.name} cannot be read: {error}") from error
