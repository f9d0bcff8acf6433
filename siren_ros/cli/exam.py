"""``siren exam``: grades how drivers make way, by a rulebook, in recorded episodes or in a study made for it.

``siren exam compare A B`` compares two drivers by their certificates, episode by episode; ``siren exam verify`` grades
the episodes of a certificate again.
"""

import argparse
import shlex
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

from tqdm import tqdm

from siren_ros.base.params.folders import names_in_params
from siren_ros.base.params.signatures import private_key, sign
from siren_ros.base.tables import text_of
from siren_ros.cli.command import Command, complain
from siren_ros.cli.generate import MATRIX, add_matrix, asked_of
from siren_ros.cli.options import (
    add_processes,
    add_public_key,
    add_signing,
    faults_of_signature,
    of_each_bag,
    processes_of,
)
from siren_ros.data.recording.bag_reader import bags_among
from siren_ros.errors import EXIT_FAILED, EXIT_OK, InputError, shown_text
from siren_ros.reports.exam.certificate import (
    Certificate,
    compared,
    read_certificate,
    shown_again,
    violations_of,
)
from siren_ros.reports.exam.grading import FOLDER, Rulebook, Sitting, load_rulebook
from siren_ros.reports.exam.sitting import (
    about_of,
    certificate_of,
    make_exam,
    sit_in_bag,
    sit_in_made_episode,
    write_certificate,
)
from siren_ros.reports.exam.verifying import differences
from siren_ros.running.studies.episode_row import EpisodeRow
from siren_ros.running.studies.matrix import Seat, Study
from siren_ros.running.studies.run_study import RETRIES, TIMEOUT_S, LocalWorkers, StudyBar, WorkerOptions, run_study
from siren_ros.running.studies.study_folder import LocalFolder
from siren_ros.simulation.scenario.paper import TEMPLATES


def add_comparison(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Compares two certificates of the same rulebook in the episodes that both have a result for: the share of "
        "episodes with a violation, clause by clause, and what the drivers do to others, with 95 % intervals of the "
        "differences."
    )
    for name, meaning in (("first", "certificate.json of a driver"), ("second", "that of another one")):
        verb.add_argument(name, type=Path, metavar=name.upper(), help=meaning)
    verb.set_defaults(run=compare)


def compare(arguments: argparse.Namespace) -> int:
    """Prints the table."""
    print("\n".join(text_of([compared(read_certificate(arguments.first), read_certificate(arguments.second))])))
    return EXIT_OK


def add_verification(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Grades the episodes of a certificate again, found by their hashes among BAGS, and compares rulebook, marks "
        "and verdict. The exit code is 1 if anything differs or is missing."
    )
    verb.add_argument("certificate", type=Path, metavar="CERTIFICATE", help="certificate.json")
    verb.add_argument("bags", type=Path, metavar="BAGS", nargs="+", help="bags, or folders with bags at any depth")
    verb.add_argument("--rulebook", default="", metavar="FILE", help="own rulebook (default: the shipped one)")
    add_public_key(verb)
    add_processes(verb)
    verb.set_defaults(run=verify)


def verify(arguments: argparse.Namespace) -> int:
    """Prints what differs."""
    content = read_certificate(arguments.certificate)
    bags = bags_among(arguments.bags)
    found = differences(content, bags, arguments.rulebook, processes_of(arguments))
    found = (*faults_of_signature(arguments, arguments.certificate), *found)
    for line in found:
        print(line)
    print(f"{len(content['episodes'])} episodes, {len(found)} differences")
    return EXIT_FAILED if found else EXIT_OK


_DEFAULT: Final = Study(TEMPLATES, levels=("L2", "L3"), seeds=tuple(range(20)))
_LONGEST: Final = 100_000
"""Characters of the command on a certificate, which names each bag."""


