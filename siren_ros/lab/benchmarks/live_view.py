"""Measures how much a viewer slows a running episode: ``python -m siren_ros.benchmarks.live_view``.

It runs template S2 without sensors in turns alone and with ``siren view --live``, from which a client reads everything
and draws nothing. It prints the real-time factor from the first step to the last and the processor time of the
episode's program. At the end come the medians of the rounds' ratios of wall time and of processor time of the steps:
other work on a machine slows both runs of a round. The steps' time is that of the program without what it needs to
start, which runs of one step tell.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final
from urllib.request import urlopen

from siren_ros.lab.benchmarks.episode import measure
from siren_ros.lab.reproduction.results import add_json, write_json
from siren_ros.running.ros.transport.dds import DOMAIN_VARIABLE

_VIEWER: Final = (sys.executable, "-m", "siren_nodes.viewer", "--ros-args", "-p", "browser:=false")
_DOMAIN: Final = "79"
"""ROS domain if the user sets none: both programs must use the same."""
_SHORT: Final = "duration_s:=0.05"
_BEGIN_BYTES: Final = 100_000
"""After this many bytes the client has received the scene; a short episode may end before."""
_PATIENCE_S: Final = 60.0


@contextmanager
def reading_viewer() -> Iterator[list[int]]:
    """Start a viewer with a client; yields the sizes of what the client has read."""
    with subprocess.Popen(_VIEWER, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:  # noqa: S603 - own module
        address = process.stdout.readline().strip() if process.stdout else ""
        read: list[int] = []
        client = threading.Thread(target=lambda: read.extend(map(len, urlopen(f"{address}stream"))), daemon=True)  # noqa: S310 - own server
        client.start()
        yield read
        process.terminate()
        client.join()


def run_once(parameters: Sequence[str], folder: Path, *, viewed: bool) -> tuple[float, float, int]:
    """Run an episode: simulated seconds per second, processor time of the program, bytes that the client read."""
    if not viewed:
        figures, _ = measure("none", parameters, folder)
        return figures["real_time_factor"], figures["processor_s"], 0
    with reading_viewer() as read:
        figures, _ = measure("none", parameters, folder)
        until_s = time.monotonic() + _PATIENCE_S
        while sum(read) < _BEGIN_BYTES and time.monotonic() < until_s:
            time.sleep(0.1)
    return figures["real_time_factor"], figures["processor_s"], sum(read)


def main(argv: Sequence[str] | None = None) -> int:
    """Print a line for each round, and the ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9, help="rounds of both kinds")
    parser.add_argument("parameters", nargs="*", help="further parameters of cosim, such as realtime_factor:=1")
    add_json(parser)
    options = parser.parse_args(argv)
    os.environ.setdefault(DOMAIN_VARIABLE, _DOMAIN)
    walls: list[float] = []
    processors: list[float] = []
    with tempfile.TemporaryDirectory(prefix="siren_benchmark_") as scratch:
        starts = [measure("none", [*options.parameters, _SHORT], Path(scratch) / f"s{n}")[0] for n in range(2)]
        start_s = min(figures["processor_s"] for figures in starts)
        for number in range(options.rounds):
            order = (False, True) if number % 2 == 0 else (True, False)
            folders = {viewed: Path(scratch) / f"{number}{viewed}" for viewed in order}
            runs = {viewed: run_once(options.parameters, folders[viewed], viewed=viewed) for viewed in order}
            (alone, alone_s, _), (seen, seen_s, size) = runs[False], runs[True]
            walls.append(alone / seen)
            processors.append((seen_s - start_s) / (alone_s - start_s))
            print(
                f"alone: real-time factor {alone:6.2f}, processor {alone_s:6.2f} s; "
                f"with a viewer: {seen:6.2f}, {seen_s:6.2f} s; the client read {size / 1e6:.1f} MB",
                flush=True,
            )
    figures = {"wall": statistics.median(walls), "processor": statistics.median(processors)}
    print(f"with a viewer to alone: wall {figures['wall']:.3f}, processor time of the steps {figures['processor']:.3f}")
    write_json(options.json, {"live_view": figures})
    return 0


if __name__ == "__main__":
    sys.exit(main())
