"""Tests templates over many seeds, and prints one row per template.

``python -m siren_ros.benchmarks.templates --templates S1 S3 --seeds 0:20`` runs the episodes without ROS and
prints in how many the template's predicate holds, what failed in the others, contacts, teleports, violated checks,
the greatest impact speed and overlap, the lateral acceleration of everybody (99.9th percentile), the longitudinal one
of the EMV (1st and 99th) and of civilians that move (0.5th and 99.5th), the residual, the EMV's longest standstill and
mean speed, the error of constant-velocity prediction, and the time of behaviour and dynamics per step.
``--compare L1 L2 L3`` compares instead how far the EMV comes at each level and at the one before it in the same time,
seed by seed. Below each row stands how
the seeds differ. ``--placebo`` prints in how many seeds the predicate also holds at the levels at which its cause is
absent.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.processes.process_pool import CrashError, ProcessPool, side_by_side
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError, SirenError
from siren_ros.lab.reproduction.results import add_json, write_json
from siren_ros.running.generation.closed_loop import LoopStep, closed_loop, record_of
from siren_ros.running.generation.episode_setup import EpisodeSetup, behaviour_world, plan_length, set_up_episode
from siren_ros.running.studies.matrix import seeds_of
from siren_ros.scoring.evaluation.prediction.predictors import predictors_named
from siren_ros.scoring.evaluation.prediction.scoring import score_episode
from siren_ros.scoring.evaluation.statistics import BlockSums, interval_of_mean
from siren_ros.scoring.judging.outcome import (
    Realisation,
    evaluate_predicate,
    longest_standstill,
    realisation_of,
    summarise_residuals,
    under_way,
)
from siren_ros.scoring.judging.verify import PhysicsSummary, VerifyLimits, check_states, summarise_physics
from siren_ros.scoring.pictures.birdseye import save_episode_picture
from siren_ros.simulation.behaviour.civilians.yield_manager import YieldState, step_yield
from siren_ros.simulation.behaviour.emv.controller import EmvState, step_emv
from siren_ros.simulation.dynamics.fleet import FleetState, step_fleet
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import TEMPLATES, EmergencyLevel, level_name
from siren_ros.simulation.scenario.scenario import DECLARED_PREDICATES
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.world.actors import EventKind


@dataclass(frozen=True)
class EpisodeFigures:
    """Figures of one episode."""

    template: str
    seed: int
    error: str = ""
    """Reason why the episode failed; the other figures are then void."""
    holds: bool = False
    failing: tuple[str, ...] = ()
    """Parts of the predicate that do not hold."""
    violations: tuple[str, ...] = ()
    """Checks of continuity, ownership, teleports, residual and physics that do not hold."""
    teleports: int = 0
    physics: PhysicsSummary = field(default_factory=PhysicsSummary)
    residual_p50_m: float = 0.0
    residual_p99_m: float = 0.0
    residual_max_m: float = 0.0
    standstill_s: float = 0.0
    """Longest uninterrupted standstill of an EMV."""
    emv_speed_mps: float = 0.0
    """Mean speed of the first EMV."""
    cv_ade_m: float = float("nan")
    """Mean displacement error of constant velocity, 5 s ahead (paper, table of trajectory prediction)."""
    step_ms: float = float("nan")
    """Median time of behaviour and dynamics per step; NaN unless requested."""
    realisation: Realisation | None = None
    way_m: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """Distance driven by the first EMV, cumulative over the steps."""


@dataclass(frozen=True)
class EpisodeTask:
    """A request, and what to measure besides its record."""

    request: EpisodeRequest
    timed: bool = False
    picture: Path | None = None


def measure_episode(task: EpisodeTask) -> EpisodeFigures:
    """Run an episode and evaluate its record; the figures of a failed episode contain the error."""
    request = task.request
    try:
        setup = set_up_episode(request)
        steps = list(closed_loop(setup, plan_length(request)))
    except SirenError as error:
        return EpisodeFigures(request.template, request.seed, error=str(error))
    record = record_of(setup, steps)
    if task.picture is not None:
        save_episode_picture(record, task.picture)
    return figures_of(record, request, median_step_ms(setup, steps) if task.timed else float("nan"))


def figures_of(record: EpisodeRecord, request: EpisodeRequest, step_ms: float) -> EpisodeFigures:
    """The figures of a record."""
    verdict = evaluate_predicate(record)
    rows = record.rows
    residual = summarise_residuals(record)
    checks = check_states(record, VerifyLimits())
    emvs = [rows.select(np.flatnonzero(rows.actor_id == emv)) for emv in record.emv_ids]
    first = emvs[0]
    moved = np.hypot(np.diff(first.x_m, prepend=first.x_m[:1]), np.diff(first.y_m, prepend=first.y_m[:1]))
    ade = score_episode(request.template, record, predictors_named(["cv"])).models["cv"]["ade_m"]
    return EpisodeFigures(
        template=request.template,
        seed=request.seed,
        holds=verdict.holds,
        failing=tuple(str(part) for part in verdict.failing),
        violations=tuple(str(part) for part in checks if not part.holds),
        teleports=len(record.events_of(EventKind.TELEPORT)),
        physics=summarise_physics(record),
        residual_p50_m=residual.median_m,
        residual_p99_m=residual.p99_m,
        residual_max_m=residual.max_m,
        standstill_s=max(longest_standstill(under_way(record, emv_id).speed_mps)[0] for emv_id in record.emv_ids),
        emv_speed_mps=float(first.speed_mps.mean()) if len(first.speed_mps) else 0.0,
        cv_ade_m=float("nan") if ade.value is None else ade.value,
        step_ms=step_ms,
        realisation=realisation_of(record),
        way_m=np.cumsum(moved),
    )


def travel_times_s(first: EpisodeFigures, second: EpisodeFigures) -> tuple[float, float]:
    """Times of two EMVs for the distance that both drive."""
    common_m = min(first.way_m[-1], second.way_m[-1])
    first_s, second_s = (float(np.searchsorted(figures.way_m, common_m)) * STEP_S for figures in (first, second))
    return first_s, second_s


def median_step_ms(setup: EpisodeSetup, steps: Sequence[LoopStep]) -> float:
    """Median time of behaviour and dynamics, computed again from the recorded traffic."""
    world = behaviour_world(setup.description, setup.compiled_map.read_bytes())
    vehicles = load_vehicle_parameters(setup.description.files)
    emv, civilians = EmvState(), YieldState()
    fleet = FleetState.empty(vehicles, left_hand=setup.network.left_hand)
    taken = []
    for step in steps:
        begin = time.perf_counter()
        emv, emv_commands = step_emv(emv, step.traffic, world)
        civilians, yield_commands = step_yield(civilians, step.traffic, world)
        fleet, _, _ = step_fleet(fleet, step.traffic, (emv_commands, yield_commands))
        taken.append(time.perf_counter() - begin)
    return float(np.median(taken)) * 1e3


_WHO: Final = ("emv", "civilian")
_HEAD = (
    f"{'':<4}{'holds':>7}{'failed':>7}{'hits':>6}{'telep':>6}{'checks':>7}{'impact':>7}{'overlap':>8}"
    f"{'a_lat':>6}{'EMV a':>11}{'civ a':>11}  {'residual p50/p99/max m':<23}"
    f"{'still s':>8}{'EMV m/s':>8}{'CV ADE m':>9}{'ms/step':>8}"
)


def seeds_of_option(text: str) -> tuple[int, ...]:
    """Parse ``--seeds``: ``first:last`` without the last one, or a single number; argparse prints errors."""
    try:
        return seeds_of([text])
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def measure_all(tasks: Sequence[EpisodeTask], jobs: int) -> list[EpisodeFigures]:
    """Measure all episodes, in order. Each has a fresh process, so that a crash affects no other episode."""
    with ProcessPool(jobs, fresh=True, preload="siren_ros.running.studies.ready_worker") as pool:

        def measure(task: EpisodeTask) -> EpisodeFigures:
            try:
                return pool.call(measure_episode, task)
            except CrashError as error:
                return EpisodeFigures(task.request.template, task.request.seed, error=str(error))

        return [*side_by_side({task: partial(measure, task) for task in tasks}, jobs, pool.stop).values()]


def row_of(name: str, episodes: Sequence[EpisodeFigures]) -> str:
    """A template's row of the printed table: the figures of ``json_row`` and some more."""
    ran = [episode for episode in episodes if not episode.error]
    if not ran:
        return f"{name:<4}{f'0/{len(episodes)}':>7}{len(episodes):>7}"
    row = json_row(name, episodes)
    residual = "/".join(f"{row[f'residual_{part}_m']:.2f}" for part in ("p50", "p99", "max"))
    emv, civilian = (f"{row[f'{who}_accel_min_mps2']:.1f}/{row[f'{who}_accel_max_mps2']:.1f}" for who in _WHO)
    timed = [episode.step_ms for episode in ran if not np.isnan(episode.step_ms)]
    return (
        f"{name:<4}{row['holds']:>7}{row['failed']:>7}{row['contacts']:>6}{row['teleports']:>6}"
        f"{row['episodes_with_violations']:>7}{row['impact_max_mps']:>7.1f}{row['overlap_max_m']:>8.2f}"
        f"{row['lateral_accel_max_mps2']:>6.1f}{emv:>11}{civilian:>11}  {residual:<23}"
        f"{row['standstill_max_s']:>8.1f}{row['emv_speed_mps']:>8.1f}"
        f"{np.nanmean([episode.cv_ade_m for episode in ran]):>9.2f}{max(timed, default=float('nan')):>8.2f}"
    )


