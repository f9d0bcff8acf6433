"""``siren export``, ``siren pack`` and ``siren check``: episodes as datasets, samples in one file, checks of copies.

Other programs read a dataset; the format ``html`` is a page for people.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from tqdm import tqdm

from siren_ros.base.tables import Table, counted
from siren_ros.cli.command import complain
from siren_ros.cli.options import add_bags, add_processes, processes_of, steps_of
from siren_ros.cli.view import add_page
from siren_ros.data.datasets.export_job import AUTO, SPLITS, ExportJob, run_export
from siren_ros.data.datasets.formats import FORMATS, Format
from siren_ros.data.datasets.publication import check_copy
from siren_ros.data.episode_source import LICENCE, Need
from siren_ros.data.recording.bag_reader import bags_among
from siren_ros.errors import EXIT_FAILED, EXIT_OK
from siren_ros.lab.training.packed.pack import PACKS, RISK, RiskPack, pack_risk, read_through

_PAGE: Final = "html"
_PAGE_SUMMARY: Final = "One page for people: an episode in 3-D that any browser shows without a network"


class _ListFormats(argparse.Action):
    """``--list``: prints the table of formats and ends."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print("\n".join(_table()))
        parser.exit()


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = "Writes episodes as a dataset in another format."
    verb.add_argument("--list", action=_ListFormats, nargs=0, help="print all formats and what they need of a bag")
    formats = verb.add_subparsers(title="formats", metavar="FORMAT", required=True)
    for dataset in FORMATS.values():
        parser = formats.add_parser(dataset.name, help=dataset.summary, description=f"{dataset.summary}.")
        add_dataset_options(parser, dataset)
        parser.set_defaults(run=run)
    add_page(formats.add_parser(_PAGE, help=_PAGE_SUMMARY))


