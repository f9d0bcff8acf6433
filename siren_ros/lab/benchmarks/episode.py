"""Measures speed and memory of whole episodes on this machine.

``python -m siren_ros.benchmarks.episode`` runs template S2 with several suites of sensors as a user would,
each as a separate program, recorded. It prints the real-time factor from the first step to the last, the
wall time and the processor time of the whole program, its peak memory, the bag's size, and the share of
the wall time that each part of the graph is busy; sensors work beside the others.
"""

import argparse
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from siren_ros.lab.reproduction.results import add_json, write_json

FACTOR = re.compile(r"real-time factor (\d+\.\d+) ")
SHARE = re.compile(r"^  (\w[\w ]+\w) +\d+\.\d+ s +(\d+\.\d+) %$", re.MULTILINE)
PARTS = {
    "sumo_bridge": "sumo",
    "emv_controller": "drivers",
    "yield_manager": "drivers",
    "vehicle_dynamics": "dynamics",
    "sensor_sim": "sensors",
    "recorder": "recorder",
    "lockstep and transport": "transport",
}
"""Part of the table to which each node belongs."""


def shares_of(output: str) -> dict[str, float]:
    """Share of the wall time of each part, from the summary that an episode prints; zero if it has none."""
    shares = dict.fromkeys(PARTS.values(), 0.0)
    for name, percent in SHARE.findall(output):
        if name in PARTS:
            shares[PARTS[name]] += float(percent) / 100.0
    return shares


def measure(suite: str, arguments: Sequence[str], folder: Path) -> tuple[dict[str, float], str]:
    """Run one episode as a separate program; returns its figures and its output.

    Raises:
        RuntimeError: The episode failed; the message is its output.
    """
    bag = folder / suite
    options = ["template:=S2", f"sensors:={suite}", f"bag:={bag}", "kitti:=false", *arguments]
    command = [sys.executable, "-m", "siren_nodes.cosim", "--ros-args"]
    command += [part for option in options for part in ("-p", option)]
    before_s = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:  # noqa: S603 - own module
        output = process.stdout.read() if process.stdout else ""
        _, status, usage = os.wait4(process.pid, 0)
        # Subprocess cannot see that this wait has ended the process.
        process.returncode = os.waitstatus_to_exitcode(status)
    wall_s = time.perf_counter() - before_s
    match = FACTOR.search(output)
    if status or match is None:
        raise RuntimeError(output)
    memory_unit = 1 if sys.platform == "darwin" else 1024  # number of bytes in a unit of ru_maxrss
    figures = {
        "real_time_factor": float(match.group(1)),
        "wall_s": wall_s,
        "processor_s": usage.ru_utime + usage.ru_stime,
        "memory_mb": usage.ru_maxrss * memory_unit / 1e6,
        "bag_mb": sum(file.stat().st_size for file in bag.iterdir()) / 1e6,
        **shares_of(output),
    }
    return figures, output


def main(argv: Sequence[str] | None = None) -> int:
    """Print one line per suite."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suites", nargs="+", default=["none", "lidar", "front", "full"], help="suites of sensors")
    parser.add_argument("--runs", type=int, default=1, help="runs of each suite")
    parser.add_argument("--where", action="store_true", help="print each episode's own summary too")
    parser.add_argument("parameters", nargs="*", help="further parameters of cosim, such as processes:=true")
    add_json(parser)
    options = parser.parse_args(argv)
    measured: dict[str, dict[str, float]] = {}
    head = "".join(f"{part:>11}" for part in dict.fromkeys(PARTS.values()))
    print(f"suite     real-time factor   wall s   processor s   memory MB    bag MB{head}")
    with tempfile.TemporaryDirectory(prefix="siren_benchmark_") as scratch:
        for suite in options.suites:
            runs = []
            for run in range(options.runs):
                figures, output = measure(suite, options.parameters, Path(scratch) / str(run))
                runs.append(figures)
                factor, wall_s, processor_s, memory_mb, bag_mb, *shares = figures.values()
                columns = f"{factor:16.2f}{wall_s:9.1f}{processor_s:14.1f}{memory_mb:12.0f}{bag_mb:10.1f}"
                print(f"{suite:<10}{columns}{''.join(f'{share:11.0%}' for share in shares)}", flush=True)
                if options.where:
                    print(output)
            measured[suite] = {name: statistics.median(figures[name] for figures in runs) for name in runs[0]}
    write_json(options.json, measured)
    return 0


if __name__ == "__main__":
    sys.exit(main())
