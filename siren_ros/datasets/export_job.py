"""Exports many bags into one dataset: processes side by side, finished episodes kept, the whole moved at the end."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import siren_ros
from siren_ros.datasets.exporting.dataset_card import card, write_card
from siren_ros.datasets.exporting.file_writer import FileWriter
from siren_ros.datasets.exporting.format import EpisodePart, EpisodeReport, Format
from siren_ros.datasets.exporting.splits import AUTO, split_of_groups
from siren_ros.datasets.exporting.staging import Staging
from siren_ros.datasets.exporting.survey import BagSurvey, in_dataset_order, recovered, survey_bag
from siren_ros.datasets.exporting.worker_pool import Progress, simulated_time, worker_pool
from siren_ros.datasets.registry import load_exporter
from siren_ros.datasets.sources.episode_source import open_source
from siren_ros.errors import BagError, EpisodeError, writing

_Result = TypeVar("_Result")


@dataclass(frozen=True)
class ExportJob:
    """What is asked for."""

    format: Format
    options: Mapping[str, str]
    bags: tuple[Path, ...]
    out: Path
    processes: int = 1
    split: str = AUTO
    licence: str = ""


@dataclass(frozen=True)
class ExportResult:
    """What became of it."""

    card: Mapping[str, Any]
    notes: tuple[str, ...]
    """What is lost, one line for each bag that is not whole."""


def run_export(
    job: ExportJob, announce: Callable[[float], None] = lambda _: None, progress: Progress = lambda _: None
) -> ExportResult:
    """Exports all bags; nothing has the final name before everything is there.

    Args:
        job: What is asked for.
        announce: Told the simulated seconds of all bags, before the first is exported.
        progress: Told what has been exported.

    Raises:
        InputError: The place is taken or cannot be written, an option is unknown, or a bag cannot be used.
    """
    load_exporter(job.format, job.options)
    staging = Staging(job.out)
    staging.check_free()
    with staging.opened(_identity(job)), worker_pool(min(job.processes, len(job.bags)), progress) as run:
        arguments = [
            (bag, job.format.name, job.format.needs_with(job.options), staging.path / "recovered") for bag in job.bags
        ]
        surveys = _in_order(run(survey_bag, arguments))
        announce(sum(float(survey.episode["planned_duration_s"]) for survey in surveys))
        entries = _entries(surveys, job.split)
        threads = job.processes if len(job.bags) == 1 else 1
        todo = [
            (job.format, dict(job.options), survey, episode_id, staging, index, threads)
            for index, (survey, episode_id, _) in enumerate(entries)
            if staging.report_of(index) is None
        ]
        for _ in run(_export_part, todo):
            pass
        parts, notes = [], []
        for index, (survey, episode_id, split) in enumerate(entries):
            found = staging.report_of(index)
            if found is None:
                raise EpisodeError(f"{survey.bag}: its export has disappeared from {staging.path}")
            note = found["lost"] or survey.note
            surveys[index] = BagSurvey(survey.bag, survey.readable, survey.sha256, note, survey.episode)
            notes += [f"{survey.bag}: exported as far as it goes; {note}"] if note else []
            report = EpisodeReport(found["counts"], found["classes"])
            parts.append(EpisodePart(episode_id, index, split, staging.part(index), report))
        content = card(job.format, job.options, surveys, parts, job.licence)
        with writing(staging.path, "place"):
            folder = staging.new_dataset()
            load_exporter(job.format, job.options).assemble(parts, folder)
            write_card(folder, content)
    staging.publish()
    return ExportResult(content, tuple(notes))


def _identity(job: ExportJob) -> dict[str, Any]:
    return {
        "format": job.format.name,
        "options": dict(job.options),
        "split": job.split,
        "siren_ros": siren_ros.__version__,
        "bags": sorted(str(bag.absolute()) for bag in job.bags),
    }


def _entries(surveys: list[BagSurvey], wanted: str) -> list[tuple[BagSurvey, str, str]]:
    """Surveys in the dataset's order with id and split; sorts the given list, too."""
    ordered = in_dataset_order(surveys)
    surveys[:] = [survey for survey, _ in ordered]
    splits = split_of_groups([survey.group for survey in surveys], wanted)
    return [(survey, episode_id, splits[survey.group]) for survey, episode_id in ordered]


def _export_part(
    made: Format,
    options: Mapping[str, str],
    survey: BagSurvey,
    episode_id: str,
    staging: Staging,
    index: int,
    threads: int,
) -> None:
    exporter = load_exporter(made, options)

    def export(bag: Path) -> EpisodeReport:
        with open_source(bag) as source, FileWriter(staging.new_part(index), threads, simulated_time()) as files:
            return exporter.write_episode(source, episode_id, files)

    lost = ""
    try:
        report = export(Path(survey.readable))
    except BagError:
        if survey.note:
            raise
        bag, lost = recovered(Path(survey.bag), staging.path / "recovered")
        report = export(bag)
    staging.finish_part(index, {"counts": dict(report.counts), "classes": dict(report.classes), "lost": lost})


def _in_order(results: Iterator[tuple[int, _Result]]) -> list[_Result]:
    return [result for _, result in sorted(results, key=lambda pair: pair[0])]
