"""``siren exam BAG...``: grades how a driver made way, by a rulebook."""

import argparse
from functools import partial
from pathlib import Path

from siren_ros.cli.options import add_bags, add_processes, of_each_bag, processes_of
from siren_ros.errors import EXIT_FAILED, EXIT_OK, InputError, write_text, writing
from siren_ros.exam.certificate import Certificate, as_json, as_junit, page_of
from siren_ros.exam.grading import Sitting, examine
from siren_ros.exam.rulebook import FOLDER, Rulebook, load_rulebook
from siren_ros.params.resources import names_in_params
from siren_ros.recording.bag_reader import bags_among, read_episode
from siren_ros.study_report.page import html_of, quoted
from siren_ros.tables.table import text_of
from siren_ros.world.actors import NO_ACTOR


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Grades the driver of the AV under test in recorded episodes, clause by clause of a rulebook: pass, minor, "
        "major, or not applicable. --out writes a certificate as HTML, JSON and JUnit XML. The exit code is 1 if a "
        "clause is violated gravely, or if none is applicable."
    )
    add_bags(verb)
    verb.add_argument(
        "--rulebook",
        default="international",
        metavar="NAME",
        help=f"one of {', '.join(names_in_params(FOLDER))}, or a YAML file (default %(default)s)",
    )
    verb.add_argument("--actor", type=int, metavar="ID", help="the driver (default: the AV under test)")
    verb.add_argument("--driver", default="", metavar="TEXT", help="name of the driver on the certificate")
    verb.add_argument("--out", type=Path, metavar="DIR", help="folder for certificate.html, .json and .xml")
    add_processes(verb)
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Grades every bag; one that cannot be read does not keep the others from being graded."""
    rulebook = load_rulebook(arguments.rulebook)
    bags = bags_among(arguments.bags)
    sit = partial(sit_in_bag, actor_id=arguments.actor, rulebook=rulebook)
    sittings, worst = of_each_bag(sit, bags, processes_of(arguments))
    name = arguments.driver or ("the AV under test" if arguments.actor is None else f"actor {arguments.actor}")
    certificate = Certificate(name, rulebook, tuple(sorted(sittings, key=lambda sitting: sitting.bag)))
    print("\n".join(text_of([certificate.summary()])))
    if arguments.out is not None:
        _write(arguments, certificate)
    return max(worst, EXIT_OK if certificate.passed else EXIT_FAILED)


def sit_in_bag(bag: Path, actor_id: int | None, rulebook: Rulebook) -> Sitting:
    """The marks of a bag's AV under test, or of another driver.

    Raises:
        InputError: The bag has no AV and no driver is named, or it has no such driver.
    """
    record = read_episode(bag)
    chosen = record.description.av_id if actor_id is None else actor_id
    if chosen == NO_ACTOR:
        raise InputError("bag", str(bag), "an episode with an AV under test, or --actor")
    return examine(record, chosen, rulebook, str(bag))


def _write(arguments: argparse.Namespace, certificate: Certificate) -> None:
    out: Path = arguments.out
    actor = [] if arguments.actor is None else [f"--actor {arguments.actor}"]
    bags = [quoted(bag) for bag in arguments.bags]
    words = ["./env siren exam", *bags, f"--rulebook {arguments.rulebook}", *actor, f"--out {quoted(out)}"]
    with writing(out, "folder"):
        out.mkdir(parents=True, exist_ok=True)
    write_text(out / "certificate.html", html_of(page_of(certificate, " ".join(words))))
    write_text(out / "certificate.json", as_json(certificate))
    write_text(out / "certificate.xml", as_junit(certificate))
    print(f"{out}: certificate.html, certificate.json, certificate.xml")
