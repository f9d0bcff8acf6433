"""``siren round``: a benchmark whose answers nobody can know before: make, score, publish, verify, answer."""

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from tqdm import tqdm

from siren_ros.base.params.signatures import private_key, sign
from siren_ros.base.processes.asked_program import ANSWER_S, MEMORY_MB
from siren_ros.base.tables import text_of
from siren_ros.cli.command import complain
from siren_ros.cli.generate import add_matrix, asked_of
from siren_ros.cli.options import (
    add_processes,
    add_public_key,
    add_signing,
    faults_of_signature,
    processes_of,
    steps_of,
)
from siren_ros.errors import EXIT_FAILED, EXIT_OK, InputError
from siren_ros.reports.round.board import (
    BOARD_FILE,
    kind_of,
    make_round,
    publish_round,
    score_round,
    tables_of,
    verify_round,
)
from siren_ros.reports.round.kinds import KINDS, PREDICTION
from siren_ros.reports.round.sealed_round import PUBLIC, ROUND_FILE, read_content


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Holds a round of prediction, detection or the exam on sealed episodes: participants get a question of each, "
        "and the salt from which all episodes follow when the round is over."
    )
    actions = verb.add_subparsers(title="actions", metavar="ACTION", required=True)

    def action(name: str, run: Callable[[argparse.Namespace], int], meaning: str) -> argparse.ArgumentParser:
        line = actions.add_parser(name, help=meaning, description=f"{meaning[0].upper()}{meaning[1:]}.")
        line.set_defaults(run=run)
        return line

    line = action("make", make, "make sealed episodes and their questions; only the folder public leaves your machine")
    line.add_argument("round", type=Path, metavar="ROUND", help="new folder of the round")
    tasks = "; ".join(f"{name}: {kind.names[0]}" for name, kind in KINDS.items())
    line.add_argument("--task", default=PREDICTION, choices=tuple(KINDS), help=f"{tasks} (default %(default)s)")
    line.add_argument("--rulebook", default="international", metavar="NAME", help="of an exam (default %(default)s)")
    add_matrix(line.add_argument_group("the matrix of the episodes"), "S2 S3 S4; exam: S1 to S7", "their own", "0:2")
    add_processes(line)
    line = action("answer", answer, "answer the questions of a round with a model of the project")
    line.add_argument("public", type=Path, metavar="PUBLIC", help="public folder of the round")
    line.add_argument(
        "--model", default="siren", metavar="NAME", help="predictor, detector or driver (default %(default)s)"
    )
    line.add_argument("--out", type=Path, metavar="FILE", required=True, help="NAME.parquet, .json or .txt to write")
    line = action("score", score, "score submissions: files of answers, or folders NAME with a program's command line")
    line.add_argument("round", type=Path, metavar="ROUND", help="folder of the round")
    line.add_argument("submissions", type=Path, metavar="DIR", help="folder with the submissions")
    line.add_argument("--container", default="", metavar="IMAGE", help="run programs in a container of this image")
    line.add_argument(
        "--answer-s", type=float, default=ANSWER_S, metavar="S", help="time of an answer (default %(default)g)"
    )
    line.add_argument(
        "--memory-mb", type=int, default=MEMORY_MB, metavar="MB", help="memory of a program (default %(default)d)"
    )
    add_processes(line)
    line = action("publish", publish, "write salt, plan, answers and board for everybody")
    line.add_argument("round", type=Path, metavar="ROUND", help="folder of the round")
    line.add_argument("--out", type=Path, metavar="FOLDER", required=True, help="new folder to publish")
    add_signing(line)
    line = action("verify", verify, "check that episodes follow from the salt, and the board from the answers")
    line.add_argument("published", type=Path, metavar="FOLDER", help="published folder")
    line.add_argument("--kept", type=Path, metavar="round.json", help="the file that you got when the round began")
    add_public_key(line)
    add_processes(line)


def make(arguments: argparse.Namespace) -> int:
    """Makes the round."""
    kind = KINDS[arguments.task]
    study = replace(kind.study, **asked_of(arguments))
    how = processes_of(arguments)
    with tqdm(unit="episode", desc="round", disable=None) as bar:
        rules = kind.rules(arguments.rulebook)
        content = make_round(study, arguments.round, how, steps_of(bar), task=arguments.task, rules=rules)
    print(f"{arguments.round / PUBLIC}: {len(content['episodes'])} questions; commitment {content['commitment']}")
    return EXIT_OK


def answer(arguments: argparse.Namespace) -> int:
    """Writes a model's answers."""
    kind = kind_of(read_content(arguments.public / ROUND_FILE, "task"))
    if arguments.model not in kind.models:
        raise InputError("model", arguments.model, f"one of {', '.join(kind.models)}")
    print(f"{arguments.out}: {kind.answer(arguments.public, arguments.model, arguments.out)} answers")
    return EXIT_OK


def score(arguments: argparse.Namespace) -> int:
    """Scores every submission; the exit code is 1 if one is refused or flagged."""
    board = score_round(
        arguments.round,
        arguments.submissions,
        answer_s=arguments.answer_s,
        memory_mb=arguments.memory_mb,
        container=arguments.container,
        processes=processes_of(arguments),
    )
    print("\n".join(text_of(tables_of(board))))
    for name, reason in board["refused"].items():
        complain(f"siren round: {name} is refused: {reason}")
    for name, reason in board["flagged"].items():
        complain(f"siren round: {name} is flagged: {reason}")
    return EXIT_FAILED if board["refused"] or board["flagged"] else EXIT_OK


def publish(arguments: argparse.Namespace) -> int:
    """Writes the folder for everybody."""
    key = None if arguments.sign is None else private_key(arguments.sign)
    publish_round(arguments.round, arguments.out)
    if key is not None:
        print(sign(arguments.out / BOARD_FILE, key))
    print(f"{arguments.out}: board.html, board.json, board.csv; the episodes of the round are no secret any more")
    return EXIT_OK


def verify(arguments: argparse.Namespace) -> int:
    """Says what does not follow; the exit code is then 1."""
    with tqdm(unit="episode", desc="verify", disable=None) as bar:
        wrong = verify_round(arguments.published, arguments.kept, processes_of(arguments), steps_of(bar))
    wrong = (*faults_of_signature(arguments, arguments.published / BOARD_FILE), *wrong)
    for line in wrong:
        complain(f"siren round: {line}")
    if not wrong:
        print(f"{arguments.published}: the episodes follow from the salt, and the board from the answers")
    return EXIT_FAILED if wrong else EXIT_OK