def spread_of(episodes: Iterable[EpisodeFigures]) -> str:
    """Text with mean and standard deviation of what differs between seeds."""
    realised = [episode.realisation for episode in episodes if episode.realisation is not None]
    named = {
        "arrival s": [realisation.arrival_s for realisation in realised],
        "queue": [float(realisation.queue) for realisation in realised],
        "yielding": [float(realisation.yielding) for realisation in realised],
        "EMV m/s": [realisation.emv_speed_mps for realisation in realised],
    }
    texts = [
        f"{name} {np.nanmean(values):.1f} +- {np.nanstd(values):.1f}"
        for name, values in named.items()
        if not np.all(np.isnan(values))
    ]
    return f"     seeds differ: {', '.join(texts) or 'no episode ran'}"


def placebo_levels(name: str) -> tuple[EmergencyLevel, ...]:
    """Levels below the lowest one at which a template's interaction has its cause."""
    needed = DECLARED_PREDICATES[load_template(name).predicate.name].needs
    levels = list(EmergencyLevel)
    return tuple(levels[: levels.index(needed)])


WITHOUT_DUTY: Final = "response.duty=0"
"""Placebo value for templates whose interaction needs more than a level: drivers open no rescue lane."""


def placebo_row(name: str, by_level: Mapping[str, Sequence[EpisodeFigures]]) -> str:
    """A template's row of ``--placebo``."""
    texts = (f"{level} {sum(episode.holds for episode in ran)}/{len(ran)}" for level, ran in by_level.items())
    return f"{name:<4}holds without its cause: {', '.join(texts)}"


