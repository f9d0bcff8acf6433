"""``siren report DIR --out FILE.html``: a study as one page."""

import argparse
from pathlib import Path

from tqdm import tqdm

from siren_ros.cli.command import complain
from siren_ros.cli.options import add_processes, names_in, processes_of, steps_of
from siren_ros.errors import EXIT_OK, InputError, write_text, writing
from siren_ros.reports.study_report.build import build_page
from siren_ros.reports.study_report.page import html_of
from siren_ros.reports.study_report.study import DETECTION, MODELS, PAGES, RISK, PageOptions


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Writes one HTML file about a study: its episodes, pictures and films of the templates, yield metrics, "
        "effects of siren and level, the tables of the three tasks, diversity, and the commands that repeat each "
        "number. A browser needs no network. Its links lead to pages of episodes in a folder next to the file."
    )
    verb.add_argument("dir", type=Path, metavar="DIR", help="folder that `siren generate` made")
    verb.add_argument("--out", type=Path, required=True, metavar="FILE.html", help="page to write")
    verb.add_argument(
        "--models",
        default=",".join(MODELS),
        metavar="NAMES",
        help="predictors to score, by commas (default %(default)s)",
    )
    verb.add_argument(
        "--detection",
        type=Path,
        metavar="DIR",
        help=f"folder that `siren evaluate detection --out` wrote (default: DIR/{DETECTION})",
    )
    verb.add_argument(
        "--risk", type=Path, metavar="DIR", help=f"folder that `siren evaluate risk --out` wrote (default: DIR/{RISK})"
    )
    verb.add_argument(
        "--pages",
        type=int,
        default=PAGES,
        metavar="N",
        help="most episodes with a page of their own, about 2 MB each, in the folder FILE_pages (default %(default)s)",
    )
    add_processes(verb)
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Measures all bags and writes the page."""
    if arguments.out.suffix.lower() not in {".html", ".htm"}:
        raise InputError("out", str(arguments.out), "a file name that ends in .html")
    jobs = processes_of(arguments)
    models = names_in(arguments.models)
    if not models:
        raise InputError("models", arguments.models, "one or several predictors, by commas")
    if arguments.pages < 0:
        raise InputError("pages", arguments.pages, "a number of episodes, 0 for none")
    folder = arguments.out.with_name(f"{arguments.out.stem}_pages")
    options = PageOptions(models, arguments.detection, arguments.risk, jobs, pages=arguments.pages, pages_folder=folder)
    with tqdm(unit="bag", desc="report", disable=None) as bar:
        page, pages = build_page(arguments.dir, options, bar.reset, steps_of(bar))
    content = html_of(page)
    with writing(arguments.out):
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
    write_text(arguments.out, content)
    print(f"{arguments.out}: {len(page.sections)} sections, {len(content) / 1e6:.1f} MB")
    written, size_bytes, missing = pages.write(jobs)
    if written:
        print(f"{folder}: {written} pages of episodes, {size_bytes / 1e6:.1f} MB")
    for text in missing:
        complain(f"siren report: no page of {text}")
    return EXIT_OK
