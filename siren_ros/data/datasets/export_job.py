"""Exports many bags as one dataset, with splits and a card that describes its sources."""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import siren_ros
from siren_ros.base.numerics.arrays import Brief
from siren_ros.base.processes.process_pool import ProcessPool, Progress, simulated_time
from siren_ros.data.datasets.files import FileWriter, Staging
from siren_ros.data.datasets.formats import EpisodePart, EpisodeReport, Format, load_exporter
from siren_ros.data.datasets.publication import CARD_FILE, ORIGIN, README_FILE, datasheet, write_croissant
from siren_ros.data.episode_source import LICENCE, BagSurvey, in_dataset_order, open_source, recovered, survey_bag
from siren_ros.errors import BagError, EpisodeError, writing
from siren_ros.simulation.scenario.episode import Split, split_of

SPLITS: Final = ("train", "val", "test")
AUTO: Final = "auto"
"""Value that assigns each episode to the split that ``siren_ros.simulation.scenario.episode`` fixes for it."""


def card(
    dataset_format: Format,
    options: Mapping[str, str],
    surveys: Sequence[BagSurvey],
    parts: Sequence[EpisodePart],
    licence: str,
) -> dict[str, Any]:
    """The card as JSON types. It has no time, host or path, so that the same bags give the same card."""
    counts: Counter[str] = Counter()
    classes: Counter[str] = Counter()
    for part in parts:
        counts.update(part.report.counts)
        classes.update(part.report.classes)
    episodes = [
        {
            "id": part.episode_id,
            "split": part.split,
            **survey.episode,
            "bag_sha256": survey.sha256,
            "lost": survey.note,
            "counts": dict(part.report.counts),
        }
        for survey, part in zip(surveys, parts, strict=True)
    ]
    return card_of(dataset_format, "BAG…", options, episodes, counts, classes, licence)


def card_of(
    dataset_format: Format,
    sources: str,
    options: Mapping[str, str],
    episodes: Sequence[Mapping[str, Any]],
    counts: Mapping[str, int],
    classes: Mapping[str, int],
    licence: str,
) -> dict[str, Any]:
    """The card of a dataset of episodes, each with id, split, map and licence; ``sources`` appears in the command."""
    words = [f"--{name} {value}" for name, value in options.items()]
    splits = dict.fromkeys([*(split.value for split in Split), *(episode["split"] for episode in episodes)])
    return {
        "name": f"SIREN {dataset_format.name}",
        "format": dataset_format.name,
        "what": dataset_format.summary,
        "made_with": {
            "command": " ".join([dataset_format.command, dataset_format.name, *words, sources, "--out", "DIR"]),
            "siren_ros": siren_ros.__version__,
            "options": dict(options),
        },
        "licence": licence or LICENCE,
        "map_licences": {episode["map"]: episode["map_licence"] for episode in episodes},
        "episodes": list(episodes),
        "splits": {split: [episode["id"] for episode in episodes if episode["split"] == split] for split in splits},
        "counts": dict(counts),
        "classes": dict(sorted(classes.items())),
    }


_Columns = Mapping[str, Callable[[Mapping[str, Any]], str]]
_BAG_COLUMNS: Final[_Columns] = {
    "episode": lambda episode: episode["id"],
    "map (SHA-256)": lambda episode: f"{episode['map']} ({episode['map_sha256'][:12]}…)",
    "suite": lambda episode: episode["sensor_suite"],
    "ended": lambda episode: episode["ended"],
    "bag (SHA-256)": lambda episode: f"{episode['bag_sha256'][:12]}…",
}
_VIDEO_COLUMNS: Final[_Columns] = {
    "video": lambda episode: episode["id"],
    "template": lambda episode: episode["template"],
    "seed": lambda episode: str(episode["seed"]),
    "map": lambda episode: episode["map"],
    "class": lambda episode: episode["label"],
}


def _episode_rows(episodes: Sequence[Mapping[str, Any]]) -> str:
    """The episodes as a Markdown table, for datasets of bags or of videos."""
    columns = _BAG_COLUMNS if "bag_sha256" in episodes[0] else _VIDEO_COLUMNS
    head = [f"| {' | '.join(columns)} |", "|" + "---|" * len(columns)]
    return "\n".join([*head, *(f"| {' | '.join(show(item) for show in columns.values())} |" for item in episodes)])


