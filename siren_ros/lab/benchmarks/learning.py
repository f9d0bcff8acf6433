"""Measures the speed of the learning environments: ``python -m siren_ros.benchmarks.learning``.

It prints simulated steps of 0.05 s for each second of processor time: of SIREN's environment with an action at every
step, of SUMO's own calls in the same episodes, and of highway-env's ``highway-v0`` at 20 Hz with as many vehicles. They
take turns in one process, so that ratios hold on any machine. It prints what ``reset`` takes next to SUMO's warm-up.
With ``--processes N`` it also prints the steps of N environments in processes next to those of one, in wall time.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv

from siren_ros.base.numerics.units import STEP_S, STEPS_PER_S
from siren_ros.errors import InputError
from siren_ros.lab.benchmarks.steps import with_vehicles
from siren_ros.lab.learning.environment import YieldEnv
from siren_ros.lab.reproduction.results import add_json, write_json
from siren_ros.simulation.traffic.sumo.call_log import CallLog

_KEEP: Final = 0
"""SIREN's action "keep the lane"."""
_IDLE: Final = 1
"""highway-env's action "idle"."""


def options_for(template: str, background: int, folder: Path) -> dict[str, Any]:
    """Options of an environment whose episodes have this number of background vehicles."""
    file, values = with_vehicles(template, background, folder), f"demand.background_vehicles={background}"
    return {"template": file, "level": 2, "decision_s": STEP_S, "values": values}


def run(environment: Any, action: Any, steps: int) -> float:
    """Steps per second of processor time, over at most the given number of steps of the current episode."""
    began_s, count = time.process_time(), 0
    while count < steps:
        _, _, terminated, truncated, _ = environment.step(action)
        count += 1
        if terminated or truncated:
            break
    return count / (time.process_time() - began_s)


def highway_environment(vehicles: int) -> Any:
    """``highway-v0`` at 20 Hz with this number of vehicles, including the driven one.

    Raises:
        InputError: The extra is not installed.
    """
    try:
        import highway_env  # noqa: F401, PLC0415 - registers the environment; an extra
    except ModuleNotFoundError as error:
        runs = "the extra highway, as ./env --with highway brings it"
        raise InputError("environment", f"no {error.name}", runs) from error
    rates = {"simulation_frequency": STEPS_PER_S, "policy_frequency": STEPS_PER_S}
    return gymnasium.make("highway-v0", config={**rates, "vehicles_count": vehicles - 1, "duration": 1e6}).unwrapped


def measure(template: str, background: int, steps: int, rounds: int) -> dict[str, float]:
    """Medians over the rounds: steps per second of all three, processor time of ``reset`` and of SUMO's warm-up."""
    found = dict[str, list[float]]()

    def note(**values: float) -> None:
        for name, value in values.items():
            found.setdefault(name, []).append(value)

    with tempfile.TemporaryDirectory(prefix="siren_benchmark_") as scratch:
        siren = YieldEnv(**options_for(template, background, Path(scratch)))
        siren.reset(seed=0)  # loads all modules, so that they are not measured
        run(siren, _KEEP, 20)
        for seed in range(1, rounds + 1):
            with CallLog(Path(scratch)) as log:
                siren.reset(seed=seed)
                run(siren, _KEEP, steps)
                there = [len(step.states) for step in siren.rollout.steps]
                siren.close()
            simulated = len(there) - 1
            began_s = time.process_time()
            siren.reset(seed=seed)
            note(vehicles=float(np.mean(there)), reset_s=time.process_time() - began_s, siren=run(siren, _KEEP, steps))
            siren.close()
            began_s = time.process_time()
            marks_s = log.replay()[:-1]
            note(warm_up_s=marks_s[-1 - simulated] - began_s, sumo=simulated / (marks_s[-1] - marks_s[-1 - simulated]))
            highway = highway_environment(round(np.mean(there)))
            highway.reset(seed=seed)
            note(highway=run(highway, _IDLE, steps))
    medians = {name: float(np.median(values)) for name, values in found.items()}
    return {
        **medians,
        "to_highway": medians["siren"] / medians["highway"],
        "to_sumo": medians["siren"] / medians["sumo"],
        "reset_to_warm_up": medians["reset_s"] / medians["warm_up_s"],
    }


def steps_of_processes(options: Mapping[str, Any], count: int, decisions: int) -> float:
    """Simulated steps per second of wall time of parallel environments, one per process; resets are included."""
    made: Callable[[], Any] = partial(YieldEnv, **options)
    environments = AsyncVectorEnv([made] * count, context="forkserver")
    try:
        environments.reset(seed=1)
        actions = np.full(count, _KEEP)
        environments.step(actions)  # all modules are loaded after this
        began_s = time.perf_counter()
        for _ in range(decisions):
            environments.step(actions)
        return count * decisions * options["decision_s"] / STEP_S / (time.perf_counter() - began_s)
    finally:
        environments.close()


def main(argv: Sequence[str] | None = None) -> int:
    """Print a row for each number of background vehicles, and one for the processes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--template", default="S2", metavar="ID")
    parser.add_argument("--background", nargs="*", type=int, default=[10, 40], metavar="N", help="background vehicles")
    parser.add_argument("--steps", type=int, default=600, help="simulated steps of an episode")
    parser.add_argument("--rounds", type=int, default=5, help="episodes of each, in turns")
    parser.add_argument("--processes", type=int, default=0, metavar="N", help="also N environments in processes")
    add_json(parser)
    options = parser.parse_args(argv)
    figures: dict[str, dict[str, float]] = {}
    columns = ("siren", "sumo", "highway", "to_highway", "to_sumo", "reset_s", "warm_up_s", "reset_to_warm_up")
    print("vehicles   SIREN steps/s  SUMO steps/s  highway steps/s  to highway  to SUMO  reset s  warm-up s  ratio")
    for background in options.background:
        row = figures[str(background)] = measure(options.template, background, options.steps, options.rounds)
        widths = zip((14, 14, 17, 12, 9, 9, 11, 7), (0, 0, 0, 2, 2, 2, 2, 2), columns, strict=True)
        text = "".join(f"{row[name]:{width}.{digits}f}" for width, digits, name in widths)
        print(f"{row['vehicles']:8.1f} {text}", flush=True)
    if options.processes:
        task = {"template": options.template, "level": 2, "decision_s": 0.2}
        decisions = options.steps // 4
        counts = (1, options.processes)
        rates = np.array([[steps_of_processes(task, n, decisions) for n in counts] for _ in range(options.rounds)])
        one, several = np.median(rates, axis=0).tolist()
        ratio = float(np.median(rates[:, 1] / rates[:, 0]))
        print(f"{options.processes} processes: {several:.0f} steps/s, one: {one:.0f}, ratio {ratio:.2f} (wall time)")
        figures["processes"] = {"one": one, "all": several, "ratio": ratio}
    write_json(options.json, figures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
