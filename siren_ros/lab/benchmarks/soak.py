"""Runs many episodes in sequence and checks for equal bytes, leftover processes and files, and memory growth.

``python -m siren_ros.benchmarks.soak --episodes 100 --duration 5`` runs mixed templates, levels, seeds and process
modes, now and then with a LiDAR or on another map (``--map``), each twice as a separate program. It prints a line
for each and at the end the totals: bags that differ, topics that lost messages, processes, locks and shared memory
left behind, and the resident memory of a long-lived worker. Exit code 1 where anything is wrong.
"""

import argparse
import gc
import hashlib
import os
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from shutil import rmtree
from typing import Final

import numpy as np

from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import EXIT_BAD_INPUT, EXIT_FAILED, EXIT_OK, SirenError
from siren_ros.running.generation.closed_loop import closed_loop
from siren_ros.running.generation.episode_setup import plan_length, set_up_episode
from siren_ros.running.ros.transport.dds import abandoned_segments
from siren_ros.scoring.judging.verify import check_complete, check_message_counts, check_stamps
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import TEMPLATES

FLAT_MB_PER_EPISODE: Final = 0.1
"""Growth below which memory counts as flat: 100 MB in a thousand episodes, far below what an episode needs."""
_PAGES_COLUMN: Final = 1


@dataclass(frozen=True)
class WorkerMemory:
    """Resident memory after each episode in MB, and the end of the warm-up."""

    resident_mb: tuple[float, ...]
    warm_up: int

    @property
    def settled_mb(self) -> tuple[float, ...]:
        """Memory after the warm-up."""
        return self.resident_mb[self.warm_up :]

    @property
    def slope_mb(self) -> float:
        """Growth per episode after the warm-up: median of the slopes between all pairs (Theil and Sen).

        One episode with more vehicles than all before it lifts the level once; that is no leak.
        """
        values = np.array(self.settled_mb)
        first, second = np.triu_indices(len(values), 1)
        return float(np.median((values[second] - values[first]) / (second - first))) if len(first) else 0.0

    @property
    def flat(self) -> bool:
        """Whether memory does not grow."""
        return self.slope_mb <= FLAT_MB_PER_EPISODE


def measure_worker(requests: Sequence[EpisodeRequest], warm_up: int) -> WorkerMemory:
    """Run episodes in sequence in this process; memory counts after the first ``warm_up`` of them."""
    sizes_mb: list[float] = []
    for request in requests:
        for _ in closed_loop(set_up_episode(request), plan_length(request)):
            pass
        gc.collect()
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[_PAGES_COLUMN])
        sizes_mb.append(pages * 4096 / 1e6)
        print(f"  worker: {len(sizes_mb)}/{len(requests)} episodes, {sizes_mb[-1]:.1f} MB", file=sys.stderr, flush=True)
    return WorkerMemory(tuple(sizes_mb), warm_up)


MARK: Final = "SIREN_SOAK_MARK"
"""Environment variable that marks all processes of an episode, even if their parent has ended."""
LIMIT_S: Final = 600.0
WORKER_LIMIT_S: Final = 86_400.0
_LINES: Final = 3


@dataclass(frozen=True)
class SoakCase:
    """Settings of one test case."""

    template: str
    level: str
    seed: int
    duration_s: float
    sensors: str = "none"
    map: str = ""
    processes: tuple[bool, bool] = (False, False)
    """Whether each node has its own process, in the first and in the second run."""

    @property
    def name(self) -> str:
        """Name of the case in one word."""
        suite, town = Path(self.sensors).stem, Path(self.map).stem or "town"
        modes = "+".join("many" if many else "one" for many in self.processes)
        return f"{self.template}/{self.level}/seed{self.seed}/{suite}/{town}/{modes}"

    def parameters(self, bag: Path, run: int) -> list[str]:
        """Parameters of ``cosim`` for a run."""
        asked = [f"template:={self.template}", f"level:={self.level}", f"seed:={self.seed}", f"bag:={bag}"]
        asked += [f"duration_s:={self.duration_s}", f"sensors:={self.sensors}", "kitti:=false"]
        asked += [f"map:={self.map}"] if self.map else []
        return [*asked, f"processes:={str(self.processes[run]).lower()}"]


