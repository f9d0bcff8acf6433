"""Predictions that a user submits, from a file or from a topic of a bag: they are read, checked and sorted by sample.

A file is Parquet with our schema, or with that of Argoverse 2's challenge.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from siren_ros.base.numerics.arrays import Flags, Floats, Rows
from siren_ros.base.params import plain_files
from siren_ros.data.episode_source import EpisodeSource
from siren_ros.data.interfaces.conversions import from_predicted_paths
from siren_ros.data.interfaces.topics import ACTORS, PREDICTIONS
from siren_ros.data.recording.bag_folder import read_message_counts
from siren_ros.data.tracks import LOG_PERIOD_STEPS
from siren_ros.errors import BagError, InputError
from siren_ros.scoring.evaluation.prediction.predictors import SUM_TOLERANCE, Hypotheses
from siren_ros.scoring.evaluation.prediction.samples import (
    ARGOVERSE_WINDOW,
    FUTURE_POINTS,
    WINDOWS,
    HistoryWindow,
    SampleBatch,
    future_times_s,
)

Integers = npt.NDArray[np.int64]

PERIODS_S: Final = {25: 0.2, 30: 0.2, 50: 0.1, 60: 0.1, 80: 0.1}
"""Time between the points of a path, by the number of points: 5 or 6 s at 0.2 s, 5, 6 or 8 s at 0.1 s."""


@dataclass(frozen=True)
class SubmittedRows:
    """R hypotheses, one row each."""

    source: str
    """File or topic, for error messages."""
    episode: npt.NDArray[np.object_]
    """Name of the episode, shape ``(R,)``."""
    actor_id: Integers
    step: Integers
    """Step of the present, shape ``(R,)``."""
    mode: Integers
    """Number of the hypothesis within its sample."""
    probability: Floats
    xy_m: Floats
    """Positions on the common grid, frame ``map``, shape ``(R, FUTURE_POINTS, 2)``."""
    window: HistoryWindow
    """Window that decides which samples the model predicts."""

    def __len__(self) -> int:
        return len(self.episode)

    def named(self, row: int) -> str:
        """Description of a row for error messages."""
        return f"episode {self.episode[row]}, actor {self.actor_id[row]}, step {self.step[row]}, mode {self.mode[row]}"

    def select(self, rows: Rows | Flags) -> "SubmittedRows":
        """Select some of the rows."""
        arrays: dict[str, Any] = {name: values for name, values in vars(self).items() if isinstance(values, np.ndarray)}
        return replace(self, **{name: values[rows] for name, values in arrays.items()})


def refuse(source: str, wrong: Flags, what: str, named: Callable[[int], str], allowed: str) -> None:
    """Refuse a source if some rows, shape ``(R,)``, are wrong; the other arguments give the error's text.

    Raises:
        InputError: With their number and the first, where one is wrong.
    """
    if wrong.any():
        where = f"{source}: {wrong.sum()} of {len(wrong)} {what}; the first is {named(int(np.argmax(wrong)))}"
        raise InputError("predictions", where, allowed)


def on_grid(xy_m: Floats) -> Floats:
    """Convert paths of a length in ``PERIODS_S`` to the common grid.

    Every time of the grid is a time of these paths, so nothing is interpolated: of 60 points at 0.1 s, every second
    up to 5 s.

    Args:
        xy_m: Shape ``(R, L, 2)``; the first point lies one period after the present.

    Returns:
        Shape ``(R, FUTURE_POINTS, 2)``.
    """
    points = np.round(future_times_s() / PERIODS_S[xy_m.shape[1]]).astype(np.intp) - 1
    return np.ascontiguousarray(xy_m[:, points])


FAR_M: Final = 100.0
"""A position farther away than this after 0.2 s is impossible, so it is not in the frame ``map``."""


@dataclass(frozen=True)
class EpisodePredictions:
    """Predictions of one model in one episode: S samples with hypotheses, sorted by step and then by actor."""

    source: str
    """File or topic, for error messages."""
    window: HistoryWindow
    """Window that decides which samples the model predicts."""
    actor_id: Integers
    step: Integers
    hypotheses: Hypotheses
    allow_missing: bool = False
    """Whether samples without a prediction are left out instead of causing an error."""
    allow_unknown: bool = False
    """Whether predictions of vehicles outside the population are left out instead of causing an error."""

    def __len__(self) -> int:
        return len(self.step)

    def select(self, samples: Rows) -> "EpisodePredictions":
        """Select some of the samples by increasing indices."""
        chosen = self.actor_id[samples], self.step[samples], self.hypotheses.select(samples)
        return EpisodePredictions(self.source, self.window, *chosen, self.allow_missing, self.allow_unknown)

    def meet(self, batch: SampleBatch) -> tuple[Rows, Hypotheses]:
        """Match the predictions with an episode's samples; returns the predicted samples and their hypotheses.

        Raises:
            InputError: Predictions of samples that the episode does not have, samples without a prediction, unless
                that is allowed; positions that are not on the map.
        """
        actor, step = batch.actor_id, batch.sample_step
        asked, given = (step << 32) | actor, (self.step << 32) | self.actor_id
        unknown, missing = ~np.isin(given, asked), ~np.isin(asked, given)
        if not self.allow_unknown:
            what = "predicted samples are not in the population"
            allowed = "samples of the population: (vehicle, frame) with a whole window"
            refuse(
                self.source, unknown, what, lambda row: f"actor {self.actor_id[row]} at step {self.step[row]}", allowed
            )
        if not self.allow_missing:
            what, allowed = "samples have no prediction", "a prediction for each sample, or --allow-missing"
            refuse(self.source, missing, what, lambda row: f"actor {actor[row]} at step {step[row]}", allowed)
        rows = np.flatnonzero(~missing)
        hypotheses = self.hypotheses.select(np.searchsorted(given, asked[rows]))
        away = np.hypot(*(hypotheses.xy_m[:, 0, 0] - batch.xy_m[rows]).T)
        if len(away) and np.median(away) > FAR_M:
            where = f"{self.source}: half of the paths begin farther than {np.median(away):.0f} m from their vehicle"
            raise InputError("predictions", where, "positions in metres in the frame map")
        return rows, hypotheses


@dataclass(frozen=True)
class Submission:
    """All predictions of one model."""

    episodes: Mapping[str, EpisodePredictions]
    """Predictions by the name of the episode."""
    elsewhere: EpisodePredictions
    """Empty predictions, for every other episode."""

    def of_episode(self, names: Iterable[str]) -> EpisodePredictions:
        """Predictions of an episode that has several names; empty if there are none."""
        return next((self.episodes[name] for name in names if name in self.episodes), self.elsewhere)

    def check_episodes(self, known: Sequence[Iterable[str]]) -> None:
        """Check that predictions belong to scored episodes, unless missing ones are allowed.

        Args:
            known: The names of each scored episode.

        Raises:
            InputError: There are such, or two scored episodes have the same name in the file.
        """
        source, names = self.elsewhere.source, [name for of_episode in known for name in set(of_episode)]
        for name in self.episodes:
            if names.count(name) > 1:
                raise InputError("predictions", f"{source}: episode {name}", "a name that one bag alone has")
        if not self.elsewhere.allow_missing:
            refuse(
                source,
                np.array([name not in names for name in self.episodes], dtype=np.bool_),
                "episodes are not among the bags",
                lambda row: list(self.episodes)[row],
                "names of the given bags, or --allow-missing",
            )


_EARTH_M: Final = 4.01e7
"""Circumference of the Earth (WGS 84): squares of larger errors would overflow in the end."""


def submission(rows: SubmittedRows, allow_missing: bool = False, allow_unknown: bool = False) -> Submission:
    """Check submitted hypotheses and group them by sample.

    Samples may have different numbers of hypotheses; the lacking ones get the probability 0.

    Raises:
        InputError: Values that are not finite or beyond all places, negative probabilities, sums that are not 1,
            hypotheses given twice; with their number and the first.
    """
    for wrong, what, allowed in (
        (~np.isfinite(rows.xy_m).all(axis=(1, 2)), "paths are not finite", "finite values"),
        ((abs(rows.xy_m) > _EARTH_M).any(axis=(1, 2)), "paths leave the Earth", f"at most {_EARTH_M:g} m"),
        (~np.isfinite(rows.probability), "probabilities are not finite", "finite values"),
        (rows.probability < 0.0, "probabilities are negative", "0 or more"),
        ((rows.actor_id < 0) | (rows.step < 0), "actors or steps are negative", "0 or more"),
    ):
        refuse(rows.source, wrong, what, rows.named, allowed)
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

    def with_sum(row: int) -> str:
        return f"{rows.named(first[row])} with {total[row]:.4g}"

    wrong, what = np.abs(total - 1.0) > SUM_TOLERANCE, "samples have probabilities of another sum"
    refuse(rows.source, wrong, what, with_sum, "probabilities of the sum 1")
    xy_m = np.repeat(rows.xy_m[first][:, None], modes, axis=1)
    xy_m[sample, place] = rows.xy_m
    hypotheses, samples, code = Hypotheses.ranked(xy_m, probability), rows.select(first), code[first]

    def part(of: Rows) -> EpisodePredictions:
        content = samples.actor_id[of], samples.step[of], hypotheses.select(of)
        return EpisodePredictions(rows.source, rows.window, *content, allow_missing, allow_unknown)

    members = [np.flatnonzero(code == number) for number in np.unique(code).tolist()]
    episodes = {str(samples.episode[of[0]]): part(of) for of in members}
    return Submission(episodes, part(np.zeros(0, dtype=np.intp)))


_EPISODE: Final = "recorded"


def read_recorded_predictions(source: EpisodeSource, allow_missing: bool) -> EpisodePredictions:
    """Read the recorded predictions of an episode, and check them.

    A program in the loop does not know which vehicles will stay in the population: samples of others are left out.

    Raises:
        BagError: The bag has no such topic.
        InputError: Paths of another horizon, and whatever ``submission`` refuses.
    """
    if PREDICTIONS.name not in source.bag.type_names:
        raise BagError(str(source.path), f"a bag with the topic {PREDICTIONS.name}, of an episode with a predictor")
    messages = (from_predicted_paths(message.read()) for message in source.bag.messages({PREDICTIONS.name}))
    frames = [paths for paths in messages if len(paths)]
    counts = [len(paths) for paths in frames]
    step = np.repeat(np.array([paths.step for paths in frames], dtype=np.int64), counts)
    actor = np.concatenate([paths.actor_id for paths in frames]).astype(np.int64) if frames else step
    lengths = np.repeat(np.array([paths.xy_m.shape[1] for paths in frames], dtype=np.int64), counts)
    name, wrong = f"{PREDICTIONS.name} of {source.path}", ~np.isin(lengths, list(PERIODS_S))

    def with_length(row: int) -> str:
        return f"actor {actor[row]} at step {step[row]} with {lengths[row]} points"

    allowed = f"paths of {', '.join(map(str, PERIODS_S))} points"
    refuse(name, wrong, "paths of another horizon", with_length, allowed)
    rows = SubmittedRows(
        source=name,
        episode=np.full(len(step), _EPISODE, dtype=object),
        actor_id=actor,
        step=step,
        mode=np.concatenate([np.arange(count) for count in counts]) if frames else step,
        probability=np.concatenate([paths.probability for paths in frames]) if frames else np.zeros(0),
        xy_m=np.concatenate([on_grid(paths.xy_m) for paths in frames]) if frames else np.zeros((0, FUTURE_POINTS, 2)),
        window=HistoryWindow(),
    )
    return submission(rows, allow_missing, allow_unknown=True).of_episode([_EPISODE])


WINDOW_KEY: Final = b"window"
"""Key in the file's metadata: the window, a name of ``WINDOWS``, of the samples that the model predicts."""
_OWN: Final = ("episode", "actor", "step", "mode", "probability", "x", "y")
_ARGOVERSE: Final = ("scenario_id", "track_id", "probability", "predicted_trajectory_x", "predicted_trajectory_y")
_SCENARIO: Final = re.compile(r"(?P<episode>.+)-v(?P<actor>\d+)-f(?P<frame>\d+)")
"""Name of a scenario by ``siren export argoverse2``: ``S2-L2-seed0-town-v12-f000049``."""
_AV: Final = "AV"
"""Track id of the EMV with the sensors, in Argoverse 2's scenarios."""
ROWS_OF_FRAME: Final = 1_000
"""Largest number of hypotheses per frame of an episode: more than six for each of a hundred vehicles."""
MOST_ROW_BYTES: Final = 10_000
"""Largest size of a hypothesis: two lists of at most 80 numbers, and names."""


