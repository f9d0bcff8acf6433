"""How well the templates work over seeds, printed as one row per template.

``python -m siren_ros.benchmarks.templates --templates S1 S3 --seeds 0:20`` runs the episodes without ROS and
prints in how many the template's predicate holds, what failed in the others, contacts, teleports, violated checks,
the greatest impact speed and overlap, the lateral acceleration of everybody (99.9th percentile) and the longitudinal
one of the EMV (1st and 99th), the residual, the EMV's longest standstill and mean speed, the error of
constant-velocity prediction, and the time of behaviour and dynamics per step. ``--compare L1 L3`` compares the EMV's
travel time at two levels over the same seeds instead. Below each row stands how the seeds differ. ``--placebo``
prints in how many seeds the predicate also holds at the levels at which its cause is absent.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from siren_ros.benchmarks.template_episode import EpisodeFigures, EpisodeTask, measure_episode, travel_times_s
from siren_ros.judging.verification.physics import PhysicsSummary
from siren_ros.scenario.levels import EmergencyLevel
from siren_ros.scenario.predicates import DECLARED_PREDICATES
from siren_ros.scenario.request import EpisodeRequest
from siren_ros.scenario.templates import available_templates, load_template

_HEAD = (
    f"{'':<4}{'holds':>7}{'failed':>7}{'hits':>6}{'telep':>6}{'checks':>7}{'impact':>7}{'overlap':>8}"
    f"{'a_lat':>6}{'EMV a':>11}  {'residual p50/p99/max m':<23}"
    f"{'still s':>8}{'EMV m/s':>8}{'CV ADE m':>9}{'ms/step':>8}"
)


def seeds_of(text: str) -> range:
    """Seeds from ``first:last`` (the last one not included) or a single number.

    Raises:
        argparse.ArgumentTypeError: neither of these.
    """
    try:
        first, colon, last = text.partition(":")
        found = range(int(first), int(last) if colon else int(first) + 1)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is neither a seed nor first:last") from error
    if not found:
        raise argparse.ArgumentTypeError(f"{text!r} holds no seed")
    return found


def measure_all(tasks: Sequence[EpisodeTask], jobs: int) -> Iterator[EpisodeFigures]:
    """The figures of all episodes in order, run in processes of their own.

    Where a process dies, its episodes run again, one process each, so that only the one that kills it is lost.
    """
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        waiting = [pool.submit(measure_episode, task) for task in tasks]
        for task, future in zip(tasks, waiting, strict=True):
            try:
                figures = future.result()
            except BrokenProcessPool:
                figures = _measure_alone(task)
            yield figures


def _measure_alone(task: EpisodeTask) -> EpisodeFigures:
    try:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            return pool.submit(measure_episode, task).result()
    except BrokenProcessPool:
        return EpisodeFigures(task.request.template, task.request.seed, error="its process died")


def row_of(name: str, episodes: Sequence[EpisodeFigures]) -> str:
    """One template's row: sums of counts, medians and maxima over the seeds."""
    ran = [episode for episode in episodes if not episode.error]
    holding = f"{sum(episode.holds for episode in ran)}/{len(episodes)}"
    if not ran:
        return f"{name:<4}{holding:>7}{len(episodes):>7}"
    residual = (
        float(np.median([episode.residual_p50_m for episode in ran])),
        max(episode.residual_p99_m for episode in ran),
        max(episode.residual_max_m for episode in ran),
    )
    physics = [episode.physics for episode in ran]
    timed = [episode.step_ms for episode in ran if not np.isnan(episode.step_ms)]
    return (
        f"{name:<4}{holding:>7}{len(episodes) - len(ran):>7}{sum(one.contacts for one in physics):>6}"
        f"{sum(one.teleports for one in ran):>6}{sum(bool(one.violations) for one in ran):>7}"
        f"{_physics_columns(physics)}"
        f"  {'/'.join(f'{value:.2f}' for value in residual):<23}"
        f"{max(one.standstill_s for one in ran):>8.1f}{np.mean([one.emv_speed_mps for one in ran]):>8.1f}"
        f"{np.nanmean([one.cv_ade_m for one in ran]):>9.2f}{max(timed, default=float('nan')):>8.2f}"
    )


def _physics_columns(physics: Sequence[PhysicsSummary]) -> str:
    """Greatest impact speed, overlap and lateral acceleration, and the EMV's hardest braking and acceleration."""
    lowest = min(one.emv_accel_low_mps2 for one in physics)
    highest = max(one.emv_accel_high_mps2 for one in physics)
    return (
        f"{max(one.impact_mps for one in physics):>7.1f}{max(one.overlap_m for one in physics):>8.2f}"
        f"{max(one.lateral_accel_mps2 for one in physics):>6.1f}{f'{lowest:.1f}/{highest:.1f}':>11}"
    )


