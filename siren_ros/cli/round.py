"""``siren round``: a benchmark whose answers nobody can know before: make, score, publish, verify, answer."""

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from tqdm import tqdm

from siren_ros.base.processes.asked_program import ANSWER_S, MEMORY_MB
from siren_ros.base.tables import text_of
from siren_ros.cli.command import complain
from siren_ros.cli.generate import add_matrix, asked_of
from siren_ros.cli.options import add_processes, processes_of, steps_of
from siren_ros.errors import EXIT_FAILED, EXIT_OK
from siren_ros.reports.round.board import publish_round, score_round, tables_of, verify_round
from siren_ros.reports.round.sealed_round import MAPS, PUBLIC, QUESTIONS, make_round, read_content
from siren_ros.running.studies.matrix import Study
from siren_ros.scoring.evaluation.prediction.predictors import PREDICTORS, causal_answer, predictors_named
from siren_ros.scoring.evaluation.prediction.questions import batch_of, rows_of, write_answers
from siren_ros.simulation.roads.net_parser import parse_road_network

_DEFAULT: Final = Study(("S2", "S3", "S4"), seeds=(0, 1))


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Holds a round of trajectory prediction on sealed episodes: participants get one question of each, and the "
        "salt from which all episodes follow when the round is over."
    )
    actions = verb.add_subparsers(title="actions", metavar="ACTION", required=True)

    def action(name: str, run: Callable[[argparse.Namespace], int], meaning: str) -> argparse.ArgumentParser:
        line = actions.add_parser(name, help=meaning, description=f"{meaning[0].upper()}{meaning[1:]}.")
        line.set_defaults(run=run)
        return line

    line = action("make", make, "make sealed episodes and their questions; only the folder public leaves your machine")
    line.add_argument("round", type=Path, metavar="ROUND", help="new folder of the round")
    add_matrix(line.add_argument_group("the matrix of the episodes"), "S2 S3 S4", "their own", "0:2")
    add_processes(line)
    line = action("answer", answer, "answer the questions of a round with a predictor of the project")
    line.add_argument("public", type=Path, metavar="PUBLIC", help="public folder of the round")
    names = ", ".join(PREDICTORS)
    line.add_argument(
        "--model", default="siren", choices=tuple(PREDICTORS), metavar="NAME", help=f"{names} (default %(default)s)"
    )
    line.add_argument("--out", type=Path, metavar="FILE.parquet", required=True, help="file of predictions to write")
    line = action("score", score, "score submissions: NAME.parquet, or folders NAME with a program's command line")
    line.add_argument("round", type=Path, metavar="ROUND", help="folder of the round")
    line.add_argument("submissions", type=Path, metavar="DIR", help="folder with the submissions")
    line.add_argument("--container", default="", metavar="IMAGE", help="run programs in a container of this image")
    line.add_argument(
        "--answer-s", type=float, default=ANSWER_S, metavar="S", help="time of an answer (default %(default)g)"
    )
    line.add_argument(
        "--memory-mb", type=int, default=MEMORY_MB, metavar="MB", help="memory of a program (default %(default)d)"
    )
    line = action("publish", publish, "write salt, plan, answers and board for everybody")
    line.add_argument("round", type=Path, metavar="ROUND", help="folder of the round")
    line.add_argument("--out", type=Path, metavar="FOLDER", required=True, help="new folder to publish")
    line = action("verify", verify, "check that episodes follow from the salt, and the board from the answers")
    line.add_argument("published", type=Path, metavar="FOLDER", help="published folder")
    line.add_argument("--kept", type=Path, metavar="round.json", help="the file that you got when the round began")
    add_processes(line)


def make(arguments: argparse.Namespace) -> int:
    """Makes the round."""
    study = replace(_DEFAULT, **asked_of(arguments))
    with tqdm(unit="episode", desc="round", disable=None) as bar:
        content = make_round(study, arguments.round, processes_of(arguments), steps_of(bar))
    print(f"{arguments.round / PUBLIC}: {len(content['episodes'])} questions; commitment {content['commitment']}")
    return EXIT_OK


def answer(arguments: argparse.Namespace) -> int:
    """Writes a predictor's answers."""
    predictor, rows = predictors_named([arguments.model])[arguments.model], []
    networks: dict[str, Any] = {}
    for file in sorted((arguments.public / QUESTIONS).glob("*.json")):
        question = read_content(file, "episode", "map")
        if (name := str(question["map"])) not in networks:
            networks[name] = parse_road_network((arguments.public / MAPS / f"{Path(name).name}.net.xml").read_bytes())
        batch = batch_of(question, networks[name])
        rows += rows_of(question["episode"], batch, causal_answer(arguments.model, predictor, batch)[0])
    write_answers(arguments.out, rows)
    print(f"{arguments.out}: {len(rows)} paths")
    return EXIT_OK


def score(arguments: argparse.Namespace) -> int:
    """Scores every submission; the exit code is 1 if one is refused or flagged."""
    board = score_round(
        arguments.round,
        arguments.submissions,
        answer_s=arguments.answer_s,
        memory_mb=arguments.memory_mb,
        container=arguments.container,
    )
    print("\n".join(text_of(tables_of(board))))
    for name, reason in board["refused"].items():
        complain(f"siren round: {name} is refused: {reason}")
    for name, error_m in board["flagged"].items():
        complain(f"siren round: {name} is flagged: its error of {error_m:.3f} m is below the floor of any model")
    return EXIT_FAILED if board["refused"] or board["flagged"] else EXIT_OK


def publish(arguments: argparse.Namespace) -> int:
    """Writes the folder for everybody."""
    publish_round(arguments.round, arguments.out)
    print(f"{arguments.out}: board.html, board.json, board.csv; the episodes of the round are no secret any more")
    return EXIT_OK


def verify(arguments: argparse.Namespace) -> int:
    """Says what does not follow; the exit code is then 1."""
    with tqdm(unit="episode", desc="verify", disable=None) as bar:
        wrong = verify_round(arguments.published, arguments.kept, processes_of(arguments), steps_of(bar))
    for line in wrong:
        complain(f"siren round: {line}")
    if not wrong:
        print(f"{arguments.published}: the episodes follow from the salt, and the board from the answers")
    return EXIT_FAILED if wrong else EXIT_OK
