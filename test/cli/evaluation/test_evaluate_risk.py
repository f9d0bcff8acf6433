"""``siren evaluate risk`` on a small set, and what it refuses."""

import json
from pathlib import Path

import pytest
from evaluation.made_video_sets import small_video_set

from siren_ros.cli.main import main
from siren_ros.evaluation.risk.video_set import write_set


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_set(small_video_set(tmp_path))
    return tmp_path


@pytest.fixture
def answers(folder: Path) -> Path:
    path = folder / "answers.json"
    given = {"S4_000": "Normal", "S4_001": "Near-Miss", "S4_002": "Near-Miss", "S6_003": "unreadable"}
    path.write_text(json.dumps({**given, "S6_004": "Collision", "S6_005": "Collision"}))
    return path


def test_rows_files_and_pictures(folder: Path, answers: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = folder / "out"
    words = ["evaluate", "risk", str(folder), "--predictions", f"mine={answers}", "--out", str(out), "--compare-paper"]
    assert main(words) == 0
    lines = {line.split()[0]: line for line in reversed(capsys.readouterr().out.splitlines()) if line}
    assert "50.00" in lines["mine"]
    assert "100.00" in lines["oracle"]
    assert "70.48" in lines["Qwen3.5-9B"]
    scores = json.loads(out.joinpath("scores.json").read_text())["models"]
    assert scores["mine"]["confusion"] == [[1, 1, 0, 1], [0, 1, 1, 0], [0, 0, 1, 0]]
    assert {path.name for path in out.iterdir()} == {
        "scores.csv",
        "scores.tex",
        "scores.json",
        "confusion_mine.png",
        "confusion_majority.png",
        "confusion_oracle.png",
    }


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--predictions", "oracle={answers}"], "oracle"),
        (["--predictions", "a={answers}", "--predictions", "a={answers}"], "each name once"),
        (["--predictions", "a={answers}.none"], "No such file"),
    ],
)
def test_bad_input_ends_with_2(
    folder: Path, answers: Path, words: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evaluate", "risk", str(folder), *(word.format(answers=answers) for word in words)]) == 2
    assert named in capsys.readouterr().err


def test_missing_answers_have_to_be_allowed(folder: Path, answers: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answers.write_text('{"S4_000": "Normal"}')
    words = ["evaluate", "risk", str(folder), "--predictions", f"a={answers}"]
    assert main(words) == 2
    assert "5 videos without an answer, first S4_001" in capsys.readouterr().err
    assert main([*words, "--allow-missing"]) == 0
    assert "1/6" in capsys.readouterr().out