@dataclass(frozen=True)
class SoakResult:
    """Faults of a case; empty tuples if there are none."""

    case: SoakCase
    refused: bool = False
    """Whether both runs refused the input, because the map has no site for the template."""
    failures: tuple[str, ...] = ()
    hashes_differ: bool = False
    lost: tuple[str, ...] = ()
    processes: tuple[str, ...] = ()
    segments: int = 0
    locks: tuple[str, ...] = ()
    details: tuple[str, ...] = field(default=())

    @property
    def clean(self) -> bool:
        """Whether there is no fault."""
        return not any((self.failures, self.hashes_differ, self.lost, self.processes, self.segments, self.locks))


def run_case(case: SoakCase, folder: Path) -> SoakResult:
    """Run a case twice in separate folders."""
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
    environment, nothing = {**os.environ, MARK: mark}, subprocess.DEVNULL
    try:
        done = subprocess.run(  # noqa: S603 - our own module, no shell
            command, env=environment, stdin=nothing, capture_output=True, text=True, timeout=LIMIT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return 1, f"not done after {LIMIT_S:g} s"
    return done.returncode, " | ".join(done.stderr.strip().splitlines()[-_LINES:])


def digest(bag: Path) -> dict[str, str]:
    """SHA-256 of every file of a bag."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(bag.glob("*"))}


def lost_messages(bag: Path) -> list[str]:
    """Messages that the record lacks at the rates of its topics, or why it cannot be read."""
    if not bag.is_dir():
        return []
    try:
        record = read_episode(bag)
    except SirenError as error:
        return [str(error)]
    checks = (check_complete, check_message_counts, check_stamps)
    return [str(part) for part in (check(record) for check in checks) if not part.holds]


def left_behind(bag: Path) -> list[Path]:
    """Files in or beside a finished bag that do not belong there."""
    around = [path for path in sorted(bag.parent.iterdir()) if path != bag]
    within = [path for path in sorted(bag.glob("*")) if path.name != "metadata.yaml" and path.suffix != ".mcap"]
    return around + within


def marked_processes(mark: str, processes: Path = Path("/proc")) -> Mapping[int, str]:
    """Command lines of live processes with a mark in their environment, by process id."""
    commands = {}
    for entry in sorted(processes.glob("[0-9]*")):
        with suppress(OSError):
            carries = f"{MARK}={mark}".encode() in (entry / "environ").read_bytes().split(b"\0")
            if carries and "\nState:\tZ" not in (entry / "status").read_text(encoding="utf-8"):
                commands[int(entry.name)] = (entry / "cmdline").read_text(encoding="utf-8").replace("\0", " ").strip()
    return commands


def end_marked(mark: str) -> tuple[str, ...]:
    """End the processes that an episode has left; returns their command lines."""
    left = marked_processes(mark)
    for number in left:
        with suppress(OSError):
            os.kill(number, signal.SIGKILL)
    return tuple(left.values())


def mixed_cases(count: int, duration_s: float, templates: Sequence[str], lidar_suite: str, town: str) -> list[SoakCase]:
    """Make cases that cycle through templates, levels, seeds and process modes.

    Every fifth case has the suite with a LiDAR, every tenth case the map of the file ``town``, if there is one.
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


SMALL_SUITE: Final = """
lidars:
  lidar: {mount: {x_m: 0.0, y_m: 0.0, z_m: 1.93}, channels: 8, points_per_second: 40000, rate_hz: 20}
"""
WARM_UP_ROUNDS: Final = 3
"""Runs of every template before memory counts, because numba and SUMO keep memory after their first use."""


def lines_of(result: SoakResult) -> list[str]:
    """The output for one case: a line, and a line for each fault."""
    word = "refused" if result.refused else "ok" if result.clean else "WRONG"
    wrong = [*result.failures, *(["the two bags differ"] if result.hashes_differ else []), *result.lost]
    wrong += [f"left running: {command}" for command in result.processes]
    wrong += [f"left behind: {name}" for name in result.locks]
    wrong += [f"left behind: {result.segments} segments of shared memory"] if result.segments else []
    return [f"{word:<8}{result.case.name}", *(f"        {text}" for text in (*result.details, *wrong))]


def totals_of(results: Sequence[SoakResult], memory: WorkerMemory | None) -> list[str]:
    """Final lines with the totals."""
    ran = [result for result in results if not result.refused]
    totals = {
        "failed": sum(bool(result.failures) for result in results),
        "hash differences": sum(result.hashes_differ for result in results),
        "with lost messages": sum(bool(result.lost) for result in results),
        "processes left": sum(len(result.processes) for result in results),
        "shared-memory segments left": sum(result.segments for result in results),
        "locks and files left": sum(len(result.locks) for result in results),
    }
    lines = [f"{len(ran)} episodes, each twice ({len(results) - len(ran)} refused)"]
    lines += [f"  {name:<30}{total}" for name, total in totals.items()]
    if memory is None:
        return lines
    settled = memory.settled_mb
    first = f"{settled[0]:.1f} MB after {memory.warm_up + 1} episodes"
    last = f"{settled[-1]:.1f} MB after {len(memory.resident_mb)}"
    growth = f"{memory.slope_mb:+.3f} MB an episode (flat: up to {FLAT_MB_PER_EPISODE:g})"
    return [*lines, f"  worker's memory               {first}, {last}, {growth}"]


def soak(options: argparse.Namespace, folder: Path) -> list[SoakResult]:
    """Run the cases and print the results."""
    suite = folder / "small.yaml"
    suite.write_text(SMALL_SUITE, encoding="utf-8")
    cases = mixed_cases(options.episodes, options.duration, options.templates, str(suite), options.map)
    results = []
    for number, case in enumerate(cases):
        began_s = time.monotonic()
        place = folder / str(number)
        results.append(run_case(case, place))
        if not results[-1].clean and options.keep:
            place.rename(Path(options.keep) / f"case{number}")
        rmtree(place, ignore_errors=True)
        first, *more = lines_of(results[-1])
        print(f"{number + 1:>4}/{len(cases)} {first}  {time.monotonic() - began_s:.1f} s", *more, sep="\n", flush=True)
    return results


def worker_memory(options: argparse.Namespace) -> WorkerMemory:
    """Measure the memory of a worker in a fresh process."""
    templates, warm_up = options.templates, WARM_UP_ROUNDS * len(options.templates)
    count = max(options.worker_episodes, warm_up + 2)
    requests = [EpisodeRequest(templates[row % len(templates)], "", row, "", options.duration) for row in range(count)]
    with ProcessPool(1, fresh=True) as pool:
        return pool.call(measure_worker, requests, warm_up, timeout_s=WORKER_LIMIT_S)


def main(argv: Sequence[str] | None = None) -> int:
    """Run everything; exit code 1 if there is a fault."""
    options = _parser().parse_args(argv)
    with tempfile.TemporaryDirectory(prefix="siren_soak_") as scratch:
        results = soak(options, Path(scratch))
    memory = worker_memory(options) if options.worker_episodes else None
    print(*totals_of(results, memory), sep="\n")
    well = all(result.clean for result in results) and (memory is None or memory.flat)
    return EXIT_OK if well else EXIT_FAILED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=100, help="cases; each is run twice (100)")
    parser.add_argument("--duration", type=float, default=10.0, metavar="S", help="simulated seconds of each (10)")
    parser.add_argument("--templates", nargs="+", default=list(TEMPLATES), metavar="ID")
    parser.add_argument("--map", default="", help="another map, for every tenth case; the built-in town otherwise")
    parser.add_argument("--worker-episodes", type=int, default=100, help="episodes of the worker; 0 for none (100)")
    parser.add_argument("--keep", default="", metavar="FOLDER", help="where the bags of cases go that are wrong")
    return parser


if __name__ == "__main__":
    sys.exit(main())