def add_arguments(verb: Command) -> None:
    """Adds the description and the options of the command."""
    verb.add_variant("compare", "exam.add_comparison")
    verb.add_variant("verify", "exam.add_verification")
    verb.description = (
        "Grades a driver, clause by clause of a rulebook: pass, minor, major, or not applicable. With BAG it is the AV "
        "under test of recorded episodes. With --driver or --av the exam first makes a study in --out, with that "
        "driver at the wheel of the AV, and the same episodes with the paper's driver, to compare. --out gets a "
        "certificate as HTML, JSON and JUnit XML. The exit code is 1 if a clause is violated gravely, if "
        "none is applicable, or if an episode has no result."
    )
    verb.epilog = (
        "`siren exam compare` compares two certificates, `siren exam verify` grades one again; see their --help."
    )
    verb.add_argument("bags", type=Path, metavar="BAG", nargs="*", help="bags, or folders with bags at any depth")
    verb.add_argument(
        "--rulebook",
        default="international",
        metavar="NAME",
        help=f"one of {', '.join(names_in_params(FOLDER))}, or a YAML file (default %(default)s)",
    )
    verb.add_argument(
        "--driver",
        default="",
        metavar="NAME",
        help="driver of the AV: siren (the paper's), idm, learned, pulls-over, lawful-PLACE, FAULT-PLACE or an ONNX "
        "file; with BAG, the driver's name on the certificate",
    )
    verb.add_argument("--av", default="", metavar="PROGRAM", help="command line of a ROS program that drives the AV")
    verb.add_argument("--real-time", action="store_true", help="a step of the program's episodes takes 0.05 s")
    verb.add_argument("--actor", type=int, metavar="ID", help="the driver in BAG (default: the AV under test)")
    verb.add_argument("--alone", action="store_true", help="make no episodes with the paper's driver")
    verb.add_argument("--out", type=Path, metavar="DIR", help="folder for certificate.html, .json and .xml")
    add_signing(verb)
    add_matrix(verb.add_argument_group("the matrix of a study"), "S1 to S7", "L2 L3", "0:20")
    add_processes(verb)
    verb.add_argument(
        "--timeout-s",
        type=float,
        default=TIMEOUT_S,
        metavar="S",
        help="longest wall time of an episode (default %(default)g)",
    )
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Grades every bag, after it has made them where a seat is asked for; one without a result keeps no other back."""
    rulebook = load_rulebook(arguments.rulebook)
    seated = bool(arguments.av or (arguments.driver and not arguments.bags))
    if not seated and not arguments.bags:
        raise InputError("bags", "", "bags, --driver or --av")
    if arguments.bags and arguments.av:
        raise InputError("av", arguments.av, "no bags with it")
    if arguments.sign is not None and arguments.out is None:
        raise InputError("sign", str(arguments.sign), "--out with it")
    key = None if arguments.sign is None else private_key(arguments.sign)  # it is missed before hours of episodes
    study = _study(arguments) if seated else None
    sittings, worst = _of_bags(arguments, rulebook) if study is None else _of_study(arguments, study, rulebook)
    driver = arguments.driver or arguments.av
    certificate = certificate_of(driver, arguments.actor, rulebook, sittings, about_of(study))
    print("\n".join(text_of(certificate.tables())))
    for sitting, mark, line in violations_of(certificate.sittings):
        print(f"{line}\n    {shown_again(sitting, mark)}")
    for reason in certificate.lacks:
        complain(f"siren exam: no certificate: {reason}")
    for sitting in certificate.without_result:
        complain(f"siren exam: {sitting.episode}: no result: {sitting.lack}")
    if arguments.out is not None:
        _write(arguments, certificate)
        if key is not None:
            print(sign(arguments.out / "certificate.json", key))
    return max(worst, EXIT_OK if certificate.passed else EXIT_FAILED)


def _of_bags(arguments: argparse.Namespace, rulebook: Rulebook) -> tuple[list[Sitting], int]:
    sit = partial(sit_in_bag, actor_id=arguments.actor, rulebook=rulebook)
    return of_each_bag(sit, bags_among(arguments.bags), processes_of(arguments), "exam")


def _study(arguments: argparse.Namespace) -> Study:
    if arguments.out is None:
        raise InputError("out", "", "a folder for the episodes and the certificate")
    if arguments.av and arguments.driver:
        raise InputError("av", arguments.av, "no --driver with it")
    seat = Seat(arguments.driver, arguments.av, arguments.real_time)
    return replace(_DEFAULT, **asked_of(arguments), seat=seat)


def _of_study(arguments: argparse.Namespace, study: Study, rulebook: Rulebook) -> tuple[list[Sitting], int]:
    make = partial(_made, arguments=arguments)
    episodes, lacks = make_exam(study, arguments.out, make, paired=not arguments.alone)
    sit = partial(sit_in_made_episode, rulebook=rulebook)
    sittings, worst = of_each_bag(sit, episodes, processes_of(arguments), "exam")
    return [*sittings, *lacks], worst


def _made(study: Study, out: Path, arguments: argparse.Namespace) -> Sequence[EpisodeRow]:
    with tqdm(unit="episode", desc="exam", disable=None) as bar:
        options = WorkerOptions(RETRIES, arguments.timeout_s)
        return run_study(study, LocalFolder(out), LocalWorkers(processes_of(arguments)), options, StudyBar(bar)).rows


def _write(arguments: argparse.Namespace, certificate: Certificate) -> None:
    out: Path = arguments.out
    asked = {"--driver": arguments.driver, "--av": arguments.av}
    words = ["./env", "siren", "exam", *map(str, arguments.bags), "--rulebook", arguments.rulebook]
    words += [word for option, value in asked.items() if value for word in (option, value)]
    words += [] if arguments.actor is None else ["--actor", str(arguments.actor)]
    for name in MATRIX:
        value = getattr(arguments, name)
        if value is not None:
            words += [f"--{name.replace('_', '-')}", *map(str, value if isinstance(value, list) else [value])]
    words += ["--real-time"] * arguments.real_time + ["--alone"] * arguments.alone
    words += ["--out", str(out)]
    command = shown_text(shlex.join(words), most=_LONGEST)
    written, errors = write_certificate(certificate, out, command, processes_of(arguments))
    for error in errors:
        complain(error)
    print(f"{out}: certificate.html, certificate.json, certificate.xml, {written} pages of episodes")
