"""``siren export FORMAT BAG… --out DIR``: episodes as datasets that other programs read."""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tqdm import tqdm

from siren_ros.cli.options import add_processes, processes_of, steps_of
from siren_ros.datasets.export_job import AUTO, SPLITS, ExportJob, run_export
from siren_ros.datasets.formats import FORMATS, Format, Option
from siren_ros.errors import EXIT_FAILED, EXIT_OK
from siren_ros.recording.bag_reader import bags_among
from siren_ros.tables.table import Table


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
    for made in FORMATS.values():
        parser = formats.add_parser(made.name, help=made.summary, description=f"{made.summary}.")
        parser.add_argument(
            "bags",
            type=Path,
            metavar="BAG",
            nargs="+",
            help="folder of a recorded episode, or a folder of such folders",
        )
        parser.add_argument("--out", type=Path, metavar="DIR", required=True, help="dataset to write; new or empty")
        add_processes(parser)
        parser.add_argument(
            "--split", choices=(AUTO, *SPLITS), default=AUTO, help="split of all episodes (default: by seed and map)"
        )
        parser.add_argument("--licence", metavar="TEXT", default="", help="licence that the dataset's card states")
        for option in made.options:
            _add_option(parser, option)
        parser.set_defaults(run=run, format=made)


def _add_option(parser: argparse.ArgumentParser, option: Option) -> None:
    told = option.help.replace("%", "%%")
    if option.is_flag:
        parser.add_argument(f"--{option.name}", action="store_const", const="yes", default="no", help=told)
        return
    parser.add_argument(
        f"--{option.name}",
        default=option.default,
        choices=option.allowed or None,
        help=f"{told} (default {option.default})",
    )


def run(arguments: argparse.Namespace) -> int:
    """Exports the bags; exit code 1 where one of them is not whole."""
    made: Format = arguments.format
    jobs = processes_of(arguments)
    options = {option.name: getattr(arguments, option.name.replace("-", "_")) for option in made.options}
    job = ExportJob(made, options, bags_among(arguments.bags), arguments.out, jobs, arguments.split, arguments.licence)
    tqdm.monitor_interval = 0  # no thread of tqdm: workers are forked, which is sound without threads
    bar_format = "{l_bar}{bar}| {n:.0f}/{total:.0f} s of episodes [{elapsed}<{remaining}]"
    with tqdm(total=0, unit="s", bar_format=bar_format, disable=None, desc=f"export {made.name}") as bar:
        result = run_export(job, bar.reset, steps_of(bar))
    for note in result.notes:
        print(f"siren export: {note}", file=sys.stderr)
    counts = ", ".join(f"{count} {name}" for name, count in result.card["counts"].items())
    episodes = len(result.card["episodes"])
    print(f"{arguments.out}: {episodes} episode{'s' if episodes != 1 else ''}, {counts}")
    print(_splits_told(result.card, automatic=arguments.split == AUTO))
    return EXIT_FAILED if result.notes else EXIT_OK


def _splits_told(card: Mapping[str, Any], *, automatic: bool) -> str:
    """How the episodes are split, and what to do where a split is empty."""
    unit = next(iter(card["counts"]), "")
    parts, empty = [], []
    for split, names in card["splits"].items():
        inside = sum(one["counts"].get(unit, 0) for one in card["episodes"] if one["split"] == split)
        parts.append(f"{split} {len(names)} ({inside} {unit})" if names and unit else f"{split} {len(names)}")
        empty += [] if names else [split]
    told = f"episodes by split: {', '.join(parts)}"
    if not automatic or not empty:
        return told
    return (
        f"{told}; {' and '.join(empty)} stay empty because episodes of one seed on one map stay together: val needs "
        "two seeds or maps, test three. --split puts all episodes into one split"
    )


def _table() -> list[str]:
    rows = tuple((made.name, ", ".join(made.needs), made.summary) for made in FORMATS.values())
    lines = Table("formats", "", ("format", "needs", "what it is"), rows).text()
    extras = [made for made in FORMATS.values() if made.extra]
    lines += [f"{made.name} runs as ./env --with {made.extra} siren export {made.name} …" for made in extras]
    return lines
