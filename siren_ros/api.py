"""The public functions of the library, without ROS: make, read, judge, score, grade and export episodes and studies.

``import siren_ros`` offers all of them. Everything else in the package is private: it can change in any release. All
quantities are in SI units, angles in radians, poses in the frame ``map``. Input that cannot be used raises
``InputError``, a bag that cannot be read ``BagError``, an episode that fails ``EpisodeError``; all are ``SirenError``.
Functions print nothing; those that take long move a bar of tqdm if they get one. Each function loads what it needs when
it is called, so that ``import siren_ros`` stays fast.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from tqdm import tqdm

    from siren_ros.data.datasets.export_job import ExportResult
    from siren_ros.data.episode_source import LidarFrame
    from siren_ros.data.recording.episode_record import EpisodeRecord
    from siren_ros.reports.exam.certificate import Certificate
    from siren_ros.reports.exam.grading import Sitting
    from siren_ros.running.generation.closed_loop import RecordedEpisode
    from siren_ros.running.studies.episode_row import EpisodeRow
    from siren_ros.running.studies.matrix import Study
    from siren_ros.running.studies.run_study import StudyResult
    from siren_ros.scoring.evaluation.prediction.predictors import Predictor
    from siren_ros.scoring.evaluation.prediction.reports.score_table import ScoreTable
    from siren_ros.scoring.evaluation.prediction.samples import Population, ScoredSamples
    from siren_ros.scoring.judging.verdict import Verdict
    from siren_ros.scoring.judging.verify import Verification
    from siren_ros.simulation.scenario.episode import EpisodeRequest

Folder: TypeAlias = str | PathLike[str]
"""A path, or its text."""
Folders: TypeAlias = Folder | Sequence[Folder]


def make_episode(
    request: EpisodeRequest, bag: Folder, *, overwrite: bool = False, progress: tqdm[Any] | None = None
) -> RecordedEpisode:
    """Simulate an episode and record it.

    The bag has the same bytes as that of ``ros2 run siren_ros cosim`` with the same request and package versions.

    Args:
        request: Template, level, seed, map, sensors and the other choices.
        bag: Folder of the bag; it must not exist.
        overwrite: Whether it may be there as the bag of an earlier episode, which the new one replaces when complete.
        progress: A bar to move, in steps of 0.05 s: ``tqdm()`` for a terminal, that of ``tqdm.auto`` for a notebook.

    Returns:
        How the episode ended, and what its bag holds. An episode that fails on the way leaves a partial bag.

    Raises:
        InputError: A choice cannot be used, or the bag cannot be written. An AV under test, a predictor or a detector
            take part over ROS and need ``cosim``.
        EpisodeError: The disk is full.
    """
    from siren_ros.running.generation.closed_loop import record_episode
    from siren_ros.running.generation.episode_setup import set_up_episode

    setup = set_up_episode(request)
    on_step = _moved(progress, setup.steps)
    return record_episode(setup, Path(bag), overwrite=overwrite, on_step=lambda _: on_step())


def read_record(bag: Folder) -> EpisodeRecord:
    """Read what happened in an episode: states of all actors at 20 Hz, signals, events and the map; no sensor data.

    Args:
        bag: Folder of a recorded episode.

    Raises:
        BagError: The folder holds no episode of SIREN, or the bag is damaged.
    """
    from siren_ros.data.recording.bag_reader import read_episode

    return read_episode(Path(bag))


def judge(record: EpisodeRecord) -> Verdict:
    """Decide whether the interaction of the episode's template happened, from the record alone.

    Raises:
        BagError: The record names a predicate that this version does not know.
    """
    from siren_ros.scoring.judging.outcome import evaluate_predicate

    return evaluate_predicate(record)


def verify(record: EpisodeRecord) -> Verification:
    """Judge the interaction and check that the record is sound: motion, contacts, completeness, stamps and hashes.

    Raises:
        EpisodeError: The record contradicts itself.
        BagError: The record names a predicate that this version does not know.
    """
    from siren_ros.scoring.judging.verify import verify_episode

    return verify_episode(record)


def score_predictions(
    bags: Folders,
    predictors: Mapping[str, Predictor] | Sequence[str] = ("cv",),
    population: str = "region",
    progress: tqdm[Any] | None = None,
) -> ScoreTable:
    """Score trajectory predictors on recorded episodes: 3 s of past, 5 s of future, every 0.1 s.

    Args:
        bags: Folder or folders of recorded episodes, or folders that hold such folders, as a study does.
        predictors: Predictors by name, or names of the project's own: ``cv``, ``idm``, ``siren``.
        population: ``region`` for vehicles in the interaction region around the EMV, ``all`` for every vehicle.
        progress: As in ``make_episode``, in bags.

    Returns:
        Each metric of each predictor, by template, level and category, with 95 % intervals over the episodes.

    Raises:
        InputError: A name is unknown, or a predictor's answer cannot be scored.
        BagError: A bag cannot be read.
    """
    from siren_ros.scoring.evaluation.prediction.predictors import predictors_named
    from siren_ros.scoring.evaluation.prediction.reports.score_table import score_table
    from siren_ros.scoring.evaluation.prediction.scoring import score_episode

    loaded = predictors if isinstance(predictors, Mapping) else predictors_named(list(predictors))
    chosen, found, scores = _population(population), _bags_of(bags), []
    on_bag = _moved(progress, len(found))
    for bag in found:
        scores.append(score_episode(str(bag), read_record(bag), loaded, chosen))
        on_bag()
    return score_table(scores)


def export(
    format_name: str,
    bags: Folders,
    out: Folder,
    options: Mapping[str, str] | None = None,
    processes: int = 1,
    progress: tqdm[Any] | None = None,
) -> ExportResult:
    """Write recorded episodes as a dataset in another format.

    Args:
        format_name: Such as ``kitti``, ``nuscenes`` or ``csv``; ``siren export --list`` shows all formats.
        bags: Folder or folders of recorded episodes, or folders that hold such folders, as a study does.
        out: Folder of the dataset, new or empty. It appears when the whole dataset is written.
        options: Options of the format by name, as ``{"layout": "paper"}``.
        processes: Number of processes that work side by side.
        progress: As in ``make_episode``, in simulated seconds.

    Returns:
        The dataset's card, and notes about bags that are not whole.

    Raises:
        InputError: The format, an option or the folder cannot be used, or a bag lacks what the format needs.
    """
    from siren_ros.data.datasets.export_job import ExportJob, run_export
    from siren_ros.data.datasets.formats import format_named

    job = ExportJob(format_named(format_name), options or {}, _bags_of(bags), Path(out), processes)
    return run_export(job) if progress is None else run_export(job, progress.reset, _moved(progress, 0))


def generate_study(study: Study, out: Folder, workers: int = 1, progress: tqdm[Any] | None = None) -> StudyResult:
    """Make all episodes of a study, several at once; a call with the same folder goes on where the last one stopped.

    Each episode has a process of its own. Programs that call this function keep it under
    ``if __name__ == "__main__":``, because these processes import the program's file.

    Args:
        study: Templates, levels, seeds, maps and the other choices.
        out: Folder of the study; its table is ``manifest.parquet``.
        workers: Number of processes.
        progress: As in ``make_episode``, in episodes.

    Returns:
        A row for each episode.

    Raises:
        InputError: The study or the folder cannot be used. Videos with risk labels need ``siren generate``.
    """
    from siren_ros.errors import InputError
    from siren_ros.running.studies.run_study import LocalWorkers, StudyBar, run_study
    from siren_ros.running.studies.study_folder import LocalFolder

    if study.risk_videos:
        raise InputError("risk_videos", study.risk_videos, "0; `siren generate` makes the videos")
    observer = None if progress is None else StudyBar(progress)
    return run_study(study, LocalFolder(Path(out)), LocalWorkers(workers), observer=observer)


def examine(
    bags: Folders,
    driver: str = "",
    *,
    study: Study | None = None,
    paired: bool = True,
    actor_id: int | None = None,
    rulebook: str = "international",
    workers: int = 1,
    progress: tqdm[Any] | None = None,
) -> Certificate:
    """Grade how a driver makes way, clause by clause of a rulebook: in recorded episodes, or in a study made for it.

    Args:
        bags: Folder or folders of recorded episodes, or folders that hold such folders; with ``study`` its folder.
        driver: With ``study`` the AV's driver: ``siren`` (the paper's), ``idm``, ``learned``,
            ``pulls-over``, ``lawful-PLACE``, ``FAULT-PLACE`` or an ONNX file. Without it the name that the certificate
            gives to the driver.
        study: Episodes to make first, as ``generate_study`` makes them; None grades the bags as they are. Its seat
            may name a ROS program in place of ``driver``.
        paired: Whether the study is made again with the paper's driver, in the folder ``paper`` of ``bags``, so that
            the certificate tells what the driver does to others in comparison.
        actor_id: The driver in recorded episodes; None for the AV under test.
        rulebook: ``california``, ``germany``, ``international``, or a YAML file.
        workers: Number of processes.
        progress: As in ``make_episode``, in episodes.

    Returns:
        The grade of each clause in each episode, and whether the driver passes. It names episodes of the study that
        failed.

    Raises:
        InputError: The rulebook, the driver, the study or the folder cannot be used, or an episode has no AV under
            test while ``actor_id`` is None.
        BagError: A bag cannot be read.
    """
    from siren_ros.base.processes.process_pool import ProcessPool
    from siren_ros.reports.exam.grading import load_rulebook
    from siren_ros.reports.exam.sitting import about_of, certificate_of, make_exam, sit_in_bag, sit_in_made_episode

    def make(one: Study, out: Path) -> Sequence[EpisodeRow]:
        return generate_study(one, out, workers, progress).rows

    book = load_rulebook(rulebook)
    sit: Callable[..., Sitting]
    calls: list[tuple[Any, ...]]
    lacks: Sequence[Sitting]
    study = None if study is None else _with_driver(study, driver)
    if study is None:
        sit, calls, lacks = sit_in_bag, [(bag, actor_id, book) for bag in _bags_of(bags)], ()
    else:
        episodes, lacks = make_exam(study, _folder(bags), make, paired=paired)
        sit, calls = sit_in_made_episode, [(episode, book) for episode in episodes]
    on_bag = _moved(progress, len(calls))
    with ProcessPool(min(workers, len(calls))) as pool:
        sittings = pool.map(sit, calls, on_bag)
    name = driver or (study.seat.program if study else "")
    return certificate_of(name, actor_id, book, [*sittings, *lacks], about_of(study))


def iterate_samples(bags: Folders, window: str = "ngsim", population: str = "region") -> Iterator[ScoredSamples]:
    """Yield the prediction samples of recorded episodes, those of one episode at a time, as arrays.

    Args:
        bags: Folder or folders of recorded episodes, or folders that hold such folders.
        window: The past of a sample: ``ngsim`` (3 s, a point every 0.2 s) or ``argoverse2`` (5 s, every 0.1 s).
        population: As in ``score_predictions``.

    Raises:
        InputError: The window or the population is unknown.
        BagError: A bag cannot be read.
    """
    from siren_ros.errors import InputError
    from siren_ros.scoring.evaluation.prediction.samples import WINDOWS, samples_of

    if window not in WINDOWS:
        raise InputError("window", window, f"one of {', '.join(WINDOWS)}")
    chosen = _population(population)
    for bag in _bags_of(bags):
        yield samples_of(read_record(bag), WINDOWS[window], chosen)


def iterate_frames(bag: Folder, *, cameras: bool = False, pose: bool = False) -> Iterator[LidarFrame]:
    """Yield the steps of an episode that hold a LiDAR sweep, labels or pictures.

    Args:
        bag: Folder of an episode that was recorded with a LiDAR.
        cameras: Also the pictures of all cameras and their labels.
        pose: Also the pose of the vehicle or of the station at the roadside.

    Raises:
        BagError: The bag cannot be read, or holds no LiDAR.
    """
    from siren_ros.data.episode_source import lidar_frames, open_source

    with open_source(Path(bag)) as source:
        yield from lidar_frames(source, cameras=source.cameras if cameras else (), pose=pose)


def _moved(bar: tqdm[Any] | None, whole: float) -> Callable[..., None]:
    """A function that moves a bar, which begins anew here; where there is none it does nothing."""
    if bar is None:
        return lambda *_: None
    bar.reset(whole)

    def move(width: float = 1.0) -> None:
        bar.update(width)

    return move


def _with_driver(study: Study, driver: str) -> Study:
    from siren_ros.errors import InputError
    from siren_ros.running.studies.matrix import Seat

    if not driver and study.seat.program:
        return study
    if not driver:
        raise InputError("driver", driver, "with a study: the name of a driver, or its ONNX file")
    return replace(study, seat=Seat(driver))


def _folder(folders: Folders) -> Path:
    from siren_ros.errors import InputError

    if not isinstance(folders, str | PathLike):
        raise InputError("bags", folders, "with a study: one folder")
    return Path(folders)


def _bags_of(folders: Folders) -> tuple[Path, ...]:
    from siren_ros.data.recording.bag_reader import bags_among

    return bags_among(map(Path, [folders] if isinstance(folders, str | PathLike) else folders))


def _population(name: str) -> Population:
    from siren_ros.errors import InputError
    from siren_ros.scoring.evaluation.prediction.samples import Population

    try:
        return Population(name)
    except ValueError as error:
        raise InputError("population", name, f"one of {', '.join(Population)}") from error
