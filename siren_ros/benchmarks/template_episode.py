"""One episode of a template without ROS, and its figures."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.behaviour.civilians.yield_manager import YieldState, step_yield
from siren_ros.behaviour.emv.controller import EmvState, step_emv
from siren_ros.dynamics.fleet import step_fleet
from siren_ros.dynamics.fleet_state import FleetState
from siren_ros.dynamics.parameters import load_vehicle_parameters
from siren_ros.errors import SirenError
from siren_ros.evaluation.prediction.predictors import predictors_named
from siren_ros.evaluation.prediction.scoring.score_episode import score_episode
from siren_ros.generation.behaviour_setup import behaviour_world
from siren_ros.generation.closed_loop import LoopStep, closed_loop, record_of
from siren_ros.generation.episode_setup import EpisodeSetup, plan_length, set_up_episode
from siren_ros.judging.predicates import evaluate_predicate
from siren_ros.judging.realisation import Realisation, realisation_of
from siren_ros.judging.residuals import summarise_residuals
from siren_ros.judging.verification.limits import VerifyLimits
from siren_ros.judging.verification.physics import PhysicsSummary, summarise_physics
from siren_ros.judging.verify import STATE_CHECKS
from siren_ros.numerics.units import STEP_S
from siren_ros.pictures.birdseye import save_episode_picture
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario.request import EpisodeRequest
from siren_ros.world.events import EventKind

STILL_MPS: Final = 0.1
"""Slower than this an EMV stands."""


@dataclass(frozen=True)
class EpisodeFigures:
    """What one episode brought."""

    template: str
    seed: int
    error: str = ""
    """Why the episode failed; the other figures are then void."""
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
    """Mean of the first EMV."""
    cv_ade_m: float = float("nan")
    """Mean displacement error of constant velocity, 5 s ahead (paper, table of trajectory prediction)."""
    step_ms: float = float("nan")
    """Behaviour and dynamics, median; only where it was asked for."""
    realisation: Realisation | None = None
    way_m: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """Of the first EMV, cumulative over the steps."""


@dataclass(frozen=True)
class EpisodeTask:
    """The request, and what to measure beyond the record."""

    request: EpisodeRequest
    timed: bool = False
    picture: Path | None = None


def measure_episode(task: EpisodeTask) -> EpisodeFigures:
    """Runs an episode and evaluates its record; the figures of a failed episode hold the error."""
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
    limits = VerifyLimits()
    failed = [part for part in (check(record, limits) for check in STATE_CHECKS) if not part.holds]
    emvs = [rows.select(np.flatnonzero(rows.actor_id == emv)) for emv in record.emv_ids]
    first = emvs[0]
    moved = np.hypot(np.diff(first.x_m, prepend=first.x_m[:1]), np.diff(first.y_m, prepend=first.y_m[:1]))
    scores = score_episode(request.template, record, predictors_named(["cv"]))
    ade = scores.models["cv"]["ade_m"]
    return EpisodeFigures(
        template=request.template,
        seed=request.seed,
        holds=verdict.holds,
        failing=tuple(str(part) for part in verdict.failing),
        violations=tuple(str(part) for part in failed),
        teleports=len(record.events_of(EventKind.TELEPORT)),
        physics=summarise_physics(record),
        residual_p50_m=residual.median_m,
        residual_p99_m=residual.p99_m,
        residual_max_m=residual.max_m,
        standstill_s=max(longest_standstill_s(emv.speed_mps) for emv in emvs),
        emv_speed_mps=float(first.speed_mps.mean()) if len(first.speed_mps) else 0.0,
        cv_ade_m=ade.value if ade.valid else float("nan"),
        step_ms=step_ms,
        realisation=realisation_of(record),
        way_m=np.cumsum(moved),
    )


def longest_standstill_s(speed_mps: npt.NDArray[np.float64]) -> float:
    """Longest uninterrupted time below ``STILL_MPS``; the speeds are those of consecutive steps."""
    still = np.concatenate(([False], speed_mps < STILL_MPS, [False])).astype(np.int8)
    begins, ends = np.flatnonzero(np.diff(still) == 1), np.flatnonzero(np.diff(still) == -1)
    return float((ends - begins).max(initial=0)) * STEP_S


def travel_times_s(first: EpisodeFigures, second: EpisodeFigures) -> tuple[float, float]:
    """Times of two EMVs over the distance that both cover."""
    common_m = min(first.way_m[-1], second.way_m[-1])
    times = [float(np.searchsorted(one.way_m, common_m)) * STEP_S for one in (first, second)]
    return times[0], times[1]


def median_step_ms(setup: EpisodeSetup, steps: Sequence[LoopStep]) -> float:
    """Median time of behaviour and dynamics, computed again from the recorded traffic."""
    world = behaviour_world(setup.description, setup.compiled_map.read_bytes())
    vehicles = load_vehicle_parameters(setup.description.files)
    emv, civilians, fleet = EmvState.initial(), YieldState.initial(), FleetState.empty(vehicles)
    taken = []
    for step in steps:
        begin = time.perf_counter()
        emv, emv_commands = step_emv(emv, step.traffic, world)
        civilians, yield_commands = step_yield(civilians, step.traffic, world)
        fleet, _, _ = step_fleet(fleet, step.traffic, (emv_commands, yield_commands))
        taken.append(time.perf_counter() - begin)
    return float(np.median(taken)) * 1e3
