"""Measures how fast episodes become datasets: ``python -m siren_ros.benchmarks.exports BAG BAG``.

Prints for each LiDAR format how many seconds of simulated time are exported in a second, and how much two processes
speed up two bags, next to what they speed up two loops that do nothing but count.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.data.datasets.export_job import ExportJob, run_export
from siren_ros.data.datasets.formats import format_named
from siren_ros.errors import EXIT_OK

LIDAR_FORMATS: Final = ("kitti", "openpcdet", "nuscenes")
_LOOP: Final = 20_000_000


def export_time_s(name: str, bags: Sequence[Path], processes: int) -> tuple[float, float]:
    """Wall time of an export, and the simulated time of its episodes."""
    with tempfile.TemporaryDirectory() as folder:
        simulated: list[float] = []
        start = time.perf_counter()
        run_export(ExportJob(format_named(name), {}, tuple(bags), Path(folder) / "out", processes), simulated.append)
        return time.perf_counter() - start, sum(simulated)


def count() -> None:
    """Count in a loop, to keep one processor busy."""
    number = 0
    while number < _LOOP:
        number += 1


def busy_speedup(processes: int) -> float:
    """How much faster this number of loops is in parallel than one after the other."""
    start = time.perf_counter()
    for _ in range(processes):
        count()
    serial = time.perf_counter() - start
    with ProcessPool(processes) as pool:
        pool.map(count, [()] * processes)
        start = time.perf_counter()
        pool.map(count, [()] * processes)
        return serial / (time.perf_counter() - start)


def main(argv: Sequence[str] | None = None) -> int:
    """Print one row for each format."""
    parser = argparse.ArgumentParser(prog="exports", description=__doc__)
    parser.add_argument("bags", type=Path, nargs=2, metavar="BAG", help="two episodes with LiDAR and cameras")
    parser.add_argument("--formats", nargs="+", default=list(LIDAR_FORMATS), help="default: the LiDAR formats")
    arguments = parser.parse_args(argv)
    print(f"{'format':<12}{'one bag':>10}{'two bags':>10}{'loops':>8}{'share':>8}")
    for name in arguments.formats:
        export_time_s(name, arguments.bags[:1], 2)
        single_s, simulated_s = export_time_s(name, arguments.bags[:1], 2)
        serial_s, _ = export_time_s(name, arguments.bags, 1)
        both_s, _ = export_time_s(name, arguments.bags, 2)
        loops, speedup = busy_speedup(2), serial_s / both_s
        print(f"{name:<12}{simulated_s / single_s:>9.1f}x{speedup:>9.2f}x{loops:>7.2f}x{speedup / loops:>8.2f}")
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