def most_rows(bags: Iterable[Path]) -> int:
    """Largest number of rows of a file of predictions for some bags, from the number of their frames.

    0 without bags.
    """
    counts = 0
    for bag in bags:
        with suppress(BagError):  # the error is reported where the bag is scored
            counts += read_message_counts(bag).get(ACTORS.name, 0)
    return ROWS_OF_FRAME * (counts // LOG_PERIOD_STEPS)


def read_prediction_file(path: Path, rows: int) -> SubmittedRows:
    """Read the hypotheses of a file on the common grid. The episodes are not checked yet.

    Args:
        path: The file.
        rows: Most rows that it may have; ``most_rows`` of the bags that are scored.

    Raises:
        InputError: The file cannot be read, lacks columns or has empty cells; paths of different or unknown lengths.
    """
    try:
        return _rows(path, plain_files.read_table(path, rows, MOST_ROW_BYTES, sorted({*_OWN, *_ARGOVERSE})))
    except (OSError, ValueError, KeyError, OverflowError, pa.ArrowException) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError("predictions", str(path), f"a Parquet file of predictions ({reason})") from error


def _rows(path: Path, table: pa.Table) -> SubmittedRows:
    for needed, read in _SCHEMAS.items():
        if set(needed) <= set(table.column_names):
            for name in needed:
                empty = pc.is_null(table[name]).to_numpy()
                refuse(str(path), empty, f"rows without {name}", lambda row: f"row {row}", "a value in each row")
            return read(str(path), table)
    allowed = " or ".join(", ".join(needed) for needed in _SCHEMAS)
    raise InputError("predictions", f"{path} with the columns {', '.join(table.column_names)}", f"columns {allowed}")


def _read_own(source: str, table: pa.Table) -> SubmittedRows:
    name = (table.schema.metadata or {}).get(WINDOW_KEY, b"ngsim").decode(errors="replace")
    if name not in WINDOWS:
        raise InputError("predictions", f"{source} with the window {name}", f"one of {', '.join(WINDOWS)}")
    integers = {key: _numbers(source, table, key, integers=True) for key in ("actor", "step", "mode")}
    episode = np.asarray(table["episode"].cast(pa.string()).to_numpy(zero_copy_only=False), dtype=object)

    def named(row: int) -> str:
        numbers = ", ".join(f"{key} {values[row]}" for key, values in integers.items())
        return f"episode {episode[row]}, {numbers}"

    return SubmittedRows(
        source=source,
        episode=episode,
        actor_id=integers["actor"],
        step=integers["step"],
        mode=integers["mode"],
        probability=_numbers(source, table, "probability"),
        xy_m=_paths(source, table, "x", "y", named),
        window=WINDOWS[name],
    )


def _read_argoverse(source: str, table: pa.Table) -> SubmittedRows:
    """Read the format of ``av2``'s ``ChallengeSubmission``; only the focal track of each scenario is read."""
    scenario = table["scenario_id"].cast(pa.string()).to_pylist()
    matches = [_SCENARIO.fullmatch(name) for name in scenario]
    foreign = np.array([match is None for match in matches], dtype=np.bool_)
    allowed = "ids of siren export argoverse2, as S2-L2-seed0-town-v12-f000049"
    refuse(source, foreign, "rows with a scenario_id of another origin", lambda row: scenario[row], allowed)
    parts = [match for match in matches if match is not None]
    track = table["track_id"].cast(pa.string()).to_pylist()
    by_id = [name == part["actor"] for name, part in zip(track, parts, strict=True)]
    with_id = {name for name, is_focal in zip(scenario, by_id, strict=True) if is_focal}
    by_av = [name == _AV and of not in with_id for of, name in zip(scenario, track, strict=True)]
    rows = SubmittedRows(
        source=source,
        episode=np.array([part["episode"] for part in parts], dtype=object),
        actor_id=np.array([int(part["actor"]) for part in parts], dtype=np.int64),
        step=np.array([int(part["frame"]) * LOG_PERIOD_STEPS for part in parts], dtype=np.int64),
        mode=np.zeros(len(parts), dtype=np.int64),
        probability=_numbers(source, table, "probability"),
        xy_m=_paths(source, table, *_ARGOVERSE[-2:], lambda row: f"scenario {scenario[row]}, track {track[row]}"),
        window=ARGOVERSE_WINDOW,
    ).select(np.array(by_id, dtype=np.bool_) | np.array(by_av, dtype=np.bool_))
    # Hypotheses of a sample are numbered in the order of the file.
    episode = np.unique(rows.episode, return_inverse=True)[1]
    sample = np.unique(np.stack((episode, rows.actor_id, rows.step)), axis=1, return_inverse=True)[1].ravel()
    order = np.argsort(sample, kind="stable")
    mode = np.empty(len(rows), dtype=np.int64)
    mode[order] = np.arange(len(order)) - np.searchsorted(sample[order], sample[order])
    return replace(rows, mode=mode)


_SCHEMAS: Final[Mapping[tuple[str, ...], Callable[[str, pa.Table], SubmittedRows]]] = {
    _OWN: _read_own,
    _ARGOVERSE: _read_argoverse,
}
"""Readers by the columns that a file must have; further columns are ignored."""


def _numbers(source: str, table: pa.Table, name: str, *, integers: bool = False) -> Any:
    kind = table[name].type
    if not pa.types.is_integer(kind) and (integers or not pa.types.is_floating(kind)):
        raise InputError("predictions", f"{source}: {name} of type {kind}", "integers" if integers else "numbers")
    return np.asarray(table[name].to_numpy(), dtype=np.int64 if integers else np.float64)


def _paths(source: str, table: pa.Table, x: str, y: str, named: Callable[[int], str]) -> Floats:
    """Paths on the common grid, shape ``(R, FUTURE_POINTS, 2)``."""
    for name in (x, y):
        kind = table[name].type
        is_list = pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)
        if not is_list or not pa.types.is_floating(kind.value_type):
            raise InputError("predictions", f"{source}: {name} of type {kind}", "lists of floating-point numbers")
    lengths = np.stack([pc.list_value_length(table[name]).to_numpy().astype(np.int64) for name in (x, y)])
    if not lengths.size:
        raise InputError("predictions", f"{source} without rows", "a row for each hypothesis")
    expected = int(np.bincount(lengths[0]).argmax())
    known = ", ".join(f"{count} points ({count * period:.0f} s at {period:g} s)" for count, period in PERIODS_S.items())
    wrong = (lengths != (expected if expected in PERIODS_S else -1)).any(axis=0)

    def with_lengths(row: int) -> str:
        return f"{named(row)} with {lengths[0, row]} values in {x} and {lengths[1, row]} in {y}"

    refuse(source, wrong, "paths of another horizon", with_lengths, f"{known}, the same for all")
    flat = (np.asarray(pc.list_flatten(table[name]).to_numpy(), dtype=np.float64) for name in (x, y))
    return on_grid(np.stack([values.reshape(-1, expected) for values in flat], axis=-1))
