"""Features of many episodes, made in processes of their own and kept, so that a second run finds them."""

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from siren_ros.errors import SirenError
from siren_ros.training.episode_features import features_path, simulate, write_features
from siren_ros.training.episode_plan import PlannedEpisode


@dataclass(frozen=True)
class MadeData:
    """What became of a plan."""

    files: tuple[tuple[PlannedEpisode, Path], ...]
    missing: tuple[tuple[PlannedEpisode, str], ...]
    """Episodes that could not be made, and why: a map without a site, a failed episode."""


def make_data(
    plan: Sequence[PlannedEpisode], folder: Path, jobs: int, told: Callable[[PlannedEpisode], None]
) -> MadeData:
    """Makes what is not there yet.

    Args:
        plan: The episodes.
        folder: Where features are kept.
        jobs: Processes at once.
        told: Called after each episode.
    """
    paths = {planned: features_path(folder, planned) for planned in plan}
    missing: dict[PlannedEpisode, str] = {}
    wanted = [planned for planned, path in paths.items() if not path.exists()]
    if wanted:
        with ProcessPoolExecutor(min(jobs, len(wanted)), mp_context=get_context("spawn")) as pool:
            running = {pool.submit(_make, planned, paths[planned]): planned for planned in wanted}
            for done in as_completed(running):
                reason = done.result()
                if reason:
                    missing[running[done]] = reason
                told(running[done])
    return MadeData(
        tuple((planned, path) for planned, path in paths.items() if planned not in missing),
        tuple((planned, missing[planned]) for planned in plan if planned in missing),
    )


def _make(planned: PlannedEpisode, path: Path) -> str:
    """Makes one file; why it cannot be made, else an empty text."""
    try:
        write_features(path, simulate(planned))
    except SirenError as error:
        return str(error)
    return ""