def spread_of(episodes: Iterable[EpisodeFigures]) -> str:
    """How the seeds differ: mean and standard deviation of what makes a realisation."""
    found = [episode.realisation for episode in episodes if episode.realisation is not None]
    named = {
        "arrival s": [one.arrival_s for one in found],
        "queue": [float(one.queue) for one in found],
        "yielding": [float(one.yielding) for one in found],
        "EMV m/s": [one.emv_speed_mps for one in found],
    }
    texts = [
        f"{name} {np.nanmean(values):.1f} +- {np.nanstd(values):.1f}"
        for name, values in named.items()
        if not np.all(np.isnan(values))
    ]
    return f"     seeds differ: {', '.join(texts) or 'no episode ran'}"


def placebo_levels(name: str) -> tuple[EmergencyLevel, ...]:
    """The levels below the least one at which the cause of a template's interaction exists."""
    needed = DECLARED_PREDICATES[load_template(name).predicate.name].needs
    levels = list(EmergencyLevel)
    return tuple(levels[: levels.index(needed)])


def placebo_row(name: str, by_level: Mapping[str, Sequence[EpisodeFigures]]) -> str:
    """One template's row of ``--placebo``."""
    texts = (f"{level} {sum(one.holds for one in ran)}/{len(ran)}" for level, ran in by_level.items())
    return f"{name:<4}holds without its cause: {', '.join(texts)}"


def details_of(episodes: Iterable[EpisodeFigures]) -> Iterator[str]:
    """One line per seed that failed, with the failing part, and the violated checks with their seeds."""
    violated: Counter[str] = Counter()
    for episode in episodes:
        if episode.error:
            yield f"     seed {episode.seed}: failed, {episode.error}"
        elif not episode.holds:
            yield f"     seed {episode.seed}: {'; '.join(episode.failing)[:220]}"
        violated.update(f"{text} (seed {episode.seed})" for text in episode.violations)
    for text in violated:
        yield f"     {text}"


def comparison_of(name: str, first: Sequence[EpisodeFigures], second: Sequence[EpisodeFigures]) -> str:
    """One template's row of ``--compare``: in how many seeds the second level is faster, and by how much."""
    pairs = [(a, b) for a, b in zip(first, second, strict=True) if not a.error and not b.error]
    times = np.array([travel_times_s(a, b) for a, b in pairs]).reshape(-1, 2)
    faster = int((times[:, 1] < times[:, 0]).sum())
    change = float(np.median(1.0 - times[:, 1] / times[:, 0])) if len(times) else float("nan")
    slower = [a.seed for (a, _), (before, after) in zip(pairs, times, strict=True) if after >= before]
    return f"{name:<4}{faster:>4}/{len(first)}  median {100.0 * change:+.0f} %  not faster: {slower}"


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    options = _parser().parse_args(argv)
    for number, name in enumerate(options.templates):
        if options.compare:
            first, second = (list(measure_all(_tasks(options, name, level), options.jobs)) for level in options.compare)
            if number == 0:
                print(f"{'':<4}seeds in which the EMV is faster at {options.compare[1]} than at {options.compare[0]}")
            print(comparison_of(name, first, second), flush=True)
            continue
        if options.placebo:
            ran = {
                level.name: list(measure_all(_tasks(options, name, level.name), options.jobs))
                for level in placebo_levels(name)
            }
            print(placebo_row(name, ran), flush=True)
            continue
        if number == 0:
            print(_HEAD)
        episodes = list(measure_all(_tasks(options, name, options.level), options.jobs))
        print(row_of(name, episodes))
        print(spread_of(episodes))
        print(*details_of(episodes), sep="\n", flush=True)
    return 0


def _tasks(options: argparse.Namespace, name: str, level: str) -> list[EpisodeTask]:
    return [
        EpisodeTask(
            EpisodeRequest(name, level, seed, options.map, preset=options.preset, sensors="none"),
            timed=number == 0 and not options.compare,
            picture=options.pictures / f"{name}_{level or 'own'}_{seed}.png" if options.pictures else None,
        )
        for number, seed in enumerate(options.seeds)
    ]


def _parser() -> argparse.ArgumentParser:
    levels = [level.name for level in EmergencyLevel]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--templates", nargs="+", default=list(available_templates()), metavar="ID")
    parser.add_argument("--seeds", type=seeds_of, default=range(20), help="first:last, the last not included")
    parser.add_argument("--map", default="", help="map file; the built-in town by default")
    parser.add_argument("--level", default="", choices=["", *levels], help="the template's own by default")
    parser.add_argument("--preset", default="paper", help="how drivers respond")
    parser.add_argument("--compare", nargs=2, choices=levels, metavar="LEVEL", help="compare travel times")
    parser.add_argument("--placebo", action="store_true", help="the levels at which the predicate must not hold")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--pictures", type=Path, help="folder for a picture of each episode")
    return parser


if __name__ == "__main__":
    sys.exit(main())
