"""transformers in this process, with a real model of a few thousand random weights."""

import json
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra vlm-local is not installed")
transformers = pytest.importorskip("transformers", reason="the extra vlm-local is not installed")

from evaluation.made_video_sets import draw_films, small_video_set
from evaluation.risk.vlm.tiny_model import save_tiny_model

from siren_ros.cli.main import main
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.video_set import write_set
from siren_ros.scoring.evaluation.risk.vlm.clients import LocalModel
from siren_ros.scoring.evaluation.risk.vlm.pipeline import ModelUnavailableError, Question, as_jpeg

PICTURES = tuple(as_jpeg(np.full((60, 80, 3), 30 * number, np.uint8)) for number in range(8))
QUESTION = Question("You judge.", "Which class?", PICTURES)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(0)
    folder = tmp_path_factory.mktemp("models") / "tiny-1B"
    save_tiny_model(folder)
    return folder


@pytest.fixture(scope="module")
def model(folder: Path) -> LocalModel:
    return LocalModel(folder, "cpu", most_tokens=12)


def test_words_and_pictures_reach_the_model(model: LocalModel) -> None:
    reply = model.answer(QUESTION)
    assert model.name == "tiny-1B"
    # Single characters are words here, and a picture of 28 x 28 pixels is four patches.
    said = "system: You judge.|user: Which class?|assistant:"
    assert reply.prompt_tokens == len(said) + 8 * 4
    assert 0 < reply.completion_tokens <= 12
    assert 0 < len(reply.text) <= 12
    assert reply.seconds > 0.0
    assert model.answer(QUESTION).text == reply.text
    fewer = model.answer(Question(QUESTION.system, QUESTION.text, PICTURES[-1:]))
    assert fewer.prompt_tokens == len(said) + 4


def test_what_the_library_refuses_is_no_answer(model: LocalModel, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> None:
        raise RuntimeError("out of memory\nand a long dump")

    monkeypatch.setattr(transformers.GenerationMixin, "generate", fails)
    with pytest.raises(ModelUnavailableError, match=r"out of memory$"):
        model.answer(QUESTION)


def test_a_folder_without_such_a_model_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="chat template"):
        LocalModel(tmp_path, "cpu")
    config = json.loads((folder / "config.json").read_text())
    own = tmp_path / "own"
    own.mkdir()
    (own / "run.py").write_text("raise SystemExit('code of the folder was run')")
    other = {**config, "model_type": "nobodys", "auto_map": {"AutoConfig": "run.Config"}}
    (own / "config.json").write_text(json.dumps(other))
    with pytest.raises(InputError, match="local-model"):
        LocalModel(own, "cpu")
    for name in ("config.json", "model.safetensors", "processor_config.json", "tokenizer.json"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / "tokenizer_config.json").write_bytes((folder / "tokenizer_config.json").read_bytes())
    with pytest.raises(InputError, match="no chat template"):
        LocalModel(tmp_path, "cpu")


def test_a_set_is_asked_and_scored(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_set(small_video_set(tmp_path))
    draw_films(tmp_path)
    words = ["evaluate", "risk", str(tmp_path), "--references", "majority", "--local-model", str(folder)]
    assert main([*words, "--most-tokens", "4"]) == 0
    printed = capsys.readouterr().out
    assert "tiny-1B: 12 questions, 0 of them answered before, 12 answers unreadable" in printed
    assert "s for an answer (median)" in printed
    assert any(line.split()[:2] == ["tiny-1B", "6/6"] for line in printed.splitlines())
