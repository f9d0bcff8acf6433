"""Speed and memory of whole episodes, printed for this machine.

``python -m siren_ros.benchmarks.episode`` runs template S2 three ways as a user would (front camera and
LiDAR, LiDAR alone, no sensors), each as a separate program, recorded, and prints the real-time factor
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
from pathlib import Path

from siren_ros.benchmarks.json_figures import add_json, write_json

FACTOR = re.compile(r"real-time factor (\d+\.\d+) ")
TARGETS = {"front": "bag under 500 MB, memory under 1.5 GB", "lidar": "factor at least 3", "none": "factor at least 10"}


def measure(suite: str, arguments: Sequence[str], folder: Path) -> tuple[dict[str, float], str]:
    """The figures of one episode, run as a separate program, and what the program printed.

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
    memory_unit = 1 if sys.platform == "darwin" else 1024  # bytes per unit of ru_maxrss
    figures = {
        "real_time_factor": float(match.group(1)),
        "wall_s": wall_s,
        "memory_gb": usage.ru_maxrss * memory_unit / 1e9,
        "bag_mb": sum(file.stat().st_size for file in bag.iterdir()) / 1e6,
    }
    return figures, output


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
                figures, output = measure(suite, options.parameters, Path(scratch) / str(run))
                measured.append({"name": f"{suite}.{run}", **figures})
                factor, wall_s, memory_gb, bag_mb = figures.values()
                columns = f"{factor:>18.2f}{wall_s:>12.1f}{memory_gb:>12.2f}{bag_mb:>10.1f}"
                print(f"{suite:<10}{columns}   {TARGETS.get(suite, '')}", flush=True)
                if options.where:
                    print(output)
    write_json(options.json, measured)
    return 0


if __name__ == "__main__":
    sys.exit(main())
