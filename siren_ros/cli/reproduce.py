"""``siren reproduce``: makes every measured figure, table, picture and film of the documents."""

import argparse
import subprocess
import sys
from pathlib import Path
from typing import Final

from siren_ros.base.params.resources import params_dir
from siren_ros.cli.options import add_processes
from siren_ros.errors import EXIT_FAILED, EXIT_OK, InputError
from siren_ros.lab.reproduction.make import Reproduction
from siren_ros.lab.reproduction.parts import read_parts

_RESULTS: Final = Path("docs", "results.json")
_WRITE_DOCUMENTS: Final = Path("tools", "write_documents.py")


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Makes every measured figure, table, picture and film of the documents, part by part, and writes "
        "docs/results.json and the documents. It says first how long each part takes. It makes a part again only if "
        "its commands, its code or a part that it needs has changed. The same command continues an interrupted run. It "
        "needs a checkout of the repository."
    )
    verb.add_argument("--only", nargs="+", default=(), metavar="PART", help="only these parts and those that they need")
    verb.add_argument("--list", action="store_true", help="only list what would be made")
    verb.add_argument("--out", type=Path, default=Path("reproduction"), metavar="DIR", help="folder for the work")
    add_processes(verb)
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Makes the parts that are due."""
    repository = Path.cwd()
    if not (repository / "docs").is_dir() or not (repository / "siren_ros").is_dir():
        raise InputError("folder", str(repository), "the top folder of a checkout of the repository")
    if arguments.workers < 1:
        raise InputError("workers", arguments.workers, "1 or more")
    parts = read_parts(params_dir() / "reproduction.yaml", repository)
    work = Reproduction(repository, arguments.out.resolve(), repository / _RESULTS, arguments.workers)
    steps = work.plan(parts, arguments.only)
    if arguments.list:
        print(*steps, sep="\n")
        return EXIT_OK
    failed = work.make(steps, lambda line: print(line, flush=True))
    for line in failed:
        print(f"failed: {line}")
    written = subprocess.run([sys.executable, str(repository / _WRITE_DOCUMENTS)], check=False)  # noqa: S603 - a file of the checkout
    return EXIT_FAILED if failed or written.returncode else EXIT_OK