def readme(content: Mapping[str, Any]) -> str:
    """The card as Markdown text for people."""
    counts = {"episodes": len(content["episodes"]), **content["counts"]}
    made_with = f"Made by SIREN {content['made_with']['siren_ros']} with `{content['made_with']['command']}`."
    blocks = [
        f"# SIREN dataset, format {content['format']}",
        f"{content['what']}.",
        f"{made_with}\n{ORIGIN}",
        f"Licence: {content['licence']}.",
        "## Counts",
        "\n".join(["| | |", "|---|---|", *(f"| {name} | {count} |" for name, count in counts.items())]),
    ]
    if content["classes"]:
        labels = [f"| {name} | {count} |" for name, count in content["classes"].items()]
        blocks.append("\n".join(["| class | labels |", "|---|---|", *labels]))
    blocks += [
        "## Splits",
        "Whole episodes. An episode's map, template, seed and parameters fix its split; all levels of a seed share it.",
        "\n".join(f"* {split}: {', '.join(names) or 'none'}" for split, names in content["splits"].items()),
        "## Episodes",
        _episode_rows(content["episodes"]),
    ]
    if "recorded_with" in content["episodes"][0]:
        blocks += ["The first episode is recorded again with", f"    {content['episodes'][0]['recorded_with']}"]
    blocks += [
        f"`{CARD_FILE}` holds all of this for programs, with whole hashes, versions and every command.",
        datasheet(content),
    ]
    lost = [f"* {episode['id']}: {episode['lost']}" for episode in content["episodes"] if episode.get("lost")]
    if lost:
        blocks += ["## Not whole", "\n".join(lost)]
    return "\n\n".join(blocks) + "\n"


def write_card(folder: Path, content: Mapping[str, Any]) -> None:
    """Write card, README and metadata into a dataset's folder.

    A README of the format stays at the start of the file.
    """
    (folder / CARD_FILE).write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    file = folder / README_FILE
    head = file.read_text(encoding="utf-8") + "\n" if file.exists() else ""
    file.unlink(missing_ok=True)
    file.write_text(head + readme(content), encoding="utf-8")
    write_croissant(folder, content, siren_ros.__version__)


@dataclass(frozen=True)
class ExportJob:
    """Settings of an export."""

    format: Format
    options: Mapping[str, str]
    bags: tuple[Path, ...]
    out: Path
    processes: int = 1
    split: str = AUTO
    licence: str = ""


@dataclass(frozen=True)
class ExportResult(Brief):
    """Result of an export."""

    card: Mapping[str, Any]
    notes: tuple[str, ...]
    """Data that was lost: one line for each damaged bag."""

    def facts(self) -> dict[str, object]:
        """The dataset's name and counts."""
        return {
            "format": self.card["format"],
            "episodes": len(self.card["episodes"]),
            **self.card["counts"],
            "licence": self.card["licence"],
            "notes": len(self.notes),
        }


def run_export(
    job: ExportJob, announce: Callable[[float], None] = lambda _: None, progress: Progress = lambda _: None
) -> ExportResult:
    """Export all bags. The dataset gets its final name only when it is complete.

    ``announce`` is called with the simulated seconds of all bags before the first is exported. Raises InputError: the
    place is taken or cannot be written, an option is unknown, or a bag cannot be used.
    """
    load_exporter(job.format, job.options)
    staging = Staging(job.out)
    staging.check_free()
    identity = {
        "format": job.format.name,
        "options": dict(job.options),
        "split": job.split,
        "siren_ros": siren_ros.__version__,
        "bags": sorted(str(bag.absolute()) for bag in job.bags),
    }
    with staging.opened(identity), ProcessPool(min(job.processes, len(job.bags)), progress) as pool:
        needs = job.format.needs_with(job.options)
        surveys = pool.map(survey_bag, [(bag, job.format.name, needs, staging.path / "recovered") for bag in job.bags])
        announce(sum(float(survey.episode["planned_duration_s"]) for survey in surveys))
        episodes = in_dataset_order(surveys)
        todo = [
            (job, survey, episode_id, staging, index)
            for index, (survey, episode_id) in enumerate(episodes)
            if staging.report_of(index) is None
        ]
        pool.map(_export_part, todo)
        exported, parts, notes = [], [], []
        for index, (survey, episode_id) in enumerate(episodes):
            finished = staging.report_of(index)
            if finished is None:
                raise EpisodeError(f"{survey.bag}: its export has disappeared from {staging.path}")
            note = finished["lost"] or survey.note
            exported.append(replace(survey, note=note))
            notes += [f"{survey.bag}: exported as far as it goes; {note}"] if note else []
            report = EpisodeReport(finished["counts"], finished["classes"])
            split = split_of(survey.identity).value if job.split == AUTO else job.split
            parts.append(EpisodePart(episode_id, index, split, staging.part(index), report))
        content = card(job.format, job.options, exported, parts, job.licence)
        with writing(staging.path, "place"):
            folder = staging.new(staging.dataset)
            load_exporter(job.format, job.options).assemble(parts, folder)
            write_card(folder, content)
    staging.publish(staging.dataset)
    return ExportResult(content, tuple(notes))


def _export_part(job: ExportJob, survey: BagSurvey, episode_id: str, staging: Staging, index: int) -> None:
    exporter = load_exporter(job.format, job.options)
    threads, folder = job.processes if len(job.bags) == 1 else 1, staging.part(index)

    def export(bag: Path) -> EpisodeReport:
        with open_source(bag) as source, FileWriter(staging.new(folder), threads, simulated_time()) as files:
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
