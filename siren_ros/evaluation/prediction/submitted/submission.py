"""Checked predictions of a model, sample by sample, and how they meet the samples of an episode."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.errors import InputError
from siren_ros.evaluation.prediction.protocol.hypotheses import SUM_TOLERANCE, Hypotheses
from siren_ros.evaluation.prediction.protocol.samples import SampleBatch
from siren_ros.evaluation.prediction.protocol.window import FUTURE_POINTS, HistoryWindow
from siren_ros.evaluation.prediction.submitted.columns import Integers, SubmittedRows, refuse
from siren_ros.numerics.arrays import Rows

FAR_M: Final = 100.0
"""Farther than this nobody is 0.2 s later: such positions are not in the frame ``map``."""


@dataclass(frozen=True)
class EpisodePredictions:
    """S samples of one episode with their hypotheses, sorted by step and then by actor."""

    source: str
    actor_id: Integers
    step: Integers
    hypotheses: Hypotheses

    def __len__(self) -> int:
        return len(self.step)

    def meet(self, batch: SampleBatch, allow_missing: bool, allow_unknown: bool = False) -> tuple[Rows, Hypotheses]:
        """The samples of an episode that are predicted, and their hypotheses.

        Raises:
            InputError: Predictions of samples that the episode does not have, samples without a prediction, unless
                that is allowed; positions that are not on the map.
        """
        actor = batch.actors.actor_id[batch.target].astype(np.int64)
        step = batch.step[batch.actors.frame[batch.target]].astype(np.int64)
        wanted, given = (step << 32) | actor, (self.step << 32) | self.actor_id
        if not allow_unknown:
            refuse(
                self.source,
                ~np.isin(given, wanted),
                "predicted samples are not in the population",
                lambda row: f"actor {self.actor_id[row]} at step {self.step[row]}",
                "samples of the population: (vehicle, frame) with a whole window",
            )
        missing = ~np.isin(wanted, given)
        if not allow_missing:
            refuse(
                self.source,
                missing,
                "samples have no prediction",
                lambda row: f"actor {actor[row]} at step {step[row]}",
                "a prediction for each sample, or --allow-missing",
            )
        rows = np.flatnonzero(~missing)
        order = np.searchsorted(given, wanted[rows])
        found = self.hypotheses.select(order)
        away = np.hypot(*(found.xy_m[:, 0, 0] - batch.xy_m[rows]).T)
        if len(away) and np.median(away) > FAR_M:
            where = f"{self.source}: half of the paths begin farther than {np.median(away):.0f} m from their vehicle"
            raise InputError("predictions", where, "positions in metres in the frame map")
        return rows, found


@dataclass(frozen=True)
class SubmittedPart:
    """What a submission says of one episode, and how it is to be scored."""

    predictions: EpisodePredictions
    window: HistoryWindow
    allow_missing: bool
    allow_unknown: bool

    def meet(self, batch: SampleBatch) -> tuple[Rows, Hypotheses]:
        """As ``EpisodePredictions.meet``."""
        return self.predictions.meet(batch, self.allow_missing, self.allow_unknown)


@dataclass(frozen=True)
class Submission:
    """Everything that one model predicted, by the name of the episode."""

    source: str
    window: HistoryWindow
    episodes: dict[str, EpisodePredictions]
    allow_missing: bool = False
    allow_unknown: bool = False
    """Whether predictions of vehicles outside the population are left out, instead of refused."""

    def of_episode(self, names: Iterable[str]) -> SubmittedPart:
        """The part of an episode that has several names; empty where there are no predictions."""
        nothing = np.zeros(0, dtype=np.int64)
        none = Hypotheses(np.zeros((0, 1, FUTURE_POINTS, 2)), np.zeros((0, 1)))
        found = next((self.episodes[name] for name in names if name in self.episodes), None)
        return SubmittedPart(
            found or EpisodePredictions(self.source, nothing, nothing, none),
            self.window,
            self.allow_missing,
            self.allow_unknown,
        )

    def check_episodes(self, known: Sequence[Iterable[str]]) -> None:
        """Refuses predictions of episodes that are not scored, unless missing ones are allowed, too.

        Args:
            known: The names of each scored episode.

        Raises:
            InputError: There are such, or two scored episodes have the same name in the file.
        """
        every = [name for names in known for name in set(names)]
        for name in self.episodes:
            if every.count(name) > 1:
                raise InputError("predictions", f"{self.source}: episode {name}", "a name that one bag alone has")
        foreign = np.array([name not in every for name in self.episodes], dtype=np.bool_)
        if not self.allow_missing:
            refuse(
                self.source,
                foreign,
                "episodes are not among the bags",
                lambda row: list(self.episodes)[row],
                "names of the given bags, or --allow-missing",
            )


def submission(rows: SubmittedRows, allow_missing: bool = False, allow_unknown: bool = False) -> Submission:
    """Checks submitted hypotheses, and puts those of each sample together.

    Samples may have different numbers of hypotheses; the lacking ones get the probability 0.

    Raises:
        InputError: Values that are not finite, negative probabilities, sums that are not 1, hypotheses given twice;
            with their number and the first.
    """
    _check_values(rows)
    _, code = np.unique(rows.episode.astype(str), return_inverse=True)
    order = np.lexsort((rows.mode, rows.actor_id, rows.step, code))
    rows, code = rows.select(order), code[order]
    key = np.stack((code, rows.step, rows.actor_id))
    new = np.concatenate(([True], (np.diff(key, axis=1) != 0).any(axis=0))) if len(rows) else np.zeros(0, dtype=bool)
    sample = np.cumsum(new) - 1
    twice = np.concatenate(([False], (np.diff(rows.mode) == 0) & ~new[1:])) if len(rows) else new
    refuse(rows.source, twice, "hypotheses are given twice", rows.named, "each mode of a sample once")
    first = np.flatnonzero(new)
    place = np.arange(len(rows)) - first[sample]
    modes = int(place.max()) + 1 if len(rows) else 1
    probability = np.zeros((len(first), modes))
    probability[sample, place] = rows.probability
    total = probability.sum(axis=1)
    wrong = np.abs(total - 1.0) > SUM_TOLERANCE
    refuse(
        rows.source,
        wrong,
        "samples have probabilities of another sum",
        lambda row: f"{rows.named(first[row])} with {total[row]:.4g}",
        "probabilities of the sum 1",
    )
    xy_m = np.repeat(rows.xy_m[first][:, None], modes, axis=1)
    xy_m[sample, place] = rows.xy_m
    return Submission(
        rows.source,
        rows.window,
        _by_episode(rows.select(first), code[first], Hypotheses.ranked(xy_m, probability)),
        allow_missing,
        allow_unknown,
    )


def _check_values(rows: SubmittedRows) -> None:
    for wrong, what, allowed in (
        (~np.isfinite(rows.xy_m).all(axis=(1, 2)), "paths are not finite", "finite values"),
        (~np.isfinite(rows.probability), "probabilities are not finite", "finite values"),
        (rows.probability < 0.0, "probabilities are negative", "0 or more"),
        ((rows.actor_id < 0) | (rows.step < 0), "actors or steps are negative", "0 or more"),
    ):
        refuse(rows.source, wrong, what, rows.named, allowed)


def _by_episode(
    samples: SubmittedRows, code: npt.NDArray[np.intp], hypotheses: Hypotheses
) -> dict[str, EpisodePredictions]:
    found = {}
    for one in np.unique(code).tolist():
        here = np.flatnonzero(code == one)
        found[str(samples.episode[here[0]])] = EpisodePredictions(
            samples.source, samples.actor_id[here], samples.step[here], hypotheses.select(here)
        )
    return found