def json_row(name: str, episodes: Sequence[EpisodeFigures]) -> dict[str, Any]:
    """A template's row as JSON types; ``holds`` is a dash if no episode ran, as on a map without a site."""
    ran = [episode for episode in episodes if not episode.error]
    row: dict[str, Any] = {
        "template": name,
        "holds": f"{sum(episode.holds for episode in ran)}/{len(episodes)}" if ran else "–",
        "episodes": len(episodes),
        "failed": len(episodes) - len(ran),
    }
    if not ran:
        return row
    physics = [episode.physics for episode in ran]
    arrivals_s = [episode.realisation.arrival_s for episode in ran if episode.realisation is not None]
    arrivals_s = [arrival_s for arrival_s in arrivals_s if not np.isnan(arrival_s)]
    return row | {
        "contacts": sum(summary.contacts for summary in physics),
        "teleports": sum(episode.teleports for episode in ran),
        "episodes_with_violations": sum(bool(episode.violations) for episode in ran),
        "impact_max_mps": float(max(summary.impact_mps for summary in physics)),
        "overlap_max_m": float(max(summary.overlap_m for summary in physics)),
        "lateral_accel_max_mps2": float(max(summary.lateral_accel_mps2 for summary in physics)),
        "emv_accel_min_mps2": float(min(summary.emv_accel_low_mps2 for summary in physics)),
        "emv_accel_max_mps2": float(max(summary.emv_accel_high_mps2 for summary in physics)),
        "civilian_accel_min_mps2": float(min(summary.civilian_accel_low_mps2 for summary in physics)),
        "civilian_accel_max_mps2": float(max(summary.civilian_accel_high_mps2 for summary in physics)),
        "residual_p50_m": float(np.median([episode.residual_p50_m for episode in ran])),
        "residual_p99_m": float(max(episode.residual_p99_m for episode in ran)),
        "residual_max_m": float(max(episode.residual_max_m for episode in ran)),
        "standstill_max_s": float(max(episode.standstill_s for episode in ran)),
        "emv_speed_mps": float(np.mean([episode.emv_speed_mps for episode in ran])),
        "arrival_s": float(np.mean(arrivals_s)) if arrivals_s else None,
        "arrival_sd_s": float(np.std(arrivals_s)) if arrivals_s else None,
    }


