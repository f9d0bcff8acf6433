"""Reads predictions from a Parquet file with our schema, or with that of Argoverse 2's challenge."""

import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.params import plain_json
from siren_ros.data.interfaces.topics import ACTORS
from siren_ros.data.record.tracks import LOG_PERIOD_STEPS
from siren_ros.data.recording.bag_folder import read_message_counts
from siren_ros.errors import BagError, InputError
from siren_ros.scoring.evaluation.prediction.samples import ARGOVERSE_WINDOW, WINDOWS
from siren_ros.scoring.evaluation.prediction.submission import PERIODS_S, SubmittedRows, on_grid, refuse

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
        return _rows(path, plain_json.read_table(path, rows, MOST_ROW_BYTES, sorted({*_OWN, *_ARGOVERSE})))
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