def add_dataset_options(parser: argparse.ArgumentParser, dataset: Format) -> None:
    """Adds the bags of a format that takes bags, and the options that every dataset has."""
    if dataset.exporter:
        add_bags(parser)
        add_processes(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", required=True, help="dataset to write; new or empty")
    parser.add_argument(
        "--split",
        choices=(AUTO, *SPLITS),
        default=AUTO,
        help="split of all episodes (default: by params/splits.yaml)",
    )
    meaning = f"licence that the dataset's card states (default {LICENCE})"
    parser.add_argument("--licence", metavar="TEXT", default="", help=meaning)
    for option in dataset.options:
        name, meaning = f"--{option.name}", option.help.replace("%", "%%")
        if option.is_flag:
            parser.add_argument(name, action="store_const", const="yes", default="no", help=meaning)
        else:
            meaning += f" (default {option.default})"
            parser.add_argument(name, default=option.default, choices=option.allowed or None, help=meaning)
    parser.set_defaults(format=dataset)


def run(arguments: argparse.Namespace) -> int:
    """Exports the bags; exit code 1 where one of them is not whole."""
    return exported(arguments)[1]


def exported(arguments: argparse.Namespace) -> tuple[Mapping[str, Any], int]:
    """Exports the bags, says what was written, and returns the card and the exit code."""
    dataset: Format = arguments.format
    jobs, bags = processes_of(arguments), bags_among(arguments.bags)
    options = {option.name: getattr(arguments, option.name.replace("-", "_")) for option in dataset.options}
    job = ExportJob(dataset, options, bags, arguments.out, jobs, arguments.split, arguments.licence)
    tqdm.monitor_interval = 0  # no thread of tqdm: workers are forked, which is sound without threads
    bar_format = "{l_bar}{bar}| {n:.0f}/{total:.0f} s of episodes [{elapsed}<{remaining}]"
    with tqdm(total=0, unit="s", bar_format=bar_format, disable=None, desc=f"export {dataset.name}") as bar:
        result = run_export(job, bar.reset, steps_of(bar))
    for note in result.notes:
        complain(f"siren export: {note}")
    counts = ", ".join(f"{count} {name}" for name, count in result.card["counts"].items())
    print(f"{arguments.out}: {counted(len(result.card['episodes']), 'episode')}, {counts}")
    print(_splits_text(result.card, automatic=arguments.split == AUTO))
    return result.card, EXIT_FAILED if result.notes else EXIT_OK


def _splits_text(card: Mapping[str, Any], *, automatic: bool) -> str:
    """How the episodes are split, and what to do where a split is empty."""
    unit = next(iter(card["counts"]), "")
    parts, empty = [], []
    for split, names in card["splits"].items():
        inside = sum(episode["counts"].get(unit, 0) for episode in card["episodes"] if episode["split"] == split)
        parts.append(f"{split} {len(names)} ({inside} {unit})" if names and unit else f"{split} {len(names)}")
        empty += [] if names else [split]
    splits = f"episodes by split: {', '.join(parts)}"
    if not automatic or not empty:
        return splits
    return (
        f"{splits}; {', '.join(empty)} stay empty because an episode's map, template, seed and parameters fix its "
        "split (params/splits.yaml). --split puts all episodes into one split"
    )


def _table() -> list[str]:
    rows = tuple((dataset.name, ", ".join(dataset.needs), dataset.summary) for dataset in FORMATS.values())
    rows += ((_PAGE, f"{Need.TRACKS}, {Need.MAP}", _PAGE_SUMMARY),)
    return Table("formats", "", ("format", "needs", "what it is"), rows).text() + [
        f"{dataset.name} runs as ./env --with {dataset.extra} siren export {dataset.name} …"
        for dataset in FORMATS.values()
        if dataset.extra
    ]


def add_pack(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Packs samples for training as one Parquet file for each split, and prints how many samples a second of "
        "processor time one process reads. The classes of siren_ros.training.torch_samples give them to PyTorch."
    )
    tasks = verb.add_subparsers(title="tasks", metavar="TASK", required=True)
    for pack in PACKS.values():
        task = tasks.add_parser(pack.name, help=pack.summary, description=f"{pack.summary}.")
        add_dataset_options(task, pack)
        task.set_defaults(run=run_pack)
    task = tasks.add_parser(RISK.name, help=RISK.summary, description=f"{RISK.summary}.")
    task.add_argument("sets", type=Path, nargs="+", metavar="SET", help="folders that `siren generate risk` made")
    add_dataset_options(task, RISK)
    task.set_defaults(run=run_risk_pack)


def run_pack(arguments: argparse.Namespace) -> int:
    """Packs bags; exit code 1 where one of them is not whole."""
    card, code = exported(arguments)
    _print_speed(arguments.out, card)
    return code


def run_risk_pack(arguments: argparse.Namespace) -> int:
    """Packs sets of risk videos."""
    job = RiskPack(tuple(arguments.sets), arguments.out, arguments.split, arguments.licence)
    with tqdm(unit="video", disable=None, desc="pack") as bar:
        card = pack_risk(job, steps_of(bar))
    print(f"{arguments.out}: {card['counts']['samples']} samples")
    _print_speed(arguments.out, card)
    return EXIT_OK


def _print_speed(folder: Path, card: Mapping[str, Any]) -> None:
    for split, episodes in card["splits"].items():
        if episodes:
            count, per_s = read_through(folder / f"{split}.parquet")
            print(f"{split}.parquet: {count} samples, {per_s:.0f} samples a second")


def add_check(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Compares a copy of a dataset with the sizes and SHA-256 hashes in its croissant.json. The exit code is 1 if a "
        "file is missing or has changed."
    )
    verb.add_argument("datasets", type=Path, nargs="+", metavar="DIR", help="folder of a dataset")
    verb.set_defaults(run=check)


def check(arguments: argparse.Namespace) -> int:
    """Checks each copy; standard error names what is wrong."""
    code = EXIT_OK
    for folder in arguments.datasets:
        found = check_copy(folder)
        for what, paths in (("missing", found.missing), ("changed", found.changed), ("not of the set", found.further)):
            for path in paths:
                complain(f"siren check: {folder}: {path}: {what}")
        print(f"{folder}: {found.files} files, {'whole' if found.is_whole else 'NOT the published dataset'}")
        code = code if found.is_whole else EXIT_FAILED
    return code