def details_of(episodes: Iterable[EpisodeFigures]) -> Iterator[str]:
    """One line per failed seed with the failing part, and violated checks with their seeds."""
    violated: Counter[str] = Counter()
    for episode in episodes:
        if episode.error:
            yield f"     seed {episode.seed}: failed, {episode.error}"
        elif not episode.holds:
            yield f"     seed {episode.seed}: {'; '.join(episode.failing)[:220]}"
        violated.update(f"{text} (seed {episode.seed})" for text in episode.violations)
    for text in violated:
        yield f"     {text}"


def compared_row(name: str, levels: tuple[str, str], runs: Sequence[Sequence[EpisodeFigures]]) -> dict[str, Any]:
    """A template's row of ``--compare``: gain of the second level over the first, seed by seed.

    ``distance`` is the gain of the EMV's way over the same time as a share, with its interval; ``time`` the share of
    its travel time over the same way that is saved.
    """
    pairs = [(a, b) for a, b in zip(*runs, strict=True) if not a.error and not b.error]
    times = np.array([travel_times_s(a, b) for a, b in pairs]).reshape(-1, 2)
    gains = np.array([distance_gain(a, b) for a, b in pairs])
    ones = np.ones(len(pairs))
    worst = int(np.argmin(gains)) if pairs else -1
    return {
        "template": name,
        "levels": [levels[1], levels[0]],
        "seeds": len(pairs),
        "failed": len(runs[0]) - len(pairs),
        "distance": asdict(interval_of_mean(BlockSums(gains, ones, np.zeros(len(pairs), np.intp)))),
        "farther": int((gains > 0.0).sum()),
        "least": float(gains[worst]) if pairs else None,
        "least_seed": pairs[worst][0].seed if pairs else None,
        "time": float(np.median(1.0 - times[:, 1] / times[:, 0])) if pairs else None,
        "not_farther": [a.seed for (a, _), gain in zip(pairs, gains, strict=True) if gain <= 0.0],
    }


