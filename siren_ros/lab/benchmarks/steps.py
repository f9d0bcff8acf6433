"""Compares the processor time of a step with SUMO's own part: ``python -m siren_ros.benchmarks.steps``.

It runs episodes without ROS and sensors, then makes libsumo's calls of each episode again alone. What is left is the
project's own work: behaviour, conflicts, dynamics, and everything around libsumo. Both take turns in one process, so
that the ratio holds on any machine. The last rows have more and more vehicles on grids of streets of their size,
which SUMO's ``netgenerate`` makes.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import yaml

from siren_ros.base.params.folders import named_params_file
from siren_ros.lab.reproduction.results import add_json, write_json
from siren_ros.running.generation.closed_loop import closed_loop
from siren_ros.running.generation.episode_setup import EpisodeSetup, set_up_episode
from siren_ros.simulation.roads.maps.netconvert import sumo_home
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.traffic.sumo.call_log import CallLog

GRIDS: Final = {20: 3, 100: 6, 400: 12}
"""Number of vehicles, and streets per direction of a grid on which their density is about equal."""
_BLOCK_M: Final = 150
_ROUNDS: Final = 3
_STEPS: Final = 600


def with_vehicles(template: str, vehicles: int, folder: Path) -> str:
    """File of a template with this number of background vehicles, beyond the shipped range.

    For 0 the template itself.
    """
    if not vehicles:
        return template
    content = yaml.safe_load(named_params_file("templates", "templates", template).read_text(encoding="utf-8"))
    demand = content["demand"]["background_vehicles"]
    demand |= {"default": vehicles, "range": [min(vehicles, demand["range"][0]), max(vehicles, demand["range"][1])]}
    file = folder / f"{template}_{vehicles}.yaml"
    file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return str(file)


def street_grid(streets: int, folder: Path) -> Path:
    """Net of streets with two lanes per direction, and signals at crossings."""
    net = folder / f"grid{streets}.net.xml"
    options = {
        "--grid.number": streets,
        "--grid.length": _BLOCK_M,
        "--default.lanenumber": 2,
        "--default-junction-type": "traffic_light",
        "--no-turnarounds": "true",
        "--seed": 0,
        "--output-file": net,
    }
    program = [str(sumo_home() / "bin" / "netgenerate"), "--grid"]
    words = [str(word) for pair in options.items() for word in pair]
    subprocess.run([*program, *words], check=True, capture_output=True)  # noqa: S603 - SUMO's own program, fixed options
    return net


def step_times_ms(setup: EpisodeSetup, steps: int) -> list[float]:
    """Processor time of each step, except the first, which includes the warm-up."""
    loop = closed_loop(setup, steps)
    marks_s = [time.process_time() for _ in loop]
    return [1e3 * taken for taken in np.diff(marks_s).tolist()]


def measure(setup: EpisodeSetup, steps: int, rounds: int) -> dict[str, float]:
    """Mean processor time of a step and of libsumo's calls in it, as medians over the rounds, and derived figures."""
    with tempfile.TemporaryDirectory(prefix="siren_benchmark_") as folder:
        with CallLog(Path(folder)) as log:
            actors = [len(step.states) for step in closed_loop(setup, steps)]
        whole_ms, sumo_ms = [], []
        for _ in range(rounds):
            whole_ms.append(np.mean(step_times_ms(setup, steps)))
            sumo_ms.append(1e3 * np.mean(np.diff(log.replay())[-steps + 1 :]))
    step_ms, own_ms = float(np.median(whole_ms)), float(np.median(sumo_ms))
    return {
        "vehicles": float(np.mean(actors)),
        "step_ms": step_ms,
        "sumo_ms": own_ms,
        "beyond_sumo_ms": step_ms - own_ms,
        "to_sumo": step_ms / own_ms,
        "beyond_us_per_vehicle": 1e3 * (step_ms - own_ms) / float(np.mean(actors)),
    }


def _cases(options: argparse.Namespace, folder: Path) -> Iterator[tuple[str, EpisodeRequest]]:
    """Names and requests of the measured episodes."""
    for vehicles in options.background:
        for template in options.templates:
            request = EpisodeRequest(with_vehicles(template, vehicles, folder), seed=0, sensors="none")
            yield f"{template}.{vehicles or 'own'}", request
    for vehicles in options.grids:
        template, net = with_vehicles("S2", vehicles, folder), street_grid(GRIDS[vehicles], folder)
        yield f"grid.{vehicles}", EpisodeRequest(template, seed=0, map=str(net), sensors="none")


def main(argv: Sequence[str] | None = None) -> int:
    """Print a row for each episode."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--templates", nargs="+", default=["S2", "S4"], metavar="ID")
    parser.add_argument("--background", nargs="*", type=int, default=[0, 200], help="vehicles; 0: the template's own")
    parser.add_argument("--grids", nargs="*", type=int, default=list(GRIDS), choices=GRIDS, help="vehicles on grids")
    parser.add_argument("--steps", type=int, default=_STEPS, help="steps of an episode")
    parser.add_argument("--rounds", type=int, default=_ROUNDS, help="runs of each, in turns")
    add_json(parser)
    options = parser.parse_args(argv)
    print("episode      vehicles  step ms  SUMO ms  beyond SUMO ms  step to SUMO  beyond, us a vehicle")
    figures: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory(prefix="siren_benchmark_") as scratch:
        for name, request in _cases(options, Path(scratch)):
            row = figures[name] = measure(set_up_episode(request), options.steps, options.rounds)
            columns = (
                ("vehicles", 9, 0),
                ("step_ms", 9, 2),
                ("sumo_ms", 9, 2),
                ("beyond_sumo_ms", 16, 2),
                ("to_sumo", 14, 2),
            )
            text = "".join(f"{row[key]:{width}.{digits}f}" for key, width, digits in columns)
            print(f"{name:<12}{text}{row['beyond_us_per_vehicle']:22.1f}", flush=True)
    write_json(options.json, figures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
