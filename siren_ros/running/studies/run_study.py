"""Runs a study: verifies finished episodes, makes the others, writes the table."""

import time
from collections import Counter
from contextlib import closing
from dataclasses import dataclass, fields
from typing import Any, Final

from tqdm import tqdm

from siren_ros.base.tables.brief import Brief, data_frame
from siren_ros.errors import InputError
from siren_ros.running.studies.episode_row import EpisodeRow, Status, path_of
from siren_ros.running.studies.matrix import PlannedEpisode, Study, plan_study
from siren_ros.running.studies.study_folder import StudyFolder, is_finished, read_table, write_study, write_table
from siren_ros.running.studies.workers import WorkerOptions, Workers

TABLE_EVERY_S: Final = 60.0
"""Wall time between writes of the table; the row next to each bag is written at once."""


@dataclass(frozen=True)
class StudyResult(Brief):
    """Result of a study."""

    rows: tuple[EpisodeRow, ...]
    """Rows of this study's episodes, in their order."""
    kept: int
    """Number of episodes that were finished before."""

    def facts(self) -> dict[str, object]:
        """Number of episodes by their result."""
        ends = Counter(row.status.value for row in self.rows)
        return {"episodes": len(self.rows), "kept": self.kept, **ends}

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame`` with a row for each episode and the columns of ``manifest.parquet``.

        Raises:
            InputError: pandas is not installed.
        """
        names = [column.name for column in fields(EpisodeRow)]
        return data_frame({name: [getattr(row, name) for row in self.rows] for name in names})


class StudyObserver:
    """Observes the progress of a study; commands show it as a bar."""

    def plan(self, episodes: int) -> None:
        """Called first, with the number of episodes."""

    def keep(self, row: EpisodeRow) -> None:
        """Called for an episode that was finished before."""

    def make(self, row: EpisodeRow) -> None:
        """Called for an episode with a new result."""


class StudyBar(StudyObserver):
    """A progress bar with rate and remaining time."""

    def __init__(self, bar: "tqdm[Any]") -> None:
        self._bar = bar
        self._counts: Counter[str] = Counter()
        self._simulated_s = 0.0

    def plan(self, episodes: int) -> None:
        """Implements ``StudyObserver.plan``."""
        self._bar.reset(episodes)

    def keep(self, row: EpisodeRow) -> None:  # noqa: ARG002 - the interface
        """Implements ``StudyObserver.keep``."""
        if not self._bar.disable:
            self._bar.initial += 1  # it took no time, so it must not count for the rate
            self._bar.update(1)

    def make(self, row: EpisodeRow) -> None:
        """Implements ``StudyObserver.make``."""
        if self._bar.disable:
            return
        self._counts["retried"] += row.attempts - 1
        self._counts[row.status.value] += 1
        self._simulated_s += row.simulated_s
        counts = {name: count for name, count in self._counts.items() if count and name != Status.COMPLETE.value}
        factor = self._simulated_s / max(self._bar.format_dict["elapsed"], 1e-3)
        self._bar.set_postfix({"simulated": f"{factor:.1f}x", **counts}, refresh=False)
        self._bar.update(1)


def run_study(
    study: Study,
    folder: StudyFolder,
    workers: Workers,
    options: WorkerOptions | None = None,
    observer: StudyObserver | None = None,
) -> StudyResult:
    """Make all unfinished episodes of a study. Episodes of earlier studies in the folder stay.

    Raises:
        InputError: The study cannot be used, the folder cannot be written, or it holds an episode of the same name
            that was made from something else.
    """
    observer = observer or StudyObserver()
    planned = plan_study(study)
    observer.plan(len(planned))
    known = {row.episode: row for row in read_table(folder)}
    rows: dict[str, EpisodeRow] = {}
    for episode in planned:
        row = finished_row(episode, folder, known.get(episode.name))
        if row is not None:
            rows[episode.name] = row
            observer.keep(row)
    write_study(folder, study.to_json())  # only now, because a study that is refused must not be stored
    folder.clear_scratch()
    kept, next_table_s = len(rows), time.monotonic() + TABLE_EVERY_S
    todo = [episode for episode in planned if episode.name not in rows]
    try:
        with closing(workers.rows(todo, folder, options or WorkerOptions())) as new_rows:
            for row in new_rows:
                rows[row.episode] = row
                observer.make(row)
                if (began_s := time.monotonic()) >= next_table_s:
                    _write_rows(folder, rows)
                    # Writing a table of a million rows takes seconds; the interval keeps it a small part of the time.
                    next_table_s = time.monotonic() + max(TABLE_EVERY_S, 20.0 * (time.monotonic() - began_s))
    finally:
        _write_rows(folder, rows)
        folder.clear_scratch()
    return StudyResult(tuple(rows[episode.name] for episode in planned), kept)


def _write_rows(folder: StudyFolder, rows: dict[str, EpisodeRow]) -> None:
    """Write the table with these rows; rows that another run has written meanwhile stay."""
    write_table(folder, ({row.episode: row for row in read_table(folder)} | rows).values())


def finished_row(episode: PlannedEpisode, folder: StudyFolder, known: EpisodeRow | None) -> EpisodeRow | None:
    """Row of a finished episode; None if the episode must be made.

    The bag's bytes are hashed and compared with the row.

    Raises:
        InputError: The folder has an episode of this name that was made from something else.
    """
    row = known if known is not None and is_finished(folder, known) else None
    if row is None:  # a killed coordinator wrote no table, or an old one
        row = folder.row_of(path_of(episode.group, episode.name))
        if row is None or not is_finished(folder, row):
            return None
    if row.inputs_sha256 != episode.inputs_sha256:
        allowed = f"a new folder; this one has {row.episode} made from other inputs, files or versions"
        raise InputError("out", folder.place, allowed)
    return row
