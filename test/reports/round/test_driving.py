"""A round of the exam from its making to its verification: drivers that are graded, refused, or forged."""

import json
import shutil
from pathlib import Path

import pytest
from recorded_episode import quick_template
from repository import REPOSITORY
from signing_keys import made_keys

from siren_ros.base.params.folders import params_dir
from siren_ros.cli.main import main
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.reports.round.board import verify_round
from siren_ros.running.seat.drivers.learned import SHIPPED
from siren_ros.simulation.world.commands import AV_SOURCE

MADE = ["--levels", "L3", "--seeds", "0", "--duration-s", "2", "--workers", "1"]
THIEF = """
import os, pathlib
places = [pathlib.Path(place) for place in ("PRIVATE/salt", "PRIVATE/plan.json", f"/proc/{os.getppid()}/cmdline")]
found = []
for place in places:
    try:
        found.append(place.read_bytes())
    except OSError:
        pass
raise SystemExit(f"{len(found)} secrets")
"""
"""Reads the secret and the command line of the program that makes the episode, in place of driving."""


def test_a_round_of_drivers_from_make_to_verify(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    held, submissions, published = (tmp_path / name for name in ("round", "submissions", "published"))
    words = ["--task", "exam", "--rulebook", "california", "--templates", quick_template("S2"), *MADE]
    assert main(["round", "make", str(held), *words]) == 0
    told = json.loads((held / "public" / "round.json").read_text())
    assert told["rules"]["rulebook"] == "california"
    question = json.loads((held / "public" / "questions" / "episode001.json").read_text())
    assert question.keys() == {"episode", "map"}
    submissions.mkdir()
    lawful = submissions / "lawful.txt"
    assert main(["round", "answer", str(held / "public"), "--model", "lawful-california", "--out", str(lawful)]) == 0
    for suffix in (".onnx", ".json"):
        shutil.copy((params_dir() / SHIPPED).with_suffix(suffix), submissions / f"network{suffix}")
    (submissions / "broken.onnx").write_bytes((params_dir() / SHIPPED).read_bytes())  # without its card
    (submissions / "nobody.txt").write_text("/etc/passwd")
    programs = {
        "thief": THIEF.replace("PRIVATE", str(held / "private")),
        "policy": (REPOSITORY / "examples" / "av_policy.py").read_text(encoding="utf-8"),
    }
    for name, source in programs.items():
        (submissions / name).mkdir()
        (submissions / name / "run.py").write_text(source)
        (submissions / name / "command").write_text("python3 run.py\n")
    assert main(["round", "score", str(held), str(submissions), "--workers", "1"]) == 1
    board = json.loads((held / "scores" / "board.json").read_text())
    assert {row["model"] for row in board["rows"]} == {"lawful", "network", "policy"} == board["told"].keys()
    assert board["told"]["lawful"]["grade"] == "pass"
    assert board["told"]["lawful"]["passed"] == "no"  # one episode covers too little
    assert board["told"]["lawful"]["covered: traffic"] == 1
    assert board["refused"].keys() == {"broken", "nobody", "thief"}
    assert "0 secrets" in board["refused"]["thief"]
    assert str(tmp_path) not in json.dumps(board)
    private, public = made_keys(tmp_path, "organiser")
    assert main(["round", "publish", str(held), "--out", str(published), "--sign", str(private)]) == 0
    kept = held / "public" / "round.json"
    verify = ["round", "verify", str(published), "--kept", str(kept), "--public-key", str(public), "--workers", "1"]
    assert main(verify) == 0
    (published / "board.json").write_text((published / "board.json").read_text() + " ")
    assert main(verify) == 1
    assert "board.json is not what the owner of organiser_public.pem signed" in capsys.readouterr().err
    assert told["rules"]["rulebook_sha256"] in (published / "board.html").read_text()
    bag = published / "answers" / "lawful" / "episode001"
    assert read_episode(bag).commands[AV_SOURCE]
    shutil.rmtree(bag)
    shutil.copytree(held / "private" / "bags" / "episode001", bag)
    wrong = verify_round(published, kept)
    assert "lawful: episode001 does not follow from the salt and its controls" in wrong
    assert "answers of board.json do not follow from the answers" in wrong


@pytest.mark.parametrize("rulebook", ["atlantis", "FILE"])
def test_a_round_needs_a_rulebook_that_everybody_has(
    tmp_path: Path, rulebook: str, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "california.yaml"
    shutil.copy(params_dir() / "rulebooks" / "california.yaml", own)
    words = ["--task", "exam", "--rulebook", rulebook.replace("FILE", str(own))]
    assert main(["round", "make", str(tmp_path / "round"), *words]) == 2
    assert "rulebook" in capsys.readouterr().err
