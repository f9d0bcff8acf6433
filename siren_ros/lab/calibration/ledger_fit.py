"""Fits a preset of drivers to half of the published figures, by approximate Bayesian computation.

A try draws values from wide priors, simulates episodes with them, and compares what they show with the published
figures. Sequential Monte Carlo keeps the nearest tries and draws anew around them (Toni et al., J. R. Soc. Interface 6
(2009) 187), as pyABC implements it. The tries that are left become the draws of a preset, so that its episodes differ
by as much as the figures leave open. The other half of the figures is not looked at: it says what the fit is worth.
"""

import logging
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from siren_ros.base.numerics.arrays import chances, random_stream
from siren_ros.base.params.parameters import FILES_ON_DISK
from siren_ros.base.processes.process_pool import ProcessPool, side_by_side
from siren_ros.errors import InputError, SirenError
from siren_ros.running.generation.closed_loop import simulated
from siren_ros.scoring.evaluation.realism.ledger import SHARE, LedgerLine, LedgerResult, compare
from siren_ros.scoring.evaluation.realism.quantities import RealismEpisode
from siren_ros.simulation.scenario.episode import EpisodeRequest

PRIORS: Final[Mapping[str, tuple[float, float]]] = {
    "traffic.headway_factor": (0.5, 1.5),
    "traffic.gap_factor": (0.5, 1.5),
    "traffic.accel_factor": (0.5, 2.0),
    "traffic.spread_factor": (0.0, 2.0),
    # from 20 km/h, at which the EMV leaves a gap, to the 50 km/h of towns
    "emv_driver.corridor.speed_mps": (5.6, 13.9),
    # m, mean: the range at which a siren is heard in a closed car (De Lorenzo and Eilers 1991)
    "response_distance_m": (8.0, 50.0),
    # s, mean: the fastest tenth and the slowest tenth of drivers (Green 2000; AASHTO Green Book)
    "reaction_delay_s": (0.8, 2.5),
    # share of drivers who never react; 39 % of those asked did not move (Emerg Med J 20:277)
    "never": (0.0, 0.5),
}
"""Uniform priors: as wide as the literature, or as the parameter's own range up to 2."""
TEMPLATES_OF_A_TRY: Final = ("S1", "S2", "S3")
"""A queue, a lane change and a red light, each at its own level and at L0."""
SPREAD_M: Final = 10.1
"""Deviation of response distances among drivers (Cortes and Stefoni 2023)."""
LATE_SHARE: Final = 0.1
FARTHEST: Final = 5.0
"""Largest distance of a line, in half widths of both intervals; also that of a line without a prediction."""
KEPT_SHARE: Final = 0.5
"""Share of the tries of a round whose distance the next round must not exceed."""
MOST_SEEDS: Final = 1000
"""Episodes of the fit have smaller seeds, so that those from here on stay unseen."""

_LOG: Final = logging.getLogger("siren_ros")
Try = Mapping[str, float]
Simulate = Callable[[Try, int], Sequence[RealismEpisode]]
"""Simulates the episodes of a try with a seed."""


def halves(lines: Sequence[LedgerLine]) -> tuple[tuple[LedgerLine, ...], tuple[LedgerLine, ...]]:
    """The lines for the fit, and those that are held out: by turns, in the ledger's order.

    Only lines count that a study can answer. Shares of rare events are held out, since a try has a few episodes, and
    those of the rescue lane, which is on no road of a try.
    """
    answerable = [line for line in lines if not line.cannot]
    fitted = tuple(
        line for line in answerable[::2] if line.statistic != SHARE and not line.samples.startswith("rescue_lane")
    )
    return fitted, tuple(line for line in answerable if line not in fitted)


def distance(results: Sequence[LedgerResult]) -> float:
    """Mean distance of predicted values from published ones, each in half widths of both intervals together.

    Without the predicted ones, chance in events that a try's few episodes hardly show would decide which ones are kept.
    """
    apart = [_apart(one) if one.answered else FARTHEST for one in results]
    return float(np.mean(np.minimum(np.nan_to_num(apart, nan=FARTHEST), FARTHEST)))


def _apart(one: LedgerResult) -> float:
    tried = one.predicted
    return float(
        2.0 * abs(tried.value - one.line.value) / np.hypot(one.line.high - one.line.low, tried.high - tried.low)
    )


