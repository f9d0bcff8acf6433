"""Fits a preset of drivers to half of the published figures, by approximate Bayesian computation with an emulator.

A try draws values from wide priors, simulates a few episodes with them, and notes what they show for each published
figure. Few episodes tell little of one try, so that the nearest tries would be kept by chance; a Gaussian process over
all tries separates what the values do from that chance (Wilkinson, "Accelerating ABC methods using Gaussian processes",
AISTATS 2014). Figures for which it predicts left-out tries no better than their mean would be met by chance alone, and
do not count. Values drawn by their likelihood become the draws of a preset, so that its episodes differ by as much as
the figures leave open. The other half of the figures is not looked at: it says what the fit is worth.
"""

import logging
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from scipy.special import ndtri
from scipy.stats import t as student_t

from siren_ros.base.numerics.arrays import Floats, chances, random_stream
from siren_ros.base.params.parameters import FILES_ON_DISK
from siren_ros.base.processes.process_pool import ProcessPool, side_by_side
from siren_ros.errors import InputError, SirenError
from siren_ros.running.generation.closed_loop import simulated
from siren_ros.scoring.evaluation.realism.ledger import SHARE, LedgerLine, shown_value
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
FREEDOM: Final = 4.0
"""Degrees of freedom of Student's distribution of published values about predicted ones: single figures that no drivers
meet do not decide alone (Lange, Little and Taylor, J. Am. Stat. Assoc. 84 (1989) 881)."""
CANDIDATES: Final = 2**15
"""Number of values from the priors that are weighed."""
LEAST_TRIES: Final = 20
"""With fewer tries that show it, a line does not count."""
_FOLDS: Final = 10
"""Parts of the tries that are left out in turn."""
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
        content["fitted_to"] = [*dict.fromkeys((*content.get("fitted_to", ()), *fitted_to))]
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


def values_of(place: Floats) -> dict[str, float]:
    """The values at a place of the unit cube, whose sides are the priors."""
    return {name: low + (high - low) * float(at) for (name, (low, high)), at in zip(PRIORS.items(), place, strict=True)}


def fit_to_ledger(
    lines: Sequence[LedgerLine], simulate: Simulate, tries: int, draws: int, seed: int
) -> tuple[list[dict[str, float]], float]:
    """Fit the priors' values to the lines.

    Args:
        lines: The lines that count.
        simulate: Simulates a try.
        tries: Number of tries.
        draws: Number of values to return.
        seed: Of all random numbers.

    Returns:
        Values, each as often as it is likely; and the effective number of weighed candidates that they stand for.

    Raises:
        InputError: scikit-learn is missing.
    """
    _emulator()  # refuses before the tries, which take long
    stream = random_stream(seed, "fit/tries")
    places, shown = np.empty((tries, len(PRIORS))), np.empty((tries, len(lines)))
    for place, values in zip(places, shown, strict=True):
        place[:] = stream.random(len(PRIORS))
        episodes = simulate(values_of(place), int(stream.integers(MOST_SEEDS)))
        values[:] = [shown_value(line, episodes) for line in lines]
    candidates = stream.random((CANDIDATES, len(PRIORS)))
    weights = likelihoods(lines, places, shown, candidates)
    kept = np.searchsorted(chances(weights), (np.arange(draws) + 0.5) / draws)
    return [values_of(candidates[row]) for row in kept], float(weights.sum() ** 2 / (weights**2).sum())


def likelihoods(lines: Sequence[LedgerLine], places: Floats, shown: Floats, candidates: Floats) -> Floats:
    """How likely the published values are with each candidate, up to a factor.

    Args:
        lines: The lines that count.
        places: (tries, priors): places of the tries in the unit cube.
        shown: (tries, lines): what each try shows; NaN where it shows nothing.
        candidates: (candidates, priors): places that are weighed.

    Returns:
        (candidates,): 1 at the most likely one.

    Raises:
        InputError: scikit-learn is missing.
    """
    emulator = _emulator()
    from sklearn.exceptions import ConvergenceWarning  # noqa: PLC0415 - an extra
    from sklearn.model_selection import KFold, cross_val_predict  # noqa: PLC0415 - an extra

    folds = KFold(_FOLDS, shuffle=True, random_state=0)
    total = np.zeros(len(candidates))
    for line, values in zip(lines, shown.T, strict=True):
        known = np.isfinite(values)
        spread = float(np.std(values[known])) if known.any() else 0.0
        if known.sum() < LEAST_TRIES or not spread:
            _LOG.warning("%s: %d tries show it, so that it does not count", line.line_id, known.sum())
            continue
        middle = float(np.mean(values[known]))
        standard = (values[known] - middle) / spread
        with warnings.catch_warnings():
            # a bound of the kernel says that a prior does not matter to this line, or that chance does not
            warnings.simplefilter("ignore", ConvergenceWarning)
            left_out = cross_val_predict(emulator, places[known], standard, cv=folds)
            if np.mean((left_out - standard) ** 2) >= 1.0:
                _LOG.warning("%s: the values do not tell what tries show, so that it does not count", line.line_id)
                continue
            emulator.fit(places[known], standard)
        mean, deviation = emulator.predict(candidates, return_std=True)
        # the deviation of a new try holds its chance, which that of the mean does not
        of_mean = np.maximum(deviation**2 - emulator.kernel_.k2.noise_level, 0.0)
        published = (line.high - line.low) / (2.0 * ndtri(0.975))
        scale = np.sqrt(published**2 + spread**2 * of_mean)
        total += student_t.logpdf(line.value, FREEDOM, middle + spread * mean, scale)
    return np.exp(total - total.max())


def _emulator() -> Any:
    """A Gaussian process over the unit cube, with a length for each prior and with chance.

    Raises:
        InputError: scikit-learn is missing.
    """
    try:
        from sklearn.gaussian_process import GaussianProcessRegressor  # noqa: PLC0415 - an extra
        from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        raise InputError("package", "scikit-learn", "./env --with realism siren fit-drivers …") from error
    kernel = ConstantKernel() * RBF(np.ones(len(PRIORS)), (0.1, 100.0)) + WhiteKernel()
    return GaussianProcessRegressor(kernel, random_state=0)
