"""Many episodes one after the other: equal bytes, nothing left behind, flat memory.

``python -m siren_ros.benchmarks.soak --episodes 100 --duration 5`` runs mixed templates, levels, seeds and process
modes, now and then with a LiDAR or on another map (``--map``), each as a program of its own and twice. It prints a line
for each and at the end the totals: bags that differ, topics that lost messages, processes, locks and shared memory
left behind, and the resident memory of a long-lived worker. Exit code 1 where anything is wrong.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from shutil import rmtree
from typing import Final

from siren_ros.benchmarks.soak_episode import SoakResult, mixed_cases, run_case
from siren_ros.benchmarks.worker_memory import FLAT_MB_PER_EPISODE, WorkerMemory, measure_worker
from siren_ros.errors import EXIT_FAILED, EXIT_OK
from siren_ros.scenario.request import EpisodeRequest
from siren_ros.scenario.templates import available_templates

SMALL_SUITE: Final = """
lidars:
  lidar: {mount: {x_m: 0.0, y_m: 0.0, z_m: 1.93}, channels: 8, points_per_second: 40000, rate_hz: 20}
"""
WARM_UP_ROUNDS: Final = 3
"""Runs of every template before the worker's memory counts: numba and SUMO keep memory after their first use."""


def lines_of(result: SoakResult) -> list[str]:
    """The output for one case: a line, and a line for each fault."""
    word = "refused" if result.refused else "ok" if result.clean else "WRONG"
    wrong = [*result.failures, *(["the two bags differ"] if result.hashes_differ else []), *result.lost]
    wrong += [f"left running: {command}" for command in result.processes]
    wrong += [f"left behind: {name}" for name in result.locks]
    wrong += [f"left behind: {result.segments} segments of shared memory"] if result.segments else []
    return [f"{word:<8}{result.case.name}", *(f"        {text}" for text in (*result.details, *wrong))]


def totals_of(results: Sequence[SoakResult], memory: WorkerMemory | None) -> list[str]:
    """The last lines."""
    ran = [result for result in results if not result.refused]
    lines = [
        f"{len(ran)} episodes, each twice ({len(results) - len(ran)} refused)",
        f"  failed                        {sum(bool(result.failures) for result in results)}",
        f"  hash differences              {sum(result.hashes_differ for result in results)}",
        f"  with lost messages            {sum(bool(result.lost) for result in results)}",
        f"  processes left                {sum(len(result.processes) for result in results)}",
        f"  shared-memory segments left   {sum(result.segments for result in results)}",
        f"  locks and files left          {sum(len(result.locks) for result in results)}",
    ]
    if memory is None:
        return lines
    settled = memory.settled_mb
    first = f"{settled[0]:.1f} MB after {memory.warm_up + 1} episodes"
    last = f"{settled[-1]:.1f} MB after {len(memory.resident_mb)}"
    growth = f"{memory.slope_mb:+.3f} MB an episode (flat: up to {FLAT_MB_PER_EPISODE:g})"
    return [*lines, f"  worker's memory               {first}, {last}, {growth}"]


def soak(options: argparse.Namespace, folder: Path) -> list[SoakResult]:
    """Run the cases, and print what is found."""
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
    """The memory of a worker in a process of its own."""
    warm_up = WARM_UP_ROUNDS * len(options.templates)
    count = max(options.worker_episodes, warm_up + 2)
    requests = [
        EpisodeRequest(options.templates[number % len(options.templates)], "", number, "", options.duration)
        for number in range(count)
    ]
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(measure_worker, requests, warm_up).result()


def main(argv: Sequence[str] | None = None) -> int:
    """Runs everything; exit code 1 where anything is wrong."""
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
    parser.add_argument("--templates", nargs="+", default=list(available_templates()), metavar="ID")
    parser.add_argument("--map", default="", help="another map, for every tenth case; the built-in town otherwise")
    parser.add_argument("--worker-episodes", type=int, default=100, help="episodes of the worker; 0 for none (100)")
    parser.add_argument("--keep", default="", metavar="FOLDER", help="where the bags of cases go that are wrong")
    return parser


if __name__ == "__main__":
    sys.exit(main())
