"""Speed and memory of whole episodes, printed for this machine.

``python -m siren_ros.benchmarks.episode`` runs template S2 three ways as a user would (front camera and
LiDAR, LiDAR alone, no sensors), each as a program of its own, recorded, and prints the real-time factor
from the first step to the last, the wall time of the whole program, its peak memory and the bag's size.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from siren_ros.benchmarks.json_figures import add_json, write_json

FACTOR = re.compile(r"real-time factor (\d+\.\d+) ")
TARGETS = {"front": "bag under 500 MB, memory under 1.5 GB", "lidar": "factor at least 3", "none": "factor at least 10"}


@dataclass(frozen=True)
class Measurement:
    """One run."""

    factor: float
    wall_s: float
    memory_gb: float
    bag_mb: float
    summary: str


def measure(suite: str, arguments: Sequence[str], folder: Path) -> Measurement:
    """Run one episode as a program of its own.

    Raises:
        RuntimeError: The episode failed; the message is its output.
    """
    bag = folder / suite
    options = ["template:=S2", f"sensors:={suite}", f"bag:={bag}", "kitti:=false", *arguments]
    command = [sys.executable, "-m", "siren_nodes.cosim", "--ros-args"]
    command += [part for option in options for part in ("-p", option)]
    before_s = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)  # noqa: S603 - own module
    output = process.stdout.read() if process.stdout else ""
    _, status, usage = os.wait4(process.pid, 0)
    wall_s = time.perf_counter() - before_s
    match = FACTOR.search(output)
    if status or match is None:
        raise RuntimeError(output)
    size = sum(file.stat().st_size for file in bag.iterdir())
    return Measurement(float(match.group(1)), wall_s, usage.ru_maxrss * resource_unit() / 1e9, size / 1e6, output)


def resource_unit() -> int:
    """Bytes per unit of ``ru_maxrss``."""
    return 1 if sys.platform == "darwin" else 1024


def main(argv: Sequence[str] | None = None) -> int:
    """Print one line per suite."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suites", nargs="+", default=["front", "lidar", "none"], help="sensor suites to measure")
    parser.add_argument("--runs", type=int, default=1, help="runs of each suite")
    parser.add_argument("--where", action="store_true", help="print each episode's own summary too")
    parser.add_argument("parameters", nargs="*", help="further parameters of cosim, such as processes:=true")
    add_json(parser)
    options = parser.parse_args(argv)
    measured: list[dict[str, object]] = []
    print(f"{'suite':<10}{'real-time factor':>18}{'program s':>12}{'memory GB':>12}{'bag MB':>10}   to reach")
    with tempfile.TemporaryDirectory(prefix="siren_benchmark_") as scratch:
        for suite in options.suites:
            for run in range(options.runs):
                folder = Path(scratch) / str(run)
                one = measure(suite, options.parameters, folder)
                measured.append(
                    {
                        "name": f"{suite}.{run}",
                        "real_time_factor": one.factor,
                        "wall_s": one.wall_s,
                        "memory_gb": one.memory_gb,
                        "bag_mb": one.bag_mb,
                    }
                )
                figures = f"{one.factor:>18.2f}{one.wall_s:>12.1f}{one.memory_gb:>12.2f}{one.bag_mb:>10.1f}"
                print(f"{suite:<10}{figures}   {TARGETS.get(suite, '')}", flush=True)
                if options.where:
                    print(one.summary)
    write_json(options.json, measured)
    return 0


if __name__ == "__main__":
    sys.exit(main())
