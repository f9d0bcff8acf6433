"""The parts of a reproduction from ``params/reproduction.yaml``, and their making.

A part has commands, inputs, and figures to keep. Making prints the plan, runs commands, and stores each part's figures
when it is done.
"""

import hashlib
import json
import math
import shlex
import shutil
import subprocess
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from statistics import fmean
from typing import Any, Final

from siren_ros.base.params.parameters import StrictMapping, read_strict_yaml
from siren_ros.base.processes.interrupts import end_program
from siren_ros.errors import InputError, SirenError
from siren_ros.lab.reproduction.results import Figure, PartResult, figures_in, machine, read_results, write_results

HOURS: Final = 60.0
"""Number of minutes in an hour."""
_MOST_MINUTES: Final = 14 * 24 * HOURS


@dataclass(frozen=True)
class FigureFile:
    """A JSON file that a part's commands write, and which of its numbers are kept as figures."""

    path: str
    """Path in the part's folder. A pattern such as ``*/scores.json`` means all matching files; their folders' names
    follow the prefix."""
    keep: tuple[str, ...]
    """Patterns (``fnmatch``) for the dotted names of figures."""
    prefix: str
    """Prefix of the names, joined with a dot; empty for none."""
    leave_out: tuple[str, ...] = ()
    """Parts of the dotted names that are removed."""
    ratios: tuple[str, ...] = ()
    """Figures that are ratios of others, as ``NAME=A/B`` with names of figures."""
    means: tuple[str, ...] = ()
    """Figures that are means of others, as ``NAME=PATTERN`` with a pattern of figures' names."""


@dataclass(frozen=True)
class TargetFile:
    """A file that a part makes for the repository: a picture, a film, trained weights."""

    source: str
    """Path in the part's folder."""
    target: str
    """Path in the repository."""


@dataclass(frozen=True)
class Part:
    """One part. It is made as a whole, and again when its inputs change."""

    name: str
    about: str
    minutes: float
    """Wall time on two cores in minutes."""
    needs: tuple[str, ...]
    """Names of parts whose folders its commands read."""
    code: tuple[str, ...]
    """Files and folders of the repository that decide its figures."""
    files: tuple[str, ...]
    """Files outside the repository that it needs, as paths relative to it; without them the part is skipped."""
    commands: tuple[str, ...]
    """Commands; ``{out}`` is the part's folder, ``{NAME}`` that of the needed part NAME, ``{workers}`` a number."""
    figures: tuple[FigureFile, ...]
    targets: tuple[TargetFile, ...]

    def missing(self, repository: Path) -> tuple[str, ...]:
        """Needed files that are missing."""
        return tuple(file for file in self.files if not (repository / file).exists())


def read_parts(file: Path, repository: Path) -> dict[str, Part]:
    """Read the parts by name, in the order of the file; a part must stand below the parts that it needs.

    Raises:
        InputError: The file names a part that does not stand above, or a path that the repository does not have.
    """
    content = read_strict_yaml(file)
    groups = content.mapping("code")
    code = {name: groups.words(name) for name in tuple(groups.values)}
    parts: dict[str, Part] = {}
    for entry in content.mappings("parts"):
        part = _part(entry, code)
        if part.name in parts:
            raise InputError(entry.where("name"), part.name, "each part once")
        for need in part.needs:
            if need not in parts:
                raise InputError(entry.where("needs"), need, "a part that stands above")
        for path in part.code:
            if not (repository / path).exists():
                raise InputError(entry.where("code"), path, "a file or folder of the repository")
        parts[part.name] = part
    content.finish()
    return parts


def _part(entry: StrictMapping, code: Mapping[str, tuple[str, ...]]) -> Part:
    named = entry.words("code")
    for name in named:
        if name not in code:
            raise InputError(entry.where("code"), name, f"one of {', '.join(code)}")
    figures = entry.mappings("figures") if entry.has("figures") else ()
    targets = entry.mappings("made") if entry.has("made") else ()
    part = Part(
        name=entry.text("name"),
        about=entry.text("about"),
        minutes=entry.number("minutes", 0.0, _MOST_MINUTES),
        needs=_words(entry, "needs"),
        code=tuple(path for name in named for path in code[name]),
        files=_words(entry, "files"),
        commands=entry.words("commands"),
        figures=tuple(
            FigureFile(
                source.text("file"),
                source.words("keep"),
                source.text("prefix") if source.has("prefix") else "",
                *(_words(source, key) for key in ("leave_out", "ratios", "means")),
            )
            for source in figures
        ),
        targets=tuple(TargetFile(target.text("from"), target.text("to")) for target in targets),
    )
    for mapping in (*figures, *targets, entry):
        mapping.finish()
    return part


def _words(mapping: StrictMapping, key: str) -> tuple[str, ...]:
    """An optional list of words."""
    return mapping.words(key) if mapping.has(key) else ()


def inputs_sha256(part: Part, repository: Path, needed: Iterable[str]) -> str:
    """Hash of everything that decides a part: commands, code, outside files, hashes of needed parts."""
    digest = hashlib.sha256(json.dumps([part.commands, part.files, list(needed)]).encode())
    roots = [repository / name for name in (*part.code, *part.files)]
    for path in sorted(file for root in roots for file in ([root] if root.is_file() else root.rglob("*"))):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(f"\0{path.name}\0".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def shown_minutes(minutes: float) -> str:
    """A duration as text: ``12 min``, ``3.5 h``."""
    return f"{math.ceil(minutes)} min" if minutes < 2 * HOURS else f"{minutes / HOURS:.1f} h"


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
