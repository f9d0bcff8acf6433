"""``siren evaluate risk`` on a small set, and what it refuses."""

import json
from pathlib import Path

import pytest
from evaluation.made_video_sets import draw_films, small_video_set
from evaluation.risk.vlm.chat_server import Behaviour, chat_server

from siren_ros.cli.main import main
from siren_ros.scoring.evaluation.risk.video_set import read_set, write_set


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


def test_rows_files_and_pictures(folder: Path, answers: Path, siren) -> None:
    out = folder / "out"
    words = ["evaluate", "risk", str(folder), "--predictions", f"mine={answers}", "--out", str(out), "--compare-paper"]
    printed = siren(words).out.splitlines()
    lines = {line.split()[0]: line for line in reversed(printed) if line}
    assert "does not list the episodes of its training" in printed[-1]
    assert "50.00" in lines["mine"]
    assert "100.00" in lines["oracle"]
    assert "70.48" in lines["Qwen3.5-9B"]
    scores = json.loads(out.joinpath("scores.json").read_text())["models"]
    assert scores["sequence"]["seen"] == {}
    assert scores["mine"]["confusion"] == [[1, 1, 0, 1], [0, 1, 1, 0], [0, 0, 1, 0]]
    pictures = {f"confusion_{name}.png" for name in ("mine", "majority", "template_prior", "sequence", "oracle")}
    assert {path.name for path in out.iterdir()} == {"scores.csv", "scores.tex", "scores.json", *pictures}


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--predictions", "oracle={answers}"], "oracle"),
        (["--predictions", "a={answers}", "--predictions", "a={answers}"], "each name once"),
        (["--predictions", "a={answers}.none"], "No such file"),
    ],
)
def test_bad_input_ends_with_2(folder, answers, words, named, siren) -> None:
    assert named in siren(["evaluate", "risk", str(folder), *(word.format(answers=answers) for word in words)], 2).err


def test_missing_answers_have_to_be_allowed(folder: Path, answers: Path, siren) -> None:
    answers.write_text('{"S4_000": "Normal"}')
    words = ["evaluate", "risk", str(folder), "--predictions", f"a={answers}"]
    assert "5 videos without an answer, first S4_001" in siren(words, 2).err
    assert "1/6" in siren([*words, "--allow-missing"]).out


@pytest.fixture
def films(folder: Path) -> Path:
    """The set with its pictures."""
    draw_films(folder)
    return folder


def test_a_model_behind_a_server_is_asked_and_scored(films: Path, siren) -> None:
    pytest.importorskip("openai", reason="the extra vlm is not installed")
    out = films / "out"
    with chat_server(lambda _, __: Behaviour('{"class": "Near-Miss", "reason": "close"}')) as server:
        words = ["evaluate", "risk", str(films), "--base-url", server.url, "--model", "org/m", "--out", str(out)]
        printed = siren([*words, "--price", "1,10"]).out
        assert "12 questions, 0 of them answered before, 0 answers unreadable; 12000 tokens in, 240 out" in printed
        assert "cost 0.01" in printed
        assert "12 questions, 12 of them answered before" in siren(words).out
    assert len(server.requests) == 12
    answers = json.loads(out.joinpath("answers_org_m.json").read_text())
    assert answers == dict.fromkeys(read_set(films).videos, "Near-Miss")
    assert main(["evaluate", "risk", str(films), "--predictions", f"m={out / 'answers_org_m.json'}"]) == 0


def test_what_a_model_needs(films: Path, siren, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("openai", reason="the extra vlm is not installed")
    words = ["evaluate", "risk", str(films), "--model", "m"]
    assert "base-url" in siren(words, 2).err
    with chat_server(lambda _, __: Behaviour(status=401)) as server:
        words += ["--base-url", server.url, "--retries", "0"]
        monkeypatch.delenv("NO_SUCH_KEY", raising=False)
        assert "NO_SUCH_KEY" in siren([*words, "--api-key-env", "NO_SUCH_KEY"], 2).err
        monkeypatch.setenv("A_KEY", "very-secret")
        said = siren([*words, "--api-key-env", "A_KEY"], 1)
        assert "401" in said.err
        assert "very-secret" not in said.err + said.out
        assert server.keys == ["Bearer very-secret"] * len(server.keys)
        assert server.keys
    films.joinpath("videos/S6_004.mp4").unlink()
    assert "1 videos without their file, first S6_004" in siren(words, 2).err
