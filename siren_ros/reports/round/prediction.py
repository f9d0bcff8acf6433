"""Rounds of trajectory prediction: one question of each episode, answered by files or by programs within limits."""

import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.base.params.plain_files import load_json
from siren_ros.base.processes.asked_program import READ_AT, asked_program, container_words
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError
from siren_ros.reports.round.sealed_round import (
    MAPS,
    QUESTIONS,
    command_in,
    public_of,
    question_file,
    read_content,
    request_in,
    strata_of,
)
from siren_ros.scoring.evaluation.prediction.predictors import causal_answer, predictors_named
from siren_ros.scoring.evaluation.prediction.questions import (
    Answer,
    Content,
    batch_of,
    content_of,
    errors_of,
    floor_of,
    question_of,
    rows_in,
    rows_of,
    write_answers,
)
from siren_ros.scoring.evaluation.prediction.samples import ScoredSamples
from siren_ros.scoring.evaluation.prediction.submission import ROWS_OF_FRAME, read_prediction_file, submission
from siren_ros.scoring.evaluation.statistics import BlockSums, block_sums, interval_of_mean
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.sealing import seed_of

Limits = tuple[float, int, str, int]
"""Wall time of an answer in seconds, memory of a process in MB, image of a container, and processes at once."""
FLOOR_MODELS: Final = ("cv", "idm_stop", "ca", "ctra", "cv_lane", "decay_lane", "decay_stop", "imm", "siren")
"""Models of the floor: those of the project that need no other package."""


def question(name: str, request: EpisodeRequest, record: EpisodeRecord, _bag: Path, _public: Path) -> Content:
    """The question of an episode."""
    return content_of(name, record.description.map_sha256, _drawn(record, request).batch)


def _drawn(record: EpisodeRecord, request: EpisodeRequest) -> ScoredSamples:
    return question_of(record, random_stream(seed_of(request), "round/question"))


def questions_with_truth(plan: Content, folder: Path, bags: Path) -> dict[str, ScoredSamples]:
    """The questions of a plan with their answers, from the bags.

    Raises:
        BagError: A bag cannot be read.
    """
    names = {one["name"]: request_in(one, folder) for one in plan["episodes"]}
    return {name: _drawn(read_episode(bags / name), request) for name, request in names.items()}


def answer(public: Path, model: str, out: Path) -> int:
    """Answer the questions of a round with a predictor of the project; gives the number of paths."""
    predictor, rows = predictors_named([model])[model], []
    networks: dict[str, Any] = {}
    for file in sorted((public / QUESTIONS).glob("*.json")):
        asked = read_content(file, "episode", "map")
        if (name := str(asked["map"])) not in networks:
            networks[name] = parse_road_network((public / MAPS / f"{Path(name).name}.net.xml").read_bytes())
        batch = batch_of(asked, networks[name])
        rows += rows_of(asked["episode"], batch, causal_answer(model, predictor, batch)[0])
    write_answers(out, rows)
    return len(rows)


def take(given: Path, out: Path, folder: Path, plan: Content, limits: Limits) -> Path:
    """The file of answers of a submission, which is such a file or a program's folder."""
    file = out.with_name(f"{out.name}.parquet")
    if given.is_dir():
        names = [one["name"] for one in plan["episodes"]]
        write_answers(file, _asked(given, public_of(folder), names, *limits[:3]))
    else:
        shutil.copyfile(given, file)
    return file


def _asked(
    program: Path, public: Path, names: Sequence[str], answer_s: float, memory_mb: int, container: str
) -> list[Answer]:
    """The rows that a program answers, question by question."""
    with tempfile.TemporaryDirectory(prefix="siren-maps-") as readable:
        shutil.copytree(public / MAPS, readable, dirs_exist_ok=True)
        words = command_in(program)
        processor_s = answer_s * len(names)
        if container:
            words = [*container_words(container, program, Path(readable), memory_mb, processor_s), *words]
        words = [*words, READ_AT if container else readable]
        rows: list[Answer] = []
        with asked_program(
            words,
            program,
            answer_s=answer_s,
            memory_mb=memory_mb,
            processor_s=processor_s,
            readable=() if container else (program, Path(readable)),
        ) as ask:
            for name in names:
                question = question_file(public, name).read_text(encoding="utf-8")
                try:
                    answer = load_json(ask(question))
                except ValueError as error:
                    raise InputError("answer", f"{program.name}: {error}", "a line of JSON") from error
                rows += rows_in(load_json(question), answer)
        return rows


def judge(plan: Content, folder: Path, bags: Path) -> tuple[Callable[[Path], tuple[BlockSums, str, Content]], Content]:
    """The errors of a file of answers, and why it is flagged; with the floor that flags it."""
    questions, stratum = questions_with_truth(plan, folder, bags), strata_of(plan)

    def sums_of(errors: list[Any]) -> BlockSums:
        return block_sums(np.concatenate(errors), np.repeat(np.arange(len(errors)), [*map(len, errors)]), stratum)

    floor_m = interval_of_mean(sums_of(floor_of(questions, predictors_named(FLOOR_MODELS)))).value

    def judged(file: Path) -> tuple[BlockSums, str, Content]:
        given = submission(read_prediction_file(file, ROWS_OF_FRAME * len(questions)))
        sums = sums_of(errors_of(questions, given))
        mean_m = interval_of_mean(sums).value
        return sums, f"its error of {mean_m:.3f} m is below the floor of any model" if mean_m < floor_m else "", {}

    models = ", ".join(FLOOR_MODELS)
    told = f"The floor is {floor_m:.3f} m: for each vehicle the best of all hypotheses of {models}."
    return judged, {"floor": {"models": list(FLOOR_MODELS), "ade_m": floor_m, "text": told}}