def draw_of(values: Try) -> dict[str, Any]:
    """The parts of a preset that the values of a try stand for, as its file writes them."""
    metres, seconds, never = values["response_distance_m"], values["reaction_delay_s"], round(values["never"], 4)
    late = round(LATE_SHARE * (1.0 - never), 4)
    return {
        "reaction_delay_s": _distribution(seconds, 0.4, 0.3, 2.0 * seconds),
        "response_distance_m": _distribution(metres, SPREAD_M, 4.0, metres + 3.0 * SPREAD_M),
        "compliance": {"complies": 1.0 - never - late, "late": late, "never": never},
        "drivers": {name: values[name] for name in PRIORS if "." in name},
    }


def _distribution(mean: float, std: float, low: float, high: float) -> dict[str, float]:
    return {"mean": mean, "std": std, "min": low, "max": high}


def preset_text(title: str, draws: Sequence[Mapping[str, Any]], base: str, fitted_to: Sequence[str] = ()) -> str:
    """A preset's file: a shipped preset with draws.

    Raises:
        InputError: There is no such preset.
    """
    content = yaml.safe_load(FILES_ON_DISK.read("preset", "presets", base).text)
    content |= {"title": title, "draws": [_rounded(draw) for draw in draws]}
    if fitted_to:
        content["fitted_to"] = [*fitted_to]
    return str(yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120))


def _rounded(part: Any) -> Any:
    if isinstance(part, Mapping):
        return {key: _rounded(value) for key, value in part.items()}
    return round(float(part), 4)


@contextmanager
def simulated_tries(base: str, jobs: int) -> Iterator[Simulate]:
    """Make the function that simulates a try, its episodes in so many processes; failed episodes are left out."""
    with tempfile.TemporaryDirectory() as folder, ProcessPool(jobs) as pool:
        numbers = count()

        def simulate(values: Try, seed: int) -> list[RealismEpisode]:
            file = Path(folder) / f"try{next(numbers)}.yaml"
            file.write_text(preset_text("a try", [draw_of(values)], base), encoding="utf-8")
            requests = [
                EpisodeRequest(template, level, seed, preset=str(file), sensors="none")
                for template in TEMPLATES_OF_A_TRY
                for level in ("", "L0")
            ]
            found = side_by_side({request: partial(attempt, request) for request in requests}, jobs, pool.stop)
            return [episode for episode in found.values() if episode is not None]

        def attempt(request: EpisodeRequest) -> RealismEpisode | None:
            try:
                return pool.call(measured, request)
            except SirenError as error:
                _LOG.warning("%s %s, seed %d: %s", request.template, request.level, request.seed, error)
                return None

        yield simulate


def measured(request: EpisodeRequest) -> RealismEpisode:
    """What an episode shows."""
    return RealismEpisode.of(simulated(request))


def fit_to_ledger(
    lines: Sequence[LedgerLine], simulate: Simulate, rounds: int, tries: int, seed: int, most: int, database: Path
) -> tuple[list[dict[str, float]], list[float]]:
    """Fit the priors' values to the lines.

    Args:
        lines: The lines that count.
        simulate: Simulates a try.
        rounds: Number of rounds of the sequence.
        tries: Number of tries that each round keeps.
        seed: Of all random numbers.
        most: No round begins after so many tries in all.
        database: SQLite file in which pyABC keeps all rounds.

    Returns:
        The tries that the last round keeps, as many as it has, each as often as its weight says; and the greatest
        distance of each round.

    Raises:
        InputError: pyABC is missing.
    """
    try:
        import pyabc  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        raise InputError("package", "pyabc", "./env --with realism siren fit-drivers …") from error
    seeds = random_stream(seed, "fit/seeds")

    def model(values: Try) -> dict[str, float]:
        episodes = simulate(values, int(seeds.integers(MOST_SEEDS)))
        return {"distance": distance(compare(lines, episodes)) if episodes else FARTHEST}

    np.random.seed(seed)  # noqa: NPY002 - pyABC draws from numpy's global generator
    prior = pyabc.Distribution(**{name: pyabc.RV("uniform", low, high - low) for name, (low, high) in PRIORS.items()})
    search = pyabc.ABCSMC(
        model,
        prior,
        lambda simulated, _: simulated["distance"],
        tries,
        eps=pyabc.QuantileEpsilon(initial_epsilon=FARTHEST, alpha=KEPT_SHARE),
        sampler=pyabc.sampler.SingleCoreSampler(),
    )
    search.new(f"sqlite:///{database}", {"distance": 0.0})
    history = search.run(max_nr_populations=rounds, max_total_nr_simulations=most)
    kept, weights = history.get_distribution(m=0, t=history.max_t)
    rows = np.searchsorted(chances(weights), (np.arange(len(kept)) + 0.5) / len(kept))
    limits = [float(limit) for limit in history.get_all_populations().query("t >= 0")["epsilon"]]
    return [{name: float(kept[name].iloc[row]) for name in PRIORS} for row in rows.tolist()], limits
