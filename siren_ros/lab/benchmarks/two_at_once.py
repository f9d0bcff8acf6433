"""Measures how well two episodes run in parallel: ``python -m siren_ros.benchmarks.two_at_once``.

It runs an episode alone and two at once, with several suites of sensors, and the same of a loop that needs nothing but
a processor. Two episodes at once that are as much faster than one after the other as two such loops have a ratio of 1.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

from siren_ros.lab.benchmarks.episode import measure
from siren_ros.lab.reproduction.results import add_json, write_json
from siren_ros.running.ros.transport.dds import DOMAIN_VARIABLE

LOOP: Final = "sum(number * number for number in range(60_000_000))"
"""Program that needs nothing but a processor, for some seconds."""


def speed_up(work: Callable[[int], object]) -> float:
    """Speed of two parallel calls relative to two calls in sequence; the argument tells the calls apart."""
    start_s = time.perf_counter()
    work(0)
    alone_s = time.perf_counter() - start_s
    with ThreadPoolExecutor(2) as pool:
        start_s = time.perf_counter()
        list(pool.map(work, (1, 2)))
        return 2.0 * alone_s / (time.perf_counter() - start_s)


def _busy_loop(_: int) -> None:
    subprocess.run([sys.executable, "-c", LOOP], check=True)  # noqa: S603 - own text


def main(argv: Sequence[str] | None = None) -> int:
    """Print a line for each suite."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suites", nargs="+", default=["none", "lidar", "front"], help="suites of sensors")
    parser.add_argument("--runs", type=int, default=1, help="runs of each suite and of the loop, in turns")
    parser.add_argument("parameters", nargs="*", help="further parameters of cosim")
    add_json(parser)
    options = parser.parse_args(argv)
    os.environ.pop(DOMAIN_VARIABLE, None)  # lets each episode find a free domain
    loops: list[float] = []
    episodes: dict[str, list[float]] = {suite: [] for suite in options.suites}
    with tempfile.TemporaryDirectory(prefix="siren_benchmark_") as scratch:
        for run in range(options.runs):
            loops.append(speed_up(_busy_loop))
            for suite in options.suites:
                folder = Path(scratch) / f"{suite}{run}"
                gain = speed_up(lambda n: measure(suite, options.parameters, folder / str(n)))  # noqa: B023 - called here
                episodes[suite].append(gain)
    loop = statistics.median(loops)
    figures = {"loop": {"speed_up": loop}}
    print(f"two busy loops at once: {loop:.2f} times as fast as one after the other")
    for suite, gains in episodes.items():
        gain = statistics.median(gains)
        figures[suite] = {"speed_up": gain, "to_loop": gain / loop}
        print(f"two episodes at once, {suite}: {gain:.2f} times, {gain / loop:.2f} of the loops'")
    write_json(options.json, figures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
