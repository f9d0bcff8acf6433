"""``siren pack TASK`` and ``siren check``: samples for training in one file, and checks of copies of datasets."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tqdm import tqdm

from siren_ros.cli.command import complain
from siren_ros.cli.export import add_dataset_options, exported
from siren_ros.cli.options import steps_of
from siren_ros.data.datasets.publication import check_copy
from siren_ros.errors import EXIT_FAILED, EXIT_OK
from siren_ros.lab.training.packed.pack import PACKS, RISK, RiskPack, pack_risk, read_through


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Packs samples for training as one Parquet file for each split, and prints how many samples a second of "
        "processor time one process reads. The classes of siren_ros.training.torch_samples give them to PyTorch."
    )
    tasks = verb.add_subparsers(title="tasks", metavar="TASK", required=True)
    for pack in PACKS.values():
        task = tasks.add_parser(pack.name, help=pack.summary, description=f"{pack.summary}.")
        add_dataset_options(task, pack)
        task.set_defaults(run=run)
    task = tasks.add_parser(RISK.name, help=RISK.summary, description=f"{RISK.summary}.")
    task.add_argument("sets", type=Path, nargs="+", metavar="SET", help="folders that `siren generate risk` made")
    add_dataset_options(task, RISK)
    task.set_defaults(run=run_risk)


def run(arguments: argparse.Namespace) -> int:
    """Packs bags; exit code 1 where one of them is not whole."""
    card, code = exported(arguments)
    _print_speed(arguments.out, card)
    return code


def run_risk(arguments: argparse.Namespace) -> int:
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
            speed = read_through(folder / f"{split}.parquet")
            print(f"{split}.parquet: {speed.samples} samples, {speed.per_s:.0f} samples a second")


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