def distance_gain(first: EpisodeFigures, second: EpisodeFigures) -> float:
    """Additional distance that the second EMV drives in the same time, as a share."""
    last = min(len(first.way_m), len(second.way_m)) - 1
    return float(second.way_m[last] / first.way_m[last] - 1.0)


def compared_text(row: Mapping[str, Any]) -> str:
    """A row of ``--compare`` as printed text."""
    levels, between = "against".join(f" {level} " for level in row["levels"]), row["distance"]
    if not row["seeds"]:
        return f"{row['template']:<4}{levels}no episode ran"
    return (
        f"{row['template']:<4}{levels}distance {between['value']:+.0%} (95 %: {between['low']:+.0%} to "
        f"{between['high']:+.0%}), farther in {row['farther']}/{row['seeds']}, least {row['least']:+.0%} "
        f"(seed {row['least_seed']}), median of the time {-row['time']:+.0%}; not farther: {row['not_farther']}"
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    options = _parser().parse_args(argv)
    rows: list[dict[str, Any]] = []
    for number, name in enumerate(options.templates):
        if options.compare:
            runs = [measure_all(_tasks(options, name, level), options.workers) for level in options.compare]
            for pair, both in zip(pairwise(options.compare), pairwise(runs), strict=True):
                rows.append(compared_row(name, pair, both))
                print(compared_text(rows[-1]), flush=True)
            continue
        if options.placebo:
            levels = [level.name for level in placebo_levels(name)]
            ran = {level: measure_all(_tasks(options, name, level), options.workers) for level in levels}
            if load_template(name).response.duty:
                tasks = _tasks(options, name, options.level, WITHOUT_DUTY)
                ran["without_duty"] = measure_all(tasks, options.workers)
            print(placebo_row(name, ran), flush=True)
            rows += [{**json_row(name, episodes), "level": level} for level, episodes in ran.items()]
            continue
        if number == 0:
            print(_HEAD)
        episodes = measure_all(_tasks(options, name, options.level, options.values), options.workers)
        rows.append(json_row(name, episodes))
        print(row_of(name, episodes))
        print(spread_of(episodes))
        print(*details_of(episodes), sep="\n", flush=True)
    write_json(options.json, rows)
    return 0


def _tasks(options: argparse.Namespace, name: str, level: str, values: str = "") -> list[EpisodeTask]:
    return [
        EpisodeTask(
            EpisodeRequest(
                name, level, seed, options.map, options.site, preset=options.preset, sensors="none", values=values
            ),
            timed=number == 0 and not options.compare,
            picture=options.pictures / f"{name}_{level or 'own'}_{seed}.png" if options.pictures else None,
        )
        for number, seed in enumerate(options.seeds)
    ]


def _parser() -> argparse.ArgumentParser:
    levels = [level.name for level in EmergencyLevel]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--templates", nargs="+", default=list(TEMPLATES), metavar="ID")
    parser.add_argument("--seeds", type=seeds_of_option, default=range(20), help="first:last, the last not included")
    parser.add_argument("--map", default="", help="map file; the built-in town by default")
    parser.add_argument("--site", default="", help="a name that siren sites prints; each seed draws its own by default")
    parser.add_argument("--level", type=level_name, default="", choices=["", *levels], help="default: its own")
    parser.add_argument("--preset", default="paper", help="how drivers respond")
    parser.add_argument("--values", default="", help="scenario parameters: response.duty=0")
    parser.add_argument("--compare", nargs="+", type=level_name, choices=levels, metavar="LEVEL", help="two or more")
    parser.add_argument("--placebo", action="store_true", help="the levels at which the predicate must not hold")
    parser.add_argument("--workers", "--jobs", type=int, default=2, help="processes")
    parser.add_argument("--pictures", type=Path, help="folder for a picture of each episode")
    add_json(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
