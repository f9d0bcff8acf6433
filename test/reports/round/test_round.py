"""Tests of a round from its making to its verification: honest, broken and cheating submissions, forged boards."""

import json
import os
import shutil
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from recorded_episode import quick_template

from siren_ros.cli.main import main
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import InputError
from siren_ros.reports.round.board import BOARD_FILE, make_round, publish_round, score_round, verify_round
from siren_ros.reports.round.prediction import questions_with_truth, take
from siren_ros.reports.round.sealed_round import question_file, read_plan, request_in
from siren_ros.running.generation.closed_loop import closed_loop, record_of
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.running.studies.matrix import Study
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses, predictors_named
from siren_ros.scoring.evaluation.prediction.questions import (
    batch_of,
    content_of,
    errors_of,
    rows_in,
    rows_of,
    write_answers,
)
from siren_ros.scoring.evaluation.prediction.samples import ScoredSamples, future_offsets
from siren_ros.scoring.evaluation.prediction.submission import read_prediction_file, submission

DURATION_S = 11.0
THIEF = """
import json, os, pathlib, sys
kept = []
for line in sys.stdin:
    question = json.loads(line)
    kept.append(question)
    leaks = int(sys._getframe().f_back is not None)
    places = [f"/proc/{os.getppid()}/mem", f"/proc/{os.getppid()}/environ", *pathlib.Path("PRIVATE").glob("**/*")]
    for place in (*places, "PRIVATE/plan.json", "PRIVATE/salt", "../cv.parquet"):
        try:
            open(place, "rb").read(1)
            leaks += 1
        except OSError:
            pass
    same = [one for one in kept[:-1] if one["episode"] == question["episode"]]
    leaks += len(same)
    asked = [one for one in question["actors"] if one["asked"]]
    still = {one["id"]: [[1.0, [[one["x_m"][-1] + 1e3 * leaks, one["y_m"][-1]]] * 25]] for one in asked}
    print(json.dumps({"paths": still}), flush=True)
"""
"""Opens the bags, looks into the caller's frame and the process that asks, and remembers its questions. What it finds
moves its answers."""
ENGINE = """#!PYTHON
import os, pathlib, sys
words = sys.argv[1:]
seen = {word.split(":")[1]: word.split(":")[0] for place, word in enumerate(words) if words[place - 1] == "-v"}
home = words.index("-w")
assert words[home + 1 : home + 3] == ["/submission", "python:3.12"] and words[-1] == "/read", words
assert list(pathlib.Path(seen["/read"]).glob("*.net.xml"))
pathlib.Path(sys.argv[0] + ".ran").touch()
os.chdir(seen["/submission"])
os.execvp(words[home + 3], [seen.get(word, word) for word in words[home + 3 :]])
"""
"""Stands for Docker: checks the two folders of a container, and runs the program without one."""
WALKS_ON = """
import json, sys
for line in sys.stdin:
    paths = {}
    for one in json.loads(line)["actors"]:
        x, y, vx, vy = (one[name][-1] for name in ("x_m", "y_m", "vx_mps", "vy_mps"))
        if one["asked"]:
            paths[one["id"]] = [[1.0, [[x + 0.2 * n * vx, y + 0.2 * n * vy] for n in range(1, 26)]]]
    print(json.dumps({"paths": paths}), flush=True)
"""
Questions = Mapping[str, ScoredSamples]


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A round of two short episodes, with a salt that is the same in each run."""
    folder = tmp_path_factory.mktemp("round") / "round"
    study = Study((quick_template("S2"), quick_template("S3")), duration_s=DURATION_S)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("secrets.token_bytes", lambda count: bytes(range(count)))
        make_round(study, folder)
    return folder


@pytest.fixture(scope="module")
def questions(held: Path) -> Questions:
    private = held / "private"
    return questions_with_truth(read_plan(private), private, private / "bags")


def error_m(questions: Questions, file: Path) -> float:
    """Mean error of a file of answers."""
    return float(np.concatenate(errors_of(questions, submission(read_prediction_file(file, 10_000)))).mean())


def program(folder: Path, source: str) -> None:
    folder.mkdir()
    (folder / "run.py").write_text(source)
    (folder / "command").write_text("python3 run.py\n")


@pytest.fixture(scope="module")
def scored(held: Path, questions: Questions) -> Path:
    """The round with the scores of seven submissions, of which two cheat and two are broken."""
    submissions = held.parent / "submissions"
    submissions.mkdir()
    for model in ("cv", "siren"):
        out = str(submissions / f"{model}.parquet")
        assert main(["round", "answer", str(held / "public"), "--model", model, "--out", out]) == 0
    program(submissions / "walks_on", WALKS_ON)
    program(submissions / "thief", THIEF.replace("PRIVATE", str(held / "private")))
    told = [rows_of(name, one.batch, Hypotheses.certain(one.future_xy_m)) for name, one in questions.items()]
    write_answers(submissions / "knows.parquet", [row for rows in told for row in rows])
    honest = pq.read_table(submissions / "cv.parquet")
    nothing = [[float("nan")] * len(path) for path in honest["y"].to_pylist()]
    pq.write_table(honest.set_column(6, "y", [nothing]), submissions / "broken.parquet")
    far = [[*path[:-1], 1e200] for path in honest["y"].to_pylist()]
    pq.write_table(honest.set_column(6, "y", [far]), submissions / "huge.parquet")
    assert main(["round", "score", str(held), str(submissions)]) == 1
    return held


def board_in(folder: Path) -> Any:
    return json.loads((folder / BOARD_FILE).read_text())


def test_who_cheats_gains_nothing_and_who_is_broken_stops_nobody(scored: Path) -> None:
    board = board_in(scored / "scores")
    values = {row["model"]: row["value"] for row in board["rows"]}
    assert set(values) == {"cv", "siren", "walks_on", "thief"}
    assert values["walks_on"] == pytest.approx(values["cv"], abs=1e-9)
    assert max(values.values()) == values["thief"] < 100.0  # no leak, of which each adds a kilometre
    assert board["flagged"] == {"knows": "its error of 0.000 m is below the floor of any model"}
    assert 0.0 < board["floor"]["ade_m"] < min(values.values())
    assert set(board["refused"]) == {"broken", "huge"}
    assert "leave the Earth" in board["refused"]["huge"]
    assert "not finite" in board["refused"]["broken"]
    assert str(scored.parent) not in json.dumps(board)
    assert {name: one["kind"].split(",")[0] for name, one in board["submissions"].items()} == {
        **dict.fromkeys(("cv", "siren", "knows", "broken", "huge"), "file"),
        **dict.fromkeys(("walks_on", "thief"), "program"),
    }


def test_a_round_is_verified_by_anybody_and_a_forged_one_is_not(scored: Path, tmp_path: Path) -> None:
    published = tmp_path / "published"
    publish_round(scored, published)
    assert verify_round(published, scored / "public" / "round.json") == ()
    assert {"board.html", "board.csv", "salt", "plan.json"} <= {file.name for file in published.iterdir()}
    board = board_in(published)
    better = [{**row, "value": 0.5 * row["value"]} for row in board["rows"]]
    (published / BOARD_FILE).write_text(json.dumps({**board, "rows": better}))
    shutil.copyfile(published / "answers" / "siren.parquet", published / "answers" / "thief.parquet")
    first = question_file(published, "episode001")
    first.write_text(first.read_text().replace('"asked": true', '"asked": false', 1))
    other = tmp_path / "round.json"
    other.write_text(json.dumps({**json.loads((published / "round.json").read_text()), "commitment": "0" * 64}))
    assert {line.split(" of ")[0] for line in verify_round(published, other)} == {
        "round.json is not the one that participants got",
        "episode001: the file",
        "rows",
        "differences",
        "answers",
    }
    plan = published / "plan.json"
    plan.write_text(plan.read_text().replace('"episode001"', '"../outside"'))
    with pytest.raises(InputError, match="names as episode001"):
        verify_round(published)
    (published / "round.json").write_text(json.dumps({"episodes": 3, "versions": {}, "commitment": "0" * 64}))
    plan.write_text(plan.read_text().replace('"../outside"', '"episode001"'))
    (published / "salt").write_text("00" * 16)
    with pytest.raises(InputError, match="committed"):
        verify_round(published)


def test_what_participants_get_is_the_past_and_nothing_else(held: Path, questions: Questions) -> None:
    plan, about = read_plan(held / "private"), json.loads((held / "public" / "round.json").read_text())
    assert not {*about} & {"salt", "plan", "seeds"}
    public = "".join(file.read_text() for file in (held / "public").rglob("*.json"))
    assert not any(word in public for word in ("S2", "S3", "town", "sealed", "seed", str(held)))
    for one in plan["episodes"]:
        content = json.loads(question_file(held / "public", one["name"]).read_text())
        truth = questions[one["name"]]
        again = batch_of(content, truth.batch.network)
        assert content_of(one["name"], content["map"], again) == content
        last = {(actor["x_m"][-1], actor["y_m"][-1]) for actor in content["actors"]}
        record = read_episode(held / "private" / "bags" / one["name"])
        states = record.states[content["step"]]
        assert last <= set(zip(states.x_m.tolist(), states.y_m.tolist(), strict=True))
        model = predictors_named(["idm"])["idm"]
        assert np.array_equal(model.predict(again).xy_m, model.predict(truth.batch).xy_m)


def test_who_simulates_the_right_template_and_seed_again_gains_nothing(held: Path, questions: Questions) -> None:
    replayed, walking, private = [], [], held / "private"
    for one in read_plan(private)["episodes"]:
        name, batch = one["name"], questions[one["name"]].batch
        setup = set_up_episode(replace(request_in(one, private), salt=""))
        rows, step = record_of(setup, list(closed_loop(setup, setup.steps))).rows, int(batch.step[0])
        paths = []
        for here in batch.xy_m:  # each vehicle goes on as the one at its place in the simulation, or the nearest one
            now = np.flatnonzero(rows.step == step)
            twin = rows.actor_id[now[np.argmin(np.hypot(*(rows.xy_m[now] - here).T))]]
            track = rows.select(np.flatnonzero((rows.actor_id == twin) & (rows.step >= step)))
            moved = track.xy_m[np.minimum(2 * future_offsets(), len(track) - 1)] - track.xy_m[0]
            paths.append(here + moved)
        replayed += rows_of(name, batch, Hypotheses.certain(np.array(paths)))
        walking += rows_of(name, batch, predictors_named(["cv"])["cv"].predict(batch))
    for name, answers in (("replayed", replayed), ("cv", walking)):
        write_answers(held / f"{name}.parquet", answers)
    assert error_m(questions, held / "replayed.parquet") > error_m(questions, held / "cv.parquet")


def test_answers_that_are_none_are_refused_and_without_any_there_is_no_board(held: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="submissions"):
        score_round(held, tmp_path)
    answer: Any
    for answer in ([], {"paths": {"a": [[1.0, [[0.0, 0.0]]]]}}, {"paths": {"1": [[1.0, [[0.0]]]]}}, {"paths": None}):
        with pytest.raises(InputError, match="answer"):
            rows_in({"episode": "a", "step": 3}, answer)


def test_a_program_in_a_container_answers_like_one_in_a_process(
    held: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine = tmp_path / "bin" / "docker"
    engine.parent.mkdir()
    engine.write_text(ENGINE.replace("PYTHON", sys.executable))
    engine.chmod(0o755)
    monkeypatch.setenv("PATH", str(engine.parent), prepend=os.pathsep)
    program(tmp_path / "walks_on", WALKS_ON)
    private = held / "private"
    asked = [
        take(tmp_path / "walks_on", tmp_path / f"answers{image}", private, read_plan(private), (20.0, 512, image, 1))
        for image in ("", "python:3.12")
    ]
    assert (tmp_path / "bin" / "docker.ran").exists()
    assert pq.read_table(asked[0]).equals(pq.read_table(asked[1]))
