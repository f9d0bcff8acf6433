"""One episode of the soak: run twice as a user would, compared, and everything searched that it could leave behind."""

import hashlib
import os
import signal
import subprocess
import sys
import uuid
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from siren_ros.errors import EXIT_BAD_INPUT, EXIT_OK, SirenError
from siren_ros.judging.verification.limits import VerifyLimits
from siren_ros.judging.verify import check_complete, check_message_counts, check_stamps
from siren_ros.recording.bag_reader import read_episode
from siren_ros.ros.transport.shared_memory import abandoned_segments

MARK: Final = "SIREN_SOAK_MARK"
"""Environment variable by which all processes of an episode are found, whoever their parent is now."""
LIMIT_S: Final = 600.0
_LINES: Final = 3


@dataclass(frozen=True)
class SoakCase:
    """What is run."""

    template: str
    level: str
    seed: int
    duration_s: float
    sensors: str = "none"
    map: str = ""
    processes: tuple[bool, bool] = (False, False)
    """Of the first and of the second run: one process for each node."""

    @property
    def name(self) -> str:
        """Name of the case in one word."""
        suite, town = Path(self.sensors).stem, Path(self.map).stem or "town"
        modes = "+".join("many" if many else "one" for many in self.processes)
        return f"{self.template}/{self.level}/seed{self.seed}/{suite}/{town}/{modes}"

    def parameters(self, bag: Path, run: int) -> list[str]:
        """The parameters of ``cosim``."""
        asked = [f"template:={self.template}", f"level:={self.level}", f"seed:={self.seed}", f"bag:={bag}"]
        asked += [f"duration_s:={self.duration_s}", f"sensors:={self.sensors}", "kitti:=false"]
        asked += [f"map:={self.map}"] if self.map else []
        return [*asked, f"processes:={str(self.processes[run]).lower()}"]


@dataclass(frozen=True)
class SoakResult:
    """What was found; empty tuples where all is well."""

    case: SoakCase
    refused: bool = False
    """Both runs refused the input: the map has no site of the template's kind."""
    failures: tuple[str, ...] = ()
    hashes_differ: bool = False
    lost: tuple[str, ...] = ()
    processes: tuple[str, ...] = ()
    segments: int = 0
    locks: tuple[str, ...] = ()
    details: tuple[str, ...] = field(default=())

    @property
    def clean(self) -> bool:
        """Whether nothing is wrong with it."""
        found = (self.failures, self.hashes_differ, self.lost, self.processes, self.segments, self.locks)
        return not any(found)


def run_case(case: SoakCase, folder: Path) -> SoakResult:
    """Run a case twice in folders of its own."""
    mark = uuid.uuid4().hex
    before = set(abandoned_segments(0.0))
    runs = [_run(case, run, folder / str(run), mark) for run in range(2)]
    codes = [code for code, _ in runs]
    left = end_marked(mark)
    segments = len(set(abandoned_segments(0.0)) - before)
    if codes == [EXIT_BAD_INPUT] * 2:
        return SoakResult(case, refused=True, processes=left, segments=segments, details=(runs[0][1],))
    bags = [folder / str(run) / "bag" for run in range(2)]
    return SoakResult(
        case,
        failures=tuple(f"run {run + 1}: exit code {code}: {said}" for run, (code, said) in enumerate(runs) if code),
        hashes_differ=codes == [EXIT_OK] * 2 and digest(bags[0]) != digest(bags[1]),
        lost=tuple(text for bag in bags for text in lost_messages(bag)),
        processes=left,
        segments=segments,
        locks=tuple(str(path.name) for bag in bags for path in left_behind(bag)),
    )


def _run(case: SoakCase, run: int, folder: Path, mark: str) -> tuple[int, str]:
    folder.mkdir(parents=True)
    flags = [part for item in case.parameters(folder / "bag", run) for part in ("-p", item)]
    command = [sys.executable, "-m", "siren_nodes.cosim", "--ros-args", *flags]
    try:
        done = subprocess.run(  # noqa: S603 - our own module, no shell
            command,
            env={**os.environ, MARK: mark},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return 1, f"not done after {LIMIT_S:g} s"
    return done.returncode, " | ".join(done.stderr.strip().splitlines()[-_LINES:])


def digest(bag: Path) -> dict[str, str]:
    """SHA-256 of every file of a bag."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(bag.glob("*"))}


def lost_messages(bag: Path) -> list[str]:
    """What the record lacks against the rates of its topics, or why it cannot be read."""
    if not bag.is_dir():
        return []
    try:
        record, limits = read_episode(bag), VerifyLimits()
    except SirenError as error:
        return [str(error)]
    checks = (check_complete, check_message_counts, check_stamps)
    return [str(part) for part in (check(record, limits) for check in checks) if not part.holds]


def left_behind(bag: Path) -> list[Path]:
    """Files next to a finished bag, or in it, that do not belong there."""
    around = [path for path in sorted(bag.parent.iterdir()) if path != bag]
    within = [path for path in sorted(bag.glob("*")) if path.name != "metadata.yaml" and path.suffix != ".mcap"]
    return around + within


def marked_processes(mark: str, processes: Path = Path("/proc")) -> Mapping[int, str]:
    """Command lines of the live processes with a mark in their environment, by process id."""
    found = {}
    for entry in sorted(processes.glob("[0-9]*")):
        with suppress(OSError):
            carries = f"{MARK}={mark}".encode() in (entry / "environ").read_bytes().split(b"\0")
            if carries and "\nState:\tZ" not in (entry / "status").read_text(encoding="utf-8"):
                found[int(entry.name)] = (entry / "cmdline").read_text(encoding="utf-8").replace("\0", " ").strip()
    return found


def end_marked(mark: str) -> tuple[str, ...]:
    """End what an episode has left running; returns the command lines."""
    left = marked_processes(mark)
    for number in left:
        with suppress(OSError):
            os.kill(number, signal.SIGKILL)
    return tuple(left.values())


def mixed_cases(count: int, duration_s: float, templates: Sequence[str], lidar_suite: str, town: str) -> list[SoakCase]:
    """Cases that go through templates, levels, seeds, process modes, and now and then a LiDAR or another map.

    Args:
        count: Number of cases.
        duration_s: Simulated time of each.
        templates: Ids of the templates.
        lidar_suite: Path of the suite with a LiDAR, for every fifth case.
        town: Path of another map, for every tenth case; empty for none.
    """
    levels = ("L2", "L0", "L3", "L1")
    modes = ((False, False), (False, True), (True, True))
    return [
        SoakCase(
            templates[number % len(templates)],
            levels[number // len(templates) % len(levels)],
            number,
            duration_s,
            lidar_suite if number % 5 == 3 else "none",
            town if number % 10 == 6 else "",
            modes[number % len(modes)],
        )
        for number in range(count)
    ]
